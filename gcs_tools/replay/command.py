"""``clearway replay``: print what the daemon sees of a recording; optionally keep it."""

from __future__ import annotations

import contextlib
import json
import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

from gcs_tools.console.errors import CommandError
from gcs_tools.replay.field_file import write_field
from gcs_tools.replay.recording import Recording, open_recording
from gcs_tools.replay.run import Replay, Seen, Summary, first_stamp_ahead_s
from gcs_tools.replay.sources import Setup, setup_of
from onboard.files.sensor_sources import Ros2Source
from onboard.recording.flight_log import FlightLog
from onboard.recording.messages import Record

Form = Literal["text", "json"]
_LOG: Final = ".mcap"
_HINTS: Final = {
    "no pose at its stamp": " (stamps of another clock: --align-clock; poses too rare: --pose none)"
}
_FIELDS: Final = (".yaml", ".csv")


@dataclass(frozen=True)
class ReplayRequest:
    """What to replay; see `gcs_tools.replay.arguments`."""

    recording: Path
    daemon_config: Path | None = None
    range_m: float = 10.0
    pose_topic: str | None = None
    align_clock: bool = False
    output: Path | None = None


def replay(request: ReplayRequest, *, form: Form) -> bool:
    """Replay a recording, and print what was seen.

    Returns:
        Whether every sensor yielded frames.

    Raises:
        FileError: a file of the daemon cannot be used.
        CommandError: the recording cannot be read, or the output cannot be written.
    """
    output = request.output
    if output is not None and output.suffix not in {_LOG, *_FIELDS}:
        raise CommandError(f"{output}: expected a name that ends in {_LOG}, .yaml or .csv")
    recording = open_recording(request.recording)
    setup = setup_of(recording.topics, request.daemon_config, request.range_m, request.pose_topic)
    summary = _run(recording, setup, request)
    if output is not None and output.suffix != _LOG:
        write_field(summary.obstacles, output)
    if form == "json":
        sys.stdout.write(json.dumps(_document(recording, setup, summary), indent=2) + "\n")
    else:
        for line in _lines(recording, setup, summary):
            sys.stdout.write(f"{line}\n")
    return all(seen.frames for seen in summary.sensors.values())


def _run(recording: Recording, setup: Setup, request: ReplayRequest) -> Summary:
    first = next(iter(recording.messages()), None)
    recording.problems.clear()
    if first is None:
        raise CommandError(f"{recording.path}: has no message that can be read")
    ahead_s = 0.0
    if request.align_clock:
        topics = [
            f"/{each.topic.strip('/')}" for each in setup.sources if isinstance(each, Ros2Source)
        ]
        ahead_s = first_stamp_ahead_s(recording.messages(), topics)
    try:
        with contextlib.ExitStack() as stack:
            log = None
            if request.output is not None and request.output.suffix == _LOG:
                if request.output.resolve() in {part.resolve() for part in recording.parts}:
                    raise CommandError(f"{request.output}: would overwrite the recording")
                metadata = {
                    "contract": setup.contract.model_dump_json(),
                    "contract_sha256": setup.contract.sha256,
                    "mission": setup.mission.model_dump_json(),
                    "replay_of": recording.path.name,
                }
                log = stack.enter_context(FlightLog(request.output, metadata))

            def take(records: list[Record]) -> None:
                if log is not None:
                    log.write(records)

            return Replay(setup, first.time_unix_s, ahead_s, take).run(recording.messages())
    except OSError as error:
        raise CommandError(
            f"{request.output}: cannot be written: {error.strerror or error}"
        ) from error


def _lines(recording: Recording, setup: Setup, summary: Summary) -> Iterator[str]:
    yield f"{recording.path}: {summary.duration_s:.1f} s, {len(recording.topics)} topics"
    pose = (
        "at rest, level" if setup.pose_topic is None else f"{summary.poses} of {setup.pose_topic}"
    )
    yield f"{'poses':<10} {pose}"
    for reason, count in summary.poses_refused.most_common():
        yield f"{'':<10} {count} dropped: {reason}"
    for name, seen in summary.sensors.items():
        yield f"{name:<10} {seen.messages} messages, {seen.rate_hz:.1f} Hz, {seen.frames} frames"
        for line in _facts(seen):
            yield f"{'':<10} {line}"
    known = 0 if summary.obstacles is None else len(summary.obstacles.obstacles)
    yield f"{'map':<10} {known} obstacles at the end"
    yield from (f"{'problem':<10} {each}" for each in recording.problems)


def _facts(seen: Seen) -> Iterator[str]:
    if seen.frames:
        yield (
            f"{seen.obstacles_min} to {seen.obstacles_max} obstacles a frame, "
            f"range {seen.range_min_m:.1f} m, view {seen.view_min_deg:.0f}°, "
            f"read up to {seen.latency_max_s:.3f} s after the stamp"
        )
    for reason, count in seen.refused.most_common():
        yield f"{count} dropped: {reason}{_HINTS.get(reason, '')}"
    for violation in seen.violations.values():
        yield f"violates the contract: {violation}"


def _document(recording: Recording, setup: Setup, summary: Summary) -> dict[str, Any]:
    sensors = {}
    for name, seen in summary.sensors.items():
        sensors[name] = {
            "messages": seen.messages,
            "rate_hz": seen.rate_hz,
            "frames": seen.frames,
            "obstacles_min": seen.obstacles_min,
            "obstacles_max": seen.obstacles_max,
            "range_min_m": _finite(seen.range_min_m),
            "field_of_view_min_deg": _finite(seen.view_min_deg),
            "latency_max_s": _finite(seen.latency_max_s),
            "refused": dict(seen.refused),
            "violations": list(seen.violations.values()),
        }
    return {
        "recording": str(recording.path),
        "duration_s": summary.duration_s,
        "topics": recording.topics,
        "pose_topic": setup.pose_topic,
        "poses": summary.poses,
        "poses_refused": dict(summary.poses_refused),
        "sensors": sensors,
        "obstacles": 0 if summary.obstacles is None else len(summary.obstacles.obstacles),
        "problems": recording.problems,
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
