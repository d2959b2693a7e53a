"""What a mission item means, which ones are refused, and how a mission progresses."""

import math
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.mission import MissionItem, MissionStore, target_ned_m
from sitl.config import HomeConfig

ORIGIN = HomeConfig(latitude_deg=47.0, longitude_deg=8.0, altitude_m=500.0)
HOME_NED_M = (0.0, 0.0, -2.0)
HERE_NED_M = (7.0, 8.0, -9.0)
WAYPOINT = mavlink.MAV_CMD_NAV_WAYPOINT


def item(command: int = WAYPOINT, **changes: float) -> MissionItem:
    """Return an item 0.001 degrees (111 m) north of the origin, 20 m above home."""
    default = MissionItem(
        mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
        command,
        1,
        0.0,
        0.0,
        0.0,
        math.nan,
        470_010_000,
        80_000_000,
        20.0,
    )
    return default._replace(**changes)  # type: ignore[arg-type]


def store(*items: MissionItem, first: int = 0) -> MissionStore:
    mission = MissionStore(ORIGIN, first)
    mission.replace(items)
    return mission


def test_a_relative_altitude_counts_from_home() -> None:
    target = target_ned_m(item(), ORIGIN, HOME_NED_M, HERE_NED_M)
    assert target == pytest.approx((111.19, 0.0, -22.0), abs=0.02)


def test_an_absolute_altitude_counts_from_the_sea() -> None:
    absolute = item(frame=mavlink.MAV_FRAME_GLOBAL_INT, z=530.0)
    assert target_ned_m(absolute, ORIGIN, HOME_NED_M, HERE_NED_M)[2] == pytest.approx(-30.0)


def test_an_item_without_coordinates_is_here() -> None:
    target = target_ned_m(item(x=0, y=0), ORIGIN, HOME_NED_M, HERE_NED_M)
    assert target == pytest.approx((7.0, 8.0, -22.0))


def test_a_landing_keeps_the_height_that_it_begins_at() -> None:
    landing = item(mavlink.MAV_CMD_NAV_LAND)
    assert target_ned_m(landing, ORIGIN, HOME_NED_M, HERE_NED_M)[2] == -9.0


@pytest.mark.parametrize(
    ("refused", "result"),
    [
        (item(mavlink.MAV_CMD_NAV_SPLINE_WAYPOINT), mavlink.MAV_MISSION_UNSUPPORTED),
        (item(frame=mavlink.MAV_FRAME_LOCAL_NED), mavlink.MAV_MISSION_UNSUPPORTED_FRAME),
        (item(z=1e5), mavlink.MAV_MISSION_INVALID_PARAM7),
        (item(z=math.nan), mavlink.MAV_MISSION_INVALID_PARAM7),
        (item(x=490_000_000), mavlink.MAV_MISSION_INVALID_PARAM5_X),
        (
            item(mavlink.MAV_CMD_DO_CHANGE_SPEED, param2=math.nan),
            mavlink.MAV_MISSION_INVALID_PARAM2,
        ),
    ],
)
def test_an_item_that_cannot_be_flown_is_refused(refused: MissionItem, result: int) -> None:
    assert refused.refusal(ORIGIN) == result
    assert MissionStore(ORIGIN, 0).refusal(0, refused) == result


@pytest.mark.parametrize(
    "accepted",
    [
        item(),
        item(mavlink.MAV_CMD_NAV_LAND, z=math.nan),
        item(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH, frame=mavlink.MAV_FRAME_MISSION),
        item(mavlink.MAV_CMD_NAV_DELAY, frame=mavlink.MAV_FRAME_MISSION),
        item(mavlink.MAV_CMD_DO_CHANGE_SPEED, param2=5.0),
    ],
)
def test_what_can_be_flown_is_taken(accepted: MissionItem) -> None:
    assert accepted.refusal(ORIGIN) is None


def test_item_zero_of_ardupilot_is_home_and_never_refused() -> None:
    mission = MissionStore(ORIGIN, first=1)
    assert mission.refusal(0, item(mavlink.MAV_CMD_NAV_SPLINE_WAYPOINT)) is None
    assert mission.refusal(1, item(mavlink.MAV_CMD_NAV_SPLINE_WAYPOINT)) is not None


@pytest.mark.parametrize(
    ("one", "dwell_s"),
    [
        (item(param1=3.0), 3.0),
        (item(param1=-3.0), 0.0),
        (item(param1=math.nan), 0.0),
        (item(mavlink.MAV_CMD_NAV_LOITER_TIME, param1=5.0), 5.0),
        (item(mavlink.MAV_CMD_NAV_DELAY, param1=2.0), 2.0),
        (item(mavlink.MAV_CMD_NAV_LOITER_UNLIM), math.inf),
        (item(mavlink.MAV_CMD_NAV_TAKEOFF, param1=3.0), 0.0),
    ],
)
def test_how_long_an_item_stays(one: MissionItem, dwell_s: float) -> None:
    assert one.dwell_s == dwell_s


