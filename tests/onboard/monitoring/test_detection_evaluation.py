"""Detections in flight: sightings that contradict each other, headings, clocks, names, refusals."""

import json
import math
from dataclasses import replace
from functools import partial
from itertools import pairwise

import pytest

from onboard.autonomy import Autonomy
from onboard.contract.assessment import TICK_S, assess_terms
from onboard.files.contract_file import Contract, load_contract
from onboard.files.mission_file import Mission
from onboard.geometry.frames import heading_displacement_m
from onboard.guidance.clear_check import ClearCheck
from onboard.guidance.departure import REFUSAL_PERIOD_S, Refusal, RefusalKind, RefusalReport
from onboard.guidance.phases import Phase
from onboard.monitoring.assumptions import Assumption, Violation
from onboard.monitoring.detection_consistency import SETTLED_AFTER_S
from onboard.planning.closed_form import brake_to_hover
from onboard.planning.proximity import least_room_m
from onboard.recording.messages import as_json
from onboard.recording.state import state_of
from tests.onboard.conftest import CONFIG, FROZEN
from tests.onboard.test_autonomy import EPOCH_UNIX_S, OFFBOARD, POSCTL, Rig, box


@pytest.fixture
def rig(contract: Contract, mission: Mission) -> Rig:
    return Rig(Autonomy(contract, mission, epoch_unix_s=EPOCH_UNIX_S))


@pytest.fixture
def cruising(rig: Rig) -> Rig:
    rig.mode = OFFBOARD
    rig.run(6.0)
    assert rig.phase is Phase.CRUISE
    return rig


def held(rig: Rig) -> bool:
    return rig.phase is Phase.HOLD


def avoiding(rig: Rig) -> bool:
    return rig.phase is Phase.AVOID


# ------------------------------------------------------------------ contradicting sightings


@pytest.mark.parametrize("shift_m", [(0.0, 0.6), (0.0, -2.5), (0.9, 0.0), (-1.5, 1.5)])
def test_an_obstacle_that_moves_is_kept_at_both_places_and_ends_in_a_certified_stop(
    cruising: Rig, shift_m: tuple[float, float]
) -> None:
    north_m = cruising.position_ned_m[0] + 10.0
    cruising.obstacles = [box((north_m, 0.5), side_m=0.6)]
    cruising.run(0.5)
    assert cruising.texts("violation") == []
    moved = box((north_m + shift_m[0], 0.5 + shift_m[1]), side_m=0.6)
    cruising.obstacles = [moved]
    cruising.run(0.2, until=lambda: held(cruising))
    assert held(cruising)
    (violation,) = cruising.texts("violation")
    assert violation.startswith("detection_consistency (front/1)")
    assert "although no way" not in cruising.texts("phase")[-1]
    places = {obstacle.id: obstacle.measured for obstacle in cruising.autonomy.navigator.obstacles}
    assert set(places) == {"front/1", "front/1~2"}
    # Neither place has grown.
    for measured in places.values():
        assert measured.size_m == pytest.approx((0.6, 0.6))
    assert places["front/1"].x_min_m == pytest.approx(north_m - 0.3)
    assert places["front/1~2"].x_min_m == pytest.approx(north_m + shift_m[0] - 0.3)
    cruising.run(5.0)
    assert cruising.velocity_ned_mps[0] == pytest.approx(0.0, abs=1e-6)
    assert cruising.texts("hold_replanned") == []


def test_a_wandering_heading_is_answered_far_from_the_obstacle(rig: Rig) -> None:
    """Recorded on PX4: boxes from the body united and grew until no way to stop was left."""
    wander_rad, obstacle_m = 0.0, (30.0, 0.3)

    def turned_frame() -> bytes:
        north_m, east_m, _ = rig.position_ned_m
        ahead_m, aside_m = obstacle_m[0] - north_m, obstacle_m[1] - east_m
        # The body believes that its nose points north; it does not.
        turned = [
            math.cos(wander_rad) * ahead_m + math.sin(wander_rad) * aside_m,
            math.cos(wander_rad) * aside_m - math.sin(wander_rad) * ahead_m,
        ]
        seen = [box((turned[0], turned[1]))] if math.hypot(*turned) < 11.5 else []
        return rig.frame(frame="body_frd", obstacles=seen)

    rig.mode, rig.seeing = OFFBOARD, False
    for step in range(2000):
        wander_rad = math.radians(3.5) * math.sin(step * TICK_S / 2.0)
        if step % 3 == 0:
            rig.autonomy.receive_detection(turned_frame(), rig.now_s)
        rig.tick()
        if held(rig):
            break
    assert held(rig)
    assert rig.texts("violation")[0].startswith("detection_consistency (front/1)")
    assert "although no way" not in rig.texts("phase")[-1]
    rig.run(4.0)
    assert obstacle_m[0] - rig.position_ned_m[0] > 4.0


