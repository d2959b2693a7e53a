"""The supervisor with real monitors: what each finding does to the flight, and what it says."""

import json
import math
from dataclasses import dataclass, field, replace
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

from onboard.contract.assessment import TICK_S
from onboard.events import Event
from onboard.files.contract_file import Contract
from onboard.mavlink.endpoint import MavlinkEndpoint
from onboard.monitoring.assumptions import Assumption, Violation
from onboard.monitoring.estimator.heading import POINTING_CONFIRMATION_S
from onboard.monitoring.estimator.position_quality import PositionQualityMonitor, Sign, Worth
from onboard.monitoring.loop_overrun import AGAIN_WITHIN_S, TICK_OVERRUN_S
from onboard.monitoring.response.tracking import CONFIRMATIONS
from onboard.monitoring.response.trim import LEARNING_TIME_S
from onboard.monitoring.response.vehicle_response import SECOND_COMMANDER_MEMORY_S
from onboard.monitoring.response.wind import CONFIRMATION_S
from onboard.monitoring.supervisor import MonitorSupervisor
from onboard.motion.trajectory import State
from onboard.perception.intake import DetectionCounters
from onboard.perception.sources.json_v1 import parse_frame
from onboard.vehicle_state import Pose, Setpoint
from tests.onboard.monitoring.fake_flight import AT_START, FakeFlight
from tests.onboard.perception.messages import frame, obstacle, square

EPOCH_UNIX_S = 1_790_000_000.0
TIMEOUT_S = 0.5
DOUBT = Sign("gps_fix", "GPS fix lost", Worth.DEAD_RECKONED, 1.0, 3.0, "fix type")
STILL = (0.0, 0.0, 0.0)


def pose_at(
    now_s: float, position_ned_m: tuple[float, float, float] = (0.0, 0.0, -4.0), **changes: Any
) -> Pose:
    return Pose(now_s, position_ned_m, STILL, 0.0, 0.0, 0.0)._replace(**changes)


@dataclass
class MovingFlight(FakeFlight):
    """A flight whose reference moves along the leg."""

    speed_mps: float = 0.0

    def reference(self, time_s: float) -> State | None:
        return State((self.speed_mps * time_s, 0.0, 0.0), (self.speed_mps, 0.0, 0.0))


@dataclass
class Bench:
    """A supervisor, the flight it supervises, and the link that it listens to."""

    flight: FakeFlight
    link: MavlinkEndpoint = field(default_factory=lambda: MavlinkEndpoint(1))
    counters: DetectionCounters = field(default_factory=DetectionCounters)
    events: list[Event] = field(default_factory=list)
    now_s: float = 10.0

    def __post_init__(self) -> None:
        self.supervisor = MonitorSupervisor(
            self.link,
            self.flight,
            self.events.append,
            telemetry_timeout_s=TIMEOUT_S,
            counters=self.counters,
        )
        self.link.status = replace(self.link.status, airborne=True, heard_s=math.inf)
        self.see()

    def see(self, *obstacles: dict[str, Any], **changes: Any) -> None:
        """Hand over one frame, stamped now."""
        message = frame(stamp_unix_s=EPOCH_UNIX_S + self.now_s, obstacles=list(obstacles))
        read = parse_frame(json.dumps(message | changes).encode())
        self.supervisor.take_frames([read], self.now_s, EPOCH_UNIX_S)

    def move(self, pose: Pose) -> None:
        self.link.pose = pose
        self.supervisor.take_pose(pose)

    def check(self, pose: Pose | None = None) -> None:
        pose = pose or pose_at(self.now_s)
        self.move(pose)
        self.supervisor.check(pose, self.now_s)

    def run(self, seconds: float, **changes: Any) -> None:
        """Check a pose of every tick, with changes, while the sensor sees nothing."""
        for _ in range(round(seconds / TICK_S)):
            self.now_s += TICK_S
            self.see()
            self.check(pose_at(self.now_s, **changes))

    @property
    def reported(self) -> list[str]:
        return [event.data["assumption"] for event in self.events if event.name == "violation"]

    def names(self) -> list[str]:
        return [str(event.name) for event in self.events]


