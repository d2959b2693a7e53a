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
from typing import Annotated, Any, Final, Literal, NamedTuple

from pydantic import Field, model_validator
from pydantic_core import to_json

from onboard.files.obstacle_field import ObstacleField
from onboard.files.sensor_sources import SensorPose
from onboard.files.yaml_file import FileModel
from sitl.environment.detector_errors import (
    EXACT,
    Confirmation,
    DetectorErrorConfig,
    face_errors,
)
from sitl.environment.formats.ros2_topics import Ros2Topic
from sitl.environment.lidar import RangeScanner, ScannerConfig, SeenBox, View
from sitl.environment.movers.movers import Mover
from sitl.environment.movers.reports import MoverReports
from sitl.environment.view_geometry import Point, distance_in_view_m, turned
from sitl.environment.world import Neighbourhood
from sitl.plant.truth import VehicleTruth

Format = Literal[
    "json", "laserscan", "pointcloud2", "range", "obstacle_distance", "distance_sensor"
]
OVER_MAVLINK: Final[frozenset[Format]] = frozenset(("obstacle_distance", "distance_sensor"))


class SensorFault(FileModel):
    """One fault and its time.

    Attributes:
        kind: ``silent``: no frames; ``stuck``: the last frame repeats unchanged;
            ``range``: the range falls to ``range_m``, and frames say so.
        start_s, end_s: seconds after start; never ends when ``end_s`` is null.
        range_m: remaining range of a ``range`` fault.
    """

    kind: Literal["silent", "stuck", "range"]
    start_s: Annotated[float, Field(ge=0.0)] = 0.0
    end_s: float | None = None
    range_m: Annotated[float, Field(gt=0.0)] = 1.0

    def active(self, now_s: float) -> bool:
        """Whether the fault is present at ``now_s``."""
        return self.start_s <= now_s and (self.end_s is None or now_s < self.end_s)


class SensorConfig(FileModel):
    """One detector.

    Attributes:
        source: name of the sensor in its frames.
        publishes: ``json``: boxes; ``laserscan``, ``pointcloud2``, ``range``: what its rays meet,
            as ROS 2; ``obstacle_distance``, ``distance_sensor``: over MAVLink, by the autopilot.
            These come from a ``scanner``, by default one without errors.
        ros2: where a sensor that speaks ROS 2 publishes.
        mounting: of a sensor that speaks another format than ``json``, which is levelled.
        scanner: configuration of a scanning range finder; null for the ideal detector.
        yaw_deg: direction of its axis in the body, clockwise from forward.
        noise_m: greatest error of centres along each axis (uniform); ideal model only.
        face_noise_m: greatest error of each face, independently (uniform); ideal model only.
            Null: under ``realism: field`` the rest of uncertainty_m beyond noise_m, otherwise 0.
        uncertainty_m: declared for each face.
        latency_s: from measurement to publication.
        frame: frame of the reported boxes; ``body_frd`` is levelled, turned by yaw only.
        placed_by: what of the autopilot's estimate places boxes in ``local_ned``: its ``pose``, as
            a bridge on the vehicle does, or its ``position``, where bearings are known otherwise.
        errors: how faces err by face_noise_m, and which boxes are missing; ideal model only.
        message_version: 2 says what moves, and reports movers; ideal model only.
        mover_motion: what it says of the motion of movers.
        mover_swap_share: share of the frames in which the names of two movers are exchanged.
    """

    source: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+$")] = "front"
    publishes: Format = "json"
    ros2: Ros2Topic = Ros2Topic()
    mounting: SensorPose = SensorPose()
    range_m: Annotated[float, Field(gt=0.0)] = 12.0
    field_of_view_deg: Annotated[float, Field(gt=0.0, le=360.0)] = 120.0
    yaw_deg: float = 0.0
    rate_hz: Annotated[float, Field(gt=0.0, le=200.0)] = 20.0
    latency_s: Annotated[float, Field(ge=0.0, le=10.0)] = 0.03
    noise_m: Annotated[float, Field(ge=0.0)] = 0.0
    face_noise_m: Annotated[float, Field(ge=0.0)] | None = None
    uncertainty_m: Annotated[float, Field(ge=0.0)] = 0.05
    frame: Literal["local_ned", "body_frd"] = "local_ned"
    placed_by: Literal["pose", "position"] = "pose"
    errors: DetectorErrorConfig = EXACT
    message_version: Literal[1, 2] = 1
    mover_motion: Literal["moving", "unknown", "static"] = "moving"
    mover_swap_share: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    scanner: ScannerConfig | None = None
    faults: Annotated[tuple[SensorFault, ...], Field(strict=False)] = ()

    @model_validator(mode="after")
    def _mounted_one_way(self) -> SensorConfig:
        if self.publishes == "json" and self.mounting != SensorPose():
            raise ValueError("mounting is for other formats than publishes: json; see yaw_deg")
        if self.publishes != "json" and self.yaw_deg:
            raise ValueError(f"publishes: {self.publishes} is turned by mounting.yaw_deg")
        if self.publishes in ("range", "distance_sensor") and self.field_of_view_deg >= 180.0:
            raise ValueError(
                f"field_of_view_deg [deg] = {self.field_of_view_deg:g} of publishes: "
                f"{self.publishes} must be less than 180: it is one cone"
            )
        return self

    @property
    def beams(self) -> ScannerConfig:
        """Its rays, where it does not publish boxes."""
        return self.scanner or ScannerConfig()


class _Known(NamedTuple):
    """One obstacle of the field, where its corners are, and how far from its centre."""

    box: SeenBox
    corners_ned_m: list[Point]
    reach_m: float

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
                "obstacles": obstacles,
                **says,
            }
        )
        self._sequence += 1
        return self._last_payload

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
        ):
            velocity_mps = says.pop("velocity_ned_mps")
            if self.config.frame == "body_frd":
                velocity_mps = turned(velocity_mps, -truth.yaw_rad)
            reported = self._reported(box, truth, estimate)
            says |= {"motion": self.config.mover_motion, "velocity_mps": list(velocity_mps)}
            found.append({**reported, **says})
        return found

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
        ]

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
            self._known[index] = _Known(box, _corners_ned_m(box), math.hypot(*box.size_m) / 2.0)
        return self._known[index]

    def _ideal(self, index: int, truth: VehicleTruth) -> SeenBox:
        box, noise_m = self._of_field(index).box, self.config.noise_m
        north_m, east_m = (
            coordinate_m + self._noise.uniform(-noise_m, noise_m)
            for coordinate_m in box.center_ned_m
        )
        if not self._face_noise_m:
            return SeenBox(box.id, (north_m, east_m), box.size_m, box.yaw_rad)
        distance_m = math.dist(box.center_ned_m, truth.position_ned_m[:2])
        return self._with_faces_off(box, (north_m, east_m), distance_m)

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
        return {
            "id": box.id,
            "center_m": list(center_m),
            "size_m": list(box.size_m),
            "yaw_deg": math.degrees(yaw_rad),
            "uncertainty_m": self.config.uncertainty_m,
        }


def _corners_ned_m(box: SeenBox) -> list[Point]:
    north_m, east_m = box.center_ned_m
    half_along_m, half_across_m = box.size_m[0] / 2.0, box.size_m[1] / 2.0
    corners = []
    for along, across in ((1, 1), (-1, 1), (-1, -1), (1, -1)):
        along_across = turned((along * half_along_m, across * half_across_m), box.yaw_rad)
        corners.append((north_m + along_across[0], east_m + along_across[1]))
    return corners
