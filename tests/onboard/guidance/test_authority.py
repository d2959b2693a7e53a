"""Who flies: what is taken, given back, handed over and taken back, and what never is."""

from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.contract.assessment import TICK_S, Assessment, assess
from onboard.events import Event
from onboard.files.contract_file import Contract, load_contract
from onboard.files.yaml_file import validate
from onboard.guidance.authority import (
    HANDOVER_AFTER_S,
    TAKE_BACK_AFTER_S,
    ControlAuthority,
    hovering_at,
)
from onboard.guidance.departure import STOPPED_MPS, Refusal, RefusalKind
from onboard.guidance.navigator import Navigator
from onboard.guidance.phases import Phase
from onboard.mavlink.endpoint import MavlinkEndpoint
from onboard.mavlink.profiles.registry import profile_named
from onboard.monitoring.assumptions import Assumption, Violation
from onboard.monitoring.estimator.position_quality import DEAD_RECKONING_S, Sign, Worth
from onboard.monitoring.flight_authorization import FlightAuthorizationGate
from onboard.monitoring.supervisor import MonitorSupervisor
from onboard.vehicle_state import AUTOPILOT_SILENCE_S, Pose, Setpoint
from tests.onboard.conftest import CONTRACTS

STILL = (0.0, 0.0, 0.0)
PLANNED = Setpoint((7.0, 8.0, -4.0), STILL, STILL, 0.5)
DEAD_RECKONED = Sign("gps_fix", "GPS fix lost", Worth.DEAD_RECKONED, 1.0, 3.0, "fix type")
CONTRACT = load_contract(CONTRACTS / "precise_vehicle.yaml")


def pose_at(now_s: float, north_m: float = 0.0) -> Pose:
    return Pose(now_s, (north_m, 0.0, -4.0), STILL, 0.0, 0.0, 0.25)


class FakeNavigator:
    """A navigator as far as its phase; like the real one, it refuses an illegal transition."""

    def __init__(self, assessment: Assessment) -> None:
        self.assessment = assessment
        self.phase = Phase.STANDBY
        self.refusals: list[Refusal] = []
        self.planned = PLANNED
        self.hovers: list[Pose] = []
        # Without a budget of energy, and on the way out.
        mission = SimpleNamespace(energy=None, start_clear_of_movers_m=None)
        self.situation = SimpleNamespace(route=SimpleNamespace(mission=mission, returning=False))

    @property
    def flying(self) -> bool:
        return self.phase not in (Phase.STANDBY, Phase.HOLD, Phase.ARRIVED)

    def departure_refusals(self, pose: Pose) -> list[Refusal]:  # noqa: ARG002
        return self.refusals

    def accept_no_progress(self, *, accepted: bool) -> bool:
        return accepted

    def take_control(self, pose: Pose, now_s: float) -> None:  # noqa: ARG002
        assert self.phase is Phase.STANDBY, "control taken twice"
        self.phase = Phase.CRUISE

    def release_control(self, now_s: float) -> None:  # noqa: ARG002
        assert self.phase is not Phase.STANDBY, "control released twice"
        self.phase = Phase.STANDBY

    def setpoint(self, now_s: float) -> Setpoint | None:  # noqa: ARG002
        return None if self.phase is Phase.STANDBY else self.planned

    def hover_at(self, pose: Pose, now_s: float) -> None:  # noqa: ARG002
        self.hovers.append(pose)


@dataclass
class FakeDetections:
    """Sensors that see, unless told otherwise."""

    blind: Violation | None = None
    ring: Violation | None = None
    contradicting: list[str] = field(default_factory=list)
    near: list[str] = field(default_factory=list)
    words: list[tuple[float, float, float]] = field(default_factory=list)

    @property
    def monitor(self) -> Any:
        return self

    @property
    def movers(self) -> Any:
        return SimpleNamespace(
            check_ring=lambda _: self.ring,
            refusal=None,
            near=lambda _pose, radius_m, _now_s: self.near if radius_m > 0.0 else [],
            take_word=lambda pose, radius_m, said_s: self.words.append(
                (pose.position_ned_m[0], radius_m, said_s)
            ),
        )

    @property
    def consistency(self) -> Any:
        return self

    def check(self, now_s: float, terms: object) -> Violation | None:  # noqa: ARG002
        return self.blind

    def contradicted(self, now_s: float) -> list[str]:  # noqa: ARG002
        return self.contradicting


