"""An identification flight finds what the simulated vehicle has, by the simulator's own truth."""

from __future__ import annotations

import functools
import math
from pathlib import Path

import numpy as np
import pytest

from gcs_tools.identify.flight.free_air import FreeAir
from gcs_tools.identify.flight.pilot import Stage
from gcs_tools.identify.logs import read_recording
from gcs_tools.identify.recording import Measured, measure
from onboard.files.contract_file import Contract, load_contract
from onboard.geometry.fence import Fence, FenceArea
from onboard.recording.flight_log import FlightLog
from onboard.recording.messages import StateRecord
from sitl.config import SitlConfig
from sitl.plant.truth import VehicleTruth
from tests.gcs_tools.identify.flight.virtual import VirtualFlight
from tests.gcs_tools.running import CONFIG

AIR = FreeAir(80.0, 20.0)
PARAMETERS = {
    "px4": {
        "COM_OF_LOSS_T": 0.3, "MPC_XY_P": 1.5, "MPC_JERK_AUTO": 15.0, "MPC_ACC_HOR": 5.0,
        "MPC_TILTMAX_AIR": 45.0, "MIS_TAKEOFF_ALT": 5.0,
    },
    "ardupilot": {"GUID_TIMEOUT": 0.5, "PSC_JERK_XY": 20.0, "WPNAV_ACCEL": 600.0},
}  # fmt: skip


def flight(flavour: str, realism: str = "ideal", **more: object) -> VirtualFlight:
    sitl = SitlConfig.model_validate(
        {"flavour": flavour, "realism": realism, "parameters": PARAMETERS[flavour]}
    )
    return VirtualFlight(contract_of(flavour), sitl, AIR, **more)  # type: ignore[arg-type]


def contract_of(flavour: str) -> Contract:
    return load_contract(CONFIG / f"{flavour}_contract.yaml")


def measured(flown: VirtualFlight, path: Path) -> Measured:
    with FlightLog(path, {}) as log:
        log.write(flown.records)
    return measure(read_recording(path))


@functools.cache
def whole_flight(flavour: str) -> VirtualFlight:
    """Two tests look at the same flight."""
    flown = flight(flavour, run_on=True)
    flown.fly_all()
    return flown


@pytest.mark.parametrize("flavour", ["px4", "ardupilot"])
def test_it_finds_what_the_simulator_has(flavour: str, tmp_path: Path) -> None:
    flown = whole_flight(flavour)
    assert flown.pilot.complete
    found = measured(flown, tmp_path / "flight.mcap")
    states = [each for each in flown.records if isinstance(each, StateRecord)]
    pairs = list(zip(flown.truths, states, strict=True))

    # The ideal estimate is the truth, so that the log has to show the true errors.
    errors_m = [
        math.dist(truth.position_ned_m[:2], state.reference_position_ned_m[:2])
        for (truth, _), state in pairs
        if state.phase == "identify" and state.reference_position_ned_m is not None
    ]
    assert found.tracking_error_m == pytest.approx(max(errors_m), abs=0.06)
    assert found.attitude_lag_s == pytest.approx(true_lag_s(pairs), abs=0.031)
    silent = [truth for truth, stage in flown.truths if stage is Stage.SILENT]
    before = [truth for truth, stage in flown.truths if stage is Stage.PASSING][-1]
    ran_m = math.dist(silent[-1].position_ned_m[:2], before.position_ned_m[:2])
    assert found.run_on_m == pytest.approx(ran_m, abs=0.15)
    assert found.run_on_speed_mps == pytest.approx(contract_of(flavour).vehicle.cruise_speed_mps)
    assert found.run_on_rest_s is not None
    assert 0.2 < found.run_on_rest_s < 3.0
    assert found.rest_time_s is not None
    assert found.tilt_asked_deg == pytest.approx(found.tilt_max_deg, rel=0.35)


def true_lag_s(pairs: list[tuple[tuple[VehicleTruth, Stage], StateRecord]]) -> float:
    """The delay that maps the commanded acceleration onto the plant's tilt, by correlation."""
    flying = [
        (truth, state)
        for (truth, stage), state in pairs
        if stage is Stage.PASSING and state.reference_acceleration_ned_mps2 is not None
    ]
    asked = np.array([state.reference_acceleration_ned_mps2 for _, state in flying])[:, 1]
    # The nose points north or south, so that acceleration to the east is roll.
    tilted = np.array(
        [
            9.80665 * math.tan(t.roll_rad) * math.copysign(1.0, math.cos(t.yaw_rad))
            for t, _ in flying
        ]
    )
    lags = range(40)
    fits = [float(np.sum((tilted[40:] - asked[40 - n : len(asked) - n]) ** 2)) for n in lags]
    return 0.02 * int(np.argmin(fits))


