"""Where the daemon shows its obstacles, besides its own keys: ground stations, ROS 2."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from onboard.files.sensor_sources import Topic
from onboard.files.yaml_file import FileModel

Rate = Annotated[float, Field(gt=0.0, le=10.0)]


class ObstacleDistanceOutput(FileModel):
    """MAVLink OBSTACLE_DISTANCE, which ground stations draw.

    An autopilot takes it for a sensor: see docs/sensors.md before it goes through one.
    """

    url: str | None = Field(
        None, description="link to a ground station, such as udpout://192.168.1.20:14550"
    )
    through_autopilot: bool = Field(
        False, description="send it on the vehicle's link instead; its own avoidance may act on it"
    )
    rate_hz: Rate = 2.0

    @model_validator(mode="after")
    def _goes_one_way(self) -> ObstacleDistanceOutput:
        if (self.url is None) is not self.through_autopilot:
            raise ValueError("expected either url or through_autopilot: true")
        return self


class MarkerOutput(FileModel):
    """visualization_msgs/MarkerArray for RViz and Foxglove, over Zenoh.

    Attributes:
        frame_id: of the boxes: east, north, up from the origin of the autopilot's local frame.
    """

    topic: Topic = "/clearway/obstacles"
    middleware: Literal["rmw_zenoh", "zenoh-bridge-ros2dds"] = "rmw_zenoh"
    domain_id: Annotated[int, Field(ge=0, le=232)] = 0
    frame_id: Annotated[str, Field(min_length=1, max_length=64)] = "map"
    rate_hz: Rate = 2.0


class ObstacleOutputs(FileModel):
    """Both are off unless stated."""

    obstacle_distance: ObstacleDistanceOutput | None = None
    markers: MarkerOutput | None = None
