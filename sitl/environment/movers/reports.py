"""What a detector reports of movers in a frame of version 2: errors, parts, exchanged names."""

from __future__ import annotations

import math
import random
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sitl.environment.detector_errors import Confirmation, DetectorErrorConfig, face_errors
from sitl.environment.lidar import SeenBox
from sitl.environment.movers.occlusion import are_hidden

if TYPE_CHECKING:
    from collections.abc import Sequence

    from onboard.geometry.frames import FloatArray
    from sitl.environment.movers.movers import Mover

_SAMPLES: Final = (0.0, 0.25, 0.5, 0.75, 1.0)


class MoverReports:
    """Reports movers as one detector sees them.

    Args:
        errors: as the detector makes them.
        face_noise_m: greatest error of a face.
        swap_share: share of the frames in which two names are exchanged.
        noise: of the detector.

    Attributes:
        face_error_max_m: greatest error of a face so far.
    """

    def __init__(
        self,
        errors: DetectorErrorConfig,
        face_noise_m: float,
        swap_share: float,
        noise: random.Random,
    ) -> None:
        self._errors, self._face_noise_m = errors, face_noise_m
        self._swap_share, self._noise = swap_share, noise
        self._confirmation = Confirmation(errors)
        self._names: dict[int, str] = {}
        self.face_error_max_m = 0.0

    def of(
        self,
        movers: Sequence[Mover],
        here_ned_m: tuple[float, float],
        axis_rad: float,
        half_view_rad: float,
        range_m: float,
        sequence: int,
        hides: FloatArray | None = None,
    ) -> list[tuple[SeenBox, dict[str, Any]]]:
        """Return each mover that is reported: its box in local NED, and what else is said of it.

        Beside what a frame states, its ``heights_m``, of which a detector sees what is in view.

        Args:
            movers: of the world.
            here_ned_m: where the sensor is.
            axis_rad: where it looks.
            half_view_rad: half of its view.
            range_m: how far it sees.
            sequence: number of the frame.
            hides: (k, 5), boxes that stand still, behind which it sees no mover, nor behind
                another; see `are_hidden`.  None: it sees through everything.
        """
        seen = {}
        for index, mover in enumerate(movers):
            boxes = None if hides is None else _with_others(hides, movers, index)
            part = _part_in_view(mover, here_ned_m, axis_rad, half_view_rad, range_m, boxes)
            if part is not None:
                seen[index] = part
        reported = self._confirmation.reported(list(seen), sequence)
        self._exchange_names(reported)
        found = []
        for index in reported:
            mover, (low, high, whole) = movers[index], seen[index]
            away_m = math.dist(mover.position_ned_m, here_ned_m)
            box = self._with_errors(index, low, high, sequence, away_m)
            says = {
                "class": mover.config.kind,
                "box_whole": whole,
                "velocity_ned_mps": mover.velocity_ned_mps,
                "heights_m": mover.heights_m,
            }
            found.append((box, says))
        return found

    def _exchange_names(self, reported: list[int]) -> None:
        for index in reported:
            self._names.setdefault(index, f"m{index}")
        if len(reported) >= 2 and self._noise.random() < self._swap_share:
            one, other = self._noise.sample(reported, 2)
            self._names[one], self._names[other] = self._names[other], self._names[one]

    def _with_errors(
        self,
        index: int,
        low: tuple[float, float],
        high: tuple[float, float],
        sequence: int,
        distance_m: float,
    ) -> SeenBox:
        off = face_errors(self._errors, self._face_noise_m, sequence, distance_m, self._noise)
        if self._face_noise_m > 0.0:
            self.face_error_max_m = max(self.face_error_max_m, *map(abs, off))
        north = (low[0] - off.back_m, high[0] + off.front_m)
        east = (low[1] - off.left_m, high[1] + off.right_m)
        center_m = (sum(north) / 2.0, sum(east) / 2.0)
        size_m = (max(north[1] - north[0], 0.0), max(east[1] - east[0], 0.0))
        return SeenBox(self._names[index], center_m, size_m, 0.0)


def _with_others(hides: FloatArray, movers: Sequence[Mover], index: int) -> FloatArray:
    """Return what hides a mover: what stands still, and every other mover."""
    others = [
        (*other.position_ned_m, other.half_m, other.half_m, 0.0)
        for number, other in enumerate(movers)
        if number != index
    ]
    return np.concatenate((hides, np.array(others).reshape(-1, 5)))


def _part_in_view(
    mover: Mover,
    here_ned_m: tuple[float, float],
    axis_rad: float,
    half_view_rad: float,
    range_m: float,
    boxes: FloatArray | None,
) -> tuple[tuple[float, float], tuple[float, float], bool] | None:
    """Return the corners of the part in view, and whether that is all; None if none is."""
    (north_m, east_m), half_m = mover.position_ned_m, mover.half_m
    if math.dist(mover.position_ned_m, here_ned_m) > range_m + 2.0 * half_m:
        return None
    inside, total = [], 0
    for along in _SAMPLES:
        for across in _SAMPLES:
            point = (
                north_m + (2.0 * along - 1.0) * half_m,
                east_m + (2.0 * across - 1.0) * half_m,
            )
            total += 1
            away = (point[0] - here_ned_m[0], point[1] - here_ned_m[1])
            turn_rad = math.remainder(math.atan2(away[1], away[0]) - axis_rad, 2.0 * math.pi)
            if math.hypot(*away) <= range_m and abs(turn_rad) <= half_view_rad:
                inside.append(point)
    if inside and boxes is not None:
        hidden = are_hidden(np.array(inside), here_ned_m, boxes)
        inside = [point for point, is_hidden in zip(inside, hidden, strict=True) if not is_hidden]
    if not inside:
        return None
    if len(inside) == total:
        return (north_m - half_m, east_m - half_m), (north_m + half_m, east_m + half_m), True
    norths, easts = zip(*inside, strict=True)
    # Between what is in view and what is not lies up to a sample.
    step_m = half_m / 2.0
    low = (max(min(norths) - step_m, north_m - half_m), max(min(easts) - step_m, east_m - half_m))
    high = (min(max(norths) + step_m, north_m + half_m), min(max(easts) + step_m, east_m + half_m))
    return low, high, False