@pytest.fixture
def bench(contract: Contract) -> Bench:
    return Bench(FakeFlight.under(contract))


def test_a_flight_as_the_contract_assumes_goes_on_unanswered(bench: Bench) -> None:
    bench.run(5.0)
    assert bench.flight.answers == []
    assert bench.events == []


# ------------------------------------------------------------------ reporting and responding


def test_a_violation_is_said_once_and_responded_to_while_it_lasts(bench: Bench) -> None:
    stale = pose_at(bench.now_s - 2.0 * TIMEOUT_S)
    for _ in range(3):
        bench.check(stale)
    assert bench.flight.answered == [Assumption.TELEMETRY_AGE] * 3
    assert bench.reported == ["telemetry_age"]


def test_in_the_next_flight_it_is_said_again(bench: Bench) -> None:
    stale = pose_at(bench.now_s - 2.0 * TIMEOUT_S)
    bench.check(stale)
    bench.supervisor.begin_flight(bench.now_s)
    bench.check(stale)
    assert bench.reported == ["telemetry_age"] * 2


def test_after_a_violation_that_ends_the_flight_the_next_ones_are_moot(bench: Bench) -> None:
    bench.flight.stops = True
    bench.now_s += 2.0  # no frame since, and the pose is old
    bench.check(pose_at(bench.now_s - 2.0))
    assert bench.flight.answered == [Assumption.DETECTION_AGE]
    assert bench.reported == ["detection_age"]


def test_the_order_of_checks_is_the_order_of_responses(bench: Bench) -> None:
    bench.now_s += 2.0
    bench.supervisor.position_sign = DOUBT
    bench.flight.obstacles.add("front/1", square((12.0, 0.0), side_m=40.0), 0.05)
    bench.flight.to_meet = ["front/1"]
    bench.check(pose_at(bench.now_s - 2.0))
    assert bench.flight.answered == [
        Assumption.POSITION_QUALITY,
        Assumption.DETECTION_AGE,
        Assumption.TELEMETRY_AGE,
        Assumption.OBSTACLE_SIZE,
    ]


@pytest.mark.parametrize("in_control", [True, False])
def test_what_does_not_fly_is_not_told_to_respond(bench: Bench, *, in_control: bool) -> None:
    bench.flight.hover() if in_control else bench.flight.stand_by()
    bench.now_s += 2.0
    bench.check(pose_at(bench.now_s - 2.0))
    bench.supervisor.report_defect(bench.now_s)
    assert bench.flight.answers == []
    assert bench.events == []


@pytest.mark.parametrize(("late_s", "late"), [(0.0, False), (2.0 * TICK_OVERRUN_S, True)])
def test_a_late_tick_is_responded_to(bench: Bench, late_s: float, *, late: bool) -> None:
    bench.supervisor.check_loop(bench.now_s)
    bench.supervisor.check_loop(bench.now_s + TICK_S + late_s)
    assert bench.flight.answered == ([Assumption.TICK_OVERRUN] if late else [])


def test_a_defect_of_ours_is_responded_to_like_a_broken_assumption(bench: Bench) -> None:
    bench.supervisor.report_defect(bench.now_s)
    assert bench.flight.answered == [Assumption.SELF_CHECK]
    assert bench.reported == ["self_check"]


# ------------------------------------------------------------------ position


def test_a_doubtful_position_is_responded_to_in_flight(bench: Bench) -> None:
    bench.supervisor.position_sign = DOUBT
    bench.check()
    assert bench.flight.answered == [Assumption.POSITION_QUALITY]


