"""The sensors of a daemon's file: what each publishes, how it is mounted, and what it sees.

Angles are in degrees, in the body: forward, right, down, so that bearings run clockwise from the
nose.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import Field, model_validator

from onboard.files.yaml_file import FileModel

Metres = Annotated[float, Field(gt=0.0, le=200.0)]
Bearing = Annotated[float, Field(ge=-180.0, le=180.0)]
Sector = Annotated[tuple[Bearing, Bearing], Field(strict=False)]
View = Annotated[float, Field(gt=0.0, le=360.0)]
# Forward, left, up, or, of cameras, right, down, forward.
Axes = Literal["flu", "optical"]
Topic = Annotated[str, Field(pattern=r"^/?[A-Za-z0-9_]+(/[A-Za-z0-9_]+)*$")]
Label = Annotated[str, Field(min_length=1, max_length=64)]
MoverKind = Annotated[str, Field(pattern=r"^[a-z0-9_]{1,32}$")]
PointsMin = Annotated[int, Field(ge=1, le=1000)]
UTM: Final = "utm_global_position"
TrafficMessage = Literal[
    "adsb_vehicle", "utm_global_position", "global_position_int", "open_drone_id_location"
]
STATE_NO_ACCURACY: Final = ("adsb_vehicle", "global_position_int")  # of their position
_OFFSET_MAX_M: Final = 3.0
# Of a vehicle, by REP 105.
_BASE_FRAME: Final = "base_link"
Offset = Annotated[float, Field(ge=-_OFFSET_MAX_M, le=_OFFSET_MAX_M)]


class SensorPose(FileModel):
    """Where a sensor is in the body, and how it is turned: by yaw, then pitch, then roll."""

    x_m: Offset = Field(0.0, description="forward of the vehicle's centre")
    y_m: Offset = Field(0.0, description="to its right")
    z_m: Offset = Field(0.0, description="below it")
    roll_deg: Bearing = 0.0
    pitch_deg: Bearing = Field(0.0, description="nose up")
    yaw_deg: Bearing = Field(0.0, description="clockwise, seen from above")


class Mounting(SensorPose):
    """How a sensor is mounted, as numbers or by transforms.

    Of a ROS 2 source, static transforms may say it: the pose of the frame that its messages name in
    ``base_frame``, which is forward, left, up from the vehicle's centre.
    """

    tf_topic: Topic | None = Field(
        None, description="static transforms that say it instead, such as /tf_static"
    )
    base_frame: str = Field(_BASE_FRAME, description="of the vehicle, in these transforms")

    @model_validator(mode="after")
    def _stated_once(self) -> Mounting:
        # A model that was written out with its defaults can be read again.
        stated = [key for key in SensorPose.model_fields if getattr(self, key) != 0.0]
        if self.tf_topic is not None and stated:
            key = min(stated)
            raise ValueError(f"tf_topic replaces {key}: leave {key} out")
        if self.tf_topic is None and self.base_frame != _BASE_FRAME:
            raise ValueError("base_frame needs tf_topic: it is a frame of its transforms")
        return self


class SensorSource(FileModel):
    """What every sensor states."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")] = Field(
        description="of the sensor in logs and messages; each has its own"
    )
    range_m: Metres = Field(description="within which it sees every obstacle")
    uncertainty_m: Annotated[float, Field(ge=0.0, le=10.0)] = Field(
        description="how far each face may be off; at most the contract's position_error_m"
    )
    mounting: Mounting = Mounting()
    field_of_view_deg: Annotated[float, Field(gt=0.0, le=360.0)] = Field(
        360.0, description="around the nose, at most: what it sees besides is not counted on"
    )
    no_return_is_free_to_m: Metres | None = Field(
        None, description="how far a beam without a return shows free space; unset: not at all"
    )
    height_band_m: Annotated[tuple[Metres, Metres], Field(strict=False)] = Field(
        (1.0, 1.0), description="above, below the vehicle: the heights that every obstacle spans"
    )
    ground_margin_m: Annotated[float, Field(ge=0.0, le=10.0)] = Field(
        0.5, description="what is lower than this above the point of take-off is the ground"
    )
    own_radius_m: Annotated[float, Field(ge=0.0, le=5.0)] = Field(
        0.3, description="what is nearer than this is the vehicle itself"
    )
    blind_sectors_deg: Annotated[tuple[Sector, ...], Field(strict=False)] = Field(
        (), description="bearings (from, to), clockwise, that parts of the vehicle hide"
    )
    exposure_s: Annotated[float, Field(ge=0.0, le=1.0)] = Field(
        0.0, description="how much later than its stamp any part of a message may be measured"
    )
    box_max_m: Annotated[float, Field(ge=0.2, le=100.0)] = Field(
        2.0, description="larger obstacles become boxes side by side"
    )
    cluster_gap_m: Annotated[float, Field(gt=0.0, le=10.0)] = Field(
        0.5, description="points farther apart belong to different obstacles"
    )
    points_min: PointsMin = Field(
        1, description="fewer points together make neither an obstacle nor free space"
    )

    @property
    def measured_within_s(self) -> float:
        """How much later than its stamp any part of a message may have been measured."""
        return self.exposure_s

    @model_validator(mode="after")
    def _free_no_farther_than_it_sees(self) -> SensorSource:
        free_m = self.no_return_is_free_to_m
        if free_m is not None and free_m > self.range_m:
            raise ValueError(
                f"no_return_is_free_to_m {free_m:g} m is more than range_m {self.range_m:g} m"
            )
        return self


