"""JSON, version 1: frames as ever, optional fields, and garbage."""

import json
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.files.json_payload import MalformedPayloadError
from onboard.perception.detection import MAX_OBSTACLES_PER_FRAME
from onboard.perception.sources.detection_source import DetectionSource
from onboard.perception.sources.json_v1 import JsonV1Source, parse_frame
from tests.onboard.perception.messages import frame, obstacle

NOW_UNIX_S = 1_790_000_001.0

scalars = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8)
documents = st.recursive(
    scalars,
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4)
    ),
    max_leaves=12,
)


def payload(**changes: Any) -> bytes:
    return json.dumps(frame(**changes)).encode()


def test_design_example_frame_is_read() -> None:
    read = parse_frame(payload())
    assert read.obstacles[0].center_m == (14.2, 0.6)
    assert read.range_m == 12.0


def test_empty_frame_means_nothing_there() -> None:
    assert parse_frame(payload(obstacles=[])).obstacles == ()


def test_unknown_fields_of_a_newer_sensor_are_tolerated() -> None:
    assert parse_frame(payload(colour="red", obstacles=[obstacle(motion="static")])).sequence == 812


def test_height_and_free_range_are_read() -> None:
    seen = obstacle(down_m=[-3.0, 0.5], partial=True)
    read = parse_frame(payload(obstacles=[seen], free_range_m=[11.5, 0, 7.25]))
    assert read.obstacles[0].down_m == (-3.0, 0.5)
    assert read.obstacles[0].partial
    assert read.free_range_m == (11.5, 0.0, 7.25)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"version": 3}, "version"),
        ({"frame": "enu"}, "frame"),
        ({"range_m": 0.0}, "range_m"),
        ({"field_of_view_deg": 400.0}, "field_of_view_deg"),
        ({"sequence": -1}, "sequence"),
        ({"obstacles": [{"id": "7"}]}, "center_m"),
        ({"obstacles": [obstacle(size_m=[-1.0, 1.0])]}, "size_m"),
        ({"obstacles": [obstacle(center_m=[1e9, 0.0])]}, "center_m"),
        ({"obstacles": [obstacle(center_m=[1.0])]}, "center_m"),
        ({"obstacles": [obstacle(down_m=[0.0, -3.0])]}, "down_m"),
        ({"obstacles": [obstacle(down_m=["-3", "0"])]}, "down_m"),
        ({"obstacles": [obstacle(partial="no")]}, "partial"),
        ({"free_range_m": [-1.0]}, "free_range_m"),
        ({"free_range_m": "far"}, "free_range_m"),
    ],
)
def test_malformed_frame_is_refused_by_name(change: dict[str, Any], named: str) -> None:
    with pytest.raises(MalformedPayloadError, match=named):
        parse_frame(payload(**change))


@pytest.mark.parametrize(
    "change",
    [
        {"range_m": math.nan},
        {"stamp_unix_s": math.inf},
        {"free_range_m": [math.nan]},
        {"obstacles": [obstacle(down_m=[math.nan, 0.0])]},
        {"obstacles": [obstacle(down_m=[-math.inf, 0.0])]},
    ],
)
def test_nan_and_infinity_are_refused(change: dict[str, Any]) -> None:
    with pytest.raises(MalformedPayloadError):
        parse_frame(payload(**change))


def test_a_frame_of_absurdly_many_obstacles_is_refused() -> None:
    many = [obstacle()] * (MAX_OBSTACLES_PER_FRAME + 1)
    with pytest.raises(MalformedPayloadError, match="obstacles"):
        parse_frame(payload(obstacles=many))


# ------------------------------------------------------------------ as a source


def test_one_message_is_one_frame() -> None:
    source: DetectionSource = JsonV1Source()
    (read,) = source.read(payload(), NOW_UNIX_S)
    assert read.stamp_unix_s == 1790000000.25  # its own, not the time of reading
    assert source.malformed == 0


def test_a_malformed_message_is_counted_and_spoils_no_other(
    caplog: pytest.LogCaptureFixture,
) -> None:
    source = JsonV1Source()
    with caplog.at_level("DEBUG"):
        assert source.read(payload(range_m=-1.0), NOW_UNIX_S) == ()
    assert source.malformed == 1
    assert "malformed detection frame: range_m" in caplog.text
    assert len(source.read(payload(), NOW_UNIX_S)) == 1
    assert source.malformed == 1


@given(st.binary(max_size=300))
def test_garbage_is_counted_and_never_raises(data: bytes) -> None:
    source = JsonV1Source()
    assert source.read(data, NOW_UNIX_S) == ()
    assert source.malformed == 1


@given(documents)
def test_json_that_is_not_a_frame_is_counted_and_never_raises(document: object) -> None:
    source = JsonV1Source()
    assert source.read(json.dumps(document).encode(), NOW_UNIX_S) == ()
    assert source.malformed == 1


@given(
    st.sampled_from([*frame(), "free_range_m", "down_m", "partial", "id", "center_m"]), documents
)
def test_a_frame_with_one_foreign_value_is_read_or_counted(key: str, value: object) -> None:
    """Whatever stands under a known key, the frame is either valid or dropped as a whole."""
    in_frame = key in frame() or key == "free_range_m"
    change = {key: value} if in_frame else {"obstacles": [obstacle(**{key: value})]}
    source = JsonV1Source()
    frames = source.read(json.dumps(frame(**change)).encode(), NOW_UNIX_S)
    assert len(frames) + source.malformed == 1
    for read in frames:
        assert all(math.isfinite(each) for each in (read.stamp_unix_s, read.range_m))
        assert all((range_m or 0.0) >= 0.0 for range_m in read.free_range_m or ())
        for seen in read.obstacles:
            top_m, bottom_m = seen.down_m or (None, None)
            assert top_m is None or bottom_m is None or top_m <= bottom_m


@given(st.integers(0, 400), st.integers(0, 255))
def test_a_flipped_byte_never_raises(at: int, byte: int) -> None:
    data = bytearray(payload(free_range_m=[1.0, 2.0], obstacles=[obstacle(down_m=[-3.0, 0.0])]))
    data[at % len(data)] = byte
    source = JsonV1Source()
    assert len(source.read(bytes(data), NOW_UNIX_S)) + source.malformed == 1


@given(st.integers(0, 400))
def test_a_message_that_was_cut_off_is_malformed(length: int) -> None:
    data = payload()
    source = JsonV1Source()
    assert source.read(data[: length % len(data)], NOW_UNIX_S) == ()
    assert source.malformed == 1


def test_deep_nesting_is_malformed() -> None:
    source = JsonV1Source()
    assert source.read(b"[" * 100_000, NOW_UNIX_S) == ()
    assert source.read(b'{"obstacles":' * 10_000, NOW_UNIX_S) == ()
    assert source.malformed == 2
