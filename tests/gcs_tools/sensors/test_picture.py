"""What is drawn of a frame, and which point of it is the nearest."""

from __future__ import annotations

from typing import Any

import pytest

from gcs_tools.sensors.picture import COLUMNS, ROWS, free_ahead_m, nearest, picture
from onboard.perception.detection import DetectionFrame


def frame(*boxes: dict[str, Any], view_deg: float = 180.0, **keys: Any) -> DetectionFrame:
    return DetectionFrame.model_validate(
        {
            "version": 1, "source": "lidar", "sequence": 1, "stamp_unix_s": 0.0,
            "frame": "body_frd", "range_m": 10.0, "field_of_view_deg": view_deg,
            "obstacles": boxes,
        } | keys
    )  # fmt: skip


def box(ahead_m: float, right_m: float, yaw_deg: float = 0.0) -> dict[str, Any]:
    return {
        "id": "1", "center_m": (ahead_m, right_m), "size_m": (2.0, 1.0), "yaw_deg": yaw_deg,
        "uncertainty_m": 0.1,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("seen", "distance_m", "bearing_deg"),
    [
        (box(5.0, 0.0), 4.0, 0.0),
        (box(0.0, 5.0), 4.5, 90.0),
        (box(0.0, -5.0, yaw_deg=90.0), 4.0, -90.0),
        (box(0.3, 0.1), 0.0, 0.0),
    ],
)
def test_the_nearest_point(seen: dict[str, Any], distance_m: float, bearing_deg: float) -> None:
    found = nearest(frame(box(9.0, 0.0), seen))
    assert found is not None
    assert found.distance_m == pytest.approx(distance_m)
    assert found.bearing_deg == pytest.approx(bearing_deg)
    assert nearest(frame()) is None


def test_a_point_is_said_with_its_side() -> None:
    assert str(nearest(frame(box(0.0, 5.0)))) == "4.50 m, 90° to the right"
    assert str(nearest(frame(box(0.0, -5.0)))) == "4.50 m, 90° to the left"


def test_free_range_of_a_bearing() -> None:
    seen = frame(free_range_m=[1.0, 2.0, None, 4.0], view_deg=180.0)
    assert free_ahead_m(seen, -1.0) == 2.0 or free_ahead_m(seen, -1.0) == 1.0
    assert free_ahead_m(seen, 0.1) is None  # nothing returned
    assert free_ahead_m(seen, 1.5) == 4.0
    assert free_ahead_m(seen, 2.0) is None  # out of view
    assert free_ahead_m(frame(), 0.0) is None


def test_ahead_is_up_and_right_is_right() -> None:
    lines = picture(frame(box(8.0, 0.0), box(0.0, 8.0), free_range_m=[6.0] * 180, view_deg=360.0))
    assert len(lines) == ROWS
    middle = COLUMNS // 2
    assert lines[ROWS // 2][middle] == "^"
    assert lines[2][middle] == "#"  # 8 of 10 m ahead
    assert all(line[middle : middle + 1] != "#" for line in lines[ROWS // 2 :])
    assert lines[ROWS // 2][round(middle * 1.8)] == "#"
    assert "#" not in lines[ROWS // 2][:middle]
    assert lines[ROWS // 2 + 3][middle] == "."


def test_what_is_not_seen_is_blank() -> None:
    lines = picture(frame(free_range_m=[5.0] * 90, view_deg=90.0))
    assert "." in "".join(lines[: ROWS // 2])
    assert "".join(lines[ROWS // 2 + 1 :]).strip() == ""
