"""The operator's commands by profile, on a scripted MAVSDK: no link and no waiting."""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import pytest
from mavsdk.asyncio import MavsdkError
from mavsdk.asyncio.plugins.telemetry import LandedState

from gcs_tools.console.errors import Interrupted
from gcs_tools.console.interruption import Interruption
from gcs_tools.vehicle import operator
from gcs_tools.vehicle.operator import Vehicle, VehicleError
from onboard.mavlink.profiles.ardupilot import ARDUPILOT
from onboard.mavlink.profiles.profile import AutopilotProfile, Mode, Modes, TakeOff
from onboard.mavlink.profiles.px4 import PX4
from onboard.mavlink.profiles.registry import OTHER

SET_MODE, TAKE_OFF = 176, 22
ACCEPTED, DENIED = 0, 2
OWN = replace(
    OTHER,
    key="own",
    modes=Modes(lambda mode: f"M{mode}", external_control=Mode("M7", 7, 1)),
    take_off=TakeOff(height_parameter="CLIMB_TO"),
)


@dataclass
class Script:
    """What the vehicle is told, in order, and how it answers.

    Attributes:
        said: what was called: MAVSDK's function or MAV_CMD, with its arguments.
        results: MAV_RESULT of the next commands; then all are accepted.
        react: called after every command.
    """

    said: list[tuple[Any, ...]] = field(default_factory=list)
    results: list[int] = field(default_factory=list)
    react: Callable[[tuple[Any, ...]], None] = lambda _: None
    refused: set[str] = field(default_factory=set)

    def say(self, *call: Any) -> None:
        self.said.append(call)
        if call[0] in self.refused:
            raise MavsdkError("DENIED", "the vehicle does not like it")
        self.react(call)


class ScriptedPlugin:
    """Stands in for ActionAsync, ParamAsync, TelemetryAsync and MavlinkDirectAsync."""

    def __init__(self, script: Script) -> None:
        self._script = script

    def __getattr__(self, name: str) -> Callable[..., Any]:
        async def call(*arguments: Any) -> None:
            self._script.say(name, *arguments)

        return call

    async def send_command(self, message: Any) -> Any:
        fields = json.loads(message.fields_json)
        assert (message.target_system_id, message.target_component_id) == (1, 1)
        parameters = tuple(fields[f"param{n}"] for n in range(1, 8))
        result = self._script.results.pop(0) if self._script.results else ACCEPTED
        self._script.said.append((fields["command"], parameters))
        if result == ACCEPTED:
            self._script.react((fields["command"], parameters))
        return SimpleNamespace(fields_json=json.dumps({"result": result}))


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("ActionAsync", "ParamAsync", "TelemetryAsync", "MavlinkDirectAsync"):
        monkeypatch.setattr(operator, name, ScriptedPlugin)
    monkeypatch.setattr(operator, "_POLL_S", 0.001)
    monkeypatch.setattr(operator, "_RETRY_S", 0.001)
    monkeypatch.setattr(operator, "MODE_TIMEOUT_S", 0.05)


def vehicle_of(profile: AutopilotProfile, script: Script) -> Vehicle:
    """Return a vehicle that obeys: it changes mode, arms and climbs at once."""
    vehicle = Vehicle(script, 1, profile, Interruption())

    def obey(call: tuple[Any, ...]) -> None:
        state = vehicle.state
        match call:
            case (176, (_, main, sub, *_)):
                modes = (profile.modes.external_control, profile.modes.hold)
                taken = next(m for m in modes if m is not None and (m.main, m.sub) == (main, sub))
                state.mode = taken.name
                state.external_control = taken is profile.modes.external_control
            case ("arm",):
                state.armed = True
            case ("takeoff",) | (22, _):
                state.landed = LandedState.IN_AIR
                state.position_ned_m, state.velocity_ned_mps = (0.0, 0.0, -4.0), (0.0, 0.0, 0.0)
                for step in range(40):
                    vehicle._rest.add(step * 0.1, state.position_ned_m)
            case ("land",):
                state.armed = False
            case _:
                pass

    script.react = obey
    return vehicle


