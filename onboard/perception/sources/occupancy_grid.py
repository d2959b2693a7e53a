"""nav_msgs/OccupancyGrid as detection frames."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from onboard.files.sensor_sources import OccupancyGridSource
from onboard.geometry.frames import FloatArray, LegFrame
from onboard.perception.detection import DetectionFrame
from onboard.perception.ros2.cdr import DecodeError
from onboard.perception.ros2.messages import OccupancyGrid, decode_occupancy_grid
from onboard.perception.scan.cloud_beams import BEARINGS_RAD
from onboard.perception.scan.fitted_boxes import fit_boxes
from onboard.perception.scan.free_ranges import BIN_RAD
from onboard.perception.scan.scan_frames import ScanFrames
from onboard.perception.sources.detections3d import rotation_of
from onboard.perception.sources.sensor_input import OneFrameId, PastPoses, SensorInput
from onboard.vehicle_state import Pose

_STEP_MIN_M: Final = 0.05
_CORNERS: Final = np.array([(0, 0), (1, 0), (0, 1), (1, 1)])


class _Placed(NamedTuple):
    """A grid's cells in local NED: corner of cell (0, 0), and a step along each axis of it."""

    corner_ned_m: FloatArray
    x_step_ned_m: FloatArray
    y_step_ned_m: FloatArray


