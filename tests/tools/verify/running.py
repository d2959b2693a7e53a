"""Runs the steps one after another, keeps what each found, and goes on where it stopped."""

from __future__ import annotations

import json
import shlex
import shutil
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Final

from gcs_tools.console.errors import CommandError
from tests.tools.verify.judging import SAYS_NO
from tests.tools.verify.plan import Step

_RECORDS: Final = "records.json"


@dataclass(frozen=True)
class Record:
    """What became of a step.

    Attributes:
        command, commit: what was run, of what.
        code: its exit code.
        duration_s: how long it took, the last time that it was started.
        figures, problems: as `Findings`.
        skipped: why it was not run; empty if it was.
    """

    command: str
    commit: str
    code: int
    duration_s: float
    figures: dict[str, str] = field(default_factory=dict)
    problems: tuple[str, ...] = ()
    skipped: str = ""

    @property
    def finished(self) -> bool:
        """Whether it came to a verdict, so that it need not be run again."""
        return self.code in (0, SAYS_NO) and not self.skipped


# Runs words, appends what they print to a log; returns exit code and duration [s].
Runner = Callable[[Sequence[str], Path], tuple[int, float]]


def run_steps(
    steps: Sequence[Step], folder: Path, commit: str, run: Runner, told: Callable[[str], None]
) -> dict[str, Record]:
    """Run the steps that have no verdict on this commit yet; return the records of all.

    Args:
        steps: in order.
        folder: of results and records.
        commit: that is verified.
        run: runs a command.
        told: receives a line at the begin and the end of each step.
    """
    before = read_records(folder)
    records: dict[str, Record] = {}
    for step in steps:
        known, command = before.get(step.name), shlex.join(step.command)
        if (
            known is not None
            and known.finished
            and (known.command, known.commit)
            == (
                command,
                commit,
            )
        ):
            told(f"{step.name}: has been run on this commit")
            records[step.name] = known
            continue
        if step.skipped:
            told(f"{step.name}: skipped: {step.skipped}")
            records[step.name] = Record(command, commit, 0, 0.0, skipped=step.skipped)
        else:
            told(f"{step.name}: {command}")
            records[step.name] = _run(step, folder, commit, run)
            told(f"{step.name}: {'; '.join(records[step.name].problems) or 'good'}")
        # Another run may have added to them meanwhile.
        write_records({**read_records(folder), **records}, folder)
    return records


def _run(step: Step, folder: Path, commit: str, run: Runner) -> Record:
    place, command = folder / step.name, shlex.join(step.command)
    _cleared(place, f"{commit}\n{command}\n")
    log = place / "printed.log"
    code, duration_s = run(step.command, log)
    if code not in (0, SAYS_NO):
        problem = f"ended with exit code {code}; see {log}"
        return Record(command, commit, code, duration_s, problems=(problem,))
    try:
        printed = log.read_text(encoding="utf-8") if log.exists() else ""
        found = step.judge(place, printed)
    except (CommandError, OSError, ValueError, KeyError) as error:
        problem = f"left nothing that can be judged: {error}"
        return Record(command, commit, code, duration_s, problems=(problem,))
    problems = found.problems
    if code == SAYS_NO and not problems:
        problems = (f"said no (exit code 1); see {log}",)
    return Record(command, commit, code, duration_s, found.figures, problems)


def _cleared(place: Path, of: str) -> None:
    """Make the folder of a step; what another commit or command has left there is not evidence."""
    mark = place / "of.txt"
    if place.exists() and (not mark.exists() or mark.read_text(encoding="utf-8") != of):
        shutil.rmtree(place)
    place.mkdir(parents=True, exist_ok=True)
    mark.write_text(of, encoding="utf-8")


def read_records(folder: Path) -> dict[str, Record]:
    """Return what was run before, by the name of the step."""
    path = folder / _RECORDS
    if not path.exists():
        return {}
    found = json.loads(path.read_text(encoding="utf-8"))
    return {
        name: Record(**{**each, "problems": tuple(each["problems"])})
        for name, each in found.items()
    }


def write_records(records: dict[str, Record], folder: Path) -> None:
    """Keep what was run."""
    folder.mkdir(parents=True, exist_ok=True)
    document = {name: asdict(record) for name, record in records.items()}
    text = json.dumps(document, indent=2, ensure_ascii=False)
    (folder / _RECORDS).write_text(text + "\n", encoding="utf-8")


def summary(records: dict[str, Record], commit: str, *, short: bool) -> str:
    """Return the summary of all steps, in Markdown."""
    bad = {name: record for name, record in records.items() if record.problems}
    form = "short form, which bounds nothing" if short else "full form"
    lines = [
        "# Verification",
        "",
        f"Commit {commit}; {form}. "
        + (f"**{len(bad)} of {len(records)} steps found a problem.**" if bad else "No problem."),
        "",
        "| step | verdict | figures | took |",
        "| --- | --- | --- | --- |",
    ]
    for name, record in records.items():
        verdict = f"skipped: {record.skipped}" if record.skipped else "good"
        verdict = "**" + "; ".join(record.problems) + "**" if record.problems else verdict
        figures = "; ".join(f"{what}: {value}" for what, value in record.figures.items())
        lines.append(f"| {name} | {verdict} | {figures} | {_duration(record.duration_s)} |")
    commands = (record.command for record in records.values() if not record.skipped)
    lines += ["", "```sh", *commands, "```", ""]
    return "\n".join(lines)


def _duration(duration_s: float) -> str:
    minutes, seconds = divmod(round(duration_s), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {seconds} s"