def test_the_vehicle_stays_in_the_free_air_and_within_the_contract() -> None:
    flown = whole_flight("ardupilot")
    limit = contract_of("ardupilot").vehicle
    origin = next(t for t, stage in flown.truths if stage is Stage.RESTING).position_ned_m
    states = [each for each in flown.records if isinstance(each, StateRecord)]
    moving = [each for each in states if each.reference_velocity_ned_mps is not None]
    assert any(each.phase == "identify" for each in moving)
    for state in moving:
        assert state.reference_velocity_ned_mps is not None
        assert math.hypot(*state.reference_velocity_ned_mps) < 1.5 * limit.cruise_speed_mps
        assert abs(state.reference_velocity_ned_mps[0]) < limit.cruise_speed_mps + 1e-4
    reached = np.array([t.position_ned_m for t, stage in flown.truths if stage is Stage.PASSING])
    ahead_m, aside_m, up_m = np.abs(reached - np.array(origin)).max(axis=0)
    assert ahead_m < AIR.length_m
    assert aside_m < AIR.width_m / 2.0
    assert up_m < 2.0
    assert ahead_m > 15.0  # it did fly


# ------------------------------------------------------------------ who may fly


def test_the_pilot_ends_it_at_once_and_for_good() -> None:
    flown = flight("px4")
    flown.fly(lambda: flown.pilot.stage is Stage.PASSING)
    flown.operator.take_over()
    flown.fly(lambda: flown.link.status.mode == "LOITER")
    flown.advance()
    assert flown.pilot.over
    assert "the pilot has taken over (LOITER)" in flown.pilot.ended
    flown.operator.hand_back()
    flown.fly(lambda: flown.link.status.external_control or flown.now_s > 60.0)
    assert flown.pilot.over
    assert flown.pilot.setpoint(flown.now_s) is None


def test_it_does_not_begin_before_control_is_granted() -> None:
    flown = flight("px4")
    while not flown.link.status.external_control:
        assert flown.pilot.stage is Stage.WAITING
        flown.advance()
        setpoint = flown.pilot.setpoint(flown.now_s)
        assert (setpoint is None) is (flown.link.status.airborne is not True)
        if setpoint is not None:
            assert setpoint.velocity_ned_mps == (0.0, 0.0, 0.0)


def test_an_interruption_leads_to_rest_and_a_hover() -> None:
    flown = flight("ardupilot")
    flown.fly(lambda: flown.pilot.stage is Stage.PASSING)
    began_s = flown.now_s
    flown.fly(lambda: flown.now_s > began_s + 4.0)
    flown.pilot.stop(flown.now_s)
    flown.fly(lambda: flown.pilot.stage is Stage.HOLDING)
    assert flown.now_s < began_s + 8.0
    flown.fly(lambda: flown.now_s > began_s + 12.0)
    assert flown.scene.vehicle.truth.ground_speed_mps < 0.1
    assert not flown.pilot.complete
    setpoint = flown.pilot.setpoint(flown.now_s)
    assert setpoint is not None
    assert setpoint.velocity_ned_mps == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


def test_telemetry_that_stops_ends_it_in_a_brake() -> None:
    flown = flight("ardupilot")
    flown.fly(lambda: flown.pilot.stage is Stage.PASSING)
    lost_s = flown.now_s
    while flown.now_s < lost_s + 0.6:
        flown.now_s += 0.02
        flown.pilot.tick(flown.now_s)
    assert flown.pilot.ended == "telemetry is missing"
    assert flown.pilot.stage in (Stage.BRAKING, Stage.HOLDING)
    # Long without a position, the autopilot does better alone.
    flown.now_s += 3.0
    flown.pilot.tick(flown.now_s)
    assert flown.pilot.setpoint(flown.now_s) is None


@pytest.mark.parametrize(("radius_m", "begins"), [(200.0, True), (30.0, False)])
def test_the_free_air_lies_within_the_geofence(radius_m: float, *, begins: bool) -> None:
    fence = Fence((FenceArea(((0.0, 0.0),), radius_m, keeps_in=True),))
    flown = flight("ardupilot", fence=fence)
    flown.fly(lambda: bool(flown.notices))
    flown.fly(lambda: flown.now_s > 12.0)
    assert (flown.pilot.stage is Stage.WAITING) is not begins
    said = "beyond the geofence" in " ".join(each.text for each in flown.notices)
    assert said is not begins