class Ros2Source(SensorSource):
    """A ROS 2 topic over Zenoh."""

    topic: Topic
    middleware: Literal["rmw_zenoh", "zenoh-bridge-ros2dds"] = "rmw_zenoh"
    domain_id: Annotated[int, Field(ge=0, le=232)] = Field(0, description="of rmw_zenoh")
    frame_id: str | None = Field(
        None, description="messages in another frame are dropped; unset: that of the first one"
    )


class LaserScanSource(Ros2Source):
    """sensor_msgs/LaserScan: a scanning lidar."""

    kind: Literal["laserscan"]
    points_min: PointsMin = 2


class PointCloudSource(Ros2Source):
    """sensor_msgs/PointCloud2: a lidar of several lines, or a depth camera."""

    kind: Literal["pointcloud2"]
    range_m: Annotated[float, Field(gt=0.0, le=60.0)] = Field(
        description="within which it sees every obstacle"
    )
    points_min: PointsMin = Field(2, description="in an upright cell of 5 cm")
    axes: Axes = "flu"
    view_deg: Annotated[tuple[View, View], Field(strict=False)] = Field(
        description="of the sensor itself, around its axis: across, up and down"
    )


class RangeSource(Ros2Source):
    """sensor_msgs/Range: one cone."""

    kind: Literal["range"]


class LabelledSource(Ros2Source):
    """Boxes with labels: classes of a contract's movers, where it has some.

    Attributes:
        labels: class of each label; a box with any other is of class ``unknown``.
        boxes_whole: whether a box holds all of what it shows, faces within ``uncertainty_m``.
    """

    labels: Annotated[dict[Label, MoverKind], Field(max_length=100)] = Field(
        default_factory=dict,
        description="class of movers, as the contract names it, of each label",
    )
    boxes_whole: bool = Field(
        False, description="a box holds all of what it shows, and not only what faces the sensor"
    )


class DetectionsSource(LabelledSource):
    """vision_msgs/Detection3DArray: boxes of a detector."""

    kind: Literal["detection3d"]
    axes: Axes = "flu"
    view_deg: Annotated[tuple[View, View], Field(strict=False)] = Field(
        description="of the sensor itself, around its axis: across, up and down"
    )