@pytest.mark.parametrize("heading_error_deg", [0.0, 2.0, 5.0])
@pytest.mark.parametrize("frame", ["local_ned", "body_frd"])
def test_boxes_carry_what_a_wrong_heading_displaces(
    cruising: Rig, heading_error_deg: float, frame: str
) -> None:
    navigator = cruising.autonomy.navigator
    error_rad = math.radians(heading_error_deg)
    terms = replace(navigator.assessment.terms, heading_error_rad=error_rad)
    navigator.situation.assessment = assess_terms(navigator.assessment.contract, terms)
    here_m = cruising.position_ned_m[0]
    centre_m = (10.0, 2.0) if frame == "body_frd" else (here_m + 10.0, 2.0)
    seen = cruising.frame(frame=frame, obstacles=[box(centre_m)])
    cruising.autonomy.receive_detection(seen, cruising.now_s)
    cruising.tick()
    (known,) = navigator.obstacles
    displaced_m = heading_displacement_m(math.hypot(10.5, 2.5), error_rad)
    # Since the stamp the vehicle has flown 56 mm: 5° of that.
    # The stated error is one of each axis; a box across the leg is off by both.
    stated_m = math.sqrt(2.0) * 0.05
    assert known.position_error_m == pytest.approx(stated_m + displaced_m, abs=6e-3)
    # What a sensor states is compared with what the contract assumes of the sensor alone.
    assert not any("detection_uncertainty" in text for text in cruising.texts("violation"))


@pytest.mark.parametrize("frame", ["local_ned", "body_frd"])
def test_a_sensor_that_sees_farther_than_declared_makes_no_obstacle_larger(
    mission: Mission, frame: str
) -> None:
    """At 60 m a heading error of 2 degrees displaces by 2 m, but the pillar is 1 m wide."""
    # The published regions are wider than the separation that the file states for its own.
    pure = (FROZEN, "requirements.stop=false", "environment.obstacle_separation_min_m=30")
    contract = load_contract(CONFIG / "default_contract.yaml", pure)
    leg = {"end_ned_m": (90.0, 0.0), "target_half_width_m": 10.0}
    legs = [mission.legs[0].model_copy(update=leg)]
    long = mission.model_copy(update={"legs": tuple(legs)})
    rig = Rig(Autonomy(contract, long, epoch_unix_s=EPOCH_UNIX_S), mode=OFFBOARD, seeing=False)

    def look() -> bool:
        north_m, east_m = rig.position_ned_m[:2] if frame == "body_frd" else (0.0, 0.0)
        seen = [box((60.0 - north_m, 0.2 - east_m))] if rig.position_ned_m[0] < 60.0 else []
        payload = rig.frame(frame=frame, range_m=80.0, obstacles=seen)
        rig.autonomy.receive_detection(payload, rig.now_s)
        return rig.phase in (Phase.AVOID, Phase.HOLD)

    rig.run(40.0, until=look)
    assert rig.phase is Phase.AVOID
    navigator = rig.autonomy.navigator
    assert navigator.avoidance is not None
    error_m = navigator.assessment.face_error_m
    assert navigator.avoidance.obstacle.position_error_m <= error_m
    terms = navigator.assessment.terms
    widest_m = 1.0 + 2.0 * (terms.radius_m + terms.tracking_error_m + error_m)
    assert max(navigator.avoidance.obstacle.region.obstacle.size_m) <= widest_m + 0.1
    rig.run(40.0, until=lambda: look() and rig.phase is Phase.HOLD)
    assert rig.texts("violation") == []


def test_sightings_that_contradict_in_standby_delay_the_departure_and_become_one_obstacle(
    rig: Rig,
) -> None:
    rig.obstacles = [box((9.0, 5.5), side_m=0.6)]
    rig.run(0.5)
    rig.obstacles = [box((9.0, 6.5), side_m=0.6)]
    rig.run(0.2)
    rig.mode = OFFBOARD
    rig.run(0.5)
    assert rig.phase is Phase.STANDBY
    assert "sightings of front/1 contradict each other" in rig.texts("refused")[-1]
    assert [o.id for o in rig.autonomy.navigator.obstacles] == ["front/1+front/1~2"]
    rig.run(2.0 * SETTLED_AFTER_S)
    assert rig.phase is not Phase.STANDBY


def test_places_kept_apart_in_flight_may_be_one_obstacle_once_the_pilot_has_taken_over(
    cruising: Rig,
) -> None:
    north_m = cruising.position_ned_m[0] + 9.0
    cruising.obstacles = [box((north_m, 5.5), side_m=0.6)]
    cruising.run(0.3)
    cruising.obstacles = [box((north_m, 6.5), side_m=0.6)]
    cruising.run(3.0)
    assert held(cruising)
    assert len(cruising.autonomy.navigator.obstacles) == 2
    cruising.mode = POSCTL
    cruising.run(3.0)
    (one,) = cruising.autonomy.navigator.obstacles
    assert one.id == "front/1+front/1~2"
    assert one.measured.size_m == pytest.approx((0.6, 1.6))


