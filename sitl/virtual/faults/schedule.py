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

from onboard.files.yaml_file import FileModel
from sitl.environment.imperfect_link import ImperfectLink, LinkConfig

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
    "detections_split",
    "detections_merged",
    "detections_swapped",
    "detections_wrong_frame",
    "detections_out_of_order",
    "sensor_clock_ahead",
    "sensor_clock_skewed",
]
LinkKind = Literal[
    "telemetry_lost",
    "telemetry_corrupted",
    "heartbeats_lost",
    "setpoints_lost",
    "link_partitioned",
    "link_lossy",
    "link_duplicating",
    "link_reordering",
    "link_corrupting",
    "second_commander",
]
VehicleKind = Literal[
    "position_reset",
    "position_misreported",
    "height_reset",
    "attitude_stuck",
    "gps_lost",
    "mode_rejected",
    "parameter_changed",
    "gust",
    "thrust_lost",
    "attitude_slow",
    "motor_failed",
]
ProcessKind = Literal["tick_stall", "solver_limited", "daemon_dead", "disk_full"]
OperatorKind = Literal["operator_takes_over", "mission_changed"]
FaultKind = Literal[DetectionKind, LinkKind, VehicleKind, ProcessKind, OperatorKind]

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
    "detections_out_of_order": (0.5, "share of frames that are overtaken by the next"),
    "sensor_clock_ahead": (5.0, "seconds"),
    "sensor_clock_skewed": (0.05, "seconds per second by which the sensor's clock runs fast"),
    "link_lossy": (0.3, "share of datagrams that are lost, either way"),
    "link_duplicating": (0.3, "share of datagrams that arrive twice, either way"),
    "link_reordering": (0.3, "share of datagrams that later ones may overtake, either way"),
    "link_corrupting": (0.2, "share of datagrams of which one byte changes, either way"),
    "parameter_changed": (20.0, "degrees of tilt that the autopilot still allows"),
    "gust": (6.0, "metres per second, to the east, at the peak"),
    "thrust_lost": (0.9, "share of its speed that every rotor reaches"),
    "attitude_slow": (3.0, "attitude feedback [1/s]"),
    "telemetry_corrupted": (0.2, "share of datagrams of which one byte changes"),
    "position_reset": (3.0, "metres to the east, of the estimate that is told and flown by"),
    "height_reset": (4.0, "metres upwards, of the estimate that is told and flown by"),
    "mission_changed": (30.0, "degrees by which what is left of the leg turns to the right"),
    "position_misreported": (
        0.3,
        "metres to the east, of what is told but not flown by; builds up and goes at 0.5 m/s",
    ),
}