@dataclass
class FakeSupervisor:
    """Monitors that find nothing, unless told otherwise."""

    detections: FakeDetections = field(default_factory=FakeDetections)
    position_sign: Sign | None = None
    wind_violation: Violation | None = None
    flight_time_violation: Violation | None = None
    telemetry: Violation | None = None
    environment: list[Violation] = field(default_factory=list)
    position_failures: list[str] = field(default_factory=list)
    lost_for: float = 0.0
    flights: int = 0
    ended: int = 0

    @property
    def position_quality(self) -> Any:
        return self

    def departure_failures(self, now_s: float) -> list[str]:  # noqa: ARG002
        return self.position_failures

    def lost_for_s(self, sign: Sign, now_s: float) -> float:  # noqa: ARG002
        return self.lost_for

    def telemetry_age_violation(self, pose: Pose, now_s: float) -> Violation | None:  # noqa: ARG002
        return self.telemetry

    def environment_violations(self, now_s: float) -> list[Violation]:  # noqa: ARG002
        return self.environment

    def begin_flight(self, now_s: float) -> None:  # noqa: ARG002
        self.flights += 1

    def end_flight(self) -> None:
        self.ended += 1


class Bench:
    """An authority between a scripted pilot, autopilot and supervisor."""

    def __init__(
        self, contract: Contract, *, outside: bool = False, age_max_s: float | None = None
    ) -> None:
        assessment = assess(contract, "inner", mission_altitude_m=4.0)
        self.link = MavlinkEndpoint(1)
        self.navigator = FakeNavigator(assessment)
        self.supervisor = FakeSupervisor()
        self.events: list[Event] = []
        self.authority = ControlAuthority(
            self.link,
            cast(Navigator, self.navigator),
            cast(MonitorSupervisor, self.supervisor),
            FlightAuthorizationGate(contract.sha256, age_max_s),
            self.events.append,
            fly_outside_contract=outside,
        )
        self.now_s = 0.0
        self.silent = False
        self.lost = False
        self.north_m = 0.0
        self.says(armed=True, airborne=True, external_control=False)

    def says(self, **status: Any) -> None:
        self.link.status = replace(self.link.status, **status)

    def grant(self, *, granted: bool = True) -> None:
        self.says(external_control=granted)

    def tick(self, seconds: float = TICK_S) -> Setpoint | None:
        """Let time pass in one step, then decide as the service does; return what is sent."""
        self.now_s += seconds
        if not self.silent:
            self.says(heard_s=self.now_s)
        if not self.lost:
            self.link.pose = pose_at(self.now_s, self.north_m)
        if self.link.pose is not None:
            self.authority.follow_mode(self.link.pose, self.now_s, 1e9 + self.now_s)
        return self.authority.setpoint(self.now_s)

    def in_phase(self, phase: Phase) -> None:
        self.grant()
        self.tick()
        self.navigator.phase = phase

    @property
    def phase(self) -> Phase:
        return self.navigator.phase

    def texts(self, name: str) -> list[str]:
        return [event.text for event in self.events if event.name == name]


@pytest.fixture
def bench(contract: Contract) -> Bench:
    return Bench(contract)


# ------------------------------------------------------------------ granted and taken


@pytest.mark.parametrize(("outside", "phase"), [(False, Phase.STANDBY), (True, Phase.CRUISE)])
def test_a_px4_whose_contract_lets_it_coast_is_not_flown(*, outside: bool, phase: Phase) -> None:
    """Its run after a loss of the stream is longer than that: a model of it has to be stated."""
    bench = Bench(CONTRACT, outside=outside)
    bench.link.profile = profile_named("px4")
    bench.grant()
    bench.tick()
    assert bench.phase is phase
    assert ("PX4 keeps flying to the last setpoint" in "".join(bench.texts("refused"))) != outside


