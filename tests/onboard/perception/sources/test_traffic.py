"""ADS-B, UTM, positions of other systems and Remote ID as MAVLink words them: movers besides."""

import logging
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from onboard.files.sensor_sources import TrafficSource
from onboard.mavlink.endpoint import MavlinkEndpoint
from onboard.perception.movers.moving_detection import MovingDetection, ReportsFrame, is_complete
from onboard.perception.sources.registry import mavlink_ids_of
from onboard.perception.sources.traffic import TrafficInput
from tests.onboard.perception.sources.scenes import EPOCH_UNIX_S, pose_at, poses_of
from tests.tools.fuzz_sensors import with_checksum

LATITUDE_DEG, LONGITUDE_DEG, ALTITUDE_M = 47.397742, 8.545594, 488.0
METRES_PER_DEGREE = math.radians(1.0) * 6_371_000.0
NOW_UNIX_S = EPOCH_UNIX_S + 0.2
MESSAGES = (
    "adsb_vehicle", "utm_global_position", "global_position_int", "open_drone_id_location",
)  # fmt: skip
KEYS: dict[str, Any] = {
    "kind": "traffic", "name": "traffic", "range_m": 200.0, "uncertainty_m": 2.0,
    "messages": MESSAGES, "mover_class": "drone", "latency_s": 0.5, "accuracy_m": 5.0,
    "sigmas": 3.0,
}  # fmt: skip
COORDS = mavlink.ADSB_FLAGS_VALID_COORDS
MOVES = mavlink.ADSB_FLAGS_VALID_VELOCITY | mavlink.ADSB_FLAGS_VALID_HEADING


def framed(message: Any, system: int = 7, component: int = 1) -> bytes:
    return bytes(message.pack(mavlink.MAVLink(None, system, component)))


def named(value: object) -> str | None:
    """Return no name for bytes, which would be long."""
    return "" if isinstance(value, bytes) else None


def degrees_e7(north_m: float, east_m: float) -> tuple[int, int]:
    east_deg = east_m / METRES_PER_DEGREE / math.cos(math.radians(LATITUDE_DEG))
    north_deg = north_m / METRES_PER_DEGREE
    return round(1e7 * (LATITUDE_DEG + north_deg)), round(1e7 * (LONGITUDE_DEG + east_deg))


def origin() -> bytes:
    place = degrees_e7(0.0, 0.0)
    return framed(mavlink.MAVLink_gps_global_origin_message(*place, round(1e3 * ALTITUDE_M)), 1)


def adsb(
    north_m: float, east_m: float, *, flags: int = COORDS | MOVES, tslc: int = 0, **keys: Any
) -> bytes:
    message = mavlink.MAVLink_adsb_vehicle_message(
        keys.get("icao", 0xABCDEF), *degrees_e7(north_m, east_m), keys.get("altitude_type", 1),
        round(1e3 * keys.get("altitude_m", ALTITUDE_M)), 9000, 1200, 0, b"CLEARWAY", 14, tslc,
        flags, 0,
    )  # fmt: skip
    return framed(message, 1, 156)


def utm(north_m: float, east_m: float, *, flags: int = 4 | 2 | 32, **keys: Any) -> bytes:
    message = mavlink.MAVLink_utm_global_position_message(
        keys.get("time_us", 0), list(range(18)), *degrees_e7(north_m, east_m),
        round(1e3 * keys.get("altitude_m", ALTITUDE_M)), 0, 300, -400, 0, keys.get("h_acc", 2000),
        3000, 50, 0, 0, 0, 0, 3, flags,
    )  # fmt: skip
    return framed(message)


def position(north_m: float, east_m: float, altitude_m: float = ALTITUDE_M, **keys: Any) -> bytes:
    message = mavlink.MAVLink_global_position_int_message(
        123, *degrees_e7(north_m, east_m), round(1e3 * altitude_m), 0, 100, 200, 0, 65535
    )
    return framed(message, **keys)


def remote_id(accuracy: int = 10, **keys: Any) -> bytes:
    message = mavlink.MAVLink_open_drone_id_location_message(
        0, 0, [1, 2, 3, *[0] * 17], 2, 0, keys.get("speed", 500), 0, *degrees_e7(0.0, 120.0),
        0.0, 0.0, 0, 0.0, accuracy, 0, 0, 3, 100.0, 5,
    )  # fmt: skip
    return framed(message)


def traffic(*, placed: bool = True, **keys: Any) -> TrafficInput:
    source = TrafficInput(TrafficSource.model_validate(KEYS | keys), poses_of(pose_at()))
    if placed:
        assert source.read(origin(), NOW_UNIX_S) == []
    return source


def read(payload: bytes, **keys: Any) -> tuple[ReportsFrame, MovingDetection]:
    source = traffic(**keys)
    (frame,) = source.read(payload, NOW_UNIX_S)
    assert isinstance(frame, ReportsFrame)
    (seen,) = frame.obstacles
    return frame, seen


