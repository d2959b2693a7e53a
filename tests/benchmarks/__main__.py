"""The benchmarks: ``make bench [ONLY=name]`` prints a table and writes ``build/bench.json``.

It exits with 1 if a figure misses its limit.  ``--page`` writes the table into a page, too.

Every ``bench_*.py`` beside the tests is read; each function ``bench_NAME`` in it measures one
thing, with a peer wherever there is one to be had, in the same run and on the same machine.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

from rich.console import Console
from rich.table import Table

from tests.benchmarks.measurement import Measurement, Scale
from tests.benchmarks.page import rows, write_table

HERE = Path(__file__).parent
PREFIX = "bench_"

Benchmark = Callable[[], Measurement]


def collect() -> Iterator[tuple[str, Benchmark]]:
    """Yield every benchmark by its name."""
    for path in sorted(HERE.rglob(f"{PREFIX}*.py")):
        spec = importlib.util.spec_from_file_location(path.stem, path)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[path.stem] = module  # dataclasses look up their module
        spec.loader.exec_module(module)
        if Scale.small and getattr(module, "LIVE", False):
            continue
        for name, function in vars(module).items():
            if name.startswith(PREFIX):
                yield name.removeprefix(PREFIX), function


def main() -> int:
    """Run the requested benchmarks; return 1 if one misses its limit, 2 if there are none."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", metavar="NAME", help="benchmarks whose name contains this")
    parser.add_argument("--output", type=Path, default=Path("build/bench.json"))
    parser.add_argument("--page", type=Path, help="page that has the table, to bring up to date")
    parser.add_argument("--small", action="store_true", help="only check that they run")
    options = parser.parse_args()
    Scale.small = options.small
    chosen = {name: run for name, run in collect() if (options.only or "") in name}
    if not chosen:
        sys.stderr.write(f"bench: error: no benchmark is called {options.only!r}\n")
        return 2
    measured = {}
    for name, run in chosen.items():
        sys.stderr.write(f"{name} ...\n")
        measured[name] = run()
    _print(measured)
    options.output.parent.mkdir(parents=True, exist_ok=True)
    document = {name: measurement.document() for name, measurement in measured.items()}
    options.output.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")
    if options.page is not None:
        write_table(options.page, measured)
    missed = [name for name, measurement in measured.items() if measurement.passes is False]
    if not missed or options.small:
        return 0
    sys.stderr.write(f"bench: missed their limits: {', '.join(missed)}\n")
    return 1


def _print(measured: dict[str, Measurement]) -> None:
    header, *lines = rows(measured)
    table = Table(*header)
    for line in lines:
        table.add_row(*line)
    Console(highlight=False).print(table)


if __name__ == "__main__":
    sys.exit(main())
