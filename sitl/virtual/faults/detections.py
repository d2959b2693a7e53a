"""Faults of what the sensor sends: applied to the frames between sensor and service.

Faults that edit a frame leave alone what is not JSON.
"""

from __future__ import annotations

import json
import math
from collections import deque
from collections.abc import Callable
from typing import Any, ClassVar, Final, NamedTuple

from sitl.environment.sensor_message import ZenohMessage
from sitl.virtual.faults.schedule import FaultSchedule
from sitl.virtual.faults.schema import FaultKind

_GARBAGE_MAX_BYTES: Final = 400
_FRAMES_PER_NAME: Final = 5


class Viewpoint(NamedTuple):
    """From where and when a frame was taken.

    Attributes:
        number: of the frame, the flight's first being 1.
        north_m, east_m: position of the vehicle, local NED.
        present_s: how long the fault has been changing frames.
    """

    number: int
    north_m: float
    east_m: float
    present_s: float


class DetectionFaults:
    """Apply the faults of detections.

    Args:
        schedule: what is present.
    """

    def __init__(self, schedule: FaultSchedule) -> None:
        self._schedule = schedule
        self._frames = 0
        self._latest: ZenohMessage | None = None
        self._held_back: ZenohMessage | None = None
        self._delayed: deque[tuple[float, ZenohMessage]] = deque()
        self._editing_since_s: dict[FaultKind, float] = {}

    def arriving(
        self, sent: list[ZenohMessage], position_ned_m: tuple[float, float, float]
    ) -> list[ZenohMessage]:
        """Return the frames that reach the service now.

        Args:
            sent: what the sensors have sent.
            position_ned_m: of the vehicle.
        """
        if not sent and not self._delayed:
            return sent
        changed = [one for message in sent for one in self._changed(message, position_ned_m)]
        ordered = [one for frame in changed for one in self._in_order(frame)]
        return self._in_time(ordered)

    def _changed(
        self, message: ZenohMessage, position_ned_m: tuple[float, float, float]
    ) -> list[ZenohMessage]:
        self._frames += 1
        if self._latest is None or not self._schedule.present("detections_stuck"):
            self._latest = message
        if not self._schedule.any_present:
            self._editing_since_s = {}
            return [message]
        for kind, replace in self.REPLACEMENTS.items():
            amount = self._schedule.amount(kind)
            if amount is not None and (frames := replace(self, message, amount)) is not None:
                return frames
        if message.key is not None:
            return [message]
        return [message._replace(payload=self._edited(message.payload, position_ned_m))]

    def _edited(self, payload: bytes, position_ned_m: tuple[float, float, float]) -> bytes:
        now_s = self._schedule.now_s
        amounts = {kind: each for kind, each in self._schedule.amounts.items() if kind in EDITS}
        self._editing_since_s = {kind: self._editing_since_s.get(kind, now_s) for kind in amounts}
        if not amounts:
            return payload
        frame: dict[str, Any] = json.loads(payload)
        north_m, east_m, _ = position_ned_m
        for kind, amount in amounts.items():
            present_s = now_s - self._editing_since_s[kind]
            EDITS[kind](frame, amount, Viewpoint(self._frames, north_m, east_m, present_s))
        return json.dumps(frame).encode()

    def _in_order(self, frame: ZenohMessage) -> list[ZenohMessage]:
        """Hold a frame back until the next one has overtaken it, or let it pass."""
        if self._held_back is not None:
            frames, self._held_back = [frame, self._held_back], None
            return frames
        share = self._schedule.amount("detections_out_of_order")
        if share is not None and self._schedule.chance.random() < share:
            self._held_back = frame
            return []
        return [frame]

    def _in_time(self, frames: list[ZenohMessage]) -> list[ZenohMessage]:
        """Queue frames while they are late; return those that are due."""
        delay_s, now_s = self._schedule.amount("detections_late"), self._schedule.now_s
        if delay_s is None and not self._delayed:
            return frames
        self._delayed.extend((now_s + (delay_s or 0.0), frame) for frame in frames)
        due = []
        while self._delayed and self._delayed[0][0] <= now_s + 1e-9:
            due.append(self._delayed.popleft()[1])
        return due

    # Each returns the frames that arrive instead of one, or None to let it pass.

    def _repeat_latest(self, message: ZenohMessage, _: float) -> list[ZenohMessage] | None:
        fresh = self._latest is None or self._latest is message
        return None if fresh or self._latest is None else [self._latest]

    def _drop(self, _: ZenohMessage, __: float) -> list[ZenohMessage] | None:
        return []

    def _drop_some(self, _: ZenohMessage, share: float) -> list[ZenohMessage] | None:
        return [] if self._schedule.chance.random() < share else None

    def _keep_one_in(self, _: ZenohMessage, frames: float) -> list[ZenohMessage] | None:
        return [] if self._frames % int(frames) else None

    def _send_garbage(self, message: ZenohMessage, _: float) -> list[ZenohMessage] | None:
        chance = self._schedule.chance
        garbage = chance.randbytes(chance.randrange(_GARBAGE_MAX_BYTES))
        return [message._replace(payload=garbage)]

    def _declare_nan(self, message: ZenohMessage, _: float) -> list[ZenohMessage] | None:
        payload = message.payload.replace(b'"range_m":', b'"range_m":NaN,"was":', 1)
        return [message._replace(payload=payload)]

    # The first one that is present and does not let a frame pass decides, in this order.
    REPLACEMENTS: ClassVar[
        dict[
            FaultKind,
            Callable[[DetectionFaults, ZenohMessage, float], list[ZenohMessage] | None],
        ]
    ] = {
        "detections_stuck": _repeat_latest,
        "detections_off": _drop,
        "detections_intermittent": _drop_some,
        "detections_slow": _keep_one_in,
        "detections_garbage": _send_garbage,
        "detections_nan": _declare_nan,
    }


