"""Write docs/traceability.md: ``python -m tests.tools.traceability [--figures DIRECTORY ...]``.

With ``--figures`` it first counts what campaigns show of each assumption, from the
``flights.parquet`` in their directories, and states it in docs/data/campaign_figures.csv.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from gcs_tools.console.errors import CommandError
from tests.tools.traceability.figures import STATED, stated_figures, write_figures
from tests.tools.traceability.page import PAGE, page


def main(arguments: Sequence[str] | None = None) -> int:
    """Parse arguments and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--figures", type=Path, nargs="+", metavar="DIRECTORY")
    parser.add_argument("--add", action="store_true", help="keep the figures of other campaigns")
    parser.add_argument(
        "--output", type=Path, metavar="FOLDER", help="write both there, not into the docs"
    )
    options = parser.parse_args(arguments)
    folder = options.output
    stated = STATED if folder is None else folder / STATED.name
    if options.figures:
        kept = stated_figures() if options.add else ()
        try:
            write_figures(options.figures, stated, kept)
        except CommandError as error:
            sys.stderr.write(f"traceability: error: {error}\n")
            return 2
    figures = stated_figures(stated if options.figures else STATED)
    place = PAGE if folder is None else folder / PAGE.name
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_text(page(figures), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
