"""Signed and authenticated flights in virtual time, and the same with a wrong key."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from gcs_tools.scenario import load_scenario
from onboard.authentication.operator_command import (
    CommandGate,
    CommandJournal,
    CommandKind,
    CommandRefusedError,
    sealed,
)
from onboard.guidance.phases import Phase
from onboard.mavlink.signing import Objection
from onboard.monitoring.flight_authorization import FlightAuthorization
from onboard.recording.messages import EventRecord
from sitl.virtual.simulation import EPOCH_UNIX_S, SimulatedFlight, Simulation, ticks

CONFIG = Path(__file__).parents[3] / "config"
KEY, WRONG_KEY = bytes(range(32)), bytes([1] * 32)
WORDS = "open sesame"


def flight(mavlink_key: bytes | None = None, passphrase: str | None = None) -> SimulatedFlight:
    """Five metres before the first obstacle."""
    scenario = load_scenario(CONFIG / "paper.yaml")
    leg = scenario.mission.legs[0].model_copy(update={"end_ned_m": (5.0, 0.0)})
    sitl = scenario.sitl_config(seed=1).model_copy(update={"signing_passphrase": passphrase})
    return SimulatedFlight(
        scenario.contract,
        scenario.mission.model_copy(update={"legs": (leg,)}),
        sitl,
        scenario.obstacles,
        mavlink_key=mavlink_key,
        time_limit_s=60.0,
    )


def flown(simulation: Simulation) -> tuple[set[Phase], set[str]]:
    """Fly; return the phases of the service and what it has reported."""
    phases, texts = set(), set()
    for records in ticks(simulation, shown=False):
        phases.add(simulation.autonomy.navigator.phase)
        texts |= {record.text for record in records if isinstance(record, EventRecord)}
    return phases, texts


def authorized(key: bytes) -> tuple[Simulation, str | None]:
    """Return a signed flight whose clearance is sealed with a key, and why that was refused."""
    simulation = Simulation(flight(passphrase=WORDS))
    service, contract = simulation.autonomy, simulation.flight.contract
    service.flight_authorization._age_max_s = 900.0
    clearance = FlightAuthorization(
        contract_sha256=contract.sha256, stamp_unix_s=EPOCH_UNIX_S, passed=True
    )
    data = sealed(
        clearance.model_dump_json().encode(),
        key=key,
        vehicle="v1",
        kind=CommandKind.CLEARANCE,
        now_unix_s=EPOCH_UNIX_S,
    )
    refusal = None
    try:
        payload = CommandGate(KEY, "v1", CommandJournal()).open(
            CommandKind.CLEARANCE, data, EPOCH_UNIX_S
        )
        service.receive_flight_authorization(payload, 0.0)
    except CommandRefusedError as error:
        refusal = str(error)
        service.report_refused_command("clearance", refusal, 0.0)
    return simulation, refusal


def test_with_a_wrong_key_the_service_hears_nothing_and_never_departs() -> None:
    simulation = Simulation(flight(WRONG_KEY, WORDS))
    phases, texts = flown(simulation)
    assert phases == {Phase.STANDBY}
    assert simulation.autonomy.link.security.refused[Objection.FORGED] > 10
    assert "MAVLink messages of 1/1 are refused: signed with another key, or altered" in texts


def test_where_signing_is_configured_nothing_is_flown_unsigned() -> None:
    simulation = Simulation(replace(flight(KEY), time_limit_s=3.0))
    phases, texts = flown(simulation)
    assert phases == {Phase.STANDBY}
    assert "MAVLink messages of 1/1 are refused: not signed" in texts


def test_a_signed_and_authenticated_flight_is_flown() -> None:
    simulation, refusal = authorized(KEY)
    phases, _ = flown(simulation)
    assert refusal is None
    assert Phase.ARRIVED in phases
    assert simulation.aborted is None
    assert not simulation.autonomy.link.security.refused
    assert simulation.scene.vehicle.autopilot.signing is not None
    assert simulation.scene.vehicle.autopilot.signing.refused == 0


def test_a_forged_clearance_authorizes_nothing() -> None:
    simulation, refusal = authorized(WRONG_KEY)
    phases, texts = flown(simulation)
    assert phases == {Phase.STANDBY}
    assert f"operator command refused: clearance: {refusal}" in texts
    assert any("no pre-flight check" in text for text in texts)
