"""The operator's command to end a hold: when the flight goes on, and why it does not."""

import pytest

from onboard.autonomy import Autonomy
from onboard.files.contract_file import Contract
from onboard.files.mission_file import Mission
from onboard.guidance.departure import Refusal, RefusalKind
from onboard.guidance.phases import FlightState, Phase
from onboard.monitoring.resumption import QUIET_S
from tests.onboard.test_autonomy import EPOCH_UNIX_S, OFFBOARD, POSCTL, Rig, box

LEGS = [{"end_ned_m": [40.0, 0.0], "target_half_width_m": 8.0}]
MISSION = Mission.model_validate({"altitude_m": 4.0, "legs": LEGS})


def cruising(contract: Contract) -> Rig:
    rig = Rig(Autonomy(contract, MISSION, epoch_unix_s=EPOCH_UNIX_S), mode=OFFBOARD)
    rig.run(7.0)
    assert rig.phase is Phase.CRUISE
    return rig


def blinded(rig: Rig) -> Rig:
    """Let the sensor fall silent until the vehicle holds, at rest, and then see again."""
    rig.seeing = False
    rig.run(6.0)
    assert rig.phase is Phase.HOLD
    rig.seeing = True
    return rig


def resumed(rig: Rig) -> list[Refusal]:
    """Send the command; return the answer, which the next tick gives."""
    answers: list[list[Refusal]] = []
    rig.autonomy.receive_resume(answers.append)
    assert answers == []
    rig.tick()
    (answer,) = answers
    return answer


def kinds(refusals: list[Refusal]) -> set[tuple[str, str]]:
    return {(refusal.kind.value, refusal.subject) for refusal in refusals}


def test_the_flight_goes_on_once_the_sensor_sees_again(contract: Contract) -> None:
    rig = blinded(cruising(contract))
    rig.run(QUIET_S + 0.2)
    held_at_m = rig.position_ned_m
    assert resumed(rig) == []
    assert rig.autonomy.navigator.state is FlightState.ALIGNING
    # The reference goes on from where it was: no step.
    assert rig.position_ned_m == pytest.approx(held_at_m, abs=1e-3)
    rig.run(30.0, until=lambda: rig.phase is Phase.ARRIVED)
    assert rig.phase is Phase.ARRIVED
    assert rig.position_ned_m[0] == pytest.approx(40.0, abs=0.05)


def test_a_failure_after_a_resumption_is_said_and_held_for_again(contract: Contract) -> None:
    rig = blinded(cruising(contract))
    rig.run(QUIET_S + 0.2)
    assert resumed(rig) == []
    rig.run(4.0)
    blinded(rig)
    assert len([text for text in rig.texts("violation") if "detection_age" in text]) == 2


def test_a_sensor_that_is_still_blind_is_named(contract: Contract) -> None:
    rig = blinded(cruising(contract))
    rig.seeing = False
    rig.run(QUIET_S + 0.2)
    (refusal,) = resumed(rig)
    assert refusal.kind is RefusalKind.DETECTIONS
    assert rig.phase is Phase.HOLD
    said = rig.texts("refused")[-1]
    assert said.startswith("not resuming: no fresh detection frames")


def test_every_reason_is_given(contract: Contract) -> None:
    """Braking still, the sensor silent, and the failure just now."""
    rig = cruising(contract)
    rig.seeing = False
    rig.run(5.0, until=lambda: rig.phase is Phase.HOLD)
    found = kinds(resumed(rig))
    assert {("failed", "detection_age"), ("moving", "")} <= found
    assert "detections" in {kind for kind, _ in found}


def test_a_second_commander_leaves_the_hold_to_the_pilot(contract: Contract) -> None:
    rig = blinded(cruising(contract))
    north_m, east_m, down_m = rig.position_ned_m
    rig.mode, rig.told_mode = POSCTL, OFFBOARD
    rig.target_ned_m = (north_m, east_m + 9.0, down_m)
    rig.run(2.0)
    rig.target_ned_m, rig.mode = None, OFFBOARD
    rig.run(60.0)
    assert kinds(resumed(rig)) == {("failed", "second_commander")}