def test_control_that_is_granted_is_taken_once(bench: Bench) -> None:
    bench.tick()
    assert bench.phase is Phase.STANDBY
    bench.grant()
    for _ in range(5):
        assert bench.tick() == PLANNED
    assert bench.supervisor.flights == 1


@pytest.mark.parametrize(
    "status",
    [{"armed": False}, {"external_control": False}, {"airborne": False}, {"airborne": None}],
)
@pytest.mark.parametrize("phase", [p for p in Phase if p is not Phase.STANDBY])
def test_control_is_given_back_in_every_phase_as_soon_as_it_is_not_granted(
    bench: Bench, phase: Phase, status: dict[str, Any]
) -> None:
    bench.in_phase(phase)
    bench.says(**status)
    bench.tick()
    assert bench.phase is Phase.STANDBY


@pytest.mark.parametrize("status", [{"armed": False}, {"airborne": False}, {"airborne": None}])
def test_without_grounds_control_is_not_taken(bench: Bench, status: dict[str, Any]) -> None:
    bench.says(**status)
    bench.grant()
    bench.tick()
    assert bench.phase is Phase.STANDBY
    assert bench.supervisor.flights == 0


def test_an_autopilot_that_was_never_heard_grants_nothing(bench: Bench) -> None:
    bench.silent = True
    bench.grant()
    bench.tick()
    assert bench.phase is Phase.STANDBY


@pytest.mark.parametrize(("silence_s", "granted"), [(3.0, True), (3.02, False)])
def test_an_autopilot_that_is_silent_for_longer_than_3_s_grants_nothing(
    bench: Bench, silence_s: float, *, granted: bool
) -> None:
    bench.says(heard_s=0.0, external_control=True)
    bench.silent = True
    bench.tick(silence_s)
    assert (bench.phase is not Phase.STANDBY) is granted


def test_the_pilot_takes_over_and_hands_back(bench: Bench) -> None:
    bench.in_phase(Phase.AVOID)
    bench.grant(granted=False)
    bench.north_m = 12.0
    assert bench.tick() == hovering_at(pose_at(bench.now_s, 12.0))
    bench.grant()
    assert bench.tick() == PLANNED
    assert bench.supervisor.flights == 2


def test_the_flight_ends_for_the_monitors_on_the_ground_only(bench: Bench) -> None:
    bench.in_phase(Phase.ARRIVED)
    bench.grant(granted=False)
    bench.tick()
    assert bench.supervisor.ended == 0
    bench.says(airborne=False)
    bench.tick()
    assert bench.supervisor.ended == 1


# ------------------------------------------------------------------ who ends a hold


def test_a_hold_that_the_pilot_ends_may_be_followed_by_a_departure(bench: Bench) -> None:
    bench.in_phase(Phase.HOLD)
    bench.grant(granted=False)
    bench.tick()
    bench.grant()
    bench.tick()
    assert bench.phase is not Phase.STANDBY


@pytest.mark.parametrize("end", ["silence", "failsafe"])
def test_a_hold_that_the_pilot_did_not_end_stands_until_the_pilot_takes_over(
    bench: Bench, end: str
) -> None:
    bench.in_phase(Phase.HOLD)
    if end == "silence":
        bench.silent = True
        bench.tick(AUTOPILOT_SILENCE_S + 1.0)
    else:
        bench.says(failsafe=True, external_control=False)
        bench.tick()
    assert bench.phase is Phase.STANDBY
    bench.silent = False
    bench.says(failsafe=False, external_control=True)
    for _ in range(10):
        bench.tick()
    assert bench.phase is Phase.STANDBY
    assert "the pilot has to take over first" in bench.texts("refused")[0]
    bench.grant(granted=False)
    bench.tick()
    bench.grant()
    bench.tick()
    assert bench.phase is not Phase.STANDBY