def test_a_doubtful_position_is_said_of_a_hover_and_not_in_standby(bench: Bench) -> None:
    bench.supervisor.position_sign = DOUBT
    bench.flight.stand_by()
    bench.check()
    assert bench.reported == []
    bench.flight.state = AT_START
    bench.check()
    bench.check()
    assert bench.reported == ["position_quality"]
    assert bench.flight.answers == []


def test_the_position_is_judged_between_departure_and_landing_only(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[str] = []
    for name in ("depart", "forget_flight"):
        monkeypatch.setattr(
            PositionQualityMonitor, name, lambda *_, called=name: calls.append(called)
        )
    bench.supervisor.position_sign = DOUBT
    bench.supervisor.begin_flight(bench.now_s)
    assert bench.supervisor.position_sign is None
    bench.supervisor.end_flight()
    assert calls == ["depart", "forget_flight"]


# ------------------------------------------------------------------ estimator resets


def reset(bench: Bench, shift_ned_m: tuple[float, float, float], after_s: float = TICK_S) -> bool:
    """Let the estimate jump, and respond to it in the next tick."""
    before_ned_m = (0.0, 0.0, -4.0) if bench.link.pose is None else bench.link.pose.position_ned_m
    bench.move(pose_at(bench.now_s, before_ned_m))
    bench.now_s += after_s
    north_m, east_m, down_m = (b + s for b, s in zip(before_ned_m, shift_ned_m, strict=True))
    bench.move(pose_at(bench.now_s, (north_m, east_m, down_m)))
    return bench.supervisor.respond_to_resets(bench.now_s)


def declared(bench: Bench, bound_m: float) -> None:
    terms = replace(bench.flight.assessment.terms, estimator_reset_max_m=bound_m)
    bench.flight.assessment = replace(bench.flight.assessment, terms=terms)


def test_without_a_reset_nothing_moves(bench: Bench) -> None:
    assert not reset(bench, (0.05, 0.0, 0.0))
    assert bench.flight.shifts == []


def test_a_declared_reset_moves_everything_and_the_flight_goes_on(bench: Bench) -> None:
    declared(bench, 2.0)
    assert reset(bench, (0.0, 1.0, -0.5))
    assert bench.flight.shifts == [pytest.approx((0.0, 1.0, -0.5))]
    assert [violation.assumption for violation in bench.flight.flown_on] == [
        Assumption.ESTIMATOR_RESET
    ]
    assert bench.names() == ["estimator_reset"]
    assert bench.flight.answers == []
    assert not bench.supervisor.respond_to_resets(bench.now_s)


def test_an_undeclared_reset_moves_everything_and_ends_the_flight_by_the_reference(
    bench: Bench,
) -> None:
    reset(bench, (0.0, 1.0, 0.0))
    assert len(bench.flight.shifts) == 1
    ((violation, measured),) = bench.flight.answers
    assert violation.assumption is Assumption.ESTIMATOR_RESET
    assert measured is None
    assert bench.flight.flown_on == []


def test_a_reset_of_unknown_size_moves_nothing_and_ends_the_flight_where_the_vehicle_is(
    bench: Bench,
) -> None:
    declared(bench, 100.0)
    reset(bench, (0.0, 3.0, 0.0), after_s=2.0)
    assert bench.flight.shifts == []
    ((_, measured),) = bench.flight.answers
    assert measured == bench.link.pose


def test_declared_resets_add_up_from_one_departure_to_the_next(bench: Bench) -> None:
    declared(bench, 1.5)
    for departs in (False, False, True):
        if departs:
            bench.supervisor.begin_flight(bench.now_s)
        reset(bench, (0.0, 1.0, 0.0))
    assert len(bench.flight.answers) == 1
    assert len(bench.flight.flown_on) == 2


@pytest.mark.parametrize(("after_s", "hovers"), [(TICK_S, 0), (2.0, 1)])
def test_a_hover_follows_a_reset_and_says_so(bench: Bench, after_s: float, hovers: int) -> None:
    bench.flight.hover()
    assert reset(bench, (0.0, 3.0, 0.0), after_s)
    assert len(bench.flight.hovers) == hovers
    assert bench.reported == ["estimator_reset"]
    assert bench.flight.answers == []


def test_in_standby_a_reset_moves_the_map_in_silence(bench: Bench) -> None:
    bench.flight.stand_by()
    assert reset(bench, (0.0, 3.0, 0.0))
    assert len(bench.flight.shifts) == 1
    assert bench.events == []


def test_frames_from_the_body_are_placed_in_the_frame_after_the_reset(bench: Bench) -> None:
    declared(bench, 5.0)
    reset(bench, (0.0, 3.0, 0.0))
    seen_s = bench.now_s - TICK_S  # before the reset
    stamp = {"stamp_unix_s": EPOCH_UNIX_S + seen_s}
    bench.see(obstacle(center_m=[8.0, 0.0]), frame="body_frd", **stamp)
    known = bench.flight.obstacles.of_track("front/7")
    assert known is not None
    assert (known.measured.y_min_m + known.measured.y_max_m) / 2.0 == pytest.approx(3.0)


# ------------------------------------------------------------------ detections


def test_a_box_is_remembered_and_the_plan_is_rechecked_once(bench: Bench) -> None:
    for _ in range(2):
        bench.see(obstacle(down_m=[-6.0, 0.0]))
    known = bench.flight.obstacles.of_track("front/7")
    assert known is not None
    assert known.down_m == (-6.0, 0.0)
    assert bench.flight.rechecks == ["front/7"]


def test_what_a_frame_violates_is_responded_to(bench: Bench) -> None:
    bench.see(obstacle(uncertainty_m=0.4), range_m=5.0, field_of_view_deg=30.0)
    assert bench.flight.answered == [
        Assumption.DETECTION_RANGE,
        Assumption.FIELD_OF_VIEW,
        Assumption.DETECTION_UNCERTAINTY,
    ]


def test_a_frame_of_the_future_is_a_fault_of_a_clock_and_not_remembered(bench: Bench) -> None:
    bench.see(obstacle(), stamp_unix_s=EPOCH_UNIX_S + bench.now_s + 5.0)
    assert bench.flight.answered == [Assumption.SENSOR_CLOCK]
    assert len(bench.flight.obstacles) == 0


def test_a_frame_from_an_unknown_place_is_counted_and_not_remembered(bench: Bench) -> None:
    bench.see(obstacle(), frame="body_frd")  # no pose has arrived
    assert bench.counters.unplaced_frames == 1
    assert len(bench.flight.obstacles) == 0


def test_sightings_that_contradict_each_other_are_kept_apart_in_control_only(
    contract: Contract,
) -> None:
    for in_control, apart in ((True, 2), (False, 1)):
        bench = Bench(FakeFlight.under(contract, merged_size_max_m=4.0))
        bench.flight.state = AT_START if in_control else None
        bench.move(pose_at(bench.now_s))
        for east_m in (3.0, 4.5):
            bench.see(obstacle(center_m=[9.0, east_m], size_m=[0.6, 0.6]))
        assert len(bench.flight.obstacles) == apart
        assert Assumption.DETECTION_CONSISTENCY in bench.flight.answered


def test_obstacles_merged_on_the_way_are_said_in_flight_only(contract: Contract) -> None:
    bench = Bench(FakeFlight.under(contract, merged_size_max_m=4.0))
    for name, east_m in (("a", 0.0), ("b", 1.5)):
        bench.flight.obstacles.add(name, square((12.0, east_m), side_m=0.5), 0.05)
    bench.flight.to_meet = ["a"]
    bench.flight.hover()
    assert bench.supervisor.environment_violations(bench.now_s) == []
    assert bench.events == []
    bench.flight.flying = True
    for _ in range(3):
        bench.check()
    assert bench.names() == ["violation", "merged"]
    assert bench.flight.answers == []


def test_parts_of_one_obstacle_are_no_broken_separation(contract: Contract) -> None:
    """Faces seen at a flat angle return points far apart: a scan shows two boxes of one thing."""
    bench = Bench(FakeFlight.under(contract, merged_size_max_m=4.0))
    bench.flight.flying, bench.flight.to_meet = True, ["front/a"]
    bench.move(pose_at(bench.now_s))
    corner = obstacle(id="a", center_m=[9.0, 0.0], size_m=[0.5, 2.0], partial=True)
    side = obstacle(id="b", center_m=[10.5, 1.2], size_m=[0.5, 0.2])
    bench.see(corner, side | {"partial": True})
    bench.check()
    (merged,) = bench.flight.obstacles
    assert merged.members == ("front/a", "front/b")
    assert "violation" not in bench.names()
    bench.see(corner | {"partial": False}, side, sequence=2)  # now it says that they are two
    bench.check()
    assert "violation" in bench.names()


# ------------------------------------------------------------------ how the vehicle responds


def test_a_vehicle_off_its_reference_is_responded_to_once_confirmed(bench: Bench) -> None:
    off = {"position_ned_m": (0.0, 1.0, -4.0)}
    bench.run((CONFIRMATIONS - 1) * TICK_S, **off)
    assert bench.flight.answers == []
    bench.run(TICK_S, **off)
    assert bench.flight.answered == [Assumption.TRACKING_ERROR]
    assert bench.supervisor.response.tracking_monitor.position_error_m == pytest.approx(1.0)


def test_one_pose_is_not_counted_twice(bench: Bench) -> None:
    """Ticks come more often than poses: one glitch must not confirm itself."""
    glitch = pose_at(bench.now_s, (0.0, 1.0, -4.0))
    for _ in range(2 * CONFIRMATIONS):
        bench.check(glitch)
    assert bench.flight.answers == []


def test_without_a_reference_nothing_is_tracked(bench: Bench) -> None:
    bench.flight.state = None
    bench.run(0.2, position_ned_m=(0.0, 9.0, -4.0))
    assert bench.flight.answers == []


def test_a_nose_that_points_elsewhere_is_responded_to(bench: Bench) -> None:
    bench.run(POINTING_CONFIRMATION_S + 2.0 * TICK_S, yaw_rad=0.3)
    assert Assumption.HEADING_ERROR in bench.flight.answered


def test_a_nose_that_still_turns_is_not(bench: Bench) -> None:
    bench.flight.moving = False
    bench.run(2.0 * POINTING_CONFIRMATION_S, yaw_rad=0.3)
    assert bench.flight.answers == []


def test_a_rejected_compass_is_responded_to(bench: Bench) -> None:
    bench.link.compass_ratio = 3.0
    bench.run(3.0)
    assert set(bench.flight.answered) == {Assumption.HEADING_ERROR}
    assert "(compass)" in bench.events[0].text


def windy(bench: Bench) -> None:
    terms = replace(bench.flight.assessment.terms, wind_max_mps=1.0, drag_per_s=0.2)
    bench.flight.assessment = replace(bench.flight.assessment, terms=terms)


def test_more_wind_than_declared_is_responded_to_in_flight(bench: Bench) -> None:
    windy(bench)
    bench.run(LEARNING_TIME_S + CONFIRMATION_S + 0.2, pitch_rad=-0.2)
    assert bench.flight.answered[0] is Assumption.WIND
    assert bench.supervisor.wind_violation is not None


def test_more_wind_than_declared_is_known_before_the_departure(bench: Bench) -> None:
    windy(bench)
    bench.flight.stand_by()
    bench.run(LEARNING_TIME_S + CONFIRMATION_S + 0.2, pitch_rad=-0.2)
    assert bench.supervisor.wind_violation is not None
    assert bench.events == []


def test_the_slope_of_the_ground_is_not_wind(bench: Bench) -> None:
    windy(bench)
    bench.link.status = replace(bench.link.status, airborne=False)
    bench.run(LEARNING_TIME_S + CONFIRMATION_S + 0.2, pitch_rad=-0.2)
    assert bench.supervisor.wind_violation is None


def test_an_attitude_that_does_not_follow_is_responded_to(bench: Bench) -> None:
    bench.run(LEARNING_TIME_S + 0.1)
    for _ in range(60):
        bench.now_s += TICK_S
        asked = Setpoint((0.0, 0.0, -4.0), STILL, (2.5, 0.0, 0.0), 0.0)
        bench.supervisor.response.sent.add(asked, bench.now_s)
        bench.see()
        bench.check()
    assert set(bench.flight.answered) == {Assumption.TILT_RESPONSE}


# ------------------------------------------------------------------ a second commander


def commanded_by_another(bench: Bench) -> None:
    """Let another node's setpoint pass by."""
    message = mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, mavlink.MAV_FRAME_LOCAL_NED, 0, *(0.0,) * 11
    )
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=191)
    bench.link.receive(message.pack(sender), bench.now_s)


