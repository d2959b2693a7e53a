"""What breaks drones, as seeded faults of a flight in virtual time.

A fault has a kind, a window and an amount.  Its window counts from the start of the simulation or
from the n-th time that the onboard service enters a phase, so that faults can be put exactly on the
transitions of the induction automaton.
"""

from __future__ import annotations

import json
import math
import random
from collections import deque
from collections.abc import Callable
from typing import Annotated, Any, Final, Literal, NamedTuple

from pydantic import Field
from pymavlink.dialects.v20 import common as mavlink

from onboard.yaml_file import FileModel

DetectionKind = Literal[
    "detections_off",
    "detections_stuck",
    "detections_garbage",
    "detections_nan",
    "detections_late",
    "detections_intermittent",
    "detections_slow",
    "detections_short_range",
    "detections_narrow_view",
    "detections_uncertain",
    "detections_shifted",
    "detections_oversized",
    "detections_wrong_units",
    "detections_ghost",
    "detections_renamed",
    "detections_hidden",
    "sensor_clock_ahead",
]
SystemKind = Literal[
    "telemetry_lost",
    "telemetry_corrupted",
    "setpoints_lost",
    "position_reset",
    "attitude_stuck",
    "second_commander",
    "tick_stall",
    "daemon_dead",
    "operator_takes_over",
]
FaultKind = Literal[DetectionKind, SystemKind]

# What each kind's amount means, and what it is unless a scenario says otherwise.
AMOUNTS: Final[dict[str, tuple[float, str]]] = {
    "detections_late": (0.25, "seconds of delay"),
    "detections_intermittent": (0.5, "share of frames that are lost"),
    "detections_slow": (4.0, "frames of which one arrives"),
    "detections_short_range": (5.0, "metres of range, declared"),
    "detections_narrow_view": (60.0, "degrees of view, declared"),
    "detections_uncertain": (0.15, "metres of uncertainty, declared"),
    "detections_shifted": (0.03, "metres by which boxes are wrong, undeclared"),
    "detections_oversized": (3.0, "factor on the size of boxes"),
    "detections_wrong_units": (0.001, "factor on all lengths: metres reported as millimetres"),
    "detections_ghost": (9.0, "metres ahead at which something that is not there is seen"),
    "detections_hidden": (6.0, "metres within which obstacles are first reported, undeclared"),
    "sensor_clock_ahead": (5.0, "seconds"),
    "telemetry_corrupted": (0.2, "share of datagrams of which one byte changes"),
    "position_reset": (3.0, "metres to the east"),
}


class Fault(FileModel):
    """One fault.

    Attributes:
        kind: what happens; ``AMOUNTS`` says what ``amount`` means for it.
        start_s: begins this long after the simulation, or after the phase, began.
        duration_s: and lasts this long; for ever when null.
        phase: count from the service's entry into this phase instead.
        entry: from which entry into it, the first being 1.
        amount: how bad; null for the kind's own default.
    """

    kind: FaultKind
    start_s: Annotated[float, Field(ge=0.0)] = 0.0
    duration_s: Annotated[float, Field(gt=0.0)] | None = None
    phase: Literal["cruise", "avoid", "arrived", "hold"] | None = None
    entry: Annotated[int, Field(ge=1)] = 1
    amount: float | None = None

    @property
    def value(self) -> float:
        """The amount, or the kind's own."""
        return AMOUNTS.get(self.kind, (0.0, ""))[0] if self.amount is None else self.amount