def _shorten_range(frame: dict[str, Any], range_m: float, viewpoint: Viewpoint) -> None:
    frame["range_m"] = min(frame["range_m"], range_m)
    _hide(frame, range_m, viewpoint)


def _hide(frame: dict[str, Any], range_m: float, viewpoint: Viewpoint) -> None:
    at = (0.0, 0.0) if frame["frame"] == "body_frd" else (viewpoint.north_m, viewpoint.east_m)
    frame["obstacles"] = [
        obstacle
        for obstacle in frame["obstacles"]
        if math.dist(obstacle["center_m"], at) - math.hypot(*obstacle["size_m"]) / 2.0 <= range_m
    ]


def _narrow_view(frame: dict[str, Any], view_deg: float, _: Viewpoint) -> None:
    frame["field_of_view_deg"] = min(frame["field_of_view_deg"], view_deg)


def _set_uncertainty(frame: dict[str, Any], uncertainty_m: float, _: Viewpoint) -> None:
    for obstacle in frame["obstacles"]:
        obstacle["uncertainty_m"] = uncertainty_m


def _shift(frame: dict[str, Any], shift_m: float, viewpoint: Viewpoint) -> None:
    """Misplace all boxes to the east and to the west in turns."""
    for obstacle in frame["obstacles"]:
        obstacle["center_m"][1] += shift_m * (-1) ** viewpoint.number


def _oversize(frame: dict[str, Any], factor: float, _: Viewpoint) -> None:
    for obstacle in frame["obstacles"]:
        obstacle["size_m"] = [size_m * factor for size_m in obstacle["size_m"]]


def _change_units(frame: dict[str, Any], factor: float, _: Viewpoint) -> None:
    frame["range_m"] *= factor
    for obstacle in frame["obstacles"]:
        for key in ("center_m", "size_m"):
            obstacle[key] = [length_m * factor for length_m in obstacle[key]]


def _add_ghost(frame: dict[str, Any], ahead_m: float, viewpoint: Viewpoint) -> None:
    body = frame["frame"] == "body_frd"
    center_m = [ahead_m, 0.0] if body else [viewpoint.north_m + ahead_m, viewpoint.east_m]
    box = {"center_m": center_m, "size_m": [1.0, 1.0], "yaw_deg": 0.0, "uncertainty_m": 0.0}
    frame["obstacles"].append({"id": f"ghost-{viewpoint.number}", **box})


def _rename(frame: dict[str, Any], _: float, viewpoint: Viewpoint) -> None:
    for obstacle in frame["obstacles"]:
        obstacle["id"] = f"{obstacle['id']}-{viewpoint.number // _FRAMES_PER_NAME}"


def _split(frame: dict[str, Any], _: float, __: Viewpoint) -> None:
    """Report every box as its two halves, which meet in the middle of its first axis."""
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


def _merge(frame: dict[str, Any], _: float, __: Viewpoint) -> None:
    """Report all boxes as one that encloses them."""
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


def _swap_names(frame: dict[str, Any], _: float, viewpoint: Viewpoint) -> None:
    """Rotate the identifiers among the obstacles from frame to frame."""
    boxes = frame["obstacles"]
    names = [box["id"] for box in boxes]
    shift = viewpoint.number % max(1, len(names))
    for box, name in zip(boxes, names[shift:] + names[:shift], strict=True):
        box["id"] = name


def _mistake_frame(frame: dict[str, Any], _: float, __: Viewpoint) -> None:
    """Declare the other coordinate frame, without converting."""
    frame["frame"] = "local_ned" if frame["frame"] == "body_frd" else "body_frd"


def _set_clock_ahead(frame: dict[str, Any], ahead_s: float, _: Viewpoint) -> None:
    frame["stamp_unix_s"] += ahead_s


def _skew_clock(frame: dict[str, Any], rate: float, viewpoint: Viewpoint) -> None:
    frame["stamp_unix_s"] += rate * viewpoint.present_s


def _move_with_estimate(frame: dict[str, Any], east_m: float, _: Viewpoint) -> None:
    """Move what a sensor places in local NED by the estimate, which has jumped."""
    if frame["frame"] == "local_ned":
        for obstacle in frame["obstacles"]:
            obstacle["center_m"][1] += east_m


# Each changes a parsed frame in place.
EDITS: Final[dict[FaultKind, Callable[[dict[str, Any], float, Viewpoint], None]]] = {
    "position_reset": _move_with_estimate,
    "detections_short_range": _shorten_range,
    "detections_narrow_view": _narrow_view,
    "detections_uncertain": _set_uncertainty,
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
    "sensor_clock_skewed": _skew_clock,
}
CHANGES_JSON: Final[frozenset[FaultKind]] = frozenset((*EDITS, "detections_nan"))
KINDS: Final[frozenset[FaultKind]] = frozenset(
    (*DetectionFaults.REPLACEMENTS, *EDITS, "detections_out_of_order", "detections_late")
)