def test_a_silent_autopilot_is_led_to_rest_before_control_counts_as_ended(bench: Bench) -> None:
    bench.in_phase(Phase.HOLD)
    moving = PLANNED._replace(velocity_ned_mps=(0.5, 0.0, 0.0))
    bench.navigator.planned = moving
    bench.silent = True
    assert bench.tick(AUTOPILOT_SILENCE_S + 1.0) == moving
    phases = [bench.phase]
    bench.navigator.planned = PLANNED
    assert bench.tick() == PLANNED
    assert [*phases, bench.phase] == [Phase.HOLD, Phase.STANDBY]
    # It stays there, rather than drift with the vehicle that is to follow it.
    bench.north_m += 3.0
    assert bench.tick() == PLANNED


@pytest.mark.parametrize(("doubted", "resumes"), [(False, True), (True, False)])
def test_a_failsafe_on_a_doubtful_position_is_not_flown_on_from(
    bench: Bench, *, doubted: bool, resumes: bool
) -> None:
    bench.in_phase(Phase.CRUISE)
    bench.supervisor.position_sign = DEAD_RECKONED if doubted else None
    bench.says(failsafe=True, external_control=False, mode="RTL")
    bench.tick()
    assert bench.texts("failsafe") == ["the autopilot's failsafe has taken over (RTL)"]
    bench.supervisor.position_sign = None
    bench.says(failsafe=False, external_control=True)
    bench.tick()
    assert (bench.phase is not Phase.STANDBY) is resumes


def test_a_failsafe_is_said_once(bench: Bench) -> None:
    bench.in_phase(Phase.CRUISE)
    bench.says(failsafe=True, external_control=False)
    for _ in range(5):
        bench.tick()
    assert len(bench.texts("failsafe")) == 1


def test_a_failsafe_of_a_silent_autopilot_is_old_news(bench: Bench) -> None:
    bench.in_phase(Phase.CRUISE)
    bench.says(failsafe=True)
    bench.silent = True
    bench.tick(AUTOPILOT_SILENCE_S + 1.0)
    assert bench.phase is Phase.STANDBY
    assert bench.texts("failsafe") == []


# ------------------------------------------------------------------ refusals


def test_every_reason_not_to_depart_is_given(contract: Contract) -> None:
    bench = Bench(contract, age_max_s=60.0)
    supervisor = bench.supervisor
    supervisor.detections.blind = Violation(
        Assumption.DETECTION_AGE, 1.0, 0.3, "s", "front", "source 'front' silent"
    )
    supervisor.detections.contradicting = ["front/1"]
    supervisor.telemetry = Violation(Assumption.TELEMETRY_AGE, 1.0, 0.5, "s")
    supervisor.position_failures = ["GPS fix lost"]
    supervisor.wind_violation = Violation(Assumption.WIND, 9.0, 5.0, "m/s")
    supervisor.environment = [Violation(Assumption.OBSTACLE_SIZE, 9.0, 4.0, "m", "front/2")]
    terms = replace(bench.navigator.assessment.terms, wind_max_mps=5.0)
    bench.navigator.assessment = replace(bench.navigator.assessment, terms=terms)
    bench.navigator.refusals = [Refusal(RefusalKind.MOVING, "not at rest")]
    bench.grant()
    bench.tick()
    assert bench.phase is Phase.STANDBY
    (event,) = bench.events
    reasons = {reason["kind"]: reason["text"] for reason in event.data["reasons"]}
    assert reasons == {
        "preflight": "no pre-flight check",
        "detections": "no fresh detection frames: source 'front' silent",
        "contradiction": "sightings of front/1 contradict each other",
        "telemetry": "no fresh telemetry",
        "position": "GPS fix lost",
        "wind": "more wind than 5 m/s",
        "moving": "not at rest",
        "environment": "obstacle_size (front/2): 9.00, limit 4.00 m",
    }


def test_once_nothing_speaks_against_it_control_is_taken(bench: Bench) -> None:
    bench.navigator.refusals = [Refusal(RefusalKind.MOVING, "not at rest")]
    bench.grant()
    for _ in range(5):
        bench.tick()
    assert bench.phase is Phase.STANDBY
    assert len(bench.texts("refused")) == 1
    bench.navigator.refusals = []
    bench.tick()
    assert bench.phase is not Phase.STANDBY
    assert bench.supervisor.flights == 1


