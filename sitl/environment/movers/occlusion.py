"""Which places a sensor does not see, since a box stands between."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from onboard.geometry.frames import FloatArray

# A place on a face is seen past that face.
_ROUND_OFF: Final = 1e-6


def are_hidden(
    points_ned_m: FloatArray, here_ned_m: tuple[float, float], boxes: FloatArray
) -> NDArray[np.bool_]:
    """Tell of each place whether a box is between it and the sensor.

    Args:
        points_ned_m: (n, 2).
        here_ned_m: where the sensor is.
        boxes: (k, 5), north and east of each box's centre, half its extent along and across, and
            its turn [rad].
    """
    if not len(boxes) or not len(points_ned_m):
        return np.zeros(len(points_ned_m), bool)
    centre, half, turn_rad = boxes[:, :2], boxes[:, 2:4], boxes[:, 4]
    cosine, sine = np.cos(turn_rad), np.sin(turn_rad)

    def local(places_m: FloatArray) -> FloatArray:
        away = places_m - centre
        turned = (
            cosine * away[..., 0] + sine * away[..., 1],
            cosine * away[..., 1] - sine * away[..., 0],
        )
        return np.stack(turned, axis=-1)

    begin = local(np.array(here_ned_m))
    way = local(points_ned_m[:, None]) - begin
    way = np.where(np.abs(way) < 1e-12, 1e-12, way)
    one, other = (-half - begin) / way, (half - begin) / way
    enters = np.minimum(one, other).max(axis=-1)
    leaves = np.maximum(one, other).min(axis=-1)
    met = (enters < leaves) & (leaves > 0.0) & (enters < 1.0 - _ROUND_OFF)
    hidden: NDArray[np.bool_] = met.any(axis=1)
    return hidden