def refused(payload: bytes, **keys: Any) -> str:
    source = traffic(**keys)
    assert not source.read(payload, NOW_UNIX_S)
    (reason,) = source.refused
    return reason


def test_ads_b_is_a_mover_a_second_older_than_it_says() -> None:
    frame, seen = read(adsb(30.0, 40.0, tslc=1))
    assert seen.id == "icao-abcdef"
    assert seen.kind == "drone"
    assert seen.center_m == pytest.approx((30.0, 40.0), abs=0.1)
    # Of the receiver, of the local frame, and of two autopilots' spheres.
    assert seen.uncertainty_m == pytest.approx(5.0 + 2.0 + 0.06, abs=0.01)
    # tslc counts whole seconds; and it took half a second to arrive.
    assert frame.stamp_unix_s == pytest.approx(NOW_UNIX_S - 1.0 - 1.0 - 0.5)
    assert seen.velocity_mps == pytest.approx((0.0, 12.0), abs=1e-9)
    assert not is_complete(frame)
    assert not seen.box_whole


def test_utm_states_deviations_which_count_as_often_as_declared() -> None:
    frame, seen = read(utm(30.0, 0.0))
    assert seen.uncertainty_m == pytest.approx(3.0 * 2.0 + 2.0 + 0.04, abs=0.01)
    assert seen.velocity_mps == (3.0, -4.0)
    assert frame.stamp_unix_s == pytest.approx(NOW_UNIX_S - 0.5)
    stated, _ = read(utm(30.0, 0.0, flags=4 | 1, time_us=round(1e6 * (NOW_UNIX_S - 2.0))))
    # Of a clock that may be off by a tenth of a second.
    assert stated.stamp_unix_s == pytest.approx(NOW_UNIX_S - 2.1)
    _, unstated = read(utm(30.0, 0.0, h_acc=65535))
    assert unstated.uncertainty_m == pytest.approx(5.0 + 2.0 + 0.04, abs=0.01)
    assert unstated.id == "utm-" + bytes(range(18)).hex()


def test_the_position_of_another_system_has_no_common_clock() -> None:
    frame, seen = read(position(-20.0, 5.0))
    assert seen.id == "system-7"
    assert frame.stamp_unix_s == pytest.approx(NOW_UNIX_S - 0.5)
    assert seen.center_m == pytest.approx((-20.0, 5.0), abs=0.1)
    assert seen.velocity_mps == (1.0, 2.0)


@pytest.mark.parametrize(
    ("payload", "keys", "reason"),
    [
        (adsb(1.0, 0.0, flags=0), {}, "no position"),
        (adsb(1.0, 0.0, tslc=4), {}, "too old"),
        (utm(1.0, 0.0, flags=2), {}, "no position"),
        (utm(1.0, 0.0, flags=5, time_us=10**15), {}, "too old"),
        (utm(1.0, 0.0, flags=5, time_us=2**63), {}, "stamp in the future"),
        (utm(1.0, 0.0, h_acc=65535), {"messages": MESSAGES[1:2], "accuracy_m": None},
         "accuracy unknown, or too bad"),
        (utm(1.0, 0.0, h_acc=40000), {}, "accuracy unknown, or too bad"),
        (position(1.0, 0.0), {"placed": False}, "local origin not known yet"),
        (framed(mavlink.MAVLink_global_position_int_message(0, 0, 0, 0, 0, 0, 0, 0, 0)), {},
         "no position"),
        (framed(mavlink.MAVLink_global_position_int_message(0, 2**31 - 1, 1, 0, 0, 0, 0, 0, 0)),
         {}, "no position"),
    ],
    ids=named,
)  # fmt: skip
def test_what_does_not_say_where_and_when_is_refused(
    payload: bytes, keys: dict[str, Any], reason: str
) -> None:
    assert refused(payload, **keys) == reason


@pytest.mark.parametrize(
    ("payload", "keys", "counts"),
    [
        (position(150.0, 0.0), {}, True),
        (position(300.0, 0.0), {}, False),
        (position(50.0, 0.0, ALTITUDE_M + 200.0), {}, True),
        (position(50.0, 0.0, ALTITUDE_M + 200.0), {"height_m": 100.0}, False),
        (position(50.0, 0.0, ALTITUDE_M + 105.0), {"height_m": 100.0}, True),  # it may be off
        (adsb(50.0, 0.0, altitude_m=ALTITUDE_M + 900.0), {"height_m": 100.0}, True),  # unknown
        (adsb(50.0, 0.0, flags=COORDS | 2, altitude_m=ALTITUDE_M + 900.0), {"height_m": 100.0},
         False),
        (adsb(50.0, 0.0, flags=COORDS | 2, altitude_m=ALTITUDE_M + 900.0, altitude_type=0),
         {"height_m": 100.0}, True),  # a pressure altitude
        (adsb(0.0, 0.0), {"own_icao_address": 0xABCDEF}, False),
        (adsb(0.0, 0.0), {"own_icao_address": 0xABCDEE}, True),
    ],
    ids=named,
)  # fmt: skip
def test_what_is_surely_far_does_not_count(
    payload: bytes, keys: dict[str, Any], counts: bool
) -> None:
    source = traffic(**keys)
    assert bool(source.read(payload, NOW_UNIX_S)) is counts
    assert source.malformed == 0


