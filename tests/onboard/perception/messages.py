"""Detection messages as tests need them."""

from typing import Any

from onboard.perception.detection import Corners, Detection, DetectionFrame, corners_ned


def frame(**changes: Any) -> dict[str, Any]:
    """Return the example of the design, as JSON reads it, with changes."""
    return {
        "version": 1,
        "source": "front",
        "sequence": 812,
        "stamp_unix_s": 1790000000.25,
        "frame": "local_ned",
        "range_m": 12.0,
        "field_of_view_deg": 120.0,
        "obstacles": [
            {
                "id": "7",
                "center_m": [14.2, 0.6],
                "size_m": [1.0, 1.2],
                "yaw_deg": 0.0,
                "uncertainty_m": 0.05,
            }
        ],
    } | changes


def obstacle(**changes: Any) -> dict[str, Any]:
    """Return the one obstacle of `frame`, with changes."""
    return dict(frame()["obstacles"][0] | changes)


def detection(**changes: Any) -> Detection:
    return Detection.model_validate(obstacle(**changes))


def detection_frame(*obstacles: dict[str, Any], **changes: Any) -> DetectionFrame:
    return DetectionFrame.model_validate(frame(**changes) | {"obstacles": list(obstacles)})


def square(center_ned_m: tuple[float, float], side_m: float = 1.0) -> Corners:
    return corners_ned(detection(center_m=center_ned_m, size_m=(side_m, side_m)), None)
