"""Finds the files of one flight log, which goes on in a further file when one is full."""

from __future__ import annotations

import re
from collections import defaultdict
from pathlib import Path
from typing import Final

from mcap.records import Message, Metadata
from mcap.stream_reader import StreamReader

from gcs_tools.console.errors import CommandError
from gcs_tools.logs.flight_log import DAMAGED

# What `clearway export --foxglove` writes beside a log.
FOXGLOVE_SUFFIX: Final = ".foxglove.mcap"

# ``flight.mcap``, ``flight.2.mcap``, ``flight.3.mcap``.
_PART: Final = re.compile(r"(?P<log>.+?)(?:\.(?P<number>[0-9]+))?\.mcap")
_TRUTH: Final = "truth"


def log_parts(flight: Path) -> list[Path]:
    """Return the files of a flight's log in the order of writing; the first may be gone.

    Args:
        flight: a file of the log, or a directory with one log; ``flight.mcap`` in it has priority.

    Raises:
        CommandError: there is no log, or a directory holds several.
    """
    if not flight.is_dir():
        name = _log_name(flight)
        if not flight.exists():
            raise CommandError(f"{flight}: cannot be read: No such file or directory")
        siblings = _logs_in(flight.parent)[name] if name else []
        return [part for part in siblings if _same_log(part, flight)] or [flight]
    logs = _logs_in(flight)
    if not logs:
        raise CommandError(f"{flight}: no flight log in this directory, expected flight.mcap")
    if "flight" not in logs and len(logs) > 1:
        names = ", ".join(parts[0].name for parts in logs.values())
        raise CommandError(f"{flight}: holds {len(logs)} flight logs, name one of them: {names}")
    parts = logs["flight"] if "flight" in logs else next(iter(logs.values()))
    return [part for part in parts if _same_log(part, parts[0])]


def _logs_in(directory: Path) -> defaultdict[str, list[Path]]:
    """Return the parts of every log by its name, sorted."""
    numbered: defaultdict[str, list[tuple[int, Path]]] = defaultdict(list)
    for path in sorted(directory.glob("*.mcap")):
        match = _PART.fullmatch(path.name)
        if match and match["log"] != _TRUTH and not path.name.endswith(FOXGLOVE_SUFFIX):
            numbered[match["log"]].append((int(match["number"] or 1), path))
    logs: defaultdict[str, list[Path]] = defaultdict(list)
    for name, parts in numbered.items():
        logs[name] = [path for _, path in sorted(parts)]
    return logs


def _log_name(path: Path) -> str | None:
    match = _PART.fullmatch(path.name)
    return match["log"] if match else None


def _same_log(part: Path, other: Path) -> bool:
    """Tell whether two files are of one log: a name may have been used by an earlier flight."""
    return part == other or log_metadata(part).get("log_id") == log_metadata(other).get("log_id")


def log_metadata(path: Path) -> dict[str, str]:
    """Return what a log says of itself; empty if it says nothing or cannot be read."""
    try:
        with path.open("rb") as file:
            for record in StreamReader(file).records:
                if isinstance(record, Metadata) and record.name == "clearway":
                    return dict(record.metadata)
                if isinstance(record, Message):
                    break
    except (OSError, *DAMAGED):
        pass
    return {}
