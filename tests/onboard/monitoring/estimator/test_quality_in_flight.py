"""The service when the position gets worse: stops in time, says why, and knows when to let go."""

from typing import Any

import pytest

from onboard.autonomy import Autonomy
from onboard.files.contract_file import Contract
from onboard.files.mission_file import Mission
from onboard.guidance.authority import TAKE_BACK_AFTER_S
from onboard.guidance.phases import Phase
from tests.onboard.test_autonomy import EPOCH_UNIX_S, OFFBOARD, POSCTL, Rig, box

LAND = 4 << 16 | 6 << 24
GOOD, WITHOUT_GPS = 0x37F, 0x36F
CRITICAL = 5
GPS_LOST = "GPS fix lost (fix type 1): position is dead-reckoned"


@pytest.fixture
def rig(contract: Contract, mission: Mission) -> Rig:
    return Rig(Autonomy(contract, mission, epoch_unix_s=EPOCH_UNIX_S), mode=OFFBOARD)


def cruising(rig: Rig) -> Rig:
    rig.run(6.0)
    assert rig.phase is Phase.CRUISE
    return rig


def avoiding(rig: Rig) -> Rig:
    rig.obstacles = [box((20.0, 0.2))]
    rig.run(20.0, until=lambda: rig.phase is Phase.AVOID)
    rig.run(1.0)
    assert rig.phase is Phase.AVOID
    return rig


@pytest.mark.parametrize("start", [cruising, avoiding])
def test_gps_loss_is_answered_by_a_stop_and_then_left_to_the_autopilot(
    rig: Rig, start: Any
) -> None:
    start(rig)
    lost_s, rig.fix_type = rig.now_s, 1
    rig.run(1.0, until=lambda: rig.phase is Phase.HOLD)
    assert rig.phase is Phase.HOLD
    assert rig.now_s - lost_s < 1.0
    assert rig.texts("violation") == [f"position_quality: {GPS_LOST}"]
    assert rig.texts("phase")[-1].startswith(f"holding: position_quality: {GPS_LOST}; ")
    assert "no way to stop" not in rig.texts("phase")[-1]
    # The stop is flown to its end while dead reckoning is good ...
    rig.run(5.0, until=lambda: bool(rig.texts("handed_over")))
    assert rig.texts("handed_over") == [f"{GPS_LOST}: leaving the vehicle to the autopilot"]
    assert 3.0 <= rig.now_s - lost_s <= 6.1
    assert rig.setpoints[-1].vx == pytest.approx(0.0, abs=0.02)
    # ... and then nothing more is streamed.
    sent = len(rig.setpoints)
    rig.run(2.0)
    assert len(rig.setpoints) == sent


@pytest.mark.parametrize("flags", [GOOD & ~0x18, GOOD | 0x80, GOOD & ~0x02])
def test_position_that_is_made_up_is_left_to_the_autopilot_at_once(rig: Rig, flags: int) -> None:
    cruising(rig)
    rig.estimator_flags = flags
    rig.run(0.1)
    assert rig.phase is Phase.HOLD
    (said,) = rig.texts("violation")
    assert f"flags {flags:#x}): position is made up" in said
    assert len(rig.texts("handed_over")) == 1
    sent = len(rig.setpoints)
    rig.run(1.0)
    assert len(rig.setpoints) == sent


def test_position_that_comes_back_is_hovered_at_where_the_autopilot_has_left_the_vehicle(
    rig: Rig,
) -> None:
    """It has drifted: flying back in one step might lead through anything."""
    cruising(rig)
    rig.fix_type = 1
    rig.run(7.0, until=lambda: bool(rig.texts("handed_over")))
    rig.told_mode, rig.mode = OFFBOARD, POSCTL  # still in the mode, but not by our setpoints
    rig.velocity_ned_mps = (0.0, 0.5, 0.0)
    for _ in range(500):
        north_m, east_m, down_m = rig.position_ned_m
        rig.position_ned_m = (north_m, east_m + 0.01, down_m)
        rig.tick()
    rig.velocity_ned_mps, rig.fix_type = (0.0, 0.0, 0.0), 3
    rig.run(TAKE_BACK_AFTER_S + 0.5)
    assert rig.setpoints[-1].y == pytest.approx(rig.position_ned_m[1], abs=0.1)
    assert rig.position_ned_m[1] == pytest.approx(5.0, abs=0.1)


def test_position_that_flickers_is_left_to_the_autopilot_once(rig: Rig) -> None:
    """Neither a storm of events, nor a stream of set-points that stutters."""
    cruising(rig)
    rig.estimator_flags = GOOD & ~0x18
    rig.run(0.2)
    assert rig.phase is Phase.HOLD
    sent = len(rig.setpoints)
    for _ in range(20):
        for flags in (GOOD, GOOD & ~0x18):
            rig.estimator_flags = flags
            rig.run(0.2)
    assert len(rig.texts("handed_over")) == 1
    assert len(rig.setpoints) == sent
    rig.estimator_flags = GOOD
    rig.run(TAKE_BACK_AFTER_S + 0.5)
    assert len(rig.setpoints) > sent


