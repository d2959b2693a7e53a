"""Obstacle detector: what a sensor with limited range and field of view reports, and when.

Two models.  The *ideal* one is a shortcut of the simulation: an obstacle of which any point is
within range and field of view is reported whole, even where another obstacle hides it.  The
*scanner* casts rays and reports boxes around what they hit (``scanner``).
"""

from __future__ import annotations

import math
import random
from collections import deque
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from pydantic_core import to_json

from onboard.files.obstacle_field import ObstacleField
from onboard.geometry.frames import FloatArray
from sitl.environment.detector_errors import (
    Confirmation,
    face_errors,
    height_errors,
)
from sitl.environment.lidar import RangeScanner, SeenBox, View
from sitl.environment.movers.movers import Mover
from sitl.environment.movers.reports import MoverReports
from sitl.environment.sensor_config import (
    OVER_MAVLINK,
    Format,
    SensorConfig,
    SensorFault,
)
from sitl.environment.vertical_view import VerticalView
from sitl.environment.view_geometry import Point, distance_in_view_m, turned
from sitl.environment.world import Neighbourhood, distance_to_box_m
from sitl.plant.truth import VehicleTruth

__all__ = [
    "OVER_MAVLINK",
    "Format",
    "ObstacleSensor",
    "SensorConfig",
    "SensorFault",
    "distance_in_view_m",
]


class _Known(NamedTuple):
    """One obstacle of the field, where its corners are, and how far from its centre."""

    box: SeenBox
    corners_ned_m: list[Point]
    reach_m: float
    heights_m: tuple[float, float]

    def is_seen(
        self, here_ned_m: Point, axis_rad: float, half_view_rad: float, range_m: float
    ) -> bool:
        """Return whether a part of it is within range, and within the view about its axis.

        Boxes out of range, or with their centre in view, need no clipping; the others are cut.
        """
        north_m, east_m = here_ned_m
        ahead_north_m = self.box.center_ned_m[0] - north_m
        ahead_east_m = self.box.center_ned_m[1] - east_m
        distance_m = math.hypot(ahead_north_m, ahead_east_m)
        if distance_m - self.reach_m > range_m:
            return False
        cosine, sine = math.cos(axis_rad), math.sin(axis_rad)
        along_m = cosine * ahead_north_m + sine * ahead_east_m
        if distance_m <= range_m and along_m > distance_m * math.cos(half_view_rad):
            return True
        polygon_m = [
            turned((corner_north_m - north_m, corner_east_m - east_m), -axis_rad)
            for corner_north_m, corner_east_m in self.corners_ned_m
        ]
        return distance_in_view_m(polygon_m, half_view_rad) <= range_m


