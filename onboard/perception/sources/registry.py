"""From a daemon's file to the inputs of its sensors: what is read by what."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

from pymavlink.dialects.v20 import common as mavlink

from onboard.files.sensor_sources import (
    AnySource,
    DetectionsSource,
    DistanceSensorSource,
    FieldFileSource,
    LaserScanSource,
    MavlinkSource,
    ObstacleDistanceSource,
    OccupancyGridSource,
    PointCloudSource,
    RangeSource,
    Ros2Source,
    SensorSource,
    TrackedObjectsSource,
    TrafficSource,
)
from onboard.perception.detection import MAX_PENDING_FRAMES
from onboard.perception.ros2.keys import OnePublisher, check_key, key_expression
from onboard.perception.sources.detections3d import DetectionsInput
from onboard.perception.sources.field_file import FieldFileInput
from onboard.perception.sources.laser_scan import LaserScanInput, RangeInput
from onboard.perception.sources.mavlink_ranges import DistanceSensorInput, ObstacleDistanceInput
from onboard.perception.sources.mounted_by_transforms import MountedByTransforms
from onboard.perception.sources.occupancy_grid import OccupancyGridInput
from onboard.perception.sources.point_cloud import PointCloudInput
from onboard.perception.sources.sensor_input import PastPoses, SensorInput
from onboard.perception.sources.tracked_objects import TrackedObjectsInput
from onboard.perception.sources.traffic import ORIGIN, TRAFFIC_IDS, TrafficInput

TRANSFORMS: Final = "tf2_msgs/TFMessage"
TYPE_NAMES: Final = {
    "laserscan": "sensor_msgs/LaserScan",
    "pointcloud2": "sensor_msgs/PointCloud2",
    "range": "sensor_msgs/Range",
    "detection3d": "vision_msgs/Detection3DArray",
    "tracked_objects": "autoware_perception_msgs/TrackedObjects",
    "occupancygrid": "nav_msgs/OccupancyGrid",
}
MAVLINK_IDS: Final = {
    "obstacle_distance": mavlink.MAVLINK_MSG_ID_OBSTACLE_DISTANCE,
    "distance_sensor": mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR,
}
MAVLINK_NAMES: Final = {
    "obstacle_distance": "OBSTACLE_DISTANCE",
    "distance_sensor": "DISTANCE_SENSOR",
    "traffic": "messages of other vehicles",
}
_INPUTS: Final[dict[type[SensorSource], Callable[[Any, PastPoses], SensorInput]]] = {
    LaserScanSource: LaserScanInput,
    PointCloudSource: PointCloudInput,
    RangeSource: RangeInput,
    DetectionsSource: DetectionsInput,
    TrackedObjectsSource: TrackedObjectsInput,
    OccupancyGridSource: OccupancyGridInput,
    ObstacleDistanceSource: ObstacleDistanceInput,
    DistanceSensorSource: DistanceSensorInput,
    TrafficSource: TrafficInput,
    FieldFileSource: FieldFileInput,
}
# Large messages wait at most so many deep, and one of them is read per tick.
LARGE_PENDING_MAX: Final = 2
# A receiver of ADS-B reports all vehicles at once.
TRAFFIC_PENDING_MAX: Final = 256
_LARGE: Final = ("pointcloud2", "occupancygrid")


@dataclass
class Sensor:
    """One sensor of a daemon's file.

    Attributes:
        config: its keys.
        input: what reads it.
        publishers: who may publish it.
    """

    config: AnySource
    input: SensorInput
    publishers: OnePublisher = field(default_factory=OnePublisher)

    @property
    def is_large(self) -> bool:
        """Whether its messages are large."""
        return self.config.kind in _LARGE

    @property
    def pending_max(self) -> int:
        """How many of its messages wait at most."""
        if isinstance(self.config, TrafficSource):
            return TRAFFIC_PENDING_MAX
        return LARGE_PENDING_MAX if self.is_large else MAX_PENDING_FRAMES

    def check_sample(self, key: str, attachment: bytes, now_s: float) -> None:
        """Check where a Zenoh sample comes from.

        Raises:
            DecodeError: it is of another type, or of a second publisher.
        """
        if not zenoh_key(self.config):
            return
        if getattr(self.config, "middleware", "") == "rmw_zenoh":
            check_key(key, TYPE_NAMES[self.config.kind])
        self.publishers.check(attachment, now_s)


def mavlink_ids_of(config: AnySource) -> frozenset[int]:
    """Return the ids of the messages on the vehicle's link that a sensor reads."""
    if isinstance(config, TrafficSource):
        return frozenset((ORIGIN, *(TRAFFIC_IDS[each] for each in config.messages)))
    number = MAVLINK_IDS.get(config.kind)
    return frozenset() if number is None else frozenset((number,))


def zenoh_key(config: AnySource) -> str | None:
    """Return the Zenoh key expression of a sensor; None for one that is not on Zenoh."""
    if isinstance(config, MavlinkSource | FieldFileSource):
        return None
    bridged = config.middleware != "rmw_zenoh"
    name = TYPE_NAMES[config.kind]
    return key_expression(config.topic, name, bridged=bridged, domain=config.domain_id)


def transforms_key(config: AnySource) -> str | None:
    """Return the Zenoh key expression of the transforms that mount a sensor; None without them."""
    topic = config.mounting.tf_topic
    if topic is None or not isinstance(config, Ros2Source):
        return None
    bridged = config.middleware != "rmw_zenoh"
    return key_expression(topic, TRANSFORMS, bridged=bridged, domain=config.domain_id)


def sensor(config: AnySource, poses: PastPoses) -> Sensor:
    """Return the sensor of some keys."""
    reader = _INPUTS[type(config)]
    if isinstance(config, Ros2Source) and config.mounting.tf_topic is not None:
        return Sensor(config, MountedByTransforms(config, poses, reader))
    return Sensor(config, reader(config, poses))
