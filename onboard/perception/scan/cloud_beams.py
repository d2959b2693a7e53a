"""Points around a sensor as levelled beams: the nearest that is at the vehicle's height.

Points outside the height band go; the rest is counted in upright square cells, so that the work
after that does not depend on their number.  In each bearing the nearest cell that holds enough
points is an obstacle; a cell with fewer is none, but nothing behind it is free either.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from onboard.files.sensor_sources import SensorSource
from onboard.geometry.frames import FloatArray
from onboard.perception.scan.free_ranges import BIN_RAD
from onboard.perception.scan.levelled_beams import BoolArray, LevelledBeams
from onboard.perception.scan.levelling import in_sectors, is_in_band

CELL_M: Final = 0.05
_NOWHERE_M: Final = 0.01
_BINS: Final = round(2.0 * math.pi / BIN_RAD)
BEARINGS_RAD: Final[FloatArray] = (np.arange(_BINS, dtype=np.float64) + 0.5) * BIN_RAD - math.pi

Floats32 = NDArray[np.float32]


def covered_bearings(
    level_from_sensor: FloatArray, view_deg: tuple[float, float], config: SensorSource
) -> BoolArray:
    """Tell of each of `BEARINGS_RAD` whether the sensor looks there, at its own height.

    Args:
        level_from_sensor: rotation (3, 3) from the sensor, forward, right, down.
        view_deg: of the sensor, across and up and down.
        config: of the sensor.
    """
    level = np.stack((np.cos(BEARINGS_RAD), np.sin(BEARINGS_RAD), np.zeros(_BINS)))
    forward, right, down = level_from_sensor.T @ level
    across_rad, up_rad = (math.radians(angle_deg) / 2.0 for angle_deg in view_deg)
    seen: BoolArray = np.abs(np.arctan2(right, forward)) <= across_rad
    seen &= np.abs(np.arcsin(np.clip(down, -1.0, 1.0))) <= up_rad
    return seen & ~in_sectors(BEARINGS_RAD, config.blind_sectors_deg)


def cloud_beams(
    points_m: Floats32,
    level_from_points: FloatArray,
    sensor_m: FloatArray,
    covered: BoolArray,
    band_m: tuple[float, float],
    config: SensorSource,
) -> LevelledBeams:
    """Return a cloud as beams, one for each bearing that is covered.

    Args:
        points_m: (3, n) in the axes of the message; NaN where nothing was measured.
        level_from_points: (3, 3) from those axes into the levelled body.
        sensor_m: (3,) where the sensor is in it.
        covered: of each bearing, see `covered_bearings`.
        band_m: heights above and below the vehicle that are looked at; from outside, 0 m far.
        config: of the sensor.
    """
    middle_m, count = _filled_cells(points_m, level_from_points, sensor_m, band_m, config)
    away_m = np.hypot(middle_m[0], middle_m[1])
    own = np.hypot(middle_m[0] + sensor_m[0], middle_m[1] + sensor_m[1]) < config.own_radius_m
    near_m = np.maximum(away_m - CELL_M / math.sqrt(2.0), 0.0)
    seen = ~own & (near_m < config.range_m)
    owner = _nearest(middle_m, away_m, np.flatnonzero(seen & (count >= config.points_min)))
    first_m = _distances(near_m, _nearest(middle_m, away_m, np.flatnonzero(seen)))
    hit = (owner >= 0) & ~in_sectors(BEARINGS_RAD, config.blind_sectors_deg)
    hidden = _nearest(middle_m, away_m, np.flatnonzero(own)) >= 0
    range_m = config.range_m if is_in_band(float(sensor_m[2]), band_m) else 0.0
    silent_m = min(config.no_return_is_free_to_m or 0.0, range_m)
    # Up to the first point, whether or not it is of an obstacle.
    free_m = np.where(np.isfinite(first_m), np.minimum(first_m, range_m), silent_m)
    beams = LevelledBeams(
        BEARINGS_RAD,
        np.full(_BINS, BIN_RAD),
        hit,
        middle_m[:, owner] + np.asarray(sensor_m[:2])[:, None]
        if count.size
        else np.zeros((2, _BINS)),
        np.where(hidden | ~covered, 0.0, free_m),
        hidden,
        np.where(hit, math.inf, range_m),
        (float(sensor_m[0]), float(sensor_m[1])),
        point_error_m=CELL_M / math.sqrt(2.0),
    )
    return beams.chosen(np.flatnonzero(covered | hit))


def _filled_cells(
    points_m: Floats32,
    level_from_points: FloatArray,
    sensor_m: FloatArray,
    band_m: tuple[float, float],
    config: SensorSource,
) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return the middles (2, k) of cells with points at the vehicle's height, and how many.

    They are forward and right of the sensor, in the levelled body.
    """
    turn = level_from_points.astype(np.float32)
    above_m, below_m = band_m
    half = math.ceil(config.range_m / CELL_M) + 1
    side = 2 * half
    with np.errstate(invalid="ignore", over="ignore"):
        # Written out: for three rows BLAS takes ten times longer, in threads of its own.
        x_m, y_m, down_m = (a * points_m[0] + b * points_m[1] + c * points_m[2] for a, b, c in turn)
        # NaN compares false.
        kept = (down_m >= np.float32(-above_m - sensor_m[2])) & (
            down_m <= np.float32(below_m - sensor_m[2])
        )
        limit_m = np.float32(config.range_m)
        kept &= (np.abs(x_m) <= limit_m) & (np.abs(y_m) <= limit_m)
        # Drivers write zeros where nothing was measured.
        kept &= np.abs(x_m) + np.abs(y_m) + np.abs(down_m) > np.float32(_NOWHERE_M)
        scale, offset = np.float32(1.0 / CELL_M), np.float32(half)
        row = (x_m * scale + offset).astype(np.int32)
        cell = row * np.int32(side) + (y_m * scale + offset).astype(np.int32)
    count = np.bincount(cell[kept], minlength=side * side)
    filled = np.flatnonzero(count)
    middle_m = (np.stack(np.divmod(filled, side)) - half + 0.5) * CELL_M
    return middle_m, count[filled]


def _nearest(middle_m: FloatArray, away_m: FloatArray, among: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return for each bearing the nearest of some cells that reaches into it; -1 without one."""
    owner = np.full(_BINS, -1)
    # The farthest first: what is nearer overwrites it.
    among = among[np.argsort(-away_m[among], kind="stable")]
    away_m = away_m[among]
    middle_rad = np.arctan2(middle_m[1, among], middle_m[0, among])
    half_rad = np.arcsin(np.minimum(CELL_M / math.sqrt(2.0) / np.maximum(away_m, 1e-9), 1.0))
    first = np.floor((middle_rad - half_rad + math.pi) / BIN_RAD).astype(int)
    spans = np.floor((middle_rad + half_rad + math.pi) / BIN_RAD).astype(int) - first + 1
    spans = np.minimum(spans, _BINS)
    pair = np.repeat(np.arange(among.size), spans)
    step = np.arange(pair.size) - np.repeat(np.cumsum(spans) - spans, spans)
    owner[(first[pair] + step) % _BINS] = among[pair]
    return owner


def _distances(near_m: FloatArray, owner: NDArray[np.intp]) -> FloatArray:
    if near_m.size == 0:
        return np.full(owner.shape, math.inf)
    return np.where(owner >= 0, near_m[owner], math.inf)