def test_another_nodes_setpoints_are_responded_to_in_flight(bench: Bench) -> None:
    commanded_by_another(bench)
    bench.check()
    assert bench.flight.answered == [Assumption.SECOND_COMMANDER]
    assert "(1/191)" in bench.events[0].text


def test_another_nodes_setpoints_of_a_while_ago_are_not(bench: Bench) -> None:
    commanded_by_another(bench)
    bench.run(SECOND_COMMANDER_MEMORY_S + 2.0 * TICK_S)
    bench.flight.answers.clear()
    bench.run(1.0)
    assert bench.flight.answers == []


@pytest.mark.parametrize(("in_control", "reported"), [(True, ["second_commander"]), (False, [])])
def test_a_second_commander_of_a_hover_is_only_said(
    bench: Bench, reported: list[str], *, in_control: bool
) -> None:
    bench.flight.hover() if in_control else bench.flight.stand_by()
    commanded_by_another(bench)
    bench.check()
    assert bench.reported == reported
    assert bench.flight.answers == []


def test_a_vehicle_that_follows_another_target_is_suspected_not_blamed(bench: Bench) -> None:
    """A pilot's mode change looks the same until the next heartbeat."""
    ours = Setpoint((0.0, 0.0, -4.0), STILL, STILL, 0.0)
    for _ in range(2 * CONFIRMATIONS):
        bench.now_s += TICK_S
        bench.see()
        bench.supervisor.response.sent.add(ours, bench.now_s)
        bench.link.target = ((5.0, 5.0, -4.0), STILL)
        bench.link.target_heard_s = bench.now_s
        bench.check(pose_at(bench.now_s, (0.0, 1.0, -4.0)))
    assert bench.names() == ["suspicion"]
    assert bench.flight.answers == []