class OccupancyGridInput(SensorInput):
    """Reads OccupancyGrid: occupied cells as boxes, one for each cell of a lattice in local NED.

    Free cells count only as far as ``no_return_is_free_to_m`` allows: what a mapper has cleared is
    not what a sensor sees now.

    Args:
        config: of the sensor.
        poses: of the body.
    """

    def __init__(self, config: OccupancyGridSource, poses: PastPoses) -> None:
        super().__init__()
        self._config, self._poses = config, poses
        self._frames, self._frame_id = ScanFrames(config), OneFrameId(config.frame_id)

    def frames(self, payload: bytes, now_unix_s: float) -> Sequence[DetectionFrame]:  # noqa: ARG002  stamped
        """Decode one grid."""
        config, grid = self._config, decode_occupancy_grid(payload)
        self._frame_id.check(grid.header)
        stamp_unix_s = grid.header.stamp_unix_s
        pose = self._poses.at(stamp_unix_s)
        placed = _placed(grid, pose, config)
        half = math.floor(math.radians(config.field_of_view_deg) / 2.0 / BIN_RAD + 1e-9)
        if half == 0:
            raise DecodeError("does not look ahead")
        bearings_rad = BEARINGS_RAD[BEARINGS_RAD.size // 2 - half :][: 2 * half]
        free_m = _free_m(grid, placed, pose, bearings_rad, config)
        return (
            self._frames.frame_of(
                self._obstacles(grid, placed, pose),
                stamp_unix_s,
                range_m=config.range_m,
                field_of_view_deg=math.degrees(2.0 * half * BIN_RAD),
                free_range_m=tuple(free_m.tolist()),
            ),
        )

    def _obstacles(self, grid: OccupancyGrid, placed: _Placed, pose: Pose) -> list[dict[str, Any]]:
        config, generation = self._config, self._poses.generation
        rows, columns = np.nonzero(grid.cells >= config.occupied_min)
        cells = np.stack((columns, rows), axis=1)
        steps_m = np.stack((placed.x_step_ned_m, placed.y_step_ned_m))
        middles_m = (cells + 0.5) @ steps_m + placed.corner_ned_m
        away_m = np.hypot(*(middles_m - pose.position_ned_m[:2]).T)
        seen = (away_m <= config.range_m) & (away_m >= config.own_radius_m)
        if not seen.any():
            return []
        lattice = np.floor(middles_m[seen] / (config.box_max_m / math.sqrt(2.0))).astype(int)
        names, group = np.unique(lattice, axis=0, return_inverse=True)
        order = np.argsort(group.reshape(-1), kind="stable")
        corners_m = (cells[seen][order, None] + _CORNERS) @ steps_m + placed.corner_ned_m
        counts = np.bincount(group.reshape(-1))
        fitted = fit_boxes(corners_m.reshape(-1, 2), 4 * (np.cumsum(counts) - counts))
        body = LegFrame(pose.position_ned_m, pose.yaw_rad)
        obstacles = []
        for index, (north, east) in enumerate(names.tolist()):
            north_m, east_m = fitted.center_ned_m[index].tolist()
            obstacles.append(
                {
                    "id": f"{generation}.cell{north}_{east}",
                    "center_m": body.position_leg((north_m, east_m, 0.0))[:2],
                    "size_m": tuple(fitted.size_m[index].tolist()),
                    "yaw_deg": math.degrees(float(fitted.yaw_rad[index]) - pose.yaw_rad),
                    "uncertainty_m": config.uncertainty_m,
                    "partial": True,
                }
            )
        return obstacles


def _placed(grid: OccupancyGrid, pose: Pose, config: OccupancyGridSource) -> _Placed:
    turn = rotation_of(grid.origin.rotation)[:2, :2]
    origin_m = np.array(grid.origin.position_m[:2])
    if config.grid_frame == "local_enu":
        ned_from_grid, offset_m = np.array([[0.0, 1.0], [1.0, 0.0]]), np.zeros(2)
    else:
        cosine, sine = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
        # Forward and left.
        ned_from_grid = np.array([[cosine, sine], [sine, -cosine]])
        offset_m = np.array(pose.position_ned_m[:2])
    steps = ned_from_grid @ turn * grid.cell_m
    return _Placed(ned_from_grid @ origin_m + offset_m, steps[:, 0], steps[:, 1])


def _free_m(
    grid: OccupancyGrid,
    placed: _Placed,
    pose: Pose,
    bearings_rad: FloatArray,
    config: OccupancyGridSource,
) -> FloatArray:
    """Return how far all cells around each bearing are free; those beside it as well."""
    limit_m = config.no_return_is_free_to_m
    if limit_m is None:
        return np.zeros(bearings_rad.size)
    step_m = max(grid.cell_m / 2.0, _STEP_MIN_M)
    # A point of a bin is no farther than this from a point that is looked at.
    beside_m = math.hypot(limit_m * BIN_RAD / 2.0, step_m / 2.0)
    free = (grid.cells >= 0) & (grid.cells <= config.free_max)
    for _ in range(math.ceil(beside_m / grid.cell_m)):
        free = _eroded(free)
    distances_m = np.arange(0.0, limit_m + step_m, step_m)
    rays = np.stack((np.cos(bearings_rad + pose.yaw_rad), np.sin(bearings_rad + pose.yaw_rad)))
    points_m = rays[:, :, None] * distances_m + np.array(pose.position_ned_m[:2])[:, None, None]
    points_m -= placed.corner_ned_m[:, None, None]
    steps = np.stack((placed.x_step_ned_m, placed.y_step_ned_m))
    indices = np.einsum("ij,jkl->ikl", steps / grid.cell_m**2, points_m)
    column, row = np.floor(indices).astype(int)
    inside = (column >= 0) & (row >= 0) & (column < free.shape[1]) & (row < free.shape[0])
    is_free = inside & free[np.where(inside, row, 0), np.where(inside, column, 0)]
    blocked = np.where(is_free.all(axis=1), distances_m.size, is_free.argmin(axis=1))
    reached_m = distances_m[np.maximum(blocked - 1, 0)]
    return np.where(blocked > 0, np.minimum(reached_m, limit_m), 0.0)


def _eroded(free: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the cells that are free along with all eight neighbours."""
    padded = np.pad(free, 1)
    rows = padded[:-2] & padded[1:-1] & padded[2:]
    eroded: NDArray[np.bool_] = rows[:, :-2] & rows[:, 1:-1] & rows[:, 2:]
    return eroded