@pytest.mark.parametrize(
    ("one", "speed_mps"),
    [
        (item(mavlink.MAV_CMD_DO_CHANGE_SPEED, param2=4.0), 4.0),
        (item(mavlink.MAV_CMD_DO_CHANGE_SPEED, param2=-1.0), None),
        (item(param2=4.0), None),
    ],
)
def test_which_items_set_a_speed(one: MissionItem, speed_mps: float | None) -> None:
    assert one.speed_mps == speed_mps


def test_the_acceptance_radius_belongs_to_waypoints() -> None:
    assert item(param2=3.0).acceptance_radius_m == 3.0
    assert item(param2=-3.0).acceptance_radius_m == 0.0
    assert item(mavlink.MAV_CMD_NAV_LAND, param2=3.0).acceptance_radius_m == 0.0


def test_the_heading_is_in_degrees_and_nan_leaves_it_open() -> None:
    assert item(param4=90.0).yaw_rad == pytest.approx(math.pi / 2.0)
    assert item().yaw_rad is None
    assert item(mavlink.MAV_CMD_NAV_DELAY, param4=90.0).yaw_rad is None


def test_what_an_item_does_follows_from_its_command() -> None:
    take_off, land = item(mavlink.MAV_CMD_NAV_TAKEOFF), item(mavlink.MAV_CMD_NAV_LAND)
    home, delay = item(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH), item(mavlink.MAV_CMD_NAV_DELAY)
    assert [one.takes_off for one in (take_off, land, home, delay)] == [True, False, False, False]
    assert [one.lands for one in (take_off, land, home, delay)] == [False, True, False, False]
    assert [one.returns_home for one in (take_off, land, home, delay)] == [
        False,
        False,
        True,
        False,
    ]
    assert [one.moves for one in (take_off, land, home, delay)] == [True, True, True, False]


def message(kind: str, x: float, y: float) -> SimpleNamespace:
    return SimpleNamespace(
        get_type=lambda: kind,
        frame=3,
        command=WAYPOINT,
        autocontinue=1,
        param1=0.0,
        param2=0.0,
        param3=0.0,
        param4=0.0,
        x=x,
        y=y,
        z=10.0,
    )


def test_the_older_message_has_degrees() -> None:
    older = MissionItem.of(message("MISSION_ITEM", 47.001, 8.0))
    newer = MissionItem.of(message("MISSION_ITEM_INT", 470_010_000, 80_000_000))
    assert older == newer


@pytest.mark.parametrize("degrees", [math.nan, math.inf, 1e9])
def test_absurd_degrees_of_the_older_message_count_as_none(degrees: float) -> None:
    assert MissionItem.of(message("MISSION_ITEM", degrees, degrees)).has_place is False


def test_a_mission_is_flown_item_by_item_and_then_finished() -> None:
    mission = store(item(), item())
    assert (mission.current, mission.at_last, mission.finished) == (0, False, False)
    mission.item_done()
    assert (mission.current, mission.at_last, mission.finished) == (1, True, False)
    mission.item_done()
    assert mission.finished
    assert mission.reached == [0, 1]


def test_a_finished_mission_resumes_from_the_start() -> None:
    mission = store(item(), item())
    mission.item_done()
    mission.resume()
    assert mission.current == 1
    mission.item_done()
    mission.resume()
    assert (mission.current, mission.finished) == (0, False)


@pytest.mark.parametrize(("number", "selected"), [(-1, False), (0, True), (2, True), (3, False)])
def test_only_an_existing_item_can_be_selected(number: int, selected: bool) -> None:
    mission = store(item(), item(), item())
    mission.announce_current = False
    assert mission.select(number) is selected
    assert mission.announce_current is selected


def test_selecting_home_selects_the_first_item_flown() -> None:
    mission = store(item(), item(), first=1)
    assert mission.select(0)
    assert mission.current == 1


def test_home_alone_is_not_a_mission() -> None:
    mission = store(item(), first=1)
    assert not mission.flyable
    assert mission.current_item is None
    assert not mission.starts_without_take_off


def test_the_vehicle_stops_before_items_that_do_not_move_it() -> None:
    speed = item(mavlink.MAV_CMD_DO_CHANGE_SPEED, param2=3.0)
    mission = store(item(), speed, item(), speed)
    assert not mission.stops_here
    mission.select(2)
    assert mission.stops_here


def test_a_mission_begins_with_a_climb_unless_its_item_takes_off() -> None:
    assert store(item()).starts_without_take_off
    assert not store(item(mavlink.MAV_CMD_NAV_TAKEOFF)).starts_without_take_off


def test_a_new_mission_starts_over() -> None:
    mission = store(item(), item())
    mission.item_done()
    mission.item_done()
    mission.replace((item(),))
    assert (mission.current, mission.finished, mission.is_current(0)) == (0, False, True)


@given(count=st.integers(1, 20), picks=st.lists(st.integers(-2, 22), max_size=20))
def test_the_current_item_always_exists(count: int, picks: list[int]) -> None:
    mission = store(*[item()] * count)
    for pick in picks:
        if not mission.select(pick):
            mission.item_done()
        mission.resume()
        assert mission.current_item is not None
