"""The modes that fly by themselves, driven by their reference alone."""

import math
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.auto_flight import AutoFlight
from sitl.autopilot.flavours.parameters import ParameterStore
from sitl.autopilot.flavours.px4 import Px4
from sitl.autopilot.mission import MissionItem, MissionStore
from sitl.autopilot.modes import Mode
from sitl.autopilot.plan.rally import RallyStore
from sitl.autopilot.settings import FlightSettings
from sitl.config import HomeConfig
from sitl.plant.truth import Vector
from tests.sitl.autopilot.truths import truth_at

PERIOD_S = 0.02
ORIGIN = HomeConfig(latitude_deg=47.0, longitude_deg=8.0, altitude_m=500.0)
_FLAVOUR = Px4()
SETTINGS: FlightSettings = replace(
    _FLAVOUR.settings(ParameterStore(_FLAVOUR.parameter_specs(1), {})),
    return_height_m=10.0,
    take_off_height_m=3.0,
)


class Flying:
    """Automatic flight whose vehicle is always at its reference."""

    def __init__(self, down_m: float = -5.0, *items: MissionItem) -> None:
        self.mission = MissionStore(ORIGIN, 0)
        self.mission.replace(items)
        self.rally = RallyStore(ORIGIN)
        truth = truth_at(position_ned_m=(0.0, 0.0, down_m))
        self.auto = AutoFlight(SETTINGS, truth, self.mission, self.rally)
        self.now_s = 0.0

    def fly(self, mode: Mode, time_s: float) -> Mode | None:
        """Fly a mode until another follows or the time is over; return what follows."""
        for _ in range(round(time_s / PERIOD_S)):
            self.now_s += PERIOD_S
            truth = truth_at(self.now_s, self.auto.reference.position_ned_m)
            following = self.auto.fly(mode, truth, PERIOD_S)
            if following is not None:
                return following
        return None

    @property
    def position_ned_m(self) -> Vector:
        return self.auto.reference.position_ned_m


def item(
    command: int = mavlink.MAV_CMD_NAV_WAYPOINT, north: int = 0, **changes: float
) -> MissionItem:
    """Return an item so many ten-millionths of a degree (11 mm each) north, 8 m up."""
    made = MissionItem(
        mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, command, 1, 0.0, 0.0, 0.0, math.nan,
        470_000_000 + north, 80_000_000, 8.0,
    )  # fmt: skip
    return made._replace(**changes)  # type: ignore[arg-type]


def test_hold_stays() -> None:
    flying = Flying()
    flying.auto.begin(Mode.HOLD, truth_at())
    assert flying.fly(Mode.HOLD, 5.0) is None
    assert flying.position_ned_m == pytest.approx((0.0, 0.0, -5.0))


def test_hold_flies_to_its_target() -> None:
    flying = Flying()
    flying.auto.target_ned_m = (8.0, 6.0, -7.0)
    flying.fly(Mode.HOLD, 20.0)
    assert flying.position_ned_m == pytest.approx((8.0, 6.0, -7.0), abs=0.1)


def test_a_chosen_cruise_speed_is_kept() -> None:
    flying = Flying()
    flying.auto.target_ned_m = (100.0, 0.0, -5.0)
    flying.auto.cruise_speed_mps = 2.0
    flying.fly(Mode.HOLD, 10.0)
    assert flying.auto.reference.speed_mps == pytest.approx(2.0, abs=0.05)


def test_take_off_ends_in_hold() -> None:
    flying = Flying(0.0)
    flying.auto.target_ned_m = (0.0, 0.0, -3.0)
    assert flying.fly(Mode.TAKEOFF, 20.0) is Mode.HOLD
    assert flying.position_ned_m[2] == pytest.approx(-3.0, abs=0.1)


def test_landing_sinks_slower_near_the_ground() -> None:
    flying = Flying(-20.0)
    flying.fly(Mode.LAND, 3.0)
    assert flying.auto.reference.speed_mps == pytest.approx(SETTINGS.sink_speed_mps, abs=0.05)
    while flying.position_ned_m[2] < -3.0:
        flying.fly(Mode.LAND, 0.5)
    assert flying.auto.reference.speed_mps == pytest.approx(SETTINGS.landing_speed_mps, abs=0.1)


@pytest.mark.parametrize(("down_m", "return_down_m"), [(-5.0, -10.0), (-15.0, -15.0)])
def test_return_climbs_then_comes_home_then_lands(down_m: float, return_down_m: float) -> None:
    flying = Flying(down_m)
    flying.auto.home_ned_m = (20.0, 0.0, 0.0)
    flying.auto.begin(Mode.RTL, truth_at())
    assert flying.fly(Mode.RTL, 60.0) is Mode.LAND
    assert flying.position_ned_m == pytest.approx((20.0, 0.0, return_down_m), abs=0.2)


def test_a_mission_flies_its_items_in_order_and_holds_after_the_last() -> None:
    flying = Flying(-8.0, item(north=900), item(north=1800))
    flying.auto.begin(Mode.MISSION, truth_at(position_ned_m=(0.0, 0.0, -8.0)))
    assert flying.fly(Mode.MISSION, 30.0) is None
    assert flying.mission.reached == [0, 1]
    assert flying.mission.finished
    assert flying.position_ned_m[0] == pytest.approx(20.0, abs=0.3)


