"""How what a monitor measures is answered: by the contract solved again, or by a stop."""

from dataclasses import dataclass

import pytest

from onboard.autonomy import Autonomy
from onboard.files.contract_file import Contract
from onboard.files.mission_file import Mission
from onboard.guidance.phases import Phase
from onboard.monitoring.assumptions import Assumption, Violation
from onboard.monitoring.response.trim import LEARNING_TIME_S
from onboard.monitoring.response.wind import CONFIRMATION_S
from tests.onboard.monitoring.test_monitor_responses import FieldRig
from tests.onboard.test_autonomy import EPOCH_UNIX_S, OFFBOARD

WIND_MPS = 6.5


@dataclass
class CompassRig(FieldRig):
    """A rig whose estimator says how far its magnetometer is off."""

    compass_ratio: float = 0.1

    def say_what_the_position_is_worth(self) -> None:
        assert self.estimator_flags is not None
        ratios = (0.1, 0.1, 0.1, self.compass_ratio, 0.1, 0.1)
        self._mav.estimator_status_send(0, self.estimator_flags, *ratios, 0.3, 0.3)


def cruising(
    contract: Contract,
    mission: Mission,
    vehicle: dict[str, float],
    environment: dict[str, float | None],
) -> CompassRig:
    """Fly a contract with room to spare, which complies whatever is declared here."""
    wide: dict[str, float | None] = {"obstacle_separation_min_m": 60.0}
    contract = contract.model_copy(
        update={
            "vehicle": contract.vehicle.model_copy(update=vehicle),
            "sensor": contract.sensor.model_copy(update={"detection_range_m": 30.0}),
            "environment": contract.environment.model_copy(update=wide | environment),
        }
    )
    rig = CompassRig(Autonomy(contract, mission, epoch_unix_s=EPOCH_UNIX_S), seeing=False)
    rig.run(LEARNING_TIME_S + 0.5, until=lambda: see(rig))
    rig.mode = OFFBOARD
    rig.run(4.0, until=lambda: see(rig))
    assert rig.phase is Phase.CRUISE
    return rig


def see(rig: CompassRig) -> bool:
    """Let the sensor look, as far as this contract says; tell whether the vehicle holds."""
    rig.autonomy.receive_detection(rig.frame(range_m=30.0), rig.now_s)
    return rig.phase is Phase.HOLD


@pytest.mark.parametrize(
    ("wind_max_mps", "answer"),
    [(None, "none"), (7.0, "none"), (4.2, "solved again"), (1.0, "stop"), (0.0, "stop")],
)
def test_a_wind_is_answered_as_the_wind_that_it_is(
    contract: Contract, mission: Mission, wind_max_mps: float | None, answer: str
) -> None:
    """It is measured as an acceleration, which is a smaller number."""
    agile = {"roll_max_deg": 25.0, "pitch_max_deg": 25.0, "drag_per_s": 0.3}
    rig = cruising(contract, mission, agile, {"wind_max_mps": wind_max_mps})
    still_air_mps2 = 0.3 * rig.velocity_ned_mps[0]
    rig.trim_ned_mps2 = (still_air_mps2, 0.3 * WIND_MPS)
    rig.run(CONFIRMATION_S + 5.0, until=lambda: see(rig))
    said = [text.partition(":")[0] for text in rig.texts("violation")]
    assert said == ([] if answer == "none" else ["wind"])
    assert (rig.phase is Phase.HOLD) is (answer == "stop")
    if answer == "solved again":
        limit_mps = rig.autonomy.assessment.terms.wind_max_mps
        assert limit_mps is not None
        assert limit_mps > WIND_MPS


@pytest.mark.parametrize("heading_error_deg", [0.0, 2.0, 5.0])
def test_no_declared_heading_error_covers_a_rejected_magnetometer(
    contract: Contract, mission: Mission, heading_error_deg: float
) -> None:
    """A ratio of 1.4 is not read as 1.4 degrees."""
    rig = cruising(contract, mission, {"heading_error_deg": heading_error_deg}, {})
    rig.compass_ratio = 1.4
    rig.run(2.5, until=lambda: see(rig))
    assert rig.texts("violation")[0].startswith("heading_error (compass)")
    assert rig.phase is Phase.HOLD


def test_a_nose_off_its_command_ends_in_a_stop_whatever_error_is_declared(
    contract: Contract, mission: Mission
) -> None:
    """The estimate itself says so: an error of it comes on top."""
    rig = cruising(contract, mission, {"heading_error_deg": 5.0}, {})
    rig.nose_error_rad = 0.11
    rig.run(1.5, until=lambda: see(rig))
    assert rig.texts("violation")[0].startswith("heading_error (pointing)")
    assert rig.phase is Phase.HOLD


def test_every_speed_that_the_contract_is_solved_for_is_said(
    contract: Contract, mission: Mission
) -> None:
    rig = cruising(contract, mission, {}, {})
    navigator = rig.autonomy.navigator
    speeds_mps = [navigator.assessment.terms.cruise_speed_mps]
    for apart_m in (15.0, 14.0, 13.0, 13.0):
        seen = Violation(Assumption.ROI_INTERSECTION, apart_m, 60.0, "m", "1 and 2")
        navigator.respond_to(seen, rig.now_s)
        rig.run(0.8, until=lambda: see(rig))
        speeds_mps.append(navigator.assessment.terms.cruise_speed_mps)
    assert rig.phase is Phase.CRUISE
    slower = sorted(set(speeds_mps[1:]), reverse=True)
    assert len(slower) > 1
    said = [text.rpartition(" at ")[2] for text in rig.texts("adapted")]
    assert said == [f"{speed_mps:.2f} m/s" for speed_mps in slower]