def test_after_a_departure_no_earlier_suspicion_is_left(bench: Bench) -> None:
    bench.link.target = ((5.0, 5.0, -4.0), STILL)
    bench.supervisor.response.sent.add(Setpoint((0.0, 0.0, -4.0), STILL, STILL, 0.0), bench.now_s)
    bench.link.target_heard_s = bench.now_s
    bench.check()
    bench.supervisor.begin_flight(bench.now_s)
    bench.flight.state = AT_START
    # The echo of before is not heard again; our own target comes back.
    bench.link.target = ((0.0, 0.0, -4.0), STILL)
    bench.link.target_heard_s = bench.now_s + TICK_S
    bench.run(CONFIRMATIONS * TICK_S, position_ned_m=(0.0, 1.0, -4.0))
    assert Assumption.TRACKING_ERROR in bench.flight.answered
    assert "suspicion" not in bench.names()


def test_in_seen_space_what_costs_time_only_is_a_delay(bench: Bench) -> None:
    bench.flight.in_seen_space = True
    blind = Violation(Assumption.DETECTION_AGE, 0.5, 0.3, "s", "front")
    bench.supervisor.report_and_respond(blind, 0.0)
    assert (bench.names().count("delayed"), bench.reported) == (1, [])
    # Guidance is told all the same: a cruise may have to go on as THREAD.
    assert bench.flight.answered == [Assumption.DETECTION_AGE]
    defect = Violation(Assumption.SELF_CHECK, 1.0, 0.0, "exceptions")
    bench.supervisor.report_and_respond(defect, 0.0)
    assert bench.flight.answered == [Assumption.DETECTION_AGE, Assumption.SELF_CHECK]
    assert bench.reported == ["self_check"]


