"""Reads ArduPilot's own logs: binary DataFlash (``.BIN``)."""

from __future__ import annotations

import contextlib
import io
import math
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

from pymavlink import DFReader

from gcs_tools.console.errors import CommandError
from gcs_tools.identify.streams import Streams, Timeline, in_order, reference_in_order
from onboard.mavlink.profiles.ardupilot import ARDUPILOT

BINARY_MAGIC: Final = b"\xa3\x95\x80"
# The sub-mode of GUIDED that follows position, velocity and acceleration.
_POS_VEL_ACCEL: Final = 3
_UNKNOWN: Final = float("nan")
_AXES: Final = ("PSCN", "PSCE", "PSCD")


def streams_of_dataflash(path: Path) -> Streams:
    """Return the time series of a flight in GUIDED.

    The position controller logs each axis in a message of its own, all three at the same time.

    Raises:
        CommandError: the log is damaged, or lacks a measured quantity.
    """
    timeline = Timeline()
    rows: defaultdict[str, list[tuple[float, ...]]] = defaultdict(list)
    axes: dict[str, tuple[float, float]] = {}
    for message in _messages(path):
        kind, time_s = message.get_type(), timeline.at(message.TimeUS * 1e-6)
        if kind in _AXES:
            axes[kind] = _AXIS[kind](message)
            if kind == _AXES[-1] and len(axes) == len(_AXES):
                positions_m, velocities_mps = zip(*(axes.pop(axis) for axis in _AXES), strict=True)
                rows["PSC"].append((time_s, *positions_m, *velocities_mps))
        else:
            row = _ROWS[kind](message)
            if row is not None:
                rows[kind].append((time_s, *row))
    return Streams(
        source=str(path),
        pose=in_order(rows["PSC"], 6),
        reference=reference_in_order(rows["GUIP"]),
        attitude=in_order(rows["ATT"], 3),
        control=in_order(rows["MODE"], 1),
        names=(
            "PSCN, PSCE and PSCD",
            "GUIP of position, velocity and acceleration",
            "ATT",
            "MODE",
        ),
        notes=("DataFlash logs do not have the commanded heading",),
    )


def _messages(path: Path) -> Iterator[Any]:
    """Yield the messages to read, in the order of the file, up to where it breaks off.

    Raises:
        CommandError: the file is too damaged to be read.
    """
    wanted = [*_AXES, *_ROWS]
    # Constructed in two steps, to close the file even if the reader fails at once.
    log = DFReader.DFReader_binary.__new__(DFReader.DFReader_binary)
    # The reader reports every damaged byte on standard error.
    with contextlib.redirect_stderr(io.StringIO()):
        try:
            log.__init__(str(path))
            while (message := log.recv_match(type=wanted)) is not None:
                # Records have no checksum: accept one if another follows it.
                if log.data_map[log.offset : log.offset + 2] in (BINARY_MAGIC[:2], b""):
                    yield message
        except Exception as error:  # the reader raises anything on damaged files
            raise CommandError(f"{path}: damaged DataFlash log: {error}") from error
        finally:
            for handle in ("data_map", "filehandle"):
                if hasattr(log, handle):
                    getattr(log, handle).close()


def _reference_row(m: Any) -> tuple[float, ...] | None:
    """Return the target of GUIDED in NED and metres; the log has z up.

    Before Copter 4.7 the numbers are centimetres, as the log's own units say.
    """
    if m.Type != _POS_VEL_ACCEL:
        return None
    scale = 0.01 if m.fmt.get_unit("pX") == "cm" else 1.0
    values = (m.pX, m.pY, -m.pZ, m.vX, m.vY, -m.vZ, m.aX, m.aY, -m.aZ)
    return (*(scale * value for value in values), _UNKNOWN)


def _attitude_row(m: Any) -> tuple[float, ...] | None:
    return math.radians(m.Roll), math.radians(m.Pitch), math.radians(m.Yaw)


def _mode_row(m: Any) -> tuple[float, ...] | None:
    return (float(ARDUPILOT.modes.is_external_control(m.ModeNum)),)


_AXIS: Final[dict[str, Callable[[Any], tuple[float, float]]]] = {
    "PSCN": lambda m: (m.PN, m.VN),
    "PSCE": lambda m: (m.PE, m.VE),
    "PSCD": lambda m: (m.PD, m.VD),
}
_ROWS: Final[dict[str, Callable[[Any], tuple[float, ...] | None]]] = {
    "GUIP": _reference_row,
    "ATT": _attitude_row,
    "MODE": _mode_row,
}