@pytest.mark.parametrize("follows", [True, False])
def test_what_moves_with_the_estimate_does_not_contradict(cruising: Rig, *, follows: bool) -> None:
    north_m = cruising.position_ned_m[0] + 9.0
    cruising.obstacles = [box((north_m, 3.0), side_m=0.6)]
    cruising.run(0.3)
    if follows:
        cruising.autonomy.navigator.obstacles.shift(0.0, 0.5, 0.0)
    cruising.obstacles = [box((north_m, 3.5), side_m=0.6)]
    cruising.run(0.3)
    assert held(cruising) is not follows
    assert bool(cruising.texts("violation")) is not follows


# ------------------------------------------------------------------ clocks and names


@pytest.mark.parametrize("offset_s", [-20.0, 20.0])
def test_a_clock_set_after_the_start_is_named_and_can_be_read_anew_on_the_ground(
    rig: Rig, offset_s: float
) -> None:
    """No battery clock: the service starts in the past, the sensor's clock is right."""
    autonomy = rig.autonomy
    rig.armed, autonomy.epoch_unix_s = False, EPOCH_UNIX_S - offset_s
    rig.run(1.0)
    rig.armed, rig.mode = True, OFFBOARD
    rig.run(0.2)
    (refused,) = rig.texts("refused")
    way = "ahead" if offset_s > 0.0 else "behind"
    assert f"stamps are 20.0 s {way}" in refused
    assert not autonomy.set_epoch(EPOCH_UNIX_S)  # armed
    rig.armed, rig.mode, rig.landed_state = False, POSCTL, 1
    rig.run(0.2)
    assert autonomy.set_epoch(EPOCH_UNIX_S)
    assert state_of(autonomy, rig.now_s).detection_age_s is None  # by which clock?
    rig.armed, rig.mode, rig.landed_state = True, OFFBOARD, 2
    rig.run(3.0)
    assert rig.phase is Phase.CRUISE


@pytest.mark.parametrize("frame", ["local_ned", "body_frd"])
@pytest.mark.parametrize(("step_s", "said"), [(20.0, "20.0 s ahead"), (-20.0, "back by 19.9")])
def test_a_clock_that_steps_in_flight_is_named(
    cruising: Rig, step_s: float, said: str, frame: str
) -> None:
    assert not cruising.autonomy.set_epoch(EPOCH_UNIX_S + step_s)
    cruising.seeing = False
    for sequence in range(1, 12):
        stamp_s = EPOCH_UNIX_S + cruising.now_s + (step_s if sequence > 3 else 0.0)
        seen = cruising.frame(stamp_unix_s=stamp_s, sequence=sequence, frame=frame)
        cruising.autonomy.receive_detection(seen, cruising.now_s)
        cruising.run(0.06)
    assert held(cruising)
    violation = cruising.texts("violation")[0]
    assert violation.startswith("sensor_clock (front)")
    assert said in violation


def test_a_sensor_that_renames_its_source_is_named_with_its_successor(cruising: Rig) -> None:
    cruising.seeing = False
    for _ in range(20):
        renamed = cruising.frame(source="front2")
        cruising.autonomy.receive_detection(renamed, cruising.now_s)
        cruising.run(0.04, until=lambda: held(cruising))
    assert held(cruising)
    violation = cruising.texts("violation")[0]
    assert "detection_age (front)" in violation
    assert "source 'front' silent; 'front2' is new" in violation
    sensors = json.loads(as_json(state_of(cruising.autonomy, cruising.now_s)))["sensors"]
    assert sensors["front"]["heard_age_s"] > 0.3 > sensors["front2"]["heard_age_s"]


def test_what_is_said_of_sensors_is_json_before_any_frame_could_be_used(rig: Rig) -> None:
    early = rig.frame(stamp_unix_s=EPOCH_UNIX_S + 99.0)
    rig.autonomy.receive_detection(early, 0.0)
    rig.autonomy.tick(0.0)
    said = json.loads(as_json(state_of(rig.autonomy, 0.0)))["sensors"]["front"]
    assert said == {
        "age_s": None, "heard_age_s": 0.0, "stamp_ahead_s": pytest.approx(99.0), "refused": {},
    }  # fmt: skip


# ------------------------------------------------------------------ refusals


def refusals(*kinds: RefusalKind, speed_mps: float = 0.4) -> list[Refusal]:
    return [Refusal(kind, f"{kind} {speed_mps:.1f}", "front/1") for kind in kinds]