@pytest.mark.parametrize("passive", [True, False])
def test_in_seen_space_the_speed_error_matters_to_the_run_on_only(
    bench: Bench, *, passive: bool
) -> None:
    flight = bench.flight
    flight.in_seen_space = True
    terms = replace(flight.assessment.terms, passive_safety=passive)
    flight.assessment = replace(flight.assessment, terms=terms)
    fast = Violation(Assumption.VELOCITY_ERROR, 0.9, 0.2, "m/s", "x")
    bench.supervisor.report_and_respond(fast, 0.0)
    # Guidance is told in both cases; without a run-on it is a delay.
    assert flight.answered == [Assumption.VELOCITY_ERROR]
    assert bench.names() == ["violation" if passive else "delayed"]


@pytest.mark.parametrize(
    ("silent_s", "speed_mps", "holds"), [(0.3, 2.0, False), (0.7, 2.0, True), (0.7, 0.0, False)]
)
def test_in_seen_space_a_tick_so_late_that_the_stream_was_lost_ends_where_the_vehicle_is(
    bench: Bench, silent_s: float, speed_mps: float, *, holds: bool
) -> None:
    moving = MovingFlight(bench.flight.assessment, bench.flight.obstacles)
    moving.speed_mps, moving.in_seen_space = speed_mps, True
    bench = Bench(moving)
    assert 0.3 < moving.assessment.terms.setpoint_loss_timeout_s < 0.7
    bench.check()
    bench.supervisor.check_loop(bench.now_s)
    bench.supervisor.check_loop(bench.now_s + silent_s)
    lost = [Assumption.SELF_CHECK] * holds
    assert bench.flight.answered == [Assumption.TICK_OVERRUN, *lost]
    assert all(measured is bench.link.pose for _, measured in bench.flight.answers[1:])