def test_remote_id_is_logged_once_and_is_no_mover(caplog: pytest.LogCaptureFixture) -> None:
    source = traffic()
    with caplog.at_level(logging.INFO):
        assert source.read(remote_id(), NOW_UNIX_S) == []
        assert source.read(remote_id(), NOW_UNIX_S) == []
        assert source.read(framed(mavlink.MAVLink_open_drone_id_location_message(
            0, 0, [0] * 20, 0, 0, 25500, 0, 0, 0, 0.0, 0.0, 0, 0.0, 0, 0, 0, 0, 0.0, 0
        )), NOW_UNIX_S) == []  # fmt: skip
    one, other = (record.getMessage() for record in caplog.records)
    assert "120 m from the local origin, ±10 m, 5.0 m/s ±1 m/s, stamp ±0.5 s" in one
    assert "shown only" in one
    assert "position unknown, accuracy unknown, speed unknown, stamp of unknown accuracy" in other
    assert source.malformed == 0


def test_the_link_hears_others_but_not_the_vehicle_itself() -> None:
    link = MavlinkEndpoint(system_id=1)
    own = [position(0.0, 0.0, system=1), framed(mavlink.MAVLink_utm_global_position_message(
        0, [0] * 18, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0), 1)]  # fmt: skip
    theirs = [position(9.0, 0.0), adsb(9.0, 0.0), utm(9.0, 0.0), remote_id()]
    link.receive(b"".join((*own, *theirs, origin())), 1.0)
    assert link.take_traffic() == []  # not asked for
    link.listen_to_traffic(mavlink_ids_of(TrafficSource.model_validate(KEYS)))
    foreign_origin = framed(mavlink.MAVLink_gps_global_origin_message(1, 1, 1), 7)
    link.receive(b"".join((*own, *theirs, origin(), foreign_origin)), 1.0)
    assert [frame for _, frame in link.take_traffic()] == [*theirs, origin()]
    assert link.take_traffic() == []
    assert link.missions.origin is not None
    # Our own vehicle's are of no kind that is read, and another one's origin says nothing.
    assert link.counters.foreign_messages == 1


@given(st.data())
def test_no_damaged_message_raises(data: st.DataObject) -> None:
    valid = (adsb(9.0, 0.0), utm(9.0, 0.0, flags=255), position(9.0, 0.0), remote_id(), origin())
    frame = bytearray(data.draw(st.sampled_from(valid)))
    number = int.from_bytes(frame[7:10], "little")
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(10, len(frame) - 3))
        frame[at] = data.draw(st.sampled_from((0, 1, 0x7F, 0x80, 0xFF)))
    source = traffic()
    found = source.read(with_checksum(bytes(frame), number), NOW_UNIX_S)
    for each in found:
        assert isinstance(each, ReportsFrame)
        assert NOW_UNIX_S - 5.0 <= each.stamp_unix_s <= NOW_UNIX_S
    source.read(bytes(frame), NOW_UNIX_S)  # nor one with a wrong checksum


@pytest.mark.parametrize(
    "message",
    [
        mavlink.MAVLink_global_position_int_message(
            1, *degrees_e7(5.0, 0.0), round(1e3 * ALTITUDE_M), 0, 32767, 32767, 0, 65535
        ),
        mavlink.MAVLink_adsb_vehicle_message(
            1, *degrees_e7(5.0, 0.0), 1, round(1e3 * ALTITUDE_M), 9000, 65535, 0, b"CLEARWAY", 14,
            0, COORDS | MOVES, 0,
        ),
        mavlink.MAVLink_utm_global_position_message(
            0, list(range(18)), *degrees_e7(5.0, 0.0), 0, 0, 32767, 0, 0, 2000, 3000, 50, 0, 0, 0,
            0, 3, 4 | 2 | 32,
        ),
    ],
    ids=["global_position_int", "adsb_vehicle", "utm_global_position"],
)  # fmt: skip
def test_a_velocity_beyond_any_drops_no_report(message: Any) -> None:
    _, seen = read(framed(message))
    assert seen.velocity_mps is None
    assert seen.center_m[0] == pytest.approx(5.0, abs=0.1)