def test_refusals_are_said_again_when_control_is_granted_again(bench: Bench) -> None:
    bench.navigator.refusals = [Refusal(RefusalKind.MOVING, "not at rest")]
    bench.grant()
    bench.tick()
    bench.grant(granted=False)
    bench.tick()
    bench.grant()
    bench.tick(10.0)
    assert len(bench.texts("refused")) == 2


@pytest.mark.parametrize("outside", [True, False])
def test_a_contract_that_does_not_comply_is_flown_outside_it_only(
    contract: Contract, *, outside: bool
) -> None:
    sensor = contract.sensor.model_copy(update={"detection_range_m": 2.0})
    bench = Bench(contract.model_copy(update={"sensor": sensor}), outside=outside)
    # Nor does the environment of a flight outside its contract matter.
    bench.supervisor.environment = [Violation(Assumption.OBSTACLE_SIZE, 9.0, 4.0, "m")]
    bench.grant()
    bench.tick()
    assert (bench.phase is not Phase.STANDBY) is outside
    if not outside:
        assert "the contract does not comply (" in bench.texts("refused")[0]


# ------------------------------------------------------------------ what is sent


def test_on_the_ground_nothing_is_sent(bench: Bench) -> None:
    for airborne in (False, None):
        bench.says(airborne=airborne)
        bench.grant()
        assert bench.tick() is None


def test_before_a_pose_nothing_is_sent(bench: Bench) -> None:
    bench.lost = True
    assert bench.tick() is None


def test_while_the_pilot_flies_the_vehicle_is_told_to_stay_where_it_is(bench: Bench) -> None:
    for north_m in (1.0, 2.0):
        bench.north_m = north_m
        assert bench.tick() == hovering_at(pose_at(bench.now_s, north_m))


def test_while_refusing_the_vehicle_is_held_where_control_was_granted(bench: Bench) -> None:
    bench.navigator.refusals = [Refusal(RefusalKind.MOVING, "not at rest")]
    bench.tick()
    granted_at = hovering_at(pose_at(bench.now_s))
    bench.grant()
    for north_m in (0.1, 0.2, 0.3):  # wanders with the wind
        bench.north_m = north_m
        assert bench.tick() == granted_at


def test_a_service_that_restarts_in_flight_holds_where_it_finds_itself(bench: Bench) -> None:
    bench.navigator.refusals = [Refusal(RefusalKind.MOVING, "not at rest")]
    bench.grant()
    bench.north_m = 40.0
    first = bench.tick()
    assert first == hovering_at(pose_at(bench.now_s, 40.0))
    bench.north_m = 41.0
    assert bench.tick() == first


def test_in_standby_the_hold_follows_an_estimator_reset(bench: Bench) -> None:
    bench.navigator.refusals = [Refusal(RefusalKind.MOVING, "not at rest")]
    bench.grant()
    bench.tick()
    moved = pose_at(bench.now_s, 3.0)
    bench.authority.follow_reset(moved)
    assert bench.tick() == hovering_at(moved)


def test_a_hover_points_where_the_vehicle_points_and_rests() -> None:
    held = hovering_at(pose_at(0.0, 5.0)._replace(velocity_ned_mps=(3.0, 0.0, 0.0)))
    assert held == Setpoint((5.0, 0.0, -4.0), STILL, STILL, 0.25)


# ------------------------------------------------------------------ left to the autopilot


def test_a_hover_without_a_position_is_left_to_the_autopilot_and_taken_back(bench: Bench) -> None:
    bench.in_phase(Phase.HOLD)
    bench.lost = True
    assert bench.tick(HANDOVER_AFTER_S - 0.1) == PLANNED
    assert bench.tick(0.2) is None
    assert bench.texts("handed_over") == ["no position: leaving the vehicle to the autopilot"]
    bench.lost, bench.north_m = False, 6.0
    assert bench.tick() is None  # it may flicker
    assert bench.navigator.hovers == []
    assert bench.tick(TAKE_BACK_AFTER_S) == PLANNED
    assert bench.navigator.hovers == [pose_at(bench.now_s, 6.0)]
    bench.tick()
    assert len(bench.navigator.hovers) == 1


