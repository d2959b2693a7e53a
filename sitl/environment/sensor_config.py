"""What a sensor of the simulation is like, and what is wrong with it when."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from pydantic import Field, model_validator

from onboard.files.sensor_sources import SensorPose
from onboard.files.yaml_file import FileModel
from sitl.environment.detector_errors import EXACT, DetectorErrorConfig
from sitl.environment.formats.ros2_topics import Ros2Topic
from sitl.environment.lidar import ScannerConfig

HalfView = Annotated[float, Field(gt=0.0, lt=90.0)]
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
        movers_hidden: whether it sees no mover behind an obstacle, nor behind another mover.
        mover_swap_share: share of the frames in which the names of two movers are exchanged.
        vertical_field_of_view_deg: how far up and down it sees from its level; null: boxes are
            reported without heights, whatever height they are at; ideal model only.
        height_noise_m: greatest error of top and bottom, chosen as those of faces are.
        height_uncertainty_m: declared for top and bottom.
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
    movers_hidden: bool = False
    mover_swap_share: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    vertical_field_of_view_deg: Annotated[tuple[HalfView, HalfView], Field(strict=False)] | None = (
        None
    )
    height_noise_m: Annotated[float, Field(ge=0.0)] = 0.0
    height_uncertainty_m: Annotated[float, Field(ge=0.0)] = 0.3
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
        if self.vertical_field_of_view_deg is not None and not self.is_ideal:
            raise ValueError(
                "vertical_field_of_view_deg is for the ideal detector (expected publishes: json, "
                "without scanner)"
            )
        return self

    @property
    def is_ideal(self) -> bool:
        """Whether it reports boxes as they are, not what its rays meet."""
        return self.publishes == "json" and self.scanner is None

    @property
    def beams(self) -> ScannerConfig:
        """Its rays, where it does not publish boxes."""
        return self.scanner or ScannerConfig()
