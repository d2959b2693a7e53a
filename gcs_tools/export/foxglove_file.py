"""Writes a flight log as an MCAP file with the scene that Foxglove and Lichtblick draw."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from foxglove import Context, open_mcap
from pydantic import ValidationError

from gcs_tools.console.errors import CommandError
from gcs_tools.export.foxglove_channels import foxglove_channels
from gcs_tools.export.scene import Scene
from gcs_tools.logs.flight_log import Log, read_log
from onboard.files.mission_file import Mission


def write_foxglove(parts: Sequence[Path], path: Path) -> tuple[int, list[str]]:
    """Write the records of a log and the scene drawn from them.

    Args:
        parts: files of one log, in order.
        path: the file, overwritten.

    Returns:
        How many records were exported, and what could not be read.

    Raises:
        CommandError: a part cannot be read, the log has no flight in it, or the file cannot be
            written.
    """
    logs = [read_log(part) for part in parts]
    if not any(log.states for log in logs):
        raise CommandError(f"{parts[0]}: there is no flight in it, expected records of /state")
    context, count = Context(), 0
    try:
        with (
            path.open("wb") as file,
            open_mcap(file, context=context) as writer,
            foxglove_channels(context, Scene(_mission_height_m(logs[0]))) as channels,
        ):
            for log in logs:
                for record in log.in_order():
                    channels.send(record)
                    count += 1
            for name, values in logs[0].metadata.items():
                writer.write_metadata(name, dict(values))
    except OSError as error:
        raise CommandError(f"{path}: cannot be written: {error.strerror or error}") from error
    return count, [problem for log in logs for problem in log.problems]


def _mission_height_m(log: Log) -> float | None:
    text = log.metadata.get("clearway", {}).get("mission", "")
    try:
        return Mission.model_validate_json(text).altitude_m
    except ValidationError:
        return None