def test_a_position_that_flickers_stays_left_and_is_said_once(bench: Bench) -> None:
    bench.in_phase(Phase.HOLD)
    for _ in range(5):
        bench.lost = True
        bench.tick(HANDOVER_AFTER_S + 0.1)
        bench.lost = False
        assert bench.tick(0.5 * TAKE_BACK_AFTER_S) is None
    assert len(bench.texts("handed_over")) == 1
    assert bench.navigator.hovers == []


@pytest.mark.parametrize("phase", [Phase.CRUISE, Phase.AVOID])
def test_what_is_on_its_way_is_never_left(bench: Bench, phase: Phase) -> None:
    """The monitors stop it first: a reference is better than none."""
    bench.in_phase(phase)
    bench.lost = True
    bench.supervisor.position_sign, bench.supervisor.lost_for = DEAD_RECKONED, 99.0
    assert bench.tick(HANDOVER_AFTER_S + 0.5) == PLANNED
    assert bench.texts("handed_over") == []


def test_in_standby_it_is_left_without_a_word(bench: Bench) -> None:
    bench.tick()
    bench.lost = True
    assert bench.tick(HANDOVER_AFTER_S + 0.1) is None
    assert bench.events == []


@pytest.mark.parametrize(
    ("speed_mps", "lost_for_s", "left"),
    [
        (0.0, DEAD_RECKONING_S - 0.1, False),
        (0.0, DEAD_RECKONING_S + 0.1, True),
        (10.0 * STOPPED_MPS, DEAD_RECKONING_S + 0.1, False),  # still stopping
        (10.0 * STOPPED_MPS, 2.0 * DEAD_RECKONING_S + 0.1, True),
    ],
)
def test_dead_reckoning_is_good_for_a_stop_and_no_longer(
    bench: Bench, speed_mps: float, lost_for_s: float, *, left: bool
) -> None:
    bench.in_phase(Phase.HOLD)
    bench.navigator.planned = PLANNED._replace(velocity_ned_mps=(speed_mps, 0.0, 0.0))
    bench.supervisor.position_sign = DEAD_RECKONED
    bench.supervisor.lost_for = lost_for_s
    assert (bench.tick() is None) is left
    assert bool(bench.texts("handed_over")) is left


# ------------------------------------------------------------------ any sequence


STEPS = st.fixed_dictionaries(
    {},
    optional={
        "armed": st.booleans(),
        "airborne": st.sampled_from([True, True, False, None]),
        "external_control": st.booleans(),
        "failsafe": st.booleans(),
        "silent": st.booleans(),
        "lost": st.booleans(),
        "doubted": st.booleans(),
        "refused": st.booleans(),
        "phase": st.sampled_from([Phase.CRUISE, Phase.HOLD, Phase.ARRIVED]),
        "seconds": st.sampled_from([TICK_S, 0.5, AUTOPILOT_SILENCE_S + 1.0]),
    },
)