def test_a_mission_on_the_ground_climbs_first() -> None:
    flying = Flying(0.0, item(north=900))
    flying.auto.begin(Mode.MISSION, truth_at())
    flying.fly(Mode.MISSION, 1.0)
    north_m, _, down_m = flying.position_ned_m
    assert north_m == 0.0
    assert down_m < 0.0


def test_a_waypoint_dwells() -> None:
    flying = Flying(-8.0, item(param1=3.0), item(north=900))
    flying.auto.begin(Mode.MISSION, truth_at(position_ned_m=(0.0, 0.0, -8.0)))
    flying.fly(Mode.MISSION, 2.9)
    assert flying.mission.current == 0
    flying.fly(Mode.MISSION, 0.3)
    assert flying.mission.current == 1


def test_an_item_may_set_the_speed_or_end_in_return() -> None:
    speed = item(mavlink.MAV_CMD_DO_CHANGE_SPEED, param2=2.5)
    flying = Flying(-8.0, speed, item(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH))
    flying.auto.begin(Mode.MISSION, truth_at(position_ned_m=(0.0, 0.0, -8.0)))
    assert flying.fly(Mode.MISSION, 1.0) is Mode.RTL
    assert flying.auto.cruise_speed_mps == 2.5


def test_a_landing_item_lands_where_it_is() -> None:
    flying = Flying(-8.0, item(mavlink.MAV_CMD_NAV_LAND, north=900))
    flying.auto.begin(Mode.MISSION, truth_at(position_ned_m=(0.0, 0.0, -8.0)))
    flying.fly(Mode.MISSION, 20.0)
    assert flying.auto.landing
    north_m, _, down_m = flying.position_ned_m
    assert north_m == pytest.approx(10.0, abs=0.3)
    assert down_m > -6.0


@pytest.mark.parametrize(("param4", "yaw_deg"), [(math.nan, 0.0), (45.0, 45.0)])
def test_the_nose_points_where_the_item_says_else_ahead(param4: float, yaw_deg: float) -> None:
    flying = Flying(-8.0, item(north=900, param4=param4))
    flying.auto.reference.yaw_rad = 2.0
    flying.auto.begin(Mode.MISSION, truth_at(position_ned_m=(0.0, 0.0, -8.0)))
    flying.fly(Mode.MISSION, 0.1)
    assert math.degrees(flying.auto.reference.yaw_rad) == pytest.approx(yaw_deg, abs=0.01)


def test_return_ends_at_a_rally_point_that_is_nearer_than_home() -> None:
    flying = Flying()
    rally = item(mavlink.MAV_CMD_NAV_RALLY_POINT, north=900)  # 10 m north
    flying.rally.replace((rally,))
    flying.auto.reference.position_ned_m = (8.0, 0.0, -10.0)
    assert flying.fly(Mode.RTL, 30.0) is Mode.LAND
    assert flying.position_ned_m == pytest.approx((10.0, 0.0, -10.0), abs=0.1)


@pytest.mark.parametrize(("times", "flown"), [(0, 1), (1, 2), (2, 3)])
def test_a_jump_repeats_the_items_before_it_so_many_times(times: int, flown: int) -> None:
    jump = item(mavlink.MAV_CMD_DO_JUMP, param1=0.0, param2=times)
    flying = Flying(-8.0, item(north=300), item(), jump, item(north=600))
    flying.fly(Mode.MISSION, 60.0)
    assert flying.mission.finished
    assert flying.mission.reached.count(0) == flown


def test_jumping_for_ever_never_finishes_and_a_jump_to_nowhere_goes_on() -> None:
    for_ever = item(mavlink.MAV_CMD_DO_JUMP, param1=0.0, param2=-1.0)
    flying = Flying(-8.0, item(north=300), item(), for_ever)
    flying.fly(Mode.MISSION, 60.0)
    assert flying.mission.reached.count(0) > 3
    nowhere = item(mavlink.MAV_CMD_DO_JUMP, param1=9.0, param2=-1.0)
    flying = Flying(-8.0, item(north=300), nowhere, item())
    flying.fly(Mode.MISSION, 30.0)
    assert flying.mission.finished


@pytest.mark.parametrize(("east", "slowest_mps"), [(0, 4.5), (600, 0.0)])
def test_a_waypoint_on_a_straight_way_is_flown_through_at_speed(
    east: int, slowest_mps: float
) -> None:
    corner = item(north=2000)
    after = corner._replace(x=corner.x + (0 if east else 2000), y=corner.y + east * 4)
    flying = Flying(-8.0, corner, after)
    flying.fly(Mode.MISSION, 2.0)
    while flying.mission.current == 0:
        flying.fly(Mode.MISSION, PERIOD_S)
    speed_mps = flying.auto.reference.speed_mps
    assert speed_mps > slowest_mps
    assert east == 0 or speed_mps < 3.5  # a turn is not


def test_without_a_following_place_a_waypoint_is_a_stop() -> None:
    flying = Flying(-8.0, item(north=1000), item(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH))
    while flying.mission.current == 0:
        flying.fly(Mode.MISSION, PERIOD_S)
    assert flying.auto.reference.speed_mps < 3.5
