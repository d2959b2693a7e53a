"""Legs one after another, and missions that replace them in flight."""

import math
from itertools import pairwise

import pytest

from onboard.autonomy import Autonomy
from onboard.files.contract_file import Contract
from onboard.files.mission_file import Mission
from onboard.guidance.phases import Phase
from onboard.guidance.route import Route
from onboard.recording.state import state_of
from tests.onboard.test_autonomy import EPOCH_UNIX_S, OFFBOARD, POSCTL, Rig, box


def mission_to(*ends_ned_m: tuple[float, float], altitude_m: float = 4.0) -> Mission:
    legs = [{"end_ned_m": end_m, "target_half_width_m": 8.0} for end_m in ends_ned_m]
    return Mission.model_validate({"altitude_m": altitude_m, "legs": legs})


def sent(rig: Rig, mission: Mission) -> None:
    rig.autonomy.receive_mission(mission.model_dump_json().encode(), rig.now_s)


@pytest.fixture
def cruising(px4_contract: Contract) -> Rig:
    autonomy = Autonomy(px4_contract, mission_to((60.0, 0.0)), epoch_unix_s=EPOCH_UNIX_S)
    rig = Rig(autonomy, mode=OFFBOARD)
    rig.run(6.0)
    assert rig.phase is Phase.CRUISE
    return rig


# ---------------------------------------------------------------------------- legs


def test_legs_begin_where_the_vehicle_is() -> None:
    route = Route(mission_to((30.0, 0.0), (30.0, 40.0)))
    assert route.frame.origin_ned_m == (0.0, 0.0, -4.0)
    assert route.length_m == 30.0
    assert route.begin_next(30.0, -2.0)
    assert route.frame.origin_ned_m == (30.0, -2.0, -4.0)
    assert route.frame.heading_rad == pytest.approx(math.pi / 2.0)
    assert route.length_m == 42.0
    assert not route.begin_next(30.0, 40.0)


def test_a_leg_that_ends_here_has_been_flown() -> None:
    route = Route(mission_to((30.0, 0.0), (33.0, 0.0), (33.0, 20.0)))
    assert route.begin_next(33.0, 0.0)
    assert route.leg.end_ned_m == (33.0, 20.0)
    assert not Route(mission_to((30.0, 0.0), (33.0, 0.0))).begin_next(33.0, 0.05)


def test_a_successor_begins_here_in_flight_and_at_its_start_before() -> None:
    route, other = Route(mission_to((30.0, 0.0), (30.0, 40.0))), mission_to((0.0, 50.0))
    route.successor = other
    assert route.begin_next(10.0, 0.0)
    assert route.mission is other
    assert route.successor is None
    assert route.frame.origin_ned_m == (10.0, 0.0, -4.0)
    route.successor = other
    route.restart()
    assert route.frame.origin_ned_m == (0.0, 0.0, -4.0)


# ---------------------------------------------------------------------------- in flight


def test_in_cruise_it_stops_at_once_and_flies_the_other_mission(cruising: Rig) -> None:
    north_m, _, _ = cruising.position_ned_m
    sent(cruising, mission_to((10.0, 30.0), (40.0, 30.0)))
    cruising.run(5.0, until=lambda: cruising.velocity_ned_mps[0] < 0.01)
    # 2.8 m/s at the contract's limits: within its stopping distance.
    stopping_m = cruising.autonomy.assessment.inflated.stopping_distance_m
    assert cruising.position_ned_m[0] - north_m < stopping_m
    cruising.run(60.0, until=lambda: cruising.phase is Phase.ARRIVED)
    assert cruising.position_ned_m == pytest.approx((40.0, 30.0, -4.0), abs=0.05)
    assert len(cruising.texts("mission_changed")) == 1
    assert cruising.texts("violation") == []


def test_an_avoidance_is_finished_first(cruising: Rig) -> None:
    cruising.obstacles = [box((30.0, 0.2))]
    cruising.run(20.0, until=lambda: cruising.phase is Phase.AVOID)
    (step,) = cruising.autonomy.navigator.take_planned()
    sent(cruising, mission_to((30.0, 40.0)))
    cruising.run(20.0, until=lambda: cruising.phase is not Phase.AVOID)
    # To its very end, as planned, and only then to a stop.
    assert cruising.phase is Phase.CRUISE
    end_m = step.leg.position_ned(step.plan.trajectory.final.position_leg_m)
    assert cruising.position_ned_m == pytest.approx(end_m, abs=0.1)
    cruising.run(60.0, until=lambda: cruising.phase is Phase.ARRIVED)
    assert cruising.position_ned_m == pytest.approx((30.0, 40.0, -4.0), abs=0.05)


