"""Parts of polygons within a field of view."""

from __future__ import annotations

import math

Point = tuple[float, float]


def distance_in_view_m(polygon_m: list[Point], half_view_rad: float) -> float:
    """Distance from the origin to the part of a convex polygon within the field of view.

    Args:
        polygon_m: corners (x ahead, y right) in order.
        half_view_rad: the view covers this angle to either side of +x; at most pi.

    Returns:
        The distance; 0 if the origin is inside, ``inf`` if no part is in view.
    """
    if half_view_rad >= math.pi:
        return _distance_m(polygon_m)
    if half_view_rad > math.pi / 2.0:  # a reflex wedge is two convex ones
        quarter_rad = half_view_rad / 2.0
        return min(
            distance_in_view_m([turned(p, -quarter_rad) for p in polygon_m], quarter_rad),
            distance_in_view_m([turned(p, quarter_rad) for p in polygon_m], quarter_rad),
        )
    sine, cosine = math.sin(half_view_rad), math.cos(half_view_rad)
    part = _clipped(polygon_m, (sine, -cosine))  # left of the right-hand edge
    return _distance_m(_clipped(part, (sine, cosine)))


def _clipped(polygon_m: list[Point], normal: Point) -> list[Point]:
    """Part of a convex polygon on the side of a line through the origin where ``normal`` points."""
    kept: list[Point] = []
    for start, end in zip(polygon_m, polygon_m[1:] + polygon_m[:1], strict=True):
        height_start = start[0] * normal[0] + start[1] * normal[1]
        height_end = end[0] * normal[0] + end[1] * normal[1]
        if height_start >= 0.0:
            kept.append(start)
        if (height_start >= 0.0) != (height_end >= 0.0):
            share = height_start / (height_start - height_end)
            kept.append(
                (start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1]))
            )
    return kept


def _distance_m(polygon_m: list[Point]) -> float:
    """Distance from the origin to a convex polygon; 0 inside, ``inf`` if it has no corners."""
    if not polygon_m:
        return math.inf
    turns = set()
    nearest_m = math.inf
    for start, end in zip(polygon_m, polygon_m[1:] + polygon_m[:1], strict=True):
        along = (end[0] - start[0], end[1] - start[1])
        length2 = along[0] ** 2 + along[1] ** 2
        share = 0.0
        if length2 > 0.0:
            share = min(max(-(start[0] * along[0] + start[1] * along[1]) / length2, 0.0), 1.0)
        foot = (start[0] + share * along[0], start[1] + share * along[1])
        nearest_m = min(nearest_m, math.hypot(*foot))
        turns.add(start[0] * end[1] - start[1] * end[0] > 0.0)
    return 0.0 if len(turns) == 1 and len(polygon_m) > 2 else nearest_m


def turned(vector: Point, angle_rad: float) -> Point:
    """Rotate a horizontal vector from the first axis towards the second."""
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    return cosine * vector[0] - sine * vector[1], sine * vector[0] + cosine * vector[1]
