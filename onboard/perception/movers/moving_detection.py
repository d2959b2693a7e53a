"""Detection message, version 2: what moves is told from what stands still (docs: Detections).

Readers of version 1 reject it, so that they are blind and hold: they would take a mover for static.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Final, Literal

from pydantic import AfterValidator, Field

from onboard.perception.detection import MAX_OBSTACLES_PER_FRAME, Detection, DetectionFrame

Motion = Literal["static", "moving", "unknown"]
SPEED_MAX_MPS: Final = 300.0
_Speed = Annotated[float, Field(ge=-SPEED_MAX_MPS, le=SPEED_MAX_MPS)]
UNKNOWN_CLASS = "unknown"


def _no_partial_whole(detection: MovingDetection) -> MovingDetection:
    if detection.partial and detection.box_whole:
        raise ValueError("box_whole contradicts partial: state one of them")
    return detection


class MovingDetection(Detection):
    """One obstacle of a frame of version 2.

    Attributes:
        motion: ``static`` claims that it never moves; ``unknown`` counts as moving.
        kind: its class as the contract names it; what the contract does not name is unknown.
        velocity_mps: (x, y) or (x, y, z) in the axes of the frame, over ground; None if not
            estimated.
        velocity_uncertainty_mps: how far each component may be off, a bound.
        box_whole: whether the box holds the whole obstacle, faces within `uncertainty_m`; without,
            its far faces may be anywhere.
    """

    motion: Motion = "unknown"
    kind: Annotated[str, Field(alias="class", min_length=1, max_length=32)] = UNKNOWN_CLASS
    velocity_mps: tuple[_Speed, _Speed] | tuple[_Speed, _Speed, _Speed] | None = None
    velocity_uncertainty_mps: Annotated[float, Field(ge=0.0, le=SPEED_MAX_MPS)] | None = None
    box_whole: Annotated[bool, Field(strict=True)] = False


CheckedDetection = Annotated[MovingDetection, AfterValidator(_no_partial_whole)]


class MovingFrame(DetectionFrame):
    """A frame of version 2.

    Attributes:
        frame_complete: whether everything within range and view is among the obstacles; a frame
            that is not complete shows nothing free.
        exposure_s: how much later than the stamp any part of it may have been measured.
    """

    version: Literal[2]  # type: ignore[assignment]  # a frame of another version
    obstacles: Annotated[tuple[CheckedDetection, ...], Field(max_length=MAX_OBSTACLES_PER_FRAME)]
    frame_complete: Annotated[bool, Field(strict=True)] = False
    exposure_s: Annotated[float, Field(ge=0.0, le=2.0)] = 0.0


class ReturnsFrame(MovingFrame):
    """What a sensor measured that tells ranges only, such as a lidar or a ring of sectors.

    Its obstacles enclose returns.  A return has no class, says nothing of motion, shows only the
    side that faces the sensor, and has no identity: a name is a place, and not who is there.
    """

    frame_complete: Annotated[bool, Field(strict=True)] = True


class ReportsFrame(MovingFrame):
    """What others say of movers, such as a tracker, or a vehicle of itself.

    It adds movers.  Who is not reported may be there: it shows no place free, its range and view
    mean nothing, and its silence tells nothing.
    """


def exposure_s(frame: DetectionFrame) -> float:
    """Return how much later than its stamp any part of a frame may have been measured."""
    return frame.exposure_s if isinstance(frame, MovingFrame) else 0.0


def is_mover(detection: Detection) -> bool:
    """Tell whether a detection has to be taken for one that moves, where movers are expected.

    A message of version 1 says nothing of motion.
    """
    return not isinstance(detection, MovingDetection) or detection.motion != "static"


def kind_of(detection: Detection) -> str:
    """Return the class that a sensor states; unknown where it states none."""
    return detection.kind if isinstance(detection, MovingDetection) else UNKNOWN_CLASS


def kind_of_labels(labels: Sequence[str], kinds: Mapping[str, str]) -> str:
    """Return the class of a box; unknown unless all that its detector takes it for are of one.

    Args:
        labels: what it may be.
        kinds: classes by label.
    """
    found = {kinds.get(label, UNKNOWN_CLASS) for label in labels}
    return found.pop() if len(found) == 1 else UNKNOWN_CLASS


def is_whole(detection: Detection) -> bool:
    """Tell whether the box of a mover holds all of it."""
    if isinstance(detection, MovingDetection):
        return detection.box_whole
    return not detection.partial


def is_complete(frame: DetectionFrame) -> bool:
    """Tell whether a frame says that it names everything within its range and view."""
    return not isinstance(frame, MovingFrame) or frame.frame_complete


def turned_velocity_mps(detection: Detection, yaw_rad: float) -> tuple[float, float] | None:
    """Return the velocity north and east; None where the sensor does not state it.

    Args:
        detection: what was seen.
        yaw_rad: of the frame's x axis, clockwise from north; 0 in local NED.
    """
    if not isinstance(detection, MovingDetection) or detection.velocity_mps is None:
        return None
    x_mps, y_mps = detection.velocity_mps[:2]
    cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
    return cosine * x_mps - sine * y_mps, sine * x_mps + cosine * y_mps