class FaultInjector:
    """Applies the faults of one flight to what passes between its parts.

    Args:
        faults: what goes wrong.
        seed: of every random choice.
    """

    def __init__(self, faults: tuple[Fault, ...], seed: int) -> None:
        self._faults = faults
        self._random = random.Random(f"faults {seed}")
        self._phase = ""
        self._entered_s: dict[tuple[str, int], float] = {}
        self._entries: dict[str, int] = {}
        self._active: dict[str, Fault] = {}
        self._stuck: bytes | None = None
        self._frames = 0
        self._delayed: deque[tuple[float, bytes]] = deque()
        self._codec = _Codec()

    def advance(self, now_s: float, phase: str) -> None:
        """Take note of the time and of the service's phase: which faults are present now?"""
        if phase != self._phase:
            self._phase = phase
            self._entries[phase] = self._entries.get(phase, 0) + 1
            self._entered_s[phase, self._entries[phase]] = now_s
        self._active = {fault.kind: fault for fault in self._faults if self._present(fault, now_s)}

    def _present(self, fault: Fault, now_s: float) -> bool:
        origin_s = 0.0 if fault.phase is None else self._entered_s.get((fault.phase, fault.entry))
        if origin_s is None:
            return False
        age_s = now_s - origin_s - fault.start_s
        return age_s >= 0.0 and (fault.duration_s is None or age_s < fault.duration_s)

    # ------------------------------------------------------------------ detections

    def detections(
        self, payloads: list[bytes], now_s: float, position_ned_m: tuple[float, float, float]
    ) -> list[bytes]:
        """Return the frames that reach the service now; the position is the vehicle's."""
        arriving = [f for payload in payloads for f in self._spoilt(payload, position_ned_m)]
        late = self._active.get("detections_late")
        if late is None and not self._delayed:
            return arriving
        delay_s = 0.0 if late is None else late.value
        self._delayed.extend((now_s + delay_s, frame) for frame in arriving)
        due = []
        while self._delayed and self._delayed[0][0] <= now_s + 1e-9:
            due.append(self._delayed.popleft()[1])
        return due

    def _spoilt(self, payload: bytes, position_ned_m: tuple[float, float, float]) -> list[bytes]:
        active, self._frames = self._active, self._frames + 1
        if "detections_stuck" in active:
            self._stuck = self._stuck or payload
            return [self._stuck]
        self._stuck = None
        if "detections_off" in active or self._is_lost():
            return []
        if "detections_garbage" in active:
            return [self._random.randbytes(self._random.randrange(400))]
        if "detections_nan" in active:
            return [payload.replace(b'"range_m":', b'"range_m":NaN,"was":', 1)]
        edits = [(EDITS[kind], fault) for kind, fault in active.items() if kind in EDITS]
        if not edits:
            return [payload]
        frame: dict[str, Any] = json.loads(payload)
        for edit, fault in edits:
            edit(frame, fault.value, Look(self._frames, position_ned_m[0], position_ned_m[1]))
        return [json.dumps(frame).encode()]

    def _is_lost(self) -> bool:
        intermittent = self._active.get("detections_intermittent")
        if intermittent is not None and self._random.random() < intermittent.value:
            return True
        slow = self._active.get("detections_slow")
        return slow is not None and self._frames % int(slow.value) != 0

    # ------------------------------------------------------------------ MAVLink

    def telemetry(self, data: bytes) -> bytes:
        """Return what the service hears of what the vehicle sent."""
        if "telemetry_lost" in self._active:
            return b""
        corrupted = self._active.get("telemetry_corrupted")
        if corrupted is not None and data and self._random.random() < corrupted.value:
            spoilt = bytearray(data)
            spoilt[self._random.randrange(len(spoilt))] ^= 1 << self._random.randrange(8)
            data = bytes(spoilt)
        reset = self._active.get("position_reset")
        level = "attitude_stuck" in self._active
        if reset is None and not level:
            return data
        return self._codec.edited(data, 0.0 if reset is None else reset.value, level=level)

    def setpoints(self, data: bytes) -> bytes:
        """Return what the vehicle hears of what the service sent."""
        return b"" if "setpoints_lost" in self._active else data

    def rival(self) -> bytes:
        """Return what somebody else sends to the vehicle."""
        return self._codec.go_elsewhere() if "second_commander" in self._active else b""

    # ------------------------------------------------------------------ process, operator

    def present(self, kind: FaultKind) -> bool:
        """Tell whether a fault of this kind is present."""
        return kind in self._active


class Look(NamedTuple):
    """Which frame it is, and from where it was taken."""

    number: int
    north_m: float
    east_m: float


Edit = Callable[[dict[str, Any], float, Look], None]


def _shorten_range(frame: dict[str, Any], range_m: float, look: Look) -> None:
    frame["range_m"] = min(frame["range_m"], range_m)
    _hide(frame, range_m, look)