async def fly(vehicle: Vehicle) -> None:
    await vehicle.arm()
    await vehicle.take_off(4.0)
    await vehicle.hand_over()
    await vehicle.land()


def test_px4_takes_off_to_its_parameter_and_is_then_switched_to_offboard() -> None:
    script = Script()
    asyncio.run(fly(vehicle_of(PX4, script)))
    armed = 129.0
    assert script.said == [
        ("arm",),
        ("set_param_float", "MIS_TAKEOFF_ALT", 4.0),
        ("takeoff",),
        (SET_MODE, (armed, 6.0, 0.0, 0.0, 0.0, 0.0, 0.0)),
        ("land",),
    ]


def test_ardupilot_is_armed_in_guided_and_takes_off_by_command() -> None:
    script = Script()
    asyncio.run(fly(vehicle_of(ARDUPILOT, script)))
    guided = (4.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert script.said == [
        (SET_MODE, (1.0, *guided)),
        ("arm",),
        (TAKE_OFF, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 4.0)),
        (SET_MODE, (129.0, *guided)),
        ("land",),
    ]


def test_a_vehicle_that_is_in_guided_already_is_armed_as_it_is() -> None:
    script = Script()
    vehicle = vehicle_of(ARDUPILOT, script)
    vehicle.state.external_control = True
    asyncio.run(vehicle.arm())
    assert script.said == [("arm",)]


def test_an_own_profile_takes_off_and_is_handed_over_by_its_own_names() -> None:
    script = Script()
    asyncio.run(fly(vehicle_of(OWN, script)))
    assert ("set_param_float", "CLIMB_TO", 4.0) in script.said
    assert (SET_MODE, (129.0, 7.0, 1.0, 0.0, 0.0, 0.0, 0.0)) in script.said


def test_an_unknown_autopilot_is_never_handed_over() -> None:
    script = Script()
    with pytest.raises(VehicleError, match="unknown autopilot: no mode is known that obeys"):
        asyncio.run(vehicle_of(OTHER, script).hand_over())
    assert script.said == []


def test_a_mode_that_is_rejected_at_first_is_requested_again() -> None:
    script = Script(results=[DENIED, DENIED])
    vehicle = vehicle_of(PX4, script)
    asyncio.run(vehicle.hand_over())
    assert [call[0] for call in script.said] == [SET_MODE] * 3
    assert vehicle.state.mode == "OFFBOARD"


def test_a_mode_that_stays_rejected_is_an_error_that_names_it() -> None:
    script = Script(results=[DENIED] * 1000)
    with pytest.raises(VehicleError, match=r"GUIDED: refused by the vehicle \(MAV_RESULT 2\)"):
        asyncio.run(vehicle_of(ARDUPILOT, script).hand_over())


def test_a_mode_that_is_accepted_but_not_taken_is_an_error() -> None:
    script = Script()
    vehicle = vehicle_of(PX4, script)
    script.react = lambda _: None
    with pytest.raises(VehicleError, match=r"after 0\.05 s the vehicle is still not in OFFBOARD"):
        asyncio.run(vehicle.hand_over())


@pytest.mark.parametrize(
    ("profile", "refused", "results", "words"),
    [
        (PX4, {"takeoff"}, [], "taking off: refused by the vehicle: "),
        (PX4, {"set_param_float"}, [], "setting MIS_TAKEOFF_ALT: refused by the vehicle: "),
        (ARDUPILOT, set(), [DENIED], r"taking off: refused by the vehicle \(MAV_RESULT 2\)"),
    ],
)
def test_a_refused_take_off_says_what_was_refused(
    profile: AutopilotProfile, refused: set[str], results: list[int], words: str
) -> None:
    script = Script(results=results, refused=refused)
    with pytest.raises(VehicleError, match=words):
        asyncio.run(vehicle_of(profile, script).take_off(4.0))


