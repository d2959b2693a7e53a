"""A scanning range finder in the plane: rays, what they hit, and boxes around clusters of hits.

Rays reach only the near faces, so that an object seen from one side is reported as thin as that
side, and an object behind another is not reported at all.  Identities follow from the positions of
the boxes in the previous scan, as in a tracker.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterator
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from onboard.files.obstacle_field import FloatArray, ObstacleField
from onboard.files.yaml_file import FileModel
from sitl.environment.world import IndexArray

Point = tuple[float, float]

_THICKNESS_MIN_M = 0.02  # of a face
_CLOSE_M = 0.02  # closer to an edge than this is on it
_FIT_STEP_RAD = math.radians(1.0)
_RAYS_PER_GAP = 3.0  # neighbouring hits this many ray spacings apart still belong together
Degrees = Annotated[float, Field(ge=-180.0, le=180.0)]


class ScannerConfig(FileModel):
    """What a scanner adds to a detector's range, view, rate and latency.

    Attributes:
        resolution_deg: angle between rays.
        range_noise_m: standard deviation of a measured range.
        dropout: share of rays that return nothing.
        blind_sectors_deg: (from, to) about the sensor's axis, clockwise, without rays.
        cluster_gap_m: hits farther apart belong to different objects.
        points_min: clusters of fewer hits count as noise.
        scan_time_s: from the first ray to the last, while the vehicle moves on; for formats other
            than ``json``, whose scans take no time.
        range_min_m: nearer than this nothing is measured; for the same formats.
        lines: above one another, of a ``pointcloud2``.
        lines_view_deg: from the lowest line to the highest.
    """

    resolution_deg: Annotated[float, Field(ge=0.05, le=10.0)] = 0.5
    range_noise_m: Annotated[float, Field(ge=0.0)] = 0.0
    dropout: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0
    blind_sectors_deg: Annotated[
        tuple[Annotated[tuple[Degrees, Degrees], Field(strict=False)], ...], Field(strict=False)
    ] = ()
    cluster_gap_m: Annotated[float, Field(gt=0.0)] = 0.5
    points_min: Annotated[int, Field(ge=1)] = 2
    scan_time_s: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    range_min_m: Annotated[float, Field(gt=0.0, le=2.0)] = 0.1
    lines: Annotated[int, Field(ge=1, le=128)] = 8
    lines_view_deg: Annotated[float, Field(ge=0.0, le=120.0)] = 40.0


class View(NamedTuple):
    """What a scan covers: position (north, east), axis, opening angle, range."""

    position_ned_m: Point
    axis_rad: float
    opening_rad: float
    range_m: float


class SeenBox(NamedTuple):
    """One detection in local NED: centre (north, east), extents before rotation, rotation.

    With its top and bottom, where the sensor reports them.
    """

    id: str
    center_ned_m: Point
    size_m: Point
    yaw_rad: float
    down_m: Point | None = None


class RangeScanner:
    """Turn the obstacles of a field into detections, one scan after another."""

    def __init__(self, config: ScannerConfig, field: ObstacleField, noise: random.Random) -> None:
        self._config = config
        self._field = field
        self._noise = np.random.default_rng(noise.getrandbits(64))
        self._seen: list[SeenBox] = []
        self._named = 0

    def scan(self, view: View, candidates: IndexArray) -> list[SeenBox]:
        """Return the boxes of one scan.

        Args:
            view: the sensor.
            candidates: indices of the obstacles that may be within range.
        """
        angles_rad = self._angles_rad(view.opening_rad)
        bearings_rad = view.axis_rad + angles_rad
        ranges_m = ray_ranges_m(view.position_ned_m, bearings_rad, self._field, candidates)
        hit = (ranges_m <= view.range_m) & (
            self._noise.random(len(ranges_m)) >= self._config.dropout
        )
        error_m = self._noise.normal(0.0, self._config.range_noise_m, len(ranges_m))
        ranges_m = np.where(hit, ranges_m + error_m, 0.0)
        points_ned_m = np.asarray(view.position_ned_m) + ranges_m[:, None] * np.column_stack(
            (np.cos(bearings_rad), np.sin(bearings_rad))
        )
        full_circle = view.opening_rad > 2.0 * math.pi - 1e-6
        clusters = self._clusters(points_ned_m, ranges_m, hit, full_circle=full_circle)
        self._seen = self._named_boxes([points_ned_m[cluster] for cluster in clusters])
        return self._seen

    def _angles_rad(self, opening_rad: float) -> FloatArray:
        """Directions of the rays about the axis, blind sectors left out."""
        count = max(2, round(opening_rad / math.radians(self._config.resolution_deg)) + 1)
        angles = np.linspace(-opening_rad / 2.0, opening_rad / 2.0, count)
        for first_deg, last_deg in self._config.blind_sectors_deg:
            first, width = math.radians(first_deg), math.radians(last_deg - first_deg)
            into = np.mod(angles - first, 2.0 * math.pi)
            angles = angles[into > width % (2.0 * math.pi)]
        return angles

    def _clusters(
        self,
        points_m: FloatArray,
        ranges_m: FloatArray,
        hit: NDArray[np.bool_],
        *,
        full_circle: bool,
    ) -> Iterator[IndexArray]:
        """Cut the hits, in the order of their rays, wherever neighbours are too far apart."""
        indices = np.flatnonzero(hit)
        if len(indices) == 0:
            return
        spacing = _RAYS_PER_GAP * math.radians(self._config.resolution_deg)
        following = np.roll(indices, -1)
        gap_m = np.hypot(*(points_m[following] - points_m[indices]).T)
        near = np.minimum(ranges_m[indices], ranges_m[following])
        parted = gap_m > np.maximum(self._config.cluster_gap_m, spacing * near)
        if full_circle and parted.any():  # start where something ends, not behind the vehicle
            shift = int(np.flatnonzero(parted)[-1]) + 1
            indices, parted = np.roll(indices, -shift), np.roll(parted, -shift)
        for cluster in np.split(indices, np.flatnonzero(parted[:-1]) + 1):
            if len(cluster) >= self._config.points_min:
                yield cluster

    def _named_boxes(self, clusters: list[FloatArray]) -> list[SeenBox]:
        """Box each cluster; it has the name of the box that was there before, if one was."""
        boxes = []
        unclaimed = list(self._seen)
        for points_ned_m in clusters:
            center, size, yaw_rad = enclosing_box(points_ned_m)
            reach_m = self._config.cluster_gap_m + 0.5 * math.hypot(*size)
            known = _nearest(unclaimed, center)
            if known is not None and math.dist(known.center_ned_m, center) <= reach_m:
                unclaimed.remove(known)
                name = known.id
            else:
                self._named += 1
                name = f"scan-{self._named}"
            boxes.append(SeenBox(name, center, size, yaw_rad))
        return boxes


def _nearest(boxes: list[SeenBox], point: Point) -> SeenBox | None:
    return min(boxes, key=lambda box: math.dist(box.center_ned_m, point), default=None)


def ray_ranges_m(
    origin_ned_m: Point | FloatArray,
    bearings_rad: FloatArray,
    field: ObstacleField,
    candidates: IndexArray,
) -> FloatArray:
    """Return the distance at which each ray first meets one of the boxes; ``inf`` if it does not.

    The slab method in each box's own axes; (R,) bearings and N boxes -> (R,).  A ray from inside a
    box meets it at once.

    Args:
        origin_ned_m: north and east of all rays, or (R, 2) of each.
        bearings_rad: of the rays.
        field: the boxes.
        candidates: indices of those that a ray may meet.
    """
    starts_m = np.atleast_2d(np.asarray(origin_ned_m))
    ray, box = _pairs_that_may_meet(starts_m, bearings_rad, field, candidates)
    yaw_rad = field.yaw_rad[box]
    cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
    north_m, east_m = (starts_m[ray % len(starts_m)] - field.center_ned_m[box]).T
    start = np.stack((cosine * north_m + sine * east_m, cosine * east_m - sine * north_m))
    relative = bearings_rad[ray] - yaw_rad
    direction = np.stack((np.cos(relative), np.sin(relative)))
    half = field.half_size_m[box].T
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        one = (-half - start) / direction
        other = (half - start) / direction
    enter = np.nan_to_num(np.minimum(one, other), nan=-np.inf).max(axis=0)
    leave = np.nan_to_num(np.maximum(one, other), nan=np.inf).min(axis=0)
    meets = (enter <= leave) & (leave >= 0.0)
    nearest: FloatArray = np.full(len(bearings_rad), np.inf)
    np.minimum.at(nearest, ray[meets], np.maximum(enter[meets], 0.0))
    return nearest


def _pairs_that_may_meet(
    starts_m: FloatArray, bearings_rad: FloatArray, field: ObstacleField, candidates: IndexArray
) -> tuple[IndexArray, IndexArray]:
    """Return each ray with each box whose circumscribed circle it may meet; few of them do."""
    offset_m = field.center_ned_m[candidates] - starts_m[0]
    away_m = np.hypot(offset_m[:, 0], offset_m[:, 1])
    spread_m = float(np.hypot(*(starts_m - starts_m[0]).T).max())
    reach_m = np.hypot(*field.half_size_m[candidates].T) + spread_m + _CLOSE_M
    aside = np.minimum(reach_m / np.maximum(away_m, 1e-9), 1.0)
    # Within this angle of the middle; from within the circle, in any direction.
    least = np.where(aside < 1.0, np.sqrt(1.0 - aside**2), -2.0)
    rays = np.column_stack((np.cos(bearings_rad), np.sin(bearings_rad)))
    toward = offset_m / np.maximum(away_m, 1e-9)[:, None]
    ray, among = np.nonzero(rays @ toward.T >= least)
    return ray, candidates[among]


def enclosing_box(points_m: FloatArray) -> tuple[Point, Point, float]:
    """Return centre, extents and rotation of the rectangle around (N, 2) points that fits best.

    Best is where most points lie close to an edge: the closeness criterion of Zhang et al.,
    "Efficient L-shape fitting for vehicle detection using laser scanners", 2017.
    """
    angles = np.arange(0.0, math.pi / 2.0, _FIT_STEP_RAD)
    along = np.outer(np.cos(angles), points_m[:, 0]) + np.outer(np.sin(angles), points_m[:, 1])
    across = np.outer(np.cos(angles), points_m[:, 1]) - np.outer(np.sin(angles), points_m[:, 0])
    inside = np.minimum(_inside_m(along), _inside_m(across))
    best = int(np.argmax((1.0 / np.maximum(inside, _CLOSE_M)).sum(axis=1)))
    middle_along = (along[best].max() + along[best].min()) / 2.0
    middle_across = (across[best].max() + across[best].min()) / 2.0
    cosine, sine = math.cos(angles[best]), math.sin(angles[best])
    center = (
        float(cosine * middle_along - sine * middle_across),
        float(sine * middle_along + cosine * middle_across),
    )
    length, width = (max(float(np.ptp(axis[best])), _THICKNESS_MIN_M) for axis in (along, across))
    return center, (length, width), float(angles[best])


def _inside_m(coordinates_m: FloatArray) -> FloatArray:
    """How far each coordinate lies from the nearer end of its row; (A, N) -> (A, N)."""
    low, high = coordinates_m.min(axis=1, keepdims=True), coordinates_m.max(axis=1, keepdims=True)
    nearer: FloatArray = np.minimum(coordinates_m - low, high - coordinates_m)
    return nearer