class TrackedObjectsSource(LabelledSource):
    """autoware_perception_msgs/TrackedObjects: movers besides those that sensors see.

    With ``local_enu`` objects lie in the autopilot's local frame, x east and y north, as MAVROS
    names it; with ``body`` forward, left, up of the vehicle.
    """

    kind: Literal["tracked_objects"]
    objects_frame: Literal["body", "local_enu"]
    sigmas: Annotated[float, Field(gt=0.0, le=10.0)] | None = Field(
        None, description="standard deviations of a position to add to uncertainty_m; unset: none"
    )

    @model_validator(mode="after")
    def _shows_nothing_free(self) -> TrackedObjectsSource:
        if self.no_return_is_free_to_m is not None:
            raise ValueError("no_return_is_free_to_m: what a tracker does not report may be there")
        if self.mounting.tf_topic is not None:
            raise ValueError("mounting.tf_topic: objects_frame says where objects are")
        return self


class OccupancyGridSource(Ros2Source):
    """nav_msgs/OccupancyGrid: cells of a map.

    Attributes:
        grid_frame: ``body``: around the vehicle, x forward and y left; ``local_enu``: the
            autopilot's local frame, x east and y north, as MAVROS names it.
        occupied_min: cells from this percentage on are obstacles.
        free_max: cells up to this percentage are free, where ``no_return_is_free_to_m`` allows.
    """

    kind: Literal["occupancygrid"]
    range_m: Annotated[float, Field(gt=0.0, le=60.0)] = Field(
        description="within which it sees every obstacle"
    )
    grid_frame: Literal["body", "local_enu"]
    occupied_min: Annotated[int, Field(ge=1, le=100)] = 50
    free_max: Annotated[int, Field(ge=0, le=99)] = 20

    @model_validator(mode="after")
    def _placed_by_its_frame(self) -> OccupancyGridSource:
        if self.mounting.tf_topic is not None:
            raise ValueError("mounting.tf_topic: grid_frame says where a grid is")
        return self


class MavlinkSource(SensorSource):
    """A message on the vehicle's MAVLink link, whose stamps belong to no known clock."""

    latency_s: Annotated[float, Field(ge=0.0, le=1.0)] = Field(
        0.05, description="from measurement to arrival"
    )

    @property
    def measured_within_s(self) -> float:
        """As of every sensor: at any time until it arrives, since it says nothing of that."""
        return max(self.exposure_s, self.latency_s)

    @model_validator(mode="after")
    def _names_no_frame(self) -> MavlinkSource:
        if self.mounting.tf_topic is not None:
            raise ValueError("mounting.tf_topic: messages of MAVLink name no frame of transforms")
        return self


class ObstacleDistanceSource(MavlinkSource):
    """OBSTACLE_DISTANCE: the nearest obstacle in each of 72 sectors."""

    kind: Literal["obstacle_distance"]


class DistanceSensorSource(MavlinkSource):
    """DISTANCE_SENSOR: one beam, of a sensor that looks forward."""

    kind: Literal["distance_sensor"]
    sensor_id: Annotated[int, Field(ge=0, le=255)] | None = Field(
        None, description="of the messages; unset: that of the first one"
    )
    beam_width_deg: Annotated[float, Field(ge=2.0, le=120.0)] = Field(
        3.0, description="where messages do not state it"
    )