def test_a_climb_that_does_not_end_tells_height_and_speed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(operator, "TAKE_OFF_TIMEOUT_S", 0.01)
    monkeypatch.setattr(operator, "TAKE_OFF_TIMEOUT_S_PER_M", 0.0)
    script = Script()
    vehicle = vehicle_of(PX4, script)
    script.react = lambda _: None
    vehicle.state.landed = LandedState.IN_AIR
    vehicle.state.position_ned_m, vehicle.state.velocity_ned_mps = (0.0, 0.0, -1.5), (0.3, 0.0, 0.4)
    words = r"still not hovering at 4 m \(now 1\.50 m, 0\.50 m/s\)"
    with pytest.raises(VehicleError, match=words):
        asyncio.run(vehicle.take_off(4.0))


@pytest.mark.parametrize(("profile", "waits"), [(PX4, True), (ARDUPILOT, False)])
def test_only_a_take_off_in_a_mode_of_its_own_ends_at_rest(
    profile: AutopilotProfile, *, waits: bool
) -> None:
    vehicle = vehicle_of(profile, Script())
    vehicle.state.position_ned_m = (0.0, 0.0, -4.2)
    assert not vehicle.at_rest
    assert vehicle._hovers_at(4.0) is not waits
    vehicle.state.position_ned_m = (0.0, 0.0, -4.6)
    assert not vehicle._hovers_at(4.0)


@pytest.mark.parametrize(
    ("profile", "asked"), [(PX4, 0), (OTHER, 0), (ARDUPILOT, 1)], ids=["px4", "other", "ardupilot"]
)
def test_health_is_requested_where_it_does_not_come_unasked(
    profile: AutopilotProfile, asked: int
) -> None:
    script = Script()
    asyncio.run(vehicle_of(profile, script).request_rates())
    names = [call[0] for call in script.said]
    assert names.count("set_rate_health") == asked
    assert names[-1] == "set_rate_position_velocity_ned"


def heartbeat(component: int, custom_mode: int) -> Any:
    return SimpleNamespace(
        component_id=component, fields_json=json.dumps({"custom_mode": custom_mode})
    )


def test_the_mode_is_that_of_the_autopilots_own_heartbeat() -> None:
    vehicle = vehicle_of(ARDUPILOT, Script())
    modes = []

    async def heartbeats(name: str) -> AsyncIterator[Any]:
        assert name == "HEARTBEAT"
        for component, custom_mode in ((1, 5), (196, 4), (1, 4), (196, 0), (1, 17)):
            yield heartbeat(component, custom_mode)
            modes.append((vehicle.state.mode, vehicle.state.external_control))

    vehicle._direct.subscribe_message = heartbeats
    asyncio.run(vehicle._follow_mode())
    assert modes == [
        ("LOITER", False),
        ("LOITER", False),
        ("GUIDED", True),
        ("GUIDED", True),
        ("BRAKE", False),
    ]


def test_a_lost_vehicle_ends_every_wait() -> None:
    vehicle = vehicle_of(PX4, Script())
    vehicle.state.connected = False
    with pytest.raises(VehicleError, match="lost while waiting for it to be healthy: no health"):
        asyncio.run(vehicle.wait_healthy())


def test_an_interruption_ends_every_wait() -> None:
    interruption = Interruption()
    vehicle = Vehicle(Script(), 1, PX4, interruption)
    interruption.request(2)
    with pytest.raises(Interrupted):
        asyncio.run(vehicle.wait_healthy())


def test_before_the_first_telemetry_nothing_is_known() -> None:
    state = vehicle_of(PX4, Script()).state
    assert (state.mode, state.external_control, state.armed, state.in_air) == (
        "unknown", False, False, False,
    )  # fmt: skip
    assert math.isnan(state.speed_mps)