def test_an_obstacle_beyond_the_stop_does_not_matter(cruising: Rig) -> None:
    cruising.obstacles = [box((cruising.position_ned_m[0] + 11.0, 0.2))]
    cruising.run(0.1)
    sent(cruising, mission_to((60.0, 30.0)))
    cruising.run(60.0, until=lambda: cruising.phase in (Phase.ARRIVED, Phase.HOLD))
    assert cruising.phase is Phase.ARRIVED
    assert cruising.texts("violation") == []


def test_another_height_is_refused_in_flight_and_said(cruising: Rig) -> None:
    sent(cruising, mission_to((0.0, 40.0), altitude_m=9.0))
    cruising.run(30.0, until=lambda: cruising.phase is Phase.ARRIVED)
    assert cruising.position_ned_m == pytest.approx((60.0, 0.0, -4.0), abs=0.05)
    assert cruising.texts("mission_refused") == [
        "mission refused: altitude 9 m (expected 4 m while in flight)"
    ]


def test_the_last_of_several_counts_even_while_the_nose_turns(cruising: Rig) -> None:
    sent(cruising, mission_to((10.0, 30.0)))
    cruising.run(0.1)
    sent(cruising, mission_to((10.0, -30.0)))
    cruising.run(10.0, until=lambda: "cruise (leg flown)" in cruising.texts("phase"))
    sent(cruising, mission_to((50.0, 20.0)))
    cruising.run(60.0, until=lambda: cruising.phase is Phase.ARRIVED)
    assert cruising.position_ned_m == pytest.approx((50.0, 20.0, -4.0), abs=0.05)


def test_in_standby_it_begins_at_its_own_start(cruising: Rig) -> None:
    cruising.mode = POSCTL
    cruising.run(0.2)
    sent(cruising, mission_to((0.0, 40.0)))
    cruising.position_ned_m, cruising.velocity_ned_mps = (0.0, 0.0, -4.0), (0.0, 0.0, 0.0)
    cruising.run(1.0)
    cruising.mode = OFFBOARD
    cruising.run(40.0, until=lambda: cruising.phase is Phase.ARRIVED)
    assert cruising.position_ned_m == pytest.approx((0.0, 40.0, -4.0), abs=0.05)


def test_a_hold_is_not_left_for_another_mission(cruising: Rig) -> None:
    cruising.seeing = False
    cruising.run(2.0, until=lambda: cruising.phase is Phase.HOLD)
    cruising.seeing = True
    cruising.run(3.0)
    held_m = cruising.position_ned_m
    sent(cruising, mission_to((0.0, 40.0)))
    cruising.run(5.0)
    assert cruising.phase is Phase.HOLD
    assert cruising.position_ned_m == held_m


@pytest.mark.parametrize(
    "payload",
    [
        b"\xff no JSON",
        b"[]",
        b'{"altitude_m": 4.0, "legs": []}',
        b'{"altitude_m": NaN, "legs": [{"end_ned_m": [1.0, 2.0]}]}',
        b'{"altitude_m": 4.0, "legs": [{"end_ned_m": [0.0, 0.0]}]}',
        b'{"altitude_m": 4.0, "legs": [{"end_ned_m": [1e300, 2.0]}]}',
        b'{"altitude_m": 4.0, "legs": [{"end_ned_m": [1.0, 2.0]}], "wind": 1}',
    ],
)
def test_a_malformed_mission_is_counted_and_changes_nothing(cruising: Rig, payload: bytes) -> None:
    cruising.autonomy.receive_mission(payload, cruising.now_s)
    cruising.run(0.1)
    dropped = state_of(cruising.autonomy, cruising.now_s).dropped
    assert dropped.missions_malformed == 1
    assert cruising.velocity_ned_mps[0] == pytest.approx(2.8, abs=0.01)
    assert cruising.texts("violation") == []


@pytest.mark.parametrize("east_m", [0.0, 0.2])
def test_the_new_leg_begins_at_the_height_at_which_the_vehicle_stopped(
    px4_contract: Contract, east_m: float
) -> None:
    """A climb just flown is not yet undone where the vehicle stops; the setpoints do not jump."""
    mission = mission_to((60.0, 0.0)).model_copy(update={"climb_max_m": 1.5})
    rig = Rig(Autonomy(px4_contract, mission, epoch_unix_s=EPOCH_UNIX_S), mode=OFFBOARD)
    rig.obstacles = [box((24.0, east_m))]
    rig.run(20.0, until=lambda: rig.phase is Phase.AVOID)
    sent(rig, mission_to((30.0, 40.0)))
    rig.run(60.0, until=lambda: rig.phase is Phase.ARRIVED)
    down_m = [setpoint.z for setpoint in rig.setpoints]
    assert min(down_m) < -4.05
    assert max(abs(after - before) for before, after in pairwise(down_m)) < 0.05
    steps = [
        (math.hypot(setpoint.vx, setpoint.vy, setpoint.vz), abs(after.z - setpoint.z))
        for setpoint, after in pairwise(rig.setpoints)
    ]
    assert all(moved_m < 1e-3 for speed_mps, moved_m in steps if speed_mps < 1e-3)
