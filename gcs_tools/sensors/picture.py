"""What a sensor saw, from above, in characters: the vehicle in the middle, ahead is up."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from onboard.perception.detection import Detection, DetectionFrame

ROWS: Final = 21
# A character is about twice as high as wide.
COLUMNS: Final = 2 * ROWS - 1
_VEHICLE, _BOX, _FREE, _UNKNOWN = "^", "#", ".", " "


class Nearest(NamedTuple):
    """The nearest point of what was seen.

    Attributes:
        distance_m: from the vehicle's centre.
        bearing_deg: from the nose, clockwise.
    """

    distance_m: float
    bearing_deg: float

    def __str__(self) -> str:
        side = "right" if self.bearing_deg > 0.0 else "left"
        return f"{self.distance_m:.2f} m, {abs(self.bearing_deg):.0f}° to the {side}"


def nearest(frame: DetectionFrame) -> Nearest | None:
    """Return the nearest point of a frame around the body; None where it has no obstacle."""
    points = [_nearest_point(each) for each in frame.obstacles]
    found = [Nearest(math.hypot(*each), math.degrees(math.atan2(*each[::-1]))) for each in points]
    return min(found, default=None)


def free_ahead_m(frame: DetectionFrame, bearing_rad: float = 0.0) -> float | None:
    """Return how far a frame says free along a bearing; None where it does not say."""
    bins = frame.free_range_m
    half_rad = math.radians(frame.field_of_view_deg) / 2.0
    if bins is None or abs(bearing_rad) > half_rad:
        return None
    index = min(int((bearing_rad + half_rad) / frame.bin_rad), len(bins) - 1)
    return bins[index]


def picture(frame: DetectionFrame) -> list[str]:
    """Return the lines of a picture of a frame around the body; ``#`` obstacle, ``.`` free."""
    far_m = frame.range_m
    row_m, column_m = 2.0 * far_m / ROWS, 2.0 * far_m / COLUMNS
    lines = []
    for row in range(ROWS):
        line = ""
        for column in range(COLUMNS):
            ahead_m = (ROWS // 2 - row) * row_m
            right_m = (column - COLUMNS // 2) * column_m
            line += _sign(frame, ahead_m, right_m, (row_m / 2.0, column_m / 2.0))
        lines.append(line.rstrip())
    middle, half = ROWS // 2, COLUMNS // 2
    lines[middle] = f"{lines[middle]:<{half}}"[:half] + _VEHICLE + lines[middle][half + 1 :]
    return lines


def _sign(
    frame: DetectionFrame, ahead_m: float, right_m: float, reach_m: tuple[float, float]
) -> str:
    if any(_touches(each, ahead_m, right_m, reach_m) for each in frame.obstacles):
        return _BOX
    free_m = free_ahead_m(frame, math.atan2(right_m, ahead_m))
    return _FREE if free_m is not None and math.hypot(ahead_m, right_m) <= free_m else _UNKNOWN


def _touches(box: Detection, ahead_m: float, right_m: float, reach_m: tuple[float, float]) -> bool:
    """Tell whether a box reaches into a cell."""
    along_m, across_m = _in_box(box, ahead_m, right_m)
    margin_m = max(reach_m)
    return (
        abs(along_m) <= box.size_m[0] / 2.0 + margin_m
        and abs(across_m) <= box.size_m[1] / 2.0 + margin_m
    )


def _in_box(box: Detection, ahead_m: float, right_m: float) -> tuple[float, float]:
    """Return a point in the axes of a box."""
    cosine, sine = math.cos(math.radians(box.yaw_deg)), math.sin(math.radians(box.yaw_deg))
    x_m, y_m = ahead_m - box.center_m[0], right_m - box.center_m[1]
    return cosine * x_m + sine * y_m, cosine * y_m - sine * x_m


def _nearest_point(box: Detection) -> tuple[float, float]:
    """Return the point of a box that is nearest to the vehicle: ahead, right."""
    along_m, across_m = _in_box(box, 0.0, 0.0)
    along_m = min(max(along_m, -box.size_m[0] / 2.0), box.size_m[0] / 2.0)
    across_m = min(max(across_m, -box.size_m[1] / 2.0), box.size_m[1] / 2.0)
    cosine, sine = math.cos(math.radians(box.yaw_deg)), math.sin(math.radians(box.yaw_deg))
    return (
        box.center_m[0] + cosine * along_m - sine * across_m,
        box.center_m[1] + sine * along_m + cosine * across_m,
    )