@pytest.mark.parametrize(
    ("apart_s", "speed_mps", "holds"),
    [(AGAIN_WITHIN_S - 1.0, 2.0, True), (AGAIN_WITHIN_S + 1.0, 2.0, False), (5.0, 0.0, False)],
)
def test_in_seen_space_a_second_late_tick_in_motion_within_a_minute_is_answered(
    bench: Bench, apart_s: float, speed_mps: float, *, holds: bool
) -> None:
    moving = MovingFlight(bench.flight.assessment, bench.flight.obstacles)
    moving.speed_mps, moving.in_seen_space = speed_mps, True
    bench = Bench(moving)
    for in_time_s in (0.5, apart_s - 0.2):
        for _ in range(round(in_time_s / TICK_S)):
            bench.now_s += TICK_S
            bench.supervisor.check_loop(bench.now_s)
        bench.now_s += 0.2
        bench.supervisor.check_loop(bench.now_s)
    assert bench.flight.answered == [
        *[Assumption.TICK_OVERRUN] * 2,
        *[Assumption.LATE_TICKS] * holds,
    ]
    assert all(measured is None for _, measured in bench.flight.answers)


@pytest.mark.parametrize("doubt", ["compass", "gyros", "none"])
def test_a_heading_that_is_doubted_in_standby_voids_what_has_been_seen(
    bench: Bench, doubt: str
) -> None:
    """It is flown into after the departure, which begins with fresh monitors."""
    bench.flight.stand_by()
    terms = replace(bench.flight.assessment.terms, heading_error_rad=math.radians(1.0))
    bench.flight.assessment = replace(bench.flight.assessment, terms=terms)
    look(bench)
    assert bench.supervisor.seen.size > 0
    bench.link.compass_ratio = 3.0 if doubt == "compass" else 0.5
    for tick in range(round(4.0 / TICK_S)):
        bench.now_s += TICK_S
        if doubt == "gyros":
            bench.link.heading_drift.drift_rad = math.radians(10.0) * min(tick / 100.0, 1.0)
        bench.check()
    assert (bench.supervisor.seen.size > 0) == (doubt == "none")
    if doubt != "none":
        assert doubt in bench.supervisor.seen.void_reason
    assert bench.events == []