class TrafficSource(MavlinkSource):
    """What other vehicles and an ADS-B receiver report on the vehicle's link: movers besides.

    Remote ID (OPEN_DRONE_ID_LOCATION) is logged only.
    """

    kind: Literal["traffic"]
    messages: Annotated[tuple[TrafficMessage, ...], Field(strict=False, min_length=1)]
    mover_class: MoverKind = Field(description="of all that is reported, as the contract names it")
    latency_s: Annotated[float, Field(ge=0.0, le=5.0)] = Field(
        description="from measurement to arrival, at most, where a message does not tell"
    )
    accuracy_m: Annotated[float, Field(gt=0.0, le=100.0)] | None = Field(
        None, description="how far a position may be off of which the message does not say that"
    )
    sigmas: Annotated[float, Field(ge=1.0, le=10.0)] | None = Field(
        None, description="standard deviations that a position of UTM_GLOBAL_POSITION may be off"
    )
    height_m: Annotated[float, Field(gt=0.0, le=10_000.0)] | None = Field(
        None, description="what is farther above or below the vehicle does not count; unset: all do"
    )
    own_icao_address: Annotated[int, Field(ge=0, le=0xFFFFFF)] | None = Field(
        None, description="of the vehicle's own transponder, whose echo is no other vehicle"
    )

    @model_validator(mode="after")
    def _knows_how_far_positions_are_off(self) -> TrafficSource:
        silent = [each for each in self.messages if each in STATE_NO_ACCURACY]
        if silent and self.accuracy_m is None:
            raise ValueError(f"accuracy_m: needed for {silent[0]}, which states none")
        if UTM in self.messages and self.sigmas is None and self.accuracy_m is None:
            raise ValueError(f"sigmas or accuracy_m: needed for {UTM}, which states deviations")
        if self.no_return_is_free_to_m is not None:
            raise ValueError("no_return_is_free_to_m: who does not report may be there")
        return self


class FieldFileSource(SensorSource):
    """Virtual obstacles: those of a field file, seen as a sensor at the vehicle's centre would.

    For first flights in open ground.  Nothing real is seen by it.
    """

    kind: Literal["field_file"]
    field: Annotated[Path, Field(strict=False)] = Field(
        description="obstacle field, YAML or CSV, relative to this file"
    )
    relative_to: Literal["local_ned", "home"] = Field(
        "local_ned",
        description="where its origin lies: the mission's, or where the vehicle is armed",
    )
    range_m: Annotated[float, Field(gt=0.0, le=60.0)] = Field(
        description="within which it sees every obstacle"
    )
    rate_hz: Annotated[float, Field(ge=1.0, le=50.0)] = 20.0
    latency_s: Annotated[float, Field(ge=0.0, le=1.0)] = Field(
        0.05, description="from measurement to arrival"
    )
    beside_real_sensors: bool = Field(
        False, description="permit real sensors, too; otherwise none may be stated, or heard"
    )

    @model_validator(mode="before")
    @classmethod
    def _sees_that_nothing_is_there(cls, data: Any) -> Any:
        """Show free space as far as it sees, unless stated otherwise."""
        if isinstance(data, dict) and isinstance(data.get("range_m"), int | float):
            return {"no_return_is_free_to_m": data["range_m"], **data}
        return data

    @model_validator(mode="after")
    def _is_not_mounted(self) -> FieldFileSource:
        if self.mounting != Mounting():
            raise ValueError("mounting: virtual obstacles are seen from the vehicle's centre")
        return self


AnySource = Annotated[
    LaserScanSource
    | PointCloudSource
    | RangeSource
    | DetectionsSource
    | TrackedObjectsSource
    | OccupancyGridSource
    | ObstacleDistanceSource
    | DistanceSensorSource
    | TrafficSource
    | FieldFileSource,
    Field(discriminator="kind"),
]


def shows_virtual_obstacles(sources: Iterable[SensorSource]) -> bool:
    """Tell whether one of some sensors shows obstacles that are not there."""
    return any(isinstance(source, FieldFileSource) for source in sources)


def excludes_real_sensors(sources: Iterable[SensorSource]) -> bool:
    """Tell whether obstacles that are not there have to be the only ones."""
    return any(
        isinstance(source, FieldFileSource) and not source.beside_real_sensors for source in sources
    )


def with_files_in(base: Path, sources: Iterable[AnySource]) -> tuple[AnySource, ...]:
    """Return sensors whose files are found from anywhere.

    Args:
        base: directory that their paths are relative to.
        sources: the sensors.
    """
    return tuple(
        source.model_copy(update={"field": base / source.field})
        if isinstance(source, FieldFileSource)
        else source
        for source in sources
    )


def only_adds_movers(source: SensorSource) -> bool:
    """Tell whether a source tells of movers and shows nothing, so that no flight relies on it."""
    return isinstance(source, TrackedObjectsSource | TrafficSource)