def test_a_position_that_was_in_doubt_leaves_the_hold_to_the_pilot(contract: Contract) -> None:
    rig = blinded(cruising(contract))
    rig.fix_type = 1
    rig.run(3.0)
    rig.fix_type = 3
    rig.run(60.0)
    assert ("failed", "position_quality") in kinds(resumed(rig))
    assert rig.phase is Phase.HOLD


def test_an_obstacle_beside_the_place_speaks_against_it(contract: Contract) -> None:
    rig = blinded(cruising(contract))
    north_m, east_m, _ = rig.position_ned_m
    rig.obstacles = [box((north_m + 2.5, east_m))]
    rig.run(QUIET_S + 0.2)
    assert "inside_region" in {kind for kind, _ in kinds(resumed(rig))}


def test_what_does_not_hold_cannot_resume(contract: Contract) -> None:
    rig = cruising(contract)
    (refusal,) = resumed(rig)
    assert refusal.kind is RefusalKind.NOT_HOLDING
    assert refusal.text == "not holding (phase cruise)"
    assert rig.phase is Phase.CRUISE


def test_without_telemetry_nothing_resumes(contract: Contract) -> None:
    rig = Rig(Autonomy(contract, MISSION, epoch_unix_s=EPOCH_UNIX_S), speaking=False)
    assert RefusalKind.TELEMETRY in {refusal.kind for refusal in resumed(rig)}


def test_another_mission_needs_the_pilot(contract: Contract) -> None:
    rig = blinded(cruising(contract))
    rig.autonomy.receive_mission(MISSION.model_dump_json().encode(), rig.now_s)
    rig.run(QUIET_S + 0.2)
    assert kinds(resumed(rig)) == {("mission_changed", "")}


# ------------------------------------------------------------------ best effort


@pytest.fixture
def threading(contract: Contract) -> Rig:
    """A service in THREAD, whose sensor sees all round."""
    requirements = contract.requirements.model_copy(
        update={"stop": True, "progress": "best_effort"}
    )
    sensor = contract.sensor.model_copy(update={"field_of_view_deg": 360.0})
    contract = contract.model_copy(update={"requirements": requirements, "sensor": sensor})
    rig = SeeingAllRound(Autonomy(contract, MISSION, epoch_unix_s=EPOCH_UNIX_S), mode=OFFBOARD)
    rig.run(20.0, until=lambda: rig.position_ned_m[0] > 6.0)
    assert rig.phase is Phase.THREAD
    return rig


class SeeingAllRound(Rig):
    """A rig whose sensor has a view of 360 degrees and numbers its frames."""

    def frame(self, **changes: object) -> bytes:
        sequence = round(self.now_s / 0.02)
        return super().frame(field_of_view_deg=360.0, sequence=sequence, **changes)


def test_best_effort_goes_on_after_late_ticks(threading: Rig) -> None:
    """The second within a minute holds; with ticks in time again the operator may go on."""
    rig = threading
    for _ in range(2):
        assert rig.phase is Phase.THREAD
        rig.now_s += 0.07
        rig.run(0.5)
    rig.run(QUIET_S + 4.0)
    assert rig.phase is Phase.HOLD
    assert resumed(rig) == []
    assert rig.autonomy.navigator.state is FlightState.LOOKING
    rig.run(60.0, until=lambda: rig.phase in (Phase.ARRIVED, Phase.HOLD))
    assert rig.position_ned_m[0] == pytest.approx(40.0, abs=0.3)


def test_best_effort_looks_round_again_where_nothing_is_seen_free_any_more(threading: Rig) -> None:
    """And holds again where an obstacle is at the place where it rests."""
    rig = threading
    for _ in range(2):
        rig.now_s += 0.07
        rig.run(0.5)
    rig.run(QUIET_S + 4.0)
    rig.autonomy.supervisor.seen.void("a test")
    north_m, east_m, _ = rig.position_ned_m
    rig.obstacles = [box((north_m + 0.3, east_m + 0.8))]
    rig.run(0.2)
    assert resumed(rig) == []
    assert rig.autonomy.navigator.thread is not None
    assert rig.autonomy.navigator.thread.way.certified is not True
    rig.run(20.0, until=lambda: rig.phase is not Phase.PAUSE)
    assert rig.phase is Phase.HOLD
    assert "no_passage" in rig.texts("phase")[-1]
