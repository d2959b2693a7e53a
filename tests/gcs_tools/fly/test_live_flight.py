"""Configuration and operator of a live flight, without starting its processes."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
import yaml

from gcs_tools.console.errors import CommandError
from gcs_tools.console.processes import Children
from gcs_tools.fly import live_flight
from gcs_tools.fly.live_configuration import Endpoints, write_configuration
from gcs_tools.fly.live_flight import Operator, Status
from gcs_tools.scenario import Scenario, load_scenario
from gcs_tools.vehicle.operator import Vehicle, VehicleError
from onboard.authentication.key_file import load_key
from onboard.files.daemon_config import DaemonConfig
from onboard.files.yaml_file import load_yaml
from sitl.autopilot.protocol.signing import signing_key
from sitl.config import load_sitl_config
from tests.gcs_tools.running import CONFIG

ENDPOINTS = Endpoints(14540, 14550, 7447, 7448)
SCENARIOS = {
    "px4": CONFIG / "scenarios" / "px4_three_obstacles.yaml",
    "ardupilot": CONFIG / "scenarios" / "ardupilot_three_obstacles.yaml",
}


@pytest.fixture(params=SCENARIOS)
def scenario(request: pytest.FixtureRequest) -> Scenario:
    return load_scenario(SCENARIOS[request.param])


@pytest.mark.parametrize("fly_outside_contract", [True, False])
def test_both_processes_can_read_what_is_written(
    scenario: Scenario, tmp_path: Path, *, fly_outside_contract: bool
) -> None:
    write_configuration(
        scenario, ENDPOINTS, seed=7, out=tmp_path, fly_outside_contract=fly_outside_contract
    )
    onboard = load_yaml(tmp_path / "onboard.yaml", DaemonConfig)
    sitl = load_sitl_config(tmp_path / "sitl.yaml")
    assert (onboard.fly_outside_contract, onboard.require_preflight) == (
        fly_outside_contract,
        not fly_outside_contract,
    )
    assert onboard.mavlink.url == "udpin://127.0.0.1:14540"
    assert sitl.mavlink == ("udpout://127.0.0.1:14540", "udpout://127.0.0.1:14550")
    assert onboard.zenoh.connect == sitl.zenoh.listen == (ENDPOINTS.sitl_zenoh,)
    assert (onboard.mavlink.system_id, sitl.seed) == (sitl.system_id, 7)
    for name in ("contract", "mission", "field"):
        assert (tmp_path / f"{name}.yaml").exists()


@pytest.mark.parametrize("own", [False, True])
def test_a_key_goes_to_both_ends_unless_the_vehicle_has_its_own(
    scenario: Scenario, tmp_path: Path, *, own: bool
) -> None:
    key = bytes(range(32))
    if own:
        plant = scenario.plant.model_copy(update={"signing_passphrase": "another"})
        scenario = replace(scenario, plant=plant)
    write_configuration(
        scenario, ENDPOINTS, seed=7, out=tmp_path, fly_outside_contract=False, mavlink_key=key
    )
    onboard = load_yaml(tmp_path / "onboard.yaml", DaemonConfig)
    assert onboard.mavlink.signing is not None
    assert load_key(tmp_path / onboard.mavlink.signing.key_file) == key
    assert (signing_key(load_sitl_config(tmp_path / "sitl.yaml")) == key) is not own


def test_without_a_key_nothing_is_signed(scenario: Scenario, tmp_path: Path) -> None:
    write_configuration(scenario, ENDPOINTS, seed=7, out=tmp_path, fly_outside_contract=False)
    assert load_yaml(tmp_path / "onboard.yaml", DaemonConfig).mavlink.signing is None
    assert signing_key(load_sitl_config(tmp_path / "sitl.yaml")) is None


def written_parameters(scenario: Scenario, out: Path) -> dict[str, float]:
    write_configuration(scenario, ENDPOINTS, seed=1, out=out, fly_outside_contract=False)
    document = yaml.safe_load((out / "sitl.yaml").read_text(encoding="utf-8"))
    parameters: dict[str, float] = document["parameters"]
    return parameters


def test_the_simulated_autopilot_is_set_up_by_its_profile(tmp_path: Path) -> None:
    px4 = written_parameters(load_scenario(SCENARIOS["px4"]), tmp_path)
    scenario = load_scenario(SCENARIOS["px4"])
    timeout_s = scenario.contract.vehicle.setpoint_loss_timeout_s
    assert px4["COM_RC_IN_MODE"] == 4.0
    assert px4["MIS_TAKEOFF_ALT"] == scenario.mission.altitude_m
    assert px4["COM_OF_LOSS_T"] == timeout_s
    copter = written_parameters(load_scenario(SCENARIOS["ardupilot"]), tmp_path)
    assert copter["FS_THR_ENABLE"] == 0.0
    assert copter["GUID_TIMEOUT"] == 0.5
    assert not any(name.startswith(("COM_", "MIS_")) for name in copter)


def test_parameters_of_the_scenario_come_first(tmp_path: Path) -> None:
    scenario = load_scenario(SCENARIOS["ardupilot"])
    scenario.plant.parameters["FS_THR_ENABLE"] = 3.0
    assert written_parameters(scenario, tmp_path)["FS_THR_ENABLE"] == 3.0


def test_what_cannot_be_written_is_one_error(scenario: Scenario, tmp_path: Path) -> None:
    with pytest.raises(CommandError, match="cannot be written: "):
        write_configuration(
            scenario, ENDPOINTS, seed=1, out=tmp_path / "not there", fly_outside_contract=False
        )


class ScriptedVehicle:
    """Obeys at once; its daemon goes through the phases that a test gives it."""

    def __init__(self, status: Status, phases: list[str], mode: str = "OFFBOARD") -> None:
        self.said: list[str] = []
        self.state = SimpleNamespace(
            in_air=False, position_ned_m=(0.0, 0.0, -4.0), speed_mps=0.0, mode=mode
        )
        self._status, self._phases = status, phases
        self._now_s = 0.0

    async def arm(self) -> None:
        self.said.append("arm")

    async def take_off(self, altitude_m: float) -> None:
        self.said.append(f"take off to {altitude_m:g} m")
        self.state.in_air = True
        self._status.last = {"phase": "standby", "airborne": True}

    async def hand_over(self) -> None:
        self.said.append("hand over")

    async def land(self) -> None:
        self.said.append("land")
        self.state.in_air = False

    async def until(self, condition: Any, timeout_s: float, what: Any) -> None:
        """Ask until it holds, a phase later each time; fail when there is none left."""
        if what() == "standing still":
            return
        while not condition():
            if not self._phases:
                raise VehicleError(f"after {timeout_s:g} s the vehicle is still not {what()}")
            self._status.last = {**self._status.last, "phase": self._phases.pop(0)}


def flown(phases: list[str], mode: str = "OFFBOARD") -> tuple[str | None, list[str]]:
    status = Status()
    vehicle = ScriptedVehicle(status, phases, mode)
    children = cast("Children", SimpleNamespace(check=lambda: None))
    mission = load_scenario(SCENARIOS["px4"]).mission
    operator = Operator(cast("Vehicle", vehicle), status, children, mission, lambda *_: None)
    return asyncio.run(operator.fly()), vehicle.said


def flight_steps() -> list[str]:
    altitude_m = load_scenario(SCENARIOS["px4"]).mission.altitude_m
    return ["arm", f"take off to {altitude_m:g} m", "hand over", "land"]


@pytest.mark.parametrize(
    "phases",
    [
        ["cruise", "avoid", "cruise", "arrived"],
        ["cruise", "hold"],
        ["arrived"],  # the leg is shorter than one look at the status
        ["cruise", "a phase that was added later", "arrived"],
    ],
)
def test_a_mission_that_ends_is_landed(phases: list[str]) -> None:
    assert flown(phases) == (None, flight_steps())


def test_a_daemon_that_loses_control_is_told_with_the_mode() -> None:
    mishap, said = flown(["cruise", "standby"], mode="POSCTL")
    assert mishap == "the daemon lost control to mode POSCTL"
    assert said == flight_steps()


def test_a_daemon_that_does_not_depart_is_landed_too() -> None:
    mishap, said = flown([])
    assert mishap is not None
    assert f"after {live_flight.DEPARTURE_TIMEOUT_S:g} s" in mishap
    assert said == flight_steps()


def test_a_vehicle_that_never_left_the_ground_is_not_landed() -> None:
    status = Status()
    vehicle = ScriptedVehicle(status, [])

    async def refuse(altitude_m: float) -> None:
        raise VehicleError("taking off: refused by the vehicle (MAV_RESULT 4)")

    vehicle.take_off = refuse  # type: ignore[method-assign]
    children = cast("Children", SimpleNamespace(check=lambda: None))
    mission = load_scenario(SCENARIOS["px4"]).mission
    operator = Operator(cast("Vehicle", vehicle), status, children, mission, lambda *_: None)
    assert asyncio.run(operator.fly()) == "taking off: refused by the vehicle (MAV_RESULT 4)"
    assert vehicle.said == ["arm"]


def test_before_its_first_status_the_daemon_neither_flies_nor_sees() -> None:
    status = Status()
    assert (status.phase, status.airborne, status.sees) == ("", False, False)
