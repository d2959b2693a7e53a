"""Write docs/traceability.md: ``python -m tests.tools.traceability [--figures DIRECTORY ...]``.

With ``--figures`` it first counts what campaigns show of each assumption, from the
``flights.parquet`` in their directories, and states it in docs/data/campaign_figures.csv.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from tests.tools.traceability.figures import write_figures
from tests.tools.traceability.page import PAGE, page


def main() -> int:
    """Parse arguments and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--figures", type=Path, nargs="+", metavar="DIRECTORY")
    options = parser.parse_args()
    if options.figures:
        write_figures(options.figures)
    PAGE.write_text(page(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
