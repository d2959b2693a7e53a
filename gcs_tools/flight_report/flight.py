"""Reads the logs of one flight: the daemon's, and the simulation's and the result beside it."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gcs_tools.console.errors import CommandError
from gcs_tools.logs.flight_log import Log, read_log

Document = dict[str, Any]


@dataclass(frozen=True)
class Flight:
    """The logs of one flight.

    Attributes:
        name: for the headline.
        log: the daemon's.
        truth: the simulation's; empty for a real flight.
        result: content of ``result.json`` beside the log; None without one.
    """

    name: str
    log: Log
    truth: Log
    result: Document | None


def read_flight(path: Path, watch: Callable[[int], None] = lambda _: None) -> Flight:
    """Read a flight log, and ground truth and result beside it.

    Args:
        path: the log, or the directory that `clearway fly` left.
        watch: receives the number of bytes of `logs_of` read so far, now and then.

    Raises:
        CommandError: the log has no flight.
    """
    path, *beside = logs_of(path)
    log = read_log(path, watch)
    if not log.states:
        began = "clearway" in log.metadata
        reason = "nothing was recorded" if began else "it is not a log of Clearway"
        raise CommandError(f"{path}: has no flight: {reason}")
    if beside:
        before = path.stat().st_size
        truth = _ground_truth(beside[0], lambda read: watch(before + read))
    else:
        truth = Log(truths=log.truths, true_movers=log.true_movers)
    name = path.resolve().parent.name if path.name == "flight.mcap" else path.stem
    return Flight(name, log, truth, _written_result(path.with_name("result.json"), log))


def logs_of(path: Path) -> list[Path]:
    """Return the flight log at a path, and the simulation's log beside it, if there is one."""
    log = path / "flight.mcap" if path.is_dir() else path
    truth = log.with_name("truth.mcap")
    return [log, truth] if log.name == "flight.mcap" and truth.exists() else [log]


def _ground_truth(path: Path, watch: Callable[[int], None]) -> Log:
    """Read the simulation's log; a damaged one becomes a problem of the report, not an error."""
    try:
        return read_log(path, watch)
    except CommandError as error:
        return Log(complete=False, problems=(str(error),))


def _written_result(path: Path, log: Log) -> Document | None:
    """Read this flight's result, which has what the log lacks, such as why it was aborted."""
    try:
        written = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    flown = log.metadata.get("clearway", {}).get("contract_sha256")
    return (
        written if isinstance(written, dict) and written.get("contract_sha256") == flown else None
    )