class ObstacleSensor:
    """Measure at its rate and hand out each frame after its latency; no clock, no I/O.

    Attributes:
        config: as given.
        face_error_max_m: greatest error of a face so far, ideal model only.
        confirmation: which obstacles in view were not reported.
    """

    def __init__(
        self,
        config: SensorConfig,
        field: ObstacleField,
        seed: int,
        start_unix_s: float = 0.0,
        *,
        ideal: bool = True,
        movers: Sequence[Mover] = (),
    ) -> None:
        """Set up; ``ideal`` selects the meaning of a null ``face_noise_m``."""
        self.config = config
        self.face_error_max_m = 0.0
        self.confirmation = Confirmation(config.errors)
        rest_m = 0.0 if ideal else max(config.uncertainty_m - config.noise_m, 0.0)
        self._face_noise_m = rest_m if config.face_noise_m is None else config.face_noise_m
        self._field = field
        self._movers = movers if config.message_version == 2 else ()
        self._neighbourhood = Neighbourhood(field)
        self._known: dict[int, _Known] = {}
        self._noise = random.Random(f"{seed} {config.source}")
        self.mover_reports = MoverReports(
            config.errors, self._face_noise_m, config.mover_swap_share, self._noise
        )
        self._scanner = None
        if config.scanner is not None:
            self._scanner = RangeScanner(config.scanner, field, self._noise)
        self._start_unix_s = start_unix_s
        self._frames_due = 0
        self._sequence = 0
        self._last_payload: bytes | None = None
        self._in_flight: deque[tuple[float, bytes]] = deque()

    @property
    def due_s(self) -> float:
        """When it measures next."""
        return self._frames_due / self.config.rate_hz

    def sense(
        self, now_s: float, truth: VehicleTruth, estimate: VehicleTruth | None = None
    ) -> tuple[bytes, ...]:
        """Measure if it is time to, and return the payloads that leave the sensor by ``now_s``.

        Args:
            now_s: time.
            truth: where the sensor is.
            estimate: of the autopilot, by which boxes are placed in local NED, as a bridge between
                sensor and bus does; exact when None.
        """
        # The epsilon keeps a frame from slipping by one call when now_s carries round-off.
        if now_s >= self.due_s - 1e-9:
            self._frames_due = math.floor(now_s * self.config.rate_hz + 1e-6) + 1
            payload = self._measure(now_s, truth, truth if estimate is None else estimate)
            if payload is not None:
                self._in_flight.append((now_s + self.config.latency_s, payload))
        leaving = []
        while self._in_flight and self._in_flight[0][0] <= now_s + 1e-9:
            leaving.append(self._in_flight.popleft()[1])
        return tuple(leaving)

    def _measure(self, now_s: float, truth: VehicleTruth, estimate: VehicleTruth) -> bytes | None:
        faults = {fault.kind: fault for fault in self.config.faults if fault.active(now_s)}
        if "silent" in faults:
            return None
        if "stuck" in faults:
            return self._last_payload
        range_m = min(self.config.range_m, *(f.range_m for f in faults.values()), math.inf)
        obstacles = [self._reported(box, truth, estimate) for box in self._boxes(truth, range_m)]
        says: dict[str, Any] = {}
        if self.config.message_version == 2:
            says["frame_complete"] = True
            for obstacle in obstacles:
                obstacle |= {"motion": "static", "box_whole": True}
            obstacles += self._reported_movers(truth, estimate, range_m)
        self._last_payload = to_json(
            {
                "version": self.config.message_version,
                "source": self.config.source,
                "sequence": self._sequence,
                "stamp_unix_s": self._start_unix_s + now_s,
                "frame": self.config.frame,
                "range_m": range_m,
                "field_of_view_deg": self.config.field_of_view_deg,
                **self._stated_view,
                "obstacles": obstacles,
                **says,
            }
        )
        self._sequence += 1
        return self._last_payload

    @property
    def _stated_view(self) -> dict[str, Any]:
        view_deg = self.config.vertical_field_of_view_deg
        return {} if view_deg is None else {"vertical_field_of_view_deg": list(view_deg)}

    def _reported_movers(
        self, truth: VehicleTruth, estimate: VehicleTruth, range_m: float
    ) -> list[dict[str, Any]]:
        """What is seen of movers, as a frame of version 2 states it."""
        found = []
        for box, says in self.mover_reports.of(
            self._movers,
            (truth.position_ned_m[0], truth.position_ned_m[1]),
            truth.yaw_rad + math.radians(self.config.yaw_deg),
            math.radians(self.config.field_of_view_deg) / 2.0,
            range_m,
            self._sequence,
            self._hides(truth, range_m) if self.config.movers_hidden else None,
        ):
            velocity_mps, heights_m = says.pop("velocity_ned_mps"), says.pop("heights_m")
            seen_m = self._in_view_m(box, _corners_ned_m(box), heights_m, truth)
            if seen_m is None:
                continue
            distance_m = math.dist(box.center_ned_m, truth.position_ned_m[:2])
            box = self._with_heights(box, seen_m, distance_m)  # noqa: PLW2901  as far as seen
            if self.config.frame == "body_frd":
                velocity_mps = turned(velocity_mps, -truth.yaw_rad)
            reported = self._reported(box, truth, estimate)
            says |= {"motion": self.config.mover_motion, "velocity_mps": list(velocity_mps)}
            found.append({**reported, **says})
        return found

    def _hides(self, truth: VehicleTruth, range_m: float) -> FloatArray:
        """Return what stands still and may hide movers: see `are_hidden`."""
        here_ned_m, field = (truth.position_ned_m[0], truth.position_ned_m[1]), self._field
        near = self._neighbourhood.within(here_ned_m, range_m)
        columns = (field.center_ned_m[near], field.half_size_m[near], field.yaw_rad[near, None])
        boxes: FloatArray = np.concatenate(columns, axis=1)
        return boxes

    def _boxes(self, truth: VehicleTruth, range_m: float) -> list[SeenBox]:
        """What is seen now, in local NED."""
        if self._scanner is None:
            visible = self.confirmation.reported(self._visible(truth, range_m), self._sequence)
            return [self._ideal(index, truth) for index in visible]
        here = (truth.position_ned_m[0], truth.position_ned_m[1])
        view = View(
            here,
            truth.yaw_rad + math.radians(self.config.yaw_deg),
            math.radians(self.config.field_of_view_deg),
            range_m,
        )
        return self._scanner.scan(view, self._neighbourhood.within(here, range_m))

    def _visible(self, truth: VehicleTruth, range_m: float) -> list[int]:
        """Indices of the obstacles with a point within range and field of view."""
        here_ned_m = (truth.position_ned_m[0], truth.position_ned_m[1])
        axis_rad = truth.yaw_rad + math.radians(self.config.yaw_deg)
        half_view_rad = math.radians(self.config.field_of_view_deg) / 2.0
        return [
            index
            for index in self._neighbourhood.within(here_ned_m, range_m).tolist()
            if self._of_field(index).is_seen(here_ned_m, axis_rad, half_view_rad, range_m)
            and self._seen_heights_m(index, truth) is not None
        ]

    def _seen_heights_m(self, index: int, truth: VehicleTruth) -> tuple[float, float] | None:
        """Return top and bottom of what is in view, local NED; None if nothing is."""
        known = self._of_field(index)
        return self._in_view_m(known.box, known.corners_ned_m, known.heights_m, truth)

    def _in_view_m(
        self,
        box: SeenBox,
        corners_ned_m: list[Point],
        heights_m: tuple[float, float],
        truth: VehicleTruth,
    ) -> tuple[float, float] | None:
        """Return what of the heights of a box is in view, local NED; None if nothing is."""
        view_deg = self.config.vertical_field_of_view_deg
        if view_deg is None:
            return heights_m
        north_m, east_m, _ = truth.position_ned_m
        middle_m = (box.center_ned_m[0] - north_m, box.center_ned_m[1] - east_m)
        view = VerticalView.of(view_deg, truth, math.atan2(middle_m[1], middle_m[0]))
        nearest_m = distance_to_box_m(
            (north_m, east_m),
            np.array([box.center_ned_m]),
            np.array([box.size_m]) / 2.0,
            np.array([box.yaw_rad]),
        )
        farthest_m = max(math.dist((north_m, east_m), corner) for corner in corners_ned_m)
        return view.seen_m(*heights_m, float(nearest_m[0]), farthest_m)

    def _of_field(self, index: int) -> _Known:
        """Return an obstacle of the field, which never moves, as plain numbers."""
        if index not in self._known:
            field = self._field
            box = SeenBox(
                field.ids[index],
                tuple(field.center_ned_m[index].tolist()),
                tuple((2.0 * field.half_size_m[index]).tolist()),
                float(field.yaw_rad[index]),
            )
            heights_m = (-math.inf, math.inf)
            if field.down_m is not None:
                heights_m = (float(field.down_m[index, 0]), float(field.down_m[index, 1]))
            reach_m = math.hypot(*box.size_m) / 2.0
            self._known[index] = _Known(box, _corners_ned_m(box), reach_m, heights_m)
        return self._known[index]

    def _ideal(self, index: int, truth: VehicleTruth) -> SeenBox:
        box, noise_m = self._of_field(index).box, self.config.noise_m
        north_m, east_m = (
            coordinate_m + self._noise.uniform(-noise_m, noise_m)
            for coordinate_m in box.center_ned_m
        )
        distance_m = math.dist(box.center_ned_m, truth.position_ned_m[:2])
        if self._face_noise_m:
            found = self._with_faces_off(box, (north_m, east_m), distance_m)
        else:
            found = SeenBox(box.id, (north_m, east_m), box.size_m, box.yaw_rad)
        seen_m = self._seen_heights_m(index, truth)
        return found if seen_m is None else self._with_heights(found, seen_m, distance_m)

    def _with_heights(
        self, found: SeenBox, seen_m: tuple[float, float], distance_m: float
    ) -> SeenBox:
        """State top and bottom, with their errors, where the detector sees heights."""
        if self.config.vertical_field_of_view_deg is None:
            return found
        size_m, errors = self.config.height_noise_m, self.config.errors
        off_m = height_errors(errors, size_m, self._sequence, distance_m, self._noise)
        top_m, bottom_m = (each + by for each, by in zip(seen_m, off_m, strict=True))
        return found._replace(down_m=(min(top_m, bottom_m), max(top_m, bottom_m)))

    def _with_faces_off(self, box: SeenBox, center_ned_m: Point, distance_m: float) -> SeenBox:
        """Move each of the four faces outwards or inwards."""
        off = face_errors(
            self.config.errors, self._face_noise_m, self._sequence, distance_m, self._noise
        )
        self.face_error_max_m = max(self.face_error_max_m, *map(abs, off))
        front_m, back_m, right_m, left_m = off
        shift = turned(((front_m - back_m) / 2.0, (right_m - left_m) / 2.0), box.yaw_rad)
        length_m, width_m = box.size_m
        size_m = (max(length_m + front_m + back_m, 0.0), max(width_m + right_m + left_m, 0.0))
        center_m = (center_ned_m[0] + shift[0], center_ned_m[1] + shift[1])
        return SeenBox(box.id, center_m, size_m, box.yaw_rad)

    def _reported(
        self, box: SeenBox, truth: VehicleTruth, estimate: VehicleTruth
    ) -> dict[str, Any]:
        center_m, yaw_rad = box.center_ned_m, box.yaw_rad
        if self.config.frame == "body_frd" or estimate is not truth:
            # A sensor measures relative to the body, independently of the estimate.
            offset_m = (
                center_m[0] - truth.position_ned_m[0],
                center_m[1] - truth.position_ned_m[1],
            )
            center_m = turned(offset_m, -truth.yaw_rad)
            yaw_rad -= truth.yaw_rad
        if self.config.frame == "local_ned" and estimate is not truth:
            heading_rad = (truth if self.config.placed_by == "position" else estimate).yaw_rad
            north_m, east_m = turned(center_m, heading_rad)
            center_m = (estimate.position_ned_m[0] + north_m, estimate.position_ned_m[1] + east_m)
            yaw_rad += heading_rad
        reported = {
            "id": box.id,
            "center_m": list(center_m),
            "size_m": list(box.size_m),
            "yaw_deg": math.degrees(yaw_rad),
            "uncertainty_m": self.config.uncertainty_m,
        }
        if box.down_m is None:
            return reported
        placed_by_m = 0.0 if self.config.frame == "body_frd" else estimate.position_ned_m[2]
        from_m = placed_by_m - truth.position_ned_m[2]
        return reported | {
            "down_m": [each + from_m for each in box.down_m],
            "down_uncertainty_m": self.config.height_uncertainty_m,
        }


def _corners_ned_m(box: SeenBox) -> list[Point]:
    north_m, east_m = box.center_ned_m
    half_along_m, half_across_m = box.size_m[0] / 2.0, box.size_m[1] / 2.0
    corners = []
    for along, across in ((1, 1), (-1, 1), (-1, -1), (1, -1)):
        along_across = turned((along * half_along_m, across * half_across_m), box.yaw_rad)
        corners.append((north_m + along_across[0], east_m + along_across[1]))
    return corners
