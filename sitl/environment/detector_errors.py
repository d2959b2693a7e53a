"""How a detector errs on purpose, within what a contract allows.

Face errors: a *strategy* chooses all four faces of a box at once.  Missing boxes: a tracker
confirms an obstacle only after several frames, and a detector sends an empty frame now and then.
"""

from __future__ import annotations

import random
from typing import Annotated, Final, Literal, NamedTuple

from pydantic import Field

from onboard.files.yaml_file import FileModel

FaceStrategy = Literal["random", "shrink", "grow", "shift", "alternate", "late"]


class DetectorErrorConfig(FileModel):
    """Which errors a detector makes.

    Attributes:
        faces: how the error of each face is chosen: ``random``: independently; ``shrink``: inwards;
            ``grow``: outwards; ``shift``: all to one side; ``alternate``: inwards and outwards from
            frame to frame; ``late``: inwards from afar, outwards from within ``late_m``.
        late_m: distance of the obstacle's centre at which ``late`` changes.
        confirm_frames: an obstacle is reported in this successive frame that has it in view, and
            from then on.
        empty_every: every so many frames some are empty; null: none.
        empty_frames: so many in a row.
    """

    faces: FaceStrategy = "random"
    late_m: Annotated[float, Field(ge=0.0)] = 5.0
    confirm_frames: Annotated[int, Field(ge=1)] = 1
    empty_every: Annotated[int, Field(ge=2)] | None = None
    empty_frames: Annotated[int, Field(ge=1)] = 1


class FaceErrors(NamedTuple):
    """How far each face of a box is reported outwards, in metres, in the box's own frame."""

    front_m: float
    back_m: float
    right_m: float
    left_m: float


def face_errors(
    config: DetectorErrorConfig,
    size_m: float,
    sequence: int,
    distance_m: float,
    noise: random.Random,
) -> FaceErrors:
    """Return the errors of one box in one frame.

    Args:
        config: the strategy.
        size_m: greatest error of a face.
        sequence: number of the frame.
        distance_m: of the obstacle's centre from the sensor.
        noise: of the sensor.
    """
    match config.faces:
        case "random":
            return FaceErrors(*(noise.uniform(-size_m, size_m) for _ in range(4)))
        case "shift":
            return FaceErrors(size_m, -size_m, size_m, -size_m)
        case "shrink":
            outwards = -1.0
        case "grow":
            outwards = 1.0
        case "alternate":
            outwards = 1.0 if sequence % 2 else -1.0
        case "late":
            outwards = 1.0 if distance_m < config.late_m else -1.0
    return FaceErrors(*(4 * (outwards * size_m,)))


def height_errors(
    config: DetectorErrorConfig,
    size_m: float,
    sequence: int,
    distance_m: float,
    noise: random.Random,
) -> tuple[float, float]:
    """Return how far top and bottom of a box are reported down, in metres.

    The arguments are those of `face_errors`.
    """
    if config.faces == "random":
        return noise.uniform(-size_m, size_m), noise.uniform(-size_m, size_m)
    errors = face_errors(config, size_m, sequence, distance_m, noise)
    return -errors.front_m, errors.back_m


class Confirmation:
    """Withholds obstacles until they have been in view for enough frames.

    Attributes:
        missed_max: longest row of successive frames in which an obstacle in view was not reported.
    """

    def __init__(self, config: DetectorErrorConfig) -> None:
        self._config = config
        self._in_view: dict[int, int] = {}
        self._missed: dict[int, int] = {}
        self.missed_max = 0

    def reported(self, visible: list[int], sequence: int) -> list[int]:
        """Return which of the obstacles in view are reported in a frame.

        Args:
            visible: indices of the obstacles in view.
            sequence: number of the frame.
        """
        self._in_view = {index: self._in_view.get(index, 0) + 1 for index in visible}
        every = self._config.empty_every
        empty = every is not None and sequence % every >= every - self._config.empty_frames
        found = [
            index
            for index in visible
            if not empty and self._in_view[index] >= self._config.confirm_frames
        ]
        self._missed = {
            index: self._missed.get(index, 0) + 1 for index in set(visible) - set(found)
        }
        self.missed_max = max(self.missed_max, *self._missed.values(), 0)
        return found


EXACT: Final = DetectorErrorConfig()