@pytest.mark.parametrize("phase", [Phase.HOLD, Phase.ARRIVED])
def test_hover_without_a_position_is_reported_and_left_too(rig: Rig, phase: Phase) -> None:
    if phase is Phase.HOLD:
        cruising(rig)
        rig.now_s += 0.2  # a late tick
        rig.run(4.0)
    else:
        rig.run(40.0, until=lambda: rig.phase is Phase.ARRIVED)
    assert rig.phase is phase
    rig.fix_type = 0
    rig.run(1.0)
    assert "GPS fix lost (fix type 0)" in rig.texts("violation")[-1]
    assert rig.texts("handed_over") == []
    rig.run(3.0)
    assert len(rig.texts("handed_over")) == 1


def test_doubt_alone_holds_and_keeps_streaming(rig: Rig) -> None:
    cruising(rig)
    rig.estimator_flags = None
    rig.run(2.0)
    assert rig.phase is Phase.HOLD
    assert "position quality cannot be confirmed" in rig.texts("violation")[0]
    sent = len(rig.setpoints)
    rig.run(10.0)
    assert len(rig.setpoints) == sent + 500


def test_vehicle_without_gps_flies_its_mission(rig: Rig) -> None:
    rig.estimator_flags, rig.fix_type = WITHOUT_GPS, 0
    rig.run(3.0)
    rig.fix_type = 3  # the receiver finds a fix on the way, and loses it: not our business
    rig.run(3.0)
    rig.fix_type = 1
    rig.run(40.0, until=lambda: rig.phase is Phase.ARRIVED)
    assert rig.phase is Phase.ARRIVED
    assert rig.texts("violation") == []


def test_vehicle_without_gps_stops_by_its_own_estimator(rig: Rig) -> None:
    rig.estimator_flags, rig.fix_type = WITHOUT_GPS, None
    cruising(rig)
    rig.estimator_flags = WITHOUT_GPS & ~0x08
    rig.run(0.1)
    assert rig.phase is Phase.HOLD
    assert "horizontal position lost" in rig.texts("violation")[0]


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"estimator_flags": GOOD | 0x80}, "constant position mode"),
        ({"estimator_flags": None, "fix_type": None}, "position quality unknown"),
        ({"estimator_flags": GOOD & ~0x18}, "horizontal position lost"),
    ],
)
def test_departure_on_a_bad_position_is_refused(
    rig: Rig, change: dict[str, Any], reason: str
) -> None:
    for name, value in change.items():
        setattr(rig, name, value)
    rig.run(2.0)
    assert rig.phase is Phase.STANDBY
    assert reason in rig.texts("refused")[-1]
    rig.estimator_flags, rig.fix_type = GOOD, 3
    rig.run(2.0)
    assert rig.phase.value == "cruise"


def test_px4_that_resumes_offboard_after_its_failsafe_does_not_resume_the_flight(
    rig: Rig,
) -> None:
    """PX4 returns to OFFBOARD by itself; only the pilot ends a hold."""
    cruising(rig)
    rig.fix_type = 1
    rig.run(1.0)
    assert rig.phase is Phase.HOLD
    rig.mode, rig.system_status = LAND, CRITICAL
    rig.run(1.0)
    assert rig.phase.value == "standby"
    assert rig.texts("failsafe") == ["the autopilot's failsafe has taken over (LAND)"]
    rig.fix_type = 3
    rig.run(1.0)
    rig.mode, rig.system_status = OFFBOARD, 4
    rig.run(12.0)
    assert rig.phase.value == "standby"
    assert "the pilot has to take over first" in rig.texts("refused")[-1]
    rig.mode = POSCTL
    rig.run(0.2)
    rig.mode = OFFBOARD
    rig.run(2.0)
    assert rig.phase.value == "cruise"


def test_failsafe_that_takes_over_before_we_could_stop_ends_the_flight_alike(rig: Rig) -> None:
    cruising(rig)
    rig.estimator_flags = GOOD & ~0x18
    rig.mode, rig.system_status = LAND, CRITICAL
    rig.tick()
    assert rig.phase is Phase.STANDBY
    rig.estimator_flags, rig.mode, rig.system_status = GOOD, OFFBOARD, 4
    rig.run(3.0)
    assert rig.phase.value == "standby"


def test_next_flight_is_judged_by_its_own_departure(rig: Rig) -> None:
    """Landed and taken indoors: the GPS of the flight before does not count."""
    cruising(rig)
    rig.mode, rig.landed_state = POSCTL, 1
    rig.velocity_ned_mps = rig.acceleration_ned_mps2 = (0.0, 0.0, 0.0)
    rig.run(1.0)
    rig.estimator_flags, rig.fix_type = WITHOUT_GPS, 0
    rig.run(12.0)
    rig.landed_state = 2
    sent = len(rig.setpoints)
    rig.run(1.0)
    assert len(rig.setpoints) == sent + 50  # or PX4 could not be switched to OFFBOARD
    rig.mode = OFFBOARD
    rig.run(3.0)
    assert rig.phase.value == "cruise"
    assert rig.texts("violation") == []
