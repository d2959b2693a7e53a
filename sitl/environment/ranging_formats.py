"""Where the rays of each format look, and how what they measured becomes its message."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from onboard.files.obstacle_field import FloatArray
from sitl.environment.formats.mavlink_ranges import (
    SECTOR_RAD,
    SECTORS,
    distance_sensor,
    obstacle_distance,
)
from sitl.environment.formats.ros2_messages import (
    BeamFan,
    laser_scan,
    point_cloud,
    range_reading,
)
from sitl.environment.sensor import Format, SensorConfig

_FULL_DEG: Final = 360.0


class Measured(NamedTuple):
    """One scan.

    Attributes:
        begin_s: when its first ray was cast.
        ranges_m: (n,), infinite where nothing returned.
        hidden: (n,) rays that meet a part of the vehicle.
        limits_m: between which ranges are measurements.
    """

    begin_s: float
    ranges_m: FloatArray
    hidden: NDArray[np.bool_]
    limits_m: tuple[float, float]


class RangingFormat(Protocol):
    """One format.

    Attributes:
        azimuth_rad: (n,) of the rays, clockwise from the sensor's axis.
        elevation_rad: (n,) above its plane.
        shares: (n,) when each ray is cast, from 0 to 1 of the scan's time.
    """

    azimuth_rad: FloatArray
    elevation_rad: FloatArray
    shares: FloatArray

    def message(self, scan: Measured, start_unix_s: float, frame_id: str) -> Any:
        """Return CDR, or a message of pymavlink.

        Args:
            scan: what was measured.
            start_unix_s: Unix time at time zero.
            frame_id: for the header.
        """
        ...


def _fan_rad(view_deg: float, resolution_deg: float) -> FloatArray:
    """Return angles counter-clockwise; a full turn begins and ends half a step from behind."""
    count = max(round(view_deg / resolution_deg), 1)
    if view_deg >= _FULL_DEG:
        return (np.arange(count, dtype=np.float64) + 0.5) * (2.0 * math.pi / count) - math.pi
    half_rad = math.radians(view_deg) / 2.0
    return np.linspace(-half_rad, half_rad, count + 1)


class LaserScanFormat:
    """sensor_msgs/LaserScan: one ray after another, counter-clockwise.

    Args:
        config: of the sensor.
    """

    def __init__(self, config: SensorConfig) -> None:
        angles_rad = _fan_rad(config.field_of_view_deg, config.beams.resolution_deg)
        self.azimuth_rad, self.elevation_rad = -angles_rad, np.zeros_like(angles_rad)
        self.shares = np.arange(len(angles_rad)) / len(angles_rad)
        self._fan = BeamFan(
            float(angles_rad[0]),
            float(angles_rad[1] - angles_rad[0]),
            config.beams.scan_time_s / len(angles_rad),
            1.0 / config.rate_hz,
            config.beams.range_min_m,
            config.range_m,
        )

    def message(self, scan: Measured, start_unix_s: float, frame_id: str) -> bytes:
        """Return CDR."""
        return laser_scan(start_unix_s + scan.begin_s, frame_id, self._fan, scan.ranges_m)


class PointCloudFormat:
    """sensor_msgs/PointCloud2: columns of rays, counter-clockwise, each cast at once.

    Args:
        config: of the sensor.
    """

    def __init__(self, config: SensorConfig) -> None:
        beams = config.beams
        columns_rad = _fan_rad(config.field_of_view_deg, beams.resolution_deg)
        half_rad = math.radians(beams.lines_view_deg) / 2.0 if beams.lines > 1 else 0.0
        lines_rad = np.linspace(-half_rad, half_rad, beams.lines)
        self.azimuth_rad = np.repeat(-columns_rad, beams.lines)
        self.elevation_rad = np.tile(lines_rad, len(columns_rad))
        self.shares = np.repeat(np.arange(len(columns_rad)) / len(columns_rad), beams.lines)
        flat = np.cos(self.elevation_rad)
        self._rays_flu = np.stack(
            (
                flat * np.cos(self.azimuth_rad),
                -flat * np.sin(self.azimuth_rad),
                np.sin(self.elevation_rad),
            ),
            axis=1,
        )

    def message(self, scan: Measured, start_unix_s: float, frame_id: str) -> bytes:
        """Return CDR with the points that returned."""
        returned = np.isfinite(scan.ranges_m) & (scan.ranges_m >= scan.limits_m[0])
        points_m = scan.ranges_m[returned, None] * self._rays_flu[returned]
        return point_cloud(start_unix_s + scan.begin_s, frame_id, points_m)


class ObstacleDistanceFormat:
    """OBSTACLE_DISTANCE: the nearest return in each of 72 sectors, parts of the vehicle left out.

    Args:
        config: of the sensor.
    """

    def __init__(self, config: SensorConfig) -> None:
        angles_rad = _fan_rad(config.field_of_view_deg, config.beams.resolution_deg)
        self.azimuth_rad, self.elevation_rad = -angles_rad, np.zeros_like(angles_rad)
        self.shares = np.arange(len(angles_rad)) / len(angles_rad)
        self._sectors = np.round(self.azimuth_rad / SECTOR_RAD).astype(int) % SECTORS

    def message(self, scan: Measured, start_unix_s: float, frame_id: str) -> Any:  # noqa: ARG002  has neither
        """Return a message of pymavlink."""
        unknown = scan.hidden | (scan.ranges_m < scan.limits_m[0])
        ranges_m = np.where(unknown, math.nan, scan.ranges_m)
        return obstacle_distance(scan.begin_s, self._sectors, ranges_m, scan.limits_m)


class ConeFormat:
    """sensor_msgs/Range or DISTANCE_SENSOR: the nearest return in a cone.

    Args:
        config: of the sensor.
    """

    def __init__(self, config: SensorConfig) -> None:
        self._view_rad = math.radians(config.field_of_view_deg)
        self.azimuth_rad = -_fan_rad(config.field_of_view_deg, config.beams.resolution_deg)
        self.elevation_rad = np.zeros_like(self.azimuth_rad)
        self.shares = np.zeros_like(self.azimuth_rad)
        self._over_link = config.publishes == "distance_sensor"

    def message(self, scan: Measured, start_unix_s: float, frame_id: str) -> Any:
        """Return CDR, or a message of pymavlink."""
        nearest_m = float(scan.ranges_m.min())
        if self._over_link:
            return distance_sensor(scan.begin_s, nearest_m, self._view_rad, scan.limits_m)
        return range_reading(
            start_unix_s + scan.begin_s,
            frame_id,
            nearest_m,
            view_rad=self._view_rad,
            limits_m=scan.limits_m,
        )


FORMATS: Final[dict[Format, Callable[[SensorConfig], RangingFormat]]] = {
    "laserscan": LaserScanFormat,
    "pointcloud2": PointCloudFormat,
    "range": ConeFormat,
    "obstacle_distance": ObstacleDistanceFormat,
    "distance_sensor": ConeFormat,
}
