"""Theory H: the daemon may die at any instant, and the vehicle still stays clear.

At each of many instants of one flight the vehicle is copied, and the copy flies on without a
daemon: the autopilot goes on with its last setpoint for its setpoint-loss time, then holds.
"""

import copy
import copyreg
import struct
from pathlib import Path
from types import MappingProxyType

import pytest

from gcs_tools.scenario import load_scenario
from onboard.files.contract_file import Contract
from sitl.vehicle.scene import Scene
from sitl.virtual.simulation import SimulatedFlight, Simulation

CONFIG = Path(__file__).parents[3] / "config"
AFTERMATH_S = 4.0
LOSS_TIMEOUT_S = 1.2

# pymavlink's unpackers and read-only tables do not say how to copy themselves.
copyreg.pickle(struct.Struct, lambda unpacker: (struct.Struct, (unpacker.format,)))
copyreg.pickle(MappingProxyType, lambda table: (MappingProxyType, (dict(table),)))


def head_on_flight(*, passive_safety: bool) -> SimulatedFlight:
    """One wide obstacle in the middle of the way, and an autopilot that notices a loss late."""
    scenario = load_scenario(CONFIG / "passive_safety.yaml")
    stated = scenario.contract.model_dump()
    stated["vehicle"]["setpoint_loss_timeout_s"] = LOSS_TIMEOUT_S
    stated["requirements"]["passive_safety"] = passive_safety
    sitl = scenario.sitl_config(seed=1)
    assert sitl.parameters["COM_OF_LOSS_T"] == LOSS_TIMEOUT_S
    return SimulatedFlight(
        Contract.model_validate(stated), scenario.mission, sitl, scenario.obstacles
    )


def deaths(*, passive_safety: bool, every: int) -> list[Scene]:
    """Fly; return what becomes of the vehicle if the daemon dies, for every so many ticks."""
    simulation = Simulation(head_on_flight(passive_safety=passive_safety))
    assert simulation.autonomy.assessment.compliant
    aftermaths, ticks = [], 0
    while not simulation.over:
        simulation.advance()
        ticks += 1
        if simulation.autonomy.navigator.flying and ticks % every == 0:
            orphan = copy.deepcopy(simulation.scene)
            orphan.advance(simulation.now_s + AFTERMATH_S)
            aftermaths.append(orphan)
    assert simulation.scene.world.collisions == 0
    return aftermaths


def test_daemon_may_die_at_any_instant() -> None:
    aftermaths = deaths(passive_safety=True, every=8)
    assert len(aftermaths) >= 100
    assert sum(scene.world.collisions for scene in aftermaths) == 0
    assert max(scene.vehicle.truth.ground_speed_mps for scene in aftermaths) < 0.1


def test_without_the_clause_it_may_not() -> None:
    """The test above is not vacuous: under a contract without the clause some deaths are fatal."""
    assert sum(scene.world.collisions for scene in deaths(passive_safety=False, every=25)) > 0


def test_clause_is_what_makes_the_vehicle_turn_earlier() -> None:
    fronts = [
        Simulation(head_on_flight(passive_safety=on)).autonomy.assessment.inflated.manoeuvre.front_m
        for on in (False, True)
    ]
    # It flies on to its last setpoint, by 1/1.3 s of the speed, and what the acceleration adds.
    run_on_m = 3.0 / 1.3 + (1.0 / (1.3 * 4.5) - 0.15 / (2.0 * 1.3)) * 2.6277
    assert fronts[1] - fronts[0] == pytest.approx(run_on_m, abs=0.01)