def test_a_reset_of_unknown_size_forgets_where_frames_were_taken(bench: Bench) -> None:
    look(bench)
    seen_s = bench.now_s
    bench.now_s += 0.6
    bench.move(pose_at(bench.now_s, (2.0, 0.0, -4.0)))
    assert bench.supervisor._poses.at(seen_s) is None


# ------------------------------------------------------------------ seen space


def look(bench: Bench, *obstacles: dict[str, Any]) -> None:
    """Hand over enough frames for cells to be free, each with its pose."""
    for _ in range(5):
        bench.now_s += 0.05
        bench.move(pose_at(bench.now_s - 0.02))
        bench.move(pose_at(bench.now_s))
        bench.see(*obstacles)


def free_at(bench: Bench, x_m: float, y_m: float) -> bool:
    return bench.supervisor.seen.grid().is_free(x_m, x_m, y_m, y_m)


def test_frames_say_what_is_free(bench: Bench) -> None:
    look(bench)
    assert free_at(bench, 6.0, 0.0)
    assert bench.flight.answers == []


def test_a_doubted_position_stops_the_seeing(bench: Bench) -> None:
    bench.supervisor.position_sign = DOUBT
    look(bench)
    assert bench.supervisor.seen.size == 0


@pytest.mark.parametrize("relied_on", [True, False])
def test_a_contradiction_voids_the_set_and_is_a_violation_where_it_is_relied_on(
    bench: Bench, *, relied_on: bool
) -> None:
    bench.supervisor.seen.relied_on = relied_on
    look(bench)
    bench.now_s += 0.05
    bench.move(pose_at(bench.now_s))
    bench.see(obstacle(center_m=[6.0, 0.0]))
    assert bench.supervisor.seen.size == 0
    assert bench.reported == (["sensor_contradiction"] if relied_on else [])
    assert bench.flight.answered == [Assumption.SENSOR_CONTRADICTION] * relied_on


def test_frames_with_more_than_the_declared_error_say_nothing(bench: Bench) -> None:
    look(bench)
    assert bench.supervisor.seen.size > 0
    look(bench, obstacle(center_m=[6.0, 9.0], uncertainty_m=0.5))
    assert bench.supervisor.seen.size == 0
    assert "detection_uncertainty" in bench.supervisor.seen.void_reason


@pytest.mark.parametrize(
    ("bound_m", "flying", "kept"), [(1.5, True, True), (0.0, True, False), (1.5, False, False)]
)
def test_a_reset_shifts_what_was_seen_if_it_is_declared_and_voids_it_otherwise(
    bench: Bench, bound_m: float, *, flying: bool, kept: bool
) -> None:
    declared(bench, bound_m)
    look(bench)
    assert free_at(bench, 4.0, 1.0)
    if not flying:
        bench.flight.hover()
    assert reset(bench, (0.0, 1.0, 0.0))
    assert free_at(bench, 4.0, 2.0) == kept
    assert (bench.supervisor.seen.size > 0) == kept