def _hide(frame: dict[str, Any], range_m: float, look: Look) -> None:
    at = (0.0, 0.0) if frame["frame"] == "body_frd" else (look.north_m, look.east_m)
    frame["obstacles"] = [
        obstacle
        for obstacle in frame["obstacles"]
        if math.dist(obstacle["center_m"], at) - math.hypot(*obstacle["size_m"]) / 2.0 <= range_m
    ]


def _narrow_view(frame: dict[str, Any], view_deg: float, _: Look) -> None:
    frame["field_of_view_deg"] = min(frame["field_of_view_deg"], view_deg)


def _doubt(frame: dict[str, Any], uncertainty_m: float, _: Look) -> None:
    for obstacle in frame["obstacles"]:
        obstacle["uncertainty_m"] = uncertainty_m


def _shift(frame: dict[str, Any], shift_m: float, look: Look) -> None:
    for obstacle in frame["obstacles"]:
        obstacle["center_m"][1] += shift_m * (-1) ** look.number


def _oversize(frame: dict[str, Any], factor: float, _: Look) -> None:
    for obstacle in frame["obstacles"]:
        obstacle["size_m"] = [size_m * factor for size_m in obstacle["size_m"]]


def _change_units(frame: dict[str, Any], factor: float, _: Look) -> None:
    frame["range_m"] *= factor
    for obstacle in frame["obstacles"]:
        for key in ("center_m", "size_m"):
            obstacle[key] = [length_m * factor for length_m in obstacle[key]]


def _add_ghost(frame: dict[str, Any], ahead_m: float, look: Look) -> None:
    body = frame["frame"] == "body_frd"
    here = {"center_m": [ahead_m, 0.0] if body else [look.north_m + ahead_m, look.east_m]}
    looks = {"size_m": [1.0, 1.0], "yaw_deg": 0.0, "uncertainty_m": 0.0}
    frame["obstacles"].append({"id": f"ghost-{look.number}", **here, **looks})


def _rename(frame: dict[str, Any], _: float, look: Look) -> None:
    for obstacle in frame["obstacles"]:
        obstacle["id"] = f"{obstacle['id']}-{look.number // 5}"


def _set_clock_ahead(frame: dict[str, Any], ahead_s: float, _: Look) -> None:
    frame["stamp_unix_s"] += ahead_s


EDITS: Final[dict[str, Edit]] = {
    "detections_short_range": _shorten_range,
    "detections_narrow_view": _narrow_view,
    "detections_uncertain": _doubt,
    "detections_shifted": _shift,
    "detections_oversized": _oversize,
    "detections_wrong_units": _change_units,
    "detections_ghost": _add_ghost,
    "detections_renamed": _rename,
    "detections_hidden": _hide,
    "sensor_clock_ahead": _set_clock_ahead,
}


class _Codec:
    """Reads and writes MAVLink on the way between two ends, without being one."""

    def __init__(self) -> None:
        self._vehicle = mavlink.MAVLink(None, 1, mavlink.MAV_COMP_ID_AUTOPILOT1)
        self._vehicle.robust_parsing = True
        self._rival = mavlink.MAVLink(None, 1, mavlink.MAV_COMP_ID_ONBOARD_COMPUTER)

    def edited(self, data: bytes, east_m: float, *, level: bool) -> bytes:
        """Return the same messages with local positions moved, and attitudes level if asked."""
        changed = bytearray()
        for message in self._vehicle.parse_buffer(data) or []:
            kind = message.get_type()
            if kind == "LOCAL_POSITION_NED":
                message.y += east_m
            elif kind == "ATTITUDE" and level:
                message.roll = message.pitch = 0.0
            else:
                changed += message.get_msgbuf()
                continue
            changed += message.pack(self._vehicle)
        return bytes(changed)

    def go_elsewhere(self) -> bytes:
        """Return a setpoint of a companion computer that has other plans."""
        message = self._rival.set_position_target_local_ned_encode(
            0, 1, 1, mavlink.MAV_FRAME_LOCAL_NED, 0x0DF8, *(0.0,) * 11
        )
        packed: bytes = message.pack(self._rival)
        return packed
