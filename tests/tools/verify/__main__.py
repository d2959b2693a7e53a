"""All long shows, one after another: ``make verify [QUICK=1] [DATA=FOLDER] [JOBS=N]``.

Flies the campaigns and the benchmarks, measures speed, mutates what the guarantee rests on, counts
the figures of traceability, and writes ``summary.md`` with commit, commands, figures and durations
below ``build/verify``.  Exits with 1 if a margin is negative, a flight that promises none has a
collision, an oracle or a test has a finding, or a limit is missed.  Hours on two cores; what was
interrupted goes on where it stopped, on the same commit.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from tests.tools.verify.plan import ROOT, Request, plan
from tests.tools.verify.running import read_records, run_steps, summary


def main(arguments: Sequence[str] | None = None) -> int:
    """Parse arguments and run."""
    parser = argparse.ArgumentParser(prog="verify", description=__doc__)
    parser.add_argument("--short", action="store_true", help="minutes: shows that it runs")
    parser.add_argument("--data", type=Path, metavar="FOLDER", help="scenes of the benchmarks")
    parser.add_argument("--jobs", type=int, metavar="N", help="processes; default: all cores")
    parser.add_argument("--only", nargs="+", metavar="STEP", help="these steps only")
    parser.add_argument("--out", type=Path, metavar="FOLDER", help="default: build/verify")
    options = parser.parse_args(arguments)
    if options.data is not None and not options.data.is_dir():
        parser.error(f"--data {options.data}: expected a folder")
    if options.jobs is not None and options.jobs < 1:
        parser.error(f"--jobs {options.jobs}: expected at least 1")
    folder = options.out or Path("build") / ("verify-short" if options.short else "verify")
    steps = plan(Request(folder, options.short, options.data, options.jobs))
    if unknown := set(options.only or ()) - {step.name for step in steps}:
        names = ", ".join(step.name for step in steps)
        parser.error(f"--only {min(unknown)}: expected some of {names}")
    chosen = [step for step in steps if not options.only or step.name in options.only]
    commit = _commit()
    os.chdir(ROOT)
    run_steps(chosen, folder, commit, _run, _tell)
    # Of the whole plan, what has been run on this commit, now or before.
    known = read_records(folder)
    tried = [step.name for step in steps if step.name in known]
    records = {name: known[name] for name in tried if known[name].commit == commit}
    path = folder / "summary.md"
    path.write_text(summary(records, commit, short=options.short), encoding="utf-8")
    _tell(f"summary: {path}")
    return 1 if any(record.problems for record in records.values()) else 0


def _commit() -> str:
    """Return the commit that is checked out, and what identifies changes to it."""
    name, changes = (
        subprocess.run(
            ["git", *words],  # noqa: S607  the user's own
            cwd=ROOT,
            capture_output=True,
            check=True,
        ).stdout.strip()
        for words in (("rev-parse", "--short", "HEAD"), ("diff", "HEAD"))
    )
    changed = f" with changes {hashlib.sha256(changes).hexdigest()[:8]}" if changes else ""
    return name.decode() + changed


def _run(command: Sequence[str], log: Path) -> tuple[int, float]:
    programs = {"clearway": [sys.executable, "-m", "gcs_tools"], "python": [sys.executable]}
    began_s = time.monotonic()
    with log.open("w", encoding="utf-8") as stream:
        ran = subprocess.run(
            [*programs[command[0]], *command[1:]], stdout=stream, stderr=stream, check=False
        )
    return ran.returncode, time.monotonic() - began_s


def _tell(line: str) -> None:
    sys.stderr.write(f"{line}\n")
    sys.stderr.flush()


if __name__ == "__main__":
    sys.exit(main())
