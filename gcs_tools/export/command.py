"""``clearway export``: a flight log as a file for other programs."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Literal

from gcs_tools.console.errors import CommandError
from gcs_tools.export.log_parts import FOXGLOVE_SUFFIX, log_parts

Form = Literal["tlog", "foxglove"]


def export(flight: Path, form: Form, output: Path | None) -> None:
    """Write a flight log in another form; print where it is.

    Args:
        flight: a file of the log, or the directory of a flight.
        form: ``tlog``, the MAVLink traffic; ``foxglove``, the records with a scene for viewers.
        output: the file; by default beside the log.

    Raises:
        CommandError: the log cannot be read or holds nothing to export, or the file cannot be
            written.
    """
    parts = log_parts(flight)
    path = output or default_output(parts[0], form)
    if any(path.resolve() == part.resolve() for part in parts):
        raise CommandError(f"{path}: is the log itself, expected another file for the export")
    if form == "tlog":
        from gcs_tools.export.tlog import write_tlog  # noqa: PLC0415

        count, problems = write_tlog(parts, path)
        what = "frames"
    else:
        from gcs_tools.export.foxglove_file import write_foxglove  # noqa: PLC0415  optional SDK

        count, problems = write_foxglove(parts, path)
        what = "records"
    for problem in problems:
        sys.stderr.write(f"note: {problem}\n")
    sys.stdout.write(f"{path}  {count} {what} from {len(parts)} file(s)\n")


def default_output(part: Path, form: Form) -> Path:
    """Return the name of an export beside its log: ``flight.tlog``, ``flight.foxglove.mcap``."""
    name = part.name.removesuffix(".mcap")
    stem, _, number = name.rpartition(".")
    log = stem if stem and number.isdecimal() else name
    return part.with_name(log + (".tlog" if form == "tlog" else FOXGLOVE_SUFFIX))