# An estimator that drifts, rather than jumps, which is a reset: POSITION_JUMP_M of the service.
MISREPORTED_DRIFT_MPS: Final = 0.5


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
    phase: Literal["standby", "cruise", "avoid", "arrived", "hold"] | None = None
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
        self._latest: bytes | None = None
        self._frames = 0
        self._delayed: deque[tuple[float, bytes]] = deque()
        self._overtaken: bytes | None = None
        self._skew_since_s: float | None = None
        self._now_s = 0.0
        self._misreported_m = 0.0
        self._codec = _Codec()
        self._ways = {
            way: {
                kind: _imperfect(kind, f"{way} {kind} {seed}", fault.value)
                for fault in faults
                if (kind := fault.kind) in LINK_KEYS
            }
            for way in ("up", "down")
        }

    def advance(self, now_s: float, phase: str) -> None:
        """Take note of the time and of the service's phase: which faults are present now?"""
        if phase != self._phase:
            self._phase = phase
            self._entries[phase] = self._entries.get(phase, 0) + 1
            self._entered_s[phase, self._entries[phase]] = now_s
        passed_s, self._now_s = now_s - self._now_s, now_s
        if not self._faults:
            return
        self._active = {fault.kind: fault for fault in self._faults if self._present(fault, now_s)}
        step_m = MISREPORTED_DRIFT_MPS * passed_s
        missing_m = (self.amount("position_misreported") or 0.0) - self._misreported_m
        self._misreported_m += min(max(missing_m, -step_m), step_m)

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
        spoilt = [f for payload in payloads for f in self._spoilt(payload, position_ned_m)]
        arriving = [frame for each in spoilt for frame in self._in_order(each)]
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
        if "detections_stuck" in active and self._latest is not None:
            return [self._latest]
        self._latest = payload
        if "detections_off" in active or self._is_lost():
            return []
        if "detections_garbage" in active:
            return [self._random.randbytes(self._random.randrange(400))]
        if "detections_nan" in active:
            return [payload.replace(b'"range_m":', b'"range_m":NaN,"was":', 1)]
        skew = active.get("sensor_clock_skewed")
        self._skew_since_s = None if skew is None else self._skew_since_s or self._now_s
        edits = [(EDITS[kind], fault.value) for kind, fault in active.items() if kind in EDITS]
        if skew is not None and self._skew_since_s is not None:
            edits.append((_set_clock_ahead, skew.value * (self._now_s - self._skew_since_s)))
        if not edits:
            return [payload]
        frame: dict[str, Any] = json.loads(payload)
        for edit, amount in edits:
            edit(frame, amount, Look(self._frames, position_ned_m[0], position_ned_m[1]))
        return [json.dumps(frame).encode()]

    def _in_order(self, frame: bytes) -> list[bytes]:
        """Keep a frame back until the next one has overtaken it, or let it pass."""
        if self._overtaken is not None:
            frames, self._overtaken = [frame, self._overtaken], None
            return frames
        shuffled = self._active.get("detections_out_of_order")
        if shuffled is not None and self._random.random() < shuffled.value:
            self._overtaken = frame
            return []
        return [frame]

    def _is_lost(self) -> bool:
        intermittent = self._active.get("detections_intermittent")
        if intermittent is not None and self._random.random() < intermittent.value:
            return True
        slow = self._active.get("detections_slow")
        return slow is not None and self._frames % int(slow.value) != 0

    # ------------------------------------------------------------------ MAVLink

    def telemetry(self, data: bytes) -> bytes:
        """Return what the service hears of what the vehicle sent."""
        if not self._faults:
            return data
        data = self._carried("down", data)
        if "telemetry_lost" in self._active or "link_partitioned" in self._active:
            return b""
        corrupted = self._active.get("telemetry_corrupted")
        if corrupted is not None and data and self._random.random() < corrupted.value:
            spoilt = bytearray(data)
            spoilt[self._random.randrange(len(spoilt))] ^= 1 << self._random.randrange(8)
            data = bytes(spoilt)
        reset = self._active.get("position_reset")
        target_east_m = 0.0 if reset is None else reset.value
        east_m = target_east_m or self._misreported_m
        level, mute = "attitude_stuck" in self._active, "heartbeats_lost" in self._active
        if east_m == 0.0 and not (level or mute):
            return data
        return self._codec.edited(data, east_m, target_east_m, level=level, mute=mute)

    def setpoints(self, data: bytes) -> bytes:
        """Return what the vehicle hears of what the service sent."""
        data = self._carried("up", data)
        if "setpoints_lost" in self._active or "link_partitioned" in self._active:
            return b""
        reset = self._active.get("position_reset")
        return data if reset is None else self._codec.displaced(data, -reset.value)

    def _carried(self, way: str, data: bytes) -> bytes:
        """Send a datagram over the imperfect links that are present; return what arrives now."""
        for kind, link in self._ways[way].items():
            if kind in self._active:
                link.send(data, self._now_s)
                data = b""
            data = b"".join(link.receive(self._now_s)) + data
        return data

    def rival(self) -> bytes:
        """Return what somebody else sends to the vehicle."""
        return self._codec.go_elsewhere() if "second_commander" in self._active else b""

    # ------------------------------------------------------------------ process, operator

    @property
    def any_present(self) -> bool:
        """Whether any fault is present."""
        return bool(self._active)

    def present(self, kind: FaultKind) -> bool:
        """Tell whether a fault of this kind is present."""
        return kind in self._active

    def amount(self, kind: FaultKind) -> float | None:
        """Return how bad a fault of this kind is; None while there is none."""
        fault = self._active.get(kind)
        return None if fault is None else fault.value


# The key of `LinkConfig` that a kind sets.
LINK_KEYS: Final[dict[str, str]] = {
    "link_lossy": "loss",
    "link_duplicating": "duplication",
    "link_reordering": "reordering",
    "link_corrupting": "corruption",
}


def _imperfect(kind: str, seed: str, share: float) -> ImperfectLink:
    return ImperfectLink(
        LinkConfig.model_validate({LINK_KEYS[kind]: share}), random.Random(f"link {seed}")
    )


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


def _split(frame: dict[str, Any], _: float, __: Look) -> None:
    """Every box is seen as its two halves, which meet in the middle of its own first axis."""
    halves = []
    for obstacle in frame["obstacles"]:
        (north_m, east_m), (length_m, width_m) = obstacle["center_m"], obstacle["size_m"]
        yaw_rad = math.radians(obstacle["yaw_deg"])
        for half, sign in (("a", -0.25), ("b", 0.25)):
            offset_m = sign * length_m
            center_m = [
                north_m + offset_m * math.cos(yaw_rad),
                east_m + offset_m * math.sin(yaw_rad),
            ]
            size_m = [length_m / 2.0, width_m]
            name = f"{obstacle['id']}{half}"
            halves.append({**obstacle, "id": name, "center_m": center_m, "size_m": size_m})
    frame["obstacles"] = halves