def test_a_refusal_is_said_when_it_changes_in_kind_not_in_numbers() -> None:
    report, said = RefusalReport(), []
    for step in range(4000):
        seen = refusals(RefusalKind.MOVING, RefusalKind.INSIDE_REGION, speed_mps=step % 7 / 10.0)
        said.append(report.news(seen, step * TICK_S))
    first, *later = said
    assert first is not None
    assert first.text == "not leaving standby: moving 0.0; inside_region 0.0"
    assert first.data["reasons"][0] == {
        "kind": "moving",
        "subject": "front/1",
        "text": "moving 0.0",
    }
    assert not any(later)


def test_refusals_that_flicker_are_said_at_most_every_five_seconds() -> None:
    report = RefusalReport()
    said_s = []
    for step in range(4000):
        now_s = step * TICK_S
        kinds = [RefusalKind.INSIDE_REGION] + [RefusalKind.MOVING] * (step % 2)
        if report.news(refusals(*kinds), now_s) is not None:
            said_s.append(now_s)
        if step % 100 == 50:
            report.end()
    assert len(said_s) == pytest.approx(80.0 / REFUSAL_PERIOD_S, abs=1)
    assert min(b - a for a, b in pairwise(said_s)) >= REFUSAL_PERIOD_S - 1e-9


def test_what_changed_meanwhile_is_said_as_soon_as_it_may_be() -> None:
    report = RefusalReport()
    assert report.news(refusals(RefusalKind.MOVING), 0.0) is not None
    assert report.news(refusals(RefusalKind.TELEMETRY), 1.0) is None
    assert report.news(refusals(RefusalKind.TELEMETRY), 4.9) is None
    late = report.news(refusals(RefusalKind.TELEMETRY), 5.0)
    assert late is not None
    assert "telemetry" in late.text


def test_hovering_inside_a_region_with_the_speed_of_a_real_estimate_is_refused_once(
    rig: Rig,
) -> None:
    """Recorded on PX4: 367 events and 363 texts in 80 s."""
    rig.obstacles = [box((6.0, 0.0))]
    rig.run(0.5)
    rig.mode = OFFBOARD
    texts = 0
    for step in range(round(80.0 / TICK_S)):
        rig.velocity_ned_mps = (0.35 + 0.25 * math.sin(step / 40.0), 0.1, 0.0)
        rig.tick()
        rig.position_ned_m = (0.0, 0.0, -4.0)
    texts = len(rig.texts("refused"))
    assert rig.phase is Phase.STANDBY
    assert 1 <= texts <= 80.0 / REFUSAL_PERIOD_S + 1


# ------------------------------------------------------------------ where nothing certifies


def test_where_nothing_certifies_what_keeps_farther_away_is_flown(
    contract: Contract, mission: Mission, monkeypatch: pytest.MonkeyPatch
) -> None:
    finished = []
    for seconds in (0.5, 1.0, 1.5, 2.0, 2.5, 3.0):
        rig = Rig(Autonomy(contract, mission, epoch_unix_s=EPOCH_UNIX_S), mode=OFFBOARD)
        rig.obstacles = [box((20.0, 0.1))]
        rig.run(30.0, until=partial(avoiding, rig))
        rig.run(seconds)
        navigator = rig.autonomy.navigator
        if rig.phase is not Phase.AVOID or navigator.avoidance is None:
            continue
        state = navigator.reference(rig.now_s)
        assert state is not None
        planned = navigator.avoidance.plan.trajectory.from_time(rig.now_s)
        boxes = [obstacle.region.obstacle for obstacle in navigator.obstacles]
        brake = brake_to_hover(state, rig.now_s, navigator.situation.envelope)
        farther = least_room_m(planned, boxes) > least_room_m(brake, boxes)
        with monkeypatch.context() as patch:
            patch.setattr(ClearCheck, "is_clear", lambda *_: False)
            navigator.hold(Violation(Assumption.SELF_CHECK, 1.0, 0.0, "exceptions"), rig.now_s)
        text = navigator.events[-1].text
        assert "although no way to stop is certified" in text
        assert ("keeps farther away" in text) is farther
        finished.append(farther)
    assert len(finished) >= 4
    assert set(finished) == {False, True}


def test_neighbours_with_new_names_in_every_frame_are_said_to_be_merged_every_five_seconds(
    cruising: Rig,
) -> None:
    cruising.seeing = False
    north_m = cruising.position_ned_m[0] + 28.0
    for number in range(150):
        boxes = [box((north_m, 0.2), name=f"a{number}"), box((north_m + 1.5, 0.2), name="b")]
        seen = cruising.frame(obstacles=boxes, sequence=number)
        cruising.autonomy.receive_detection(seen, cruising.now_s)
        cruising.run(0.04)
    assert cruising.now_s > 11.0
    assert 1 <= len(cruising.texts("merged")) <= 3
