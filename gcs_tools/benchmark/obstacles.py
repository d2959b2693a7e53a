"""True obstacles of a field: pillars with round or rectangular sections, and what a sensor sees."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from onboard.geometry.box import Box

Floats = NDArray[np.float64]
Ints = NDArray[np.int_]

_RAYS_PER_DEGREE = 8


@dataclass(frozen=True, eq=False)
class Obstacles:
    """Rectangles with rounded corners in one frame; a stem is a point with a radius.

    Attributes:
        centre_m: (n, 2).
        half_m: (n, 2), half extents of the rectangle that the radius grows.
        turn_rad: (n,), of the rectangle.
        radius_m: (n,).
    """

    centre_m: Floats
    half_m: Floats
    turn_rad: Floats
    radius_m: Floats

    @classmethod
    def stems(cls, centre_m: Floats, radius_m: Floats) -> Self:
        """Return round pillars."""
        return cls(centre_m, np.zeros_like(centre_m), np.zeros(len(centre_m)), radius_m)

    @classmethod
    def boxes(cls, faces_m: Floats) -> Self:
        """Return axis-aligned pillars from (n, 4): x min, x max, y min, y max."""
        low, high = faces_m[:, (0, 2)], faces_m[:, (1, 3)]
        count = len(faces_m)
        return cls((low + high) / 2.0, (high - low) / 2.0, np.zeros(count), np.zeros(count))

    def along_leg(self, start_m: Floats, heading_rad: float) -> Self:
        """Return the obstacles in the frame of a leg."""
        c, s = math.cos(heading_rad), math.sin(heading_rad)
        turned = (self.centre_m - start_m) @ np.array(((c, -s), (s, c)))
        return type(self)(turned, self.half_m, self.turn_rad - heading_rad, self.radius_m)

    def chosen(self, which: NDArray[np.bool_]) -> Self:
        """Return some of them."""
        return type(self)(
            self.centre_m[which], self.half_m[which], self.turn_rad[which], self.radius_m[which]
        )

    def distance_m(self, points_m: Floats) -> Floats:
        """Return the distance of each point (k, 2) to the nearest face, (k,); negative inside."""
        least = np.full(len(points_m), math.inf)
        if not len(self.radius_m):
            return least
        local = np.abs(self._local(points_m)) - self.half_m
        outside = np.hypot(*np.maximum(local, 0.0).transpose(2, 0, 1))
        inside = np.minimum(local.max(axis=2), 0.0)
        nearest: Floats = (outside + inside - self.radius_m).min(axis=1)
        return nearest

    def toward_nearest(self, points_m: Floats, error_m: float) -> Floats:
        """Return the points moved by the tracking error toward the nearest obstacle of each."""
        if not len(self.radius_m):
            return points_m
        local = self._local(points_m)
        beyond = local - np.clip(local, -self.half_m, self.half_m)
        distance_m = np.hypot(*beyond.transpose(2, 0, 1))
        nearest = (distance_m - self.radius_m).argmin(axis=1)
        rows = np.arange(len(points_m))
        away = beyond[rows, nearest] / np.maximum(distance_m[rows, nearest], 1e-9)[:, None]
        c, s = np.cos(self.turn_rad[nearest]), np.sin(self.turn_rad[nearest])
        world = np.stack((c * away[:, 0] - s * away[:, 1], s * away[:, 0] + c * away[:, 1]), axis=1)
        return points_m - error_m * world

    def reports(self, rng: np.random.Generator, face_error_m: float) -> list[Box]:
        """Return the enclosing box of each, every face wrong by up to an error."""
        c, s = np.abs(np.cos(self.turn_rad)), np.abs(np.sin(self.turn_rad))
        half_x = c * self.half_m[:, 0] + s * self.half_m[:, 1] + self.radius_m
        half_y = s * self.half_m[:, 0] + c * self.half_m[:, 1] + self.radius_m
        half = np.stack((half_x, half_y), axis=1)
        error = rng.uniform(-face_error_m, face_error_m, (2, *half.shape))
        low, high = self.centre_m - half + error[0], self.centre_m + half + error[1]
        middle = (low + high) / 2.0
        low, high = np.minimum(low, middle), np.maximum(high, middle)
        return [Box(a[0], b[0], a[1], b[1]) for a, b in zip(low, high, strict=True)]

    def visible(
        self, position_m: tuple[float, float], heading_rad: float, half_rad: float, range_m: float
    ) -> Ints:
        """Return the indices of the obstacles that some ray of the sensor hits first."""
        origin = np.array(position_m)
        reach = np.hypot(*(self.centre_m - origin).T) - np.hypot(*self.half_m.T) - self.radius_m
        near = np.flatnonzero(reach <= range_m)
        if not near.size:
            return near
        count = int(math.degrees(2.0 * half_rad) * _RAYS_PER_DEGREE) + 1
        angles = np.linspace(heading_rad - half_rad, heading_rad + half_rad, count)
        depth = self.chosen(np.isin(np.arange(len(reach)), near)).ray_depths_m(origin, angles)
        first = depth.argmin(axis=0)
        hit = depth[first, np.arange(count)] <= range_m
        found: Ints = near[np.unique(first[hit])]
        return found

    def ray_depths_m(self, origin: Floats, angles: Floats) -> Floats:
        """Return the way along each ray to each obstacle, (n, rays); infinite for a miss."""
        start = self._local(origin[None])[0]
        local = angles[None] - self.turn_rad[:, None]
        dx, dy = np.cos(local), np.sin(local)
        along = start[:, :1] * dx + start[:, 1:] * dy
        root = along**2 - (start**2).sum(axis=1, keepdims=True) + self.radius_m[:, None] ** 2
        round_depth = -along - np.sqrt(np.maximum(root, 0.0))
        is_round = self.half_m.max(axis=1, keepdims=True) == 0.0
        depth = np.where((root >= 0.0) & (round_depth >= 0.0) & is_round, round_depth, math.inf)
        enter = np.full(dx.shape, -math.inf)
        leave = np.full(dx.shape, math.inf)
        for axis, direction in enumerate((dx, dy)):
            safe = np.where(np.abs(direction) < 1e-12, 1e-12, direction)
            one = (-self.half_m[:, axis, None] - start[:, axis, None]) / safe
            other = (self.half_m[:, axis, None] - start[:, axis, None]) / safe
            enter = np.maximum(enter, np.minimum(one, other))
            leave = np.minimum(leave, np.maximum(one, other))
        met = (enter <= leave) & (enter >= 0.0) & ~is_round
        result: Floats = np.where(met, enter, depth)
        return result

    def _local(self, points_m: Floats) -> Floats:
        """Return each point in the frame of each obstacle, (k, n, 2)."""
        offset = points_m[:, None] - self.centre_m[None]
        c, s = np.cos(self.turn_rad), np.sin(self.turn_rad)
        x, y = offset[..., 0], offset[..., 1]
        return np.stack((c * x + s * y, c * y - s * x), axis=-1)

    def surface_points_m(self, spacing_m: float = 0.03) -> Floats:
        """Return points just inside the faces of every obstacle, (k, 2)."""
        inside_m = 1e-6
        found = [self.centre_m]
        for centre, half, turn, radius in zip(
            self.centre_m, self.half_m, self.turn_rad, self.radius_m, strict=True
        ):
            if radius > 0.0:
                count = max(8, math.ceil(2.0 * math.pi * radius / spacing_m))
                angles = np.arange(count) * 2.0 * math.pi / count
                local = (radius - inside_m) * np.stack((np.cos(angles), np.sin(angles)), axis=1)
            else:
                local = _perimeter(half - inside_m, spacing_m)
            c, s = math.cos(turn), math.sin(turn)
            found.append(centre + local @ np.array(((c, s), (-s, c))))
        return np.concatenate(found)


def _perimeter(half_m: Floats, spacing_m: float) -> Floats:
    sides = []
    for axis in (0, 1):
        count = math.ceil(2.0 * half_m[axis] / spacing_m) + 1
        values = np.linspace(-half_m[axis], half_m[axis], count)
        for sign in (-1.0, 1.0):
            side = np.full((count, 2), sign * half_m[1 - axis])
            side[:, axis] = values
            sides.append(side)
    return np.concatenate(sides)
