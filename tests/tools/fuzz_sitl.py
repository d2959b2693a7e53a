"""``python -m tests.tools.fuzz_sitl [--runs N]``: fuzz the simulator's MAVLink by coverage.

What is fuzzed, and what must not happen, is in ``tests.tools.fuzz_target``.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import atheris

from sitl.vehicle.vehicle import warm_up

# Numba cannot compile instrumented code: import and compile the plant before.
_COMPILED = {
    "sitl.plant.controller",
    "sitl.plant.inner_loop",
    "sitl.plant.jit",
    "sitl.plant.multirotor",
}
warm_up()
for _name in [name for name in sys.modules if name.startswith("sitl.")]:
    if _name not in _COMPILED:
        del sys.modules[_name]
with atheris.instrument_imports(include=["sitl"]):
    from tests.tools import fuzz_target


def main() -> None:
    """Fuzz until the number of runs is reached or an input fails."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=1_000_000)
    parser.add_argument("--corpus", type=Path, help="kept and extended; a new one by default")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        corpus = options.corpus or Path(scratch)
        corpus.mkdir(parents=True, exist_ok=True)
        for number, seed in enumerate(fuzz_target.seeds()):
            (corpus / f"seed-{number}").write_bytes(seed)
        target = fuzz_target.Target()
        arguments = [f"-runs={options.runs}", "-max_len=600", "-print_final_stats=1"]
        arguments += [f"-artifact_prefix={corpus}/", str(corpus)]
        atheris.Setup([sys.argv[0], *arguments], target.feed)
        atheris.Fuzz()


if __name__ == "__main__":
    main()