def _merge(frame: dict[str, Any], _: float, __: Look) -> None:
    """All boxes are seen as one that encloses them."""
    boxes = frame["obstacles"]
    if len(boxes) < 2:
        return
    reach_m = [math.hypot(*box["size_m"]) / 2.0 for box in boxes]
    spans_m = [
        (
            min(box["center_m"][axis] - r_m for box, r_m in zip(boxes, reach_m, strict=True)),
            max(box["center_m"][axis] + r_m for box, r_m in zip(boxes, reach_m, strict=True)),
        )
        for axis in (0, 1)
    ]
    frame["obstacles"] = [
        {
            **boxes[0],
            "center_m": [(low_m + high_m) / 2.0 for low_m, high_m in spans_m],
            "size_m": [high_m - low_m for low_m, high_m in spans_m],
            "yaw_deg": 0.0,
        }
    ]


def _swap_names(frame: dict[str, Any], _: float, look: Look) -> None:
    """Obstacles exchange their names from frame to frame."""
    boxes = frame["obstacles"]
    names = [box["id"] for box in boxes]
    shift = look.number % max(1, len(names))
    for box, name in zip(boxes, names[shift:] + names[:shift], strict=True):
        box["id"] = name


def _mistake_frame(frame: dict[str, Any], _: float, __: Look) -> None:
    """What was measured in one frame is said to be in the other."""
    frame["frame"] = "local_ned" if frame["frame"] == "body_frd" else "body_frd"


def _set_clock_ahead(frame: dict[str, Any], ahead_s: float, _: Look) -> None:
    frame["stamp_unix_s"] += ahead_s


def _move_with_estimate(frame: dict[str, Any], east_m: float, _: Look) -> None:
    """Local NED is what the estimator makes of it: what a sensor places by it moves along."""
    if frame["frame"] == "local_ned":
        for obstacle in frame["obstacles"]:
            obstacle["center_m"][1] += east_m


EDITS: Final[dict[str, Edit]] = {
    "position_reset": _move_with_estimate,
    "detections_short_range": _shorten_range,
    "detections_narrow_view": _narrow_view,
    "detections_uncertain": _doubt,
    "detections_shifted": _shift,
    "detections_oversized": _oversize,
    "detections_wrong_units": _change_units,
    "detections_ghost": _add_ghost,
    "detections_renamed": _rename,
    "detections_hidden": _hide,
    "detections_split": _split,
    "detections_merged": _merge,
    "detections_swapped": _swap_names,
    "detections_wrong_frame": _mistake_frame,
    "sensor_clock_ahead": _set_clock_ahead,
}


class _Codec:
    """Reads and writes MAVLink on the way between two ends, without being one."""

    def __init__(self) -> None:
        self._vehicle = mavlink.MAVLink(None, 1, mavlink.MAV_COMP_ID_AUTOPILOT1)
        self._vehicle.robust_parsing = True
        self._service = mavlink.MAVLink(None)
        self._service.robust_parsing = True
        self._rival = mavlink.MAVLink(None, 1, mavlink.MAV_COMP_ID_ONBOARD_COMPUTER)

    def edited(
        self, data: bytes, east_m: float, target_east_m: float, *, level: bool, mute: bool
    ) -> bytes:
        """Return the same messages with positions and targets moved, and if asked attitudes level.

        Muted, there are no heartbeats among them.
        """
        changed = bytearray()
        for message in self._vehicle.parse_buffer(data) or []:
            kind = message.get_type()
            if kind == "HEARTBEAT" and mute:
                continue
            if kind == "LOCAL_POSITION_NED":
                message.y += east_m
            elif kind == "POSITION_TARGET_LOCAL_NED":
                message.y += target_east_m
            elif kind == "ATTITUDE" and level:
                message.roll = message.pitch = 0.0
            else:
                changed += message.get_msgbuf()
                continue
            changed += message.pack(self._vehicle)
        return bytes(changed)

    def displaced(self, data: bytes, east_m: float) -> bytes:
        """Return the same messages with target positions moved.

        A vehicle whose estimate has jumped flies to where its estimate says, not to where it is.
        """
        changed = bytearray()
        for message in self._service.parse_buffer(data) or []:
            if message.get_type() != "SET_POSITION_TARGET_LOCAL_NED":
                changed += message.get_msgbuf()
                continue
            message.y += east_m
            sender = mavlink.MAVLink(None, message.get_srcSystem(), message.get_srcComponent())
            sender.seq = message.get_seq()
            changed += message.pack(sender)
        return bytes(changed)

    def go_elsewhere(self) -> bytes:
        """Return a setpoint of a companion computer that has other plans."""
        message = self._rival.set_position_target_local_ned_encode(
            0, 1, 1, mavlink.MAV_FRAME_LOCAL_NED, 0x0DF8, *(0.0,) * 11
        )
        packed: bytes = message.pack(self._rival)
        return packed
