"""Ranges along known directions, such as those of a scanning lidar, as levelled beams."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from onboard.files.sensor_sources import SensorSource
from onboard.geometry.frames import FloatArray
from onboard.perception.scan.levelled_beams import LevelledBeams
from onboard.perception.scan.levelling import (
    BodyMotion,
    band_above_ground_m,
    in_sectors,
    mounting_offset_m,
    mounting_rotation,
)

# A body that tilts spreads beams apart; beams that part by more than this leave a gap.
_SPREAD: Final = 1.1
# Beams that point steeper than this say nothing of a bearing.
_FLAT_MIN: Final = 0.1


@dataclass(frozen=True, eq=False)
class BeamDirections:
    """Directions of a sensor's beams in the body, blind sectors left out.

    Attributes:
        used: indices of the beams that are looked at.
        body: (3, used) unit vectors: forward, right, down.
        width_rad: of the sector that each stands for.
        gap_rad: how far beside a beam an obstacle may go unseen: half a width for beams
            that are thin, 0 for sectors whose nearest obstacle is given.
    """

    used: NDArray[np.intp]
    body: FloatArray
    width_rad: float
    gap_rad: float

    @classmethod
    def of_plane(
        cls, angle_rad: FloatArray, width_rad: float, config: SensorSource, *, thin: bool
    ) -> BeamDirections:
        """Return the directions of beams in the sensor's own plane.

        Args:
            angle_rad: (n,) from the sensor's axis, clockwise.
            width_rad: from beam to beam.
            thin: whether a beam sees only along its middle, and not what else is in its sector.
            config: how the sensor is mounted, and what it does not see.
        """
        plane = np.stack((np.cos(angle_rad), np.sin(angle_rad), np.zeros(angle_rad.size)))
        body = mounting_rotation(config.mounting) @ plane
        blind = in_sectors(np.arctan2(body[1], body[0]), config.blind_sectors_deg)
        used = np.flatnonzero(~blind)
        return cls(used, body[:, used], width_rad, width_rad / 2.0 if thin else 0.0)


def levelled_beams(
    ranges_m: FloatArray,
    limits_m: tuple[float, float],
    directions: BeamDirections,
    motion: BodyMotion,
    down_m: float,
    config: SensorSource,
) -> LevelledBeams:
    """Return ranges as beams in the levelled body.

    A range below the limits, or NaN, tells nothing; one above them tells of free space as far as
    ``config`` declares it.  What lies outside of the height band is neither obstacle nor free.

    Args:
        ranges_m: (n,) of every beam.
        limits_m: between which ranges are measurements.
        directions: of the beams that are looked at.
        motion: of the body, for these beams.
        down_m: of the body in local NED.
        config: of the sensor.
    """
    ranges_m = ranges_m[directions.used]
    ray, flat = _rays(directions, motion)
    origin_m = motion.place_m + motion.levelled(mounting_offset_m(config.mounting))
    measured, silent = (ranges_m >= limits_m[0]) & (ranges_m < limits_m[1]), ranges_m >= limits_m[1]
    point_m = origin_m[:2] + np.where(measured, ranges_m, 0.0) * ray[:2]
    own = np.hypot(point_m[0], point_m[1]) < config.own_radius_m
    blocked = np.where(measured, own, ~silent)
    band_m = band_above_ground_m(config, down_m, float(origin_m[2].max()))
    limit_m = np.minimum(_band_exit_m(origin_m[2], ray[2], band_m) * flat, config.range_m)
    along_m = np.where(measured, ranges_m * flat, config.no_return_is_free_to_m or 0.0)
    hit = measured & ~own & (along_m <= limit_m)
    beams = LevelledBeams(
        np.arctan2(ray[1], ray[0]),
        np.full(ranges_m.size, _SPREAD * directions.width_rad),
        hit,
        point_m,
        free_m=np.where(blocked, 0.0, np.minimum(along_m, limit_m)),
        blocked=blocked,
        reach_m=np.where(hit, math.inf, np.minimum(limit_m, limits_m[1] * flat)),
        sensor_m=(float(origin_m[0, 0]), float(origin_m[1, 0])),
        moved_m=float(np.hypot(*(origin_m[:2] - origin_m[:2, :1])).max()),
        gap_rad=directions.gap_rad,
    )
    return beams.chosen(np.flatnonzero(flat > _FLAT_MIN)).sorted()


def _rays(directions: BeamDirections, motion: BodyMotion) -> tuple[FloatArray, FloatArray]:
    """Return the directions in the levelled body, and how much of each lies along the ground."""
    ray = motion.levelled(directions.body)
    return ray, np.hypot(ray[0], ray[1])


def _band_exit_m(
    down_m: FloatArray, steepness: FloatArray, band_m: tuple[float, float]
) -> FloatArray:
    """Return how far along each beam it leaves the height band; 0 if it begins outside."""
    above_m, below_m = band_m
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        exit_m = np.where(
            steepness > 0.0, (below_m - down_m) / steepness, (above_m + down_m) / -steepness
        )
    exit_m[np.broadcast_to(steepness == 0.0, exit_m.shape)] = math.inf
    inside = (down_m >= -above_m) & (down_m <= below_m)
    return np.where(inside, exit_m, 0.0)
