"""Virtual obstacles are seen as a real sensor would see them: range, view, shadow, latency."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.files.daemon_config import DaemonConfig, load_daemon_config
from onboard.files.sensor_sources import FieldFileSource
from onboard.files.yaml_file import FileError, validate
from onboard.perception.detection import DetectionFrame, corners_ned
from onboard.perception.intake import VIRTUAL_ONLY, DetectionCounters
from onboard.perception.ros2.cdr import DecodeError
from onboard.perception.sensor_channels import SensorChannels
from onboard.perception.sources.field_file import FieldFileInput, request_of
from onboard.vehicle_state import Pose

RANGE_M = 15.0
SHED = "- {id: shed, center_ned_m: [10.0, 0.0], size_m: [2.0, 2.0]}\n"


class Poses:
    """A body that flies along north at 1 m/s, from the origin at time 0."""

    generation = 0

    def __init__(self, yaw_rad: float = 0.0, north_m: float | None = None) -> None:
        self.yaw_rad, self.north_m = yaw_rad, north_m

    def at(self, stamp_unix_s: float) -> Pose:
        if stamp_unix_s < 0.0:
            raise DecodeError("no pose at its stamp")
        north_m = stamp_unix_s if self.north_m is None else self.north_m
        # Tilt does not matter: what is seen is levelled.
        return Pose(stamp_unix_s, (north_m, 0.0, -5.0), (1.0, 0.0, 0.0), 0.3, 0.2, self.yaw_rad)


def source(directory: Path, field: str = SHED, **keys: Any) -> FieldFileSource:
    path = directory / "virtual.yaml"
    path.write_text(field, encoding="utf-8")
    stated = {
        "kind": "field_file", "name": "virtual", "field": path, "range_m": RANGE_M,
        "uncertainty_m": 0.1, "field_of_view_deg": 120.0,
    }  # fmt: skip
    return FieldFileSource.model_validate(stated | keys)


def seen(config: FieldFileSource, poses: Poses, now_s: float = 1.0) -> DetectionFrame:
    (frame,) = FieldFileInput(config, poses).read(request_of(None), now_s)
    return frame


def free_at_m(frame: DetectionFrame, bearing_deg: float) -> float:
    ranges = frame.free_range_m or ()
    at = int((bearing_deg / frame.field_of_view_deg + 0.5) * len(ranges))
    value = ranges[at]
    assert value is not None
    return value


def test_it_declares_what_the_file_states(tmp_path: Path) -> None:
    frame = seen(source(tmp_path), Poses(north_m=0.0))
    assert (frame.source, frame.range_m) == ("virtual", RANGE_M)
    assert frame.field_of_view_deg == pytest.approx(120.0)
    assert all(each.uncertainty_m == 0.1 for each in frame.obstacles)


def test_a_box_hides_what_is_behind_it_and_casts_a_shadow(tmp_path: Path) -> None:
    behind = "- {id: behind, center_ned_m: [13.5, 0.2], size_m: [0.5, 0.5]}\n"
    frame = seen(source(tmp_path, SHED + behind), Poses(north_m=0.0))
    assert free_at_m(frame, 0.0) == pytest.approx(9.0, abs=0.15)
    assert free_at_m(frame, 40.0) == pytest.approx(RANGE_M, abs=0.01)
    reached_m = [corner for each in frame.obstacles for corner in corners(each, frame, 0.0)]
    assert reached_m
    assert max(north_m for north_m, _ in reached_m) < 12.9


def corners(each: Any, frame: DetectionFrame, north_m: float) -> Any:
    assert frame.frame == "body_frd"
    return corners_ned(each, Pose(0.0, (north_m, 0.0, -5.0), (0.0, 0.0, 0.0), 0.0, 0.0, 0.0))


def test_the_face_that_is_seen_lies_where_the_field_has_it(tmp_path: Path) -> None:
    frame = seen(source(tmp_path), Poses(north_m=0.0))
    places_m = [place_m for each in frame.obstacles for place_m in corners(each, frame, 0.0)]
    assert min(north_m for north_m, _ in places_m) == pytest.approx(9.0, abs=0.1)
    assert max(east_m for _, east_m in places_m) == pytest.approx(1.0, abs=0.1)
    assert min(east_m for _, east_m in places_m) == pytest.approx(-1.0, abs=0.1)


@pytest.mark.parametrize(
    ("north_m", "yaw_rad", "sees"),
    [(0.0, 0.0, True), (-7.0, 0.0, False), (0.0, math.pi / 2.0, False), (20.0, math.pi, True)],
)
def test_range_and_view_bound_what_is_seen(
    tmp_path: Path, north_m: float, yaw_rad: float, *, sees: bool
) -> None:
    frame = seen(source(tmp_path), Poses(yaw_rad, north_m))
    assert bool(frame.obstacles) is sees


def test_it_is_measured_a_latency_before_it_arrives(tmp_path: Path) -> None:
    frame = seen(source(tmp_path, latency_s=0.5), Poses(), now_s=4.0)
    assert frame.stamp_unix_s == 3.5
    assert free_at_m(frame, 0.0) == pytest.approx(9.0 - 3.5, abs=0.1)


def test_without_a_pose_of_its_time_nothing_is_said(tmp_path: Path) -> None:
    reader = FieldFileInput(source(tmp_path), Poses())
    assert list(reader.read(request_of(None), -1.0)) == []
    assert reader.refused == {"no pose at its stamp": 1}


def test_a_field_around_home_needs_home(tmp_path: Path) -> None:
    reader = FieldFileInput(source(tmp_path, relative_to="home"), Poses(north_m=100.0))
    assert list(reader.read(request_of(None), 1.0)) == []
    assert reader.refused == {"where the vehicle was armed is unknown": 1}
    (frame,) = reader.read(request_of((100.0, 0.0)), 1.0)
    assert free_at_m(frame, 0.0) == pytest.approx(9.0, abs=0.15)


@given(
    st.floats(3.0, 14.0), st.floats(-math.pi, math.pi), st.floats(0.02, 3.0), st.floats(0.0, 90.0)
)
def test_no_box_in_range_is_missed_and_none_is_free(
    tmp_path_factory: pytest.TempPathFactory,
    distance_m: float,
    bearing_rad: float,
    side_m: float,
    yaw_deg: float,
) -> None:
    directory = tmp_path_factory.mktemp("field")
    center_m = [distance_m * math.cos(bearing_rad), distance_m * math.sin(bearing_rad)]
    box = (
        f"- {{id: box, center_ned_m: {center_m}, size_m: [{side_m}, {side_m}], yaw_deg: {yaw_deg}}}"
    )
    frame = seen(source(directory, box), Poses(bearing_rad, north_m=0.0))
    assert frame.obstacles
    assert free_at_m(frame, 0.0) <= distance_m


# ------------------------------------------------------------------ rates, and files


def test_the_service_asks_at_the_rate_of_the_sensor(tmp_path: Path) -> None:
    config = source(tmp_path, rate_hz=10.0)
    channels = SensorChannels([config], Poses(north_m=0.0), DetectionCounters())
    frames = []
    for tick in range(100):
        channels.measure_virtual(10.0 + 0.02 * tick, None)
        frames += list(channels.take(0.0))
    assert len(frames) == pytest.approx(20, abs=1)
    assert [each.sequence for each in frames] == sorted(each.sequence for each in frames)


FILE: dict[str, Any] = {"contract": "c.yaml", "mission": "m.yaml"}
VIRTUAL = {"kind": "field_file", "name": "v", "field": "f.yaml", "range_m": 9.0, "uncertainty_m": 0}
REAL = {"kind": "laserscan", "name": "l", "topic": "/scan", "range_m": 9.0, "uncertainty_m": 0}


def test_virtual_obstacles_and_a_real_sensor_do_not_mix_unless_stated() -> None:
    with pytest.raises(FileError, match=r"beside the real sensor 'l'.*beside_real_sensors"):
        validate({**FILE, "sources": [VIRTUAL, REAL]}, DaemonConfig, source="onboard.yaml")
    stated = {**VIRTUAL, "beside_real_sensors": True}
    both = validate({**FILE, "sources": [stated, REAL]}, DaemonConfig, source="onboard.yaml")
    assert len(both.sources) == 2


def test_it_is_not_mounted() -> None:
    with pytest.raises(FileError, match="mounting"):
        validate(
            {**FILE, "sources": [{**VIRTUAL, "mounting": {"x_m": 0.1}}]},
            DaemonConfig, source="onboard.yaml",
        )  # fmt: skip


def test_the_field_lies_beside_the_file(tmp_path: Path) -> None:
    (tmp_path / "onboard.yaml").write_text(
        "contract: c.yaml\nmission: m.yaml\nsources:\n"
        "  - {kind: field_file, name: v, field: f.yaml, range_m: 9.0, uncertainty_m: 0.1}\n",
        encoding="utf-8",
    )
    (read,) = load_daemon_config(tmp_path / "onboard.yaml").sources
    assert isinstance(read, FieldFileSource)
    assert read.field == tmp_path / "f.yaml"
    assert read.no_return_is_free_to_m == read.range_m
    with pytest.raises(FileError, match=r"f\.yaml"):
        FieldFileInput(read, Poses())


def test_the_reason_names_the_key() -> None:
    assert "beside_real_sensors" in VIRTUAL_ONLY