@given(st.lists(STEPS, max_size=30))
def test_no_sequence_takes_what_is_not_granted_or_keeps_what_is(
    steps: list[dict[str, Any]],
) -> None:
    """The navigator refuses where control is taken or released twice."""
    bench = Bench(CONTRACT)
    for step in steps:
        status = {
            key: step[key]
            for key in ("armed", "airborne", "external_control", "failsafe")
            if key in step
        }
        bench.says(**status)
        bench.silent, bench.lost = step.get("silent", False), step.get("lost", False)
        doubted, refused = step.get("doubted", False), step.get("refused", False)
        bench.supervisor.position_sign = DEAD_RECKONED if doubted else None
        bench.supervisor.lost_for = 99.0 if doubted else 0.0
        bench.navigator.refusals = [Refusal(RefusalKind.MOVING, "moving")] if refused else []
        if bench.phase is not Phase.STANDBY:
            bench.navigator.phase = step.get("phase", bench.phase)
        before, flights = bench.phase, bench.supervisor.flights
        sent = bench.tick(step.get("seconds", TICK_S))
        link = bench.link.status
        heard = bench.now_s - link.heard_s <= AUTOPILOT_SILENCE_S
        granted = link.armed and link.external_control and link.airborne is True and heard
        if bench.link.pose is None:
            assert (bench.phase, sent) == (before, None)
            continue
        if not granted:
            assert bench.phase is Phase.STANDBY
        if bench.supervisor.flights > flights:
            assert granted
            assert not refused
            assert before is Phase.STANDBY
        if link.airborne is not True:
            assert sent is None
        elif bench.navigator.flying:
            assert sent == PLANNED


def in_view(said_m: float) -> Bench:
    """Return a bench whose sensor sees ahead only; the operator vouches for a radius."""
    data = CONTRACT.model_dump(mode="json")
    data["vehicle"] |= {"rest_settle_s": 0.4}
    data["requirements"] |= {"stop": True, "passive_safety": False, "movers": "passive_in_view"}
    data["environment"]["movers"] = [{"class": "person", "speed_max_mps": 0.5, "size_max_m": 1.0}]
    bench = Bench(validate(data, Contract, source="test"), outside=True)
    bench.navigator.situation.route.mission.start_clear_of_movers_m = said_m
    return bench


def test_by_granting_control_the_operator_speaks_of_movers_where_the_vehicle_is() -> None:
    bench = in_view(30.0)
    bench.north_m = 3.0
    bench.tick()
    bench.grant()
    bench.tick()
    assert bench.navigator.flying
    assert bench.supervisor.detections.words == [(3.0, 30.0, bench.now_s)]


def test_a_mover_that_is_seen_near_and_goes_out_of_view_takes_another_word() -> None:
    """It may be right behind the vehicle, where nothing sees it."""
    bench = in_view(30.0)
    bench.tick()
    bench.supervisor.detections.near = ["front/7"]
    bench.grant()
    bench.tick()
    assert "mover front/7 is within 30 m" in bench.texts("refused")[0]
    bench.supervisor.detections.near = []
    bench.tick()
    assert not bench.navigator.flying
    bench.grant(granted=False)
    bench.tick()
    bench.grant()
    bench.tick()
    assert bench.navigator.flying
    assert bench.supervisor.detections.words == [(0.0, 30.0, bench.now_s)]


def test_while_something_else_keeps_it_waiting_the_word_wears_off() -> None:
    bench = in_view(30.0)
    bench.tick()
    bench.navigator.refusals = [Refusal(RefusalKind.MOVING, "not at rest")]
    bench.grant()
    bench.tick()
    said_s = bench.now_s
    bench.tick(2.0)
    bench.navigator.refusals = []
    bench.tick()
    assert bench.navigator.flying
    # It is not said again by the departure.
    assert bench.supervisor.detections.words == [(0.0, 30.0, said_s)]
    waits = in_view(30.0)
    waits.tick()
    waits.navigator.refusals = [Refusal(RefusalKind.MOVING, "not at rest")]
    waits.grant()
    waits.tick()
    waits.tick(59.0)  # times 0.5 m/s
    waits.navigator.refusals = []
    waits.tick(6.0)
    assert not waits.navigator.flying
    assert "the word on movers of" in waits.texts("refused")[-1]


def test_a_daemon_that_begins_with_control_granted_has_no_word_on_movers() -> None:
    bench = in_view(30.0)
    bench.grant()
    bench.tick()
    assert not bench.navigator.flying
    assert "no word on movers holds" in bench.texts("refused")[0]


def test_without_a_word_on_movers_none_is_taken() -> None:
    bench = Bench(CONTRACT)
    bench.supervisor.detections.near = ["front/7"]
    bench.grant()
    bench.tick()
    assert bench.navigator.phase is Phase.CRUISE
    assert bench.supervisor.detections.words == []
