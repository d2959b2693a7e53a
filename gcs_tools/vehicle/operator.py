"""Commands a live vehicle over MAVSDK, as an operator does: arm, take off, hand over, land.

Every wait has a limit and says what it waited for.  Each MAVSDK call is awaited to its end, because
MAVSDK hangs when it is closed while one of its calls is in flight; an interruption ends the wait in
progress.  This module sends no setpoints: MAVSDK's offboard plugin repeats the last one on its own,
which would defeat the autopilot's failsafe.

Modes and take-off follow the autopilot's profile, not MAVSDK, which takes the autopilot to be
whatever the first heartbeat of the system states: that may be the daemon's.
"""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import AsyncGenerator, Awaitable, Callable
from dataclasses import dataclass
from typing import Any, TypeVar

from mavsdk.asyncio import MavsdkError
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.mavlink_direct import MavlinkDirectAsync, MavlinkMessage
from mavsdk.asyncio.plugins.param import ParamAsync
from mavsdk.asyncio.plugins.telemetry import LandedState, TelemetryAsync

from gcs_tools.console.errors import CommandError
from gcs_tools.console.interruption import Interruption
from onboard.geometry.rest import RestDetector
from onboard.mavlink.profiles.profile import AutopilotProfile, Mode

T = TypeVar("T")

HEALTH_TIMEOUT_S = 30.0
ARM_TIMEOUT_S = 5.0
MODE_TIMEOUT_S = 5.0
LAND_TIMEOUT_S = 90.0
# Climb rates of autopilots start at 1 m/s.
TAKE_OFF_TIMEOUT_S = 15.0
TAKE_OFF_TIMEOUT_S_PER_M = 2.0

_POLL_S = 0.05
_RETRY_S = 0.3
# PX4 ends its climb up to 0.35 m off the height asked for.
_HEIGHT_TOLERANCE_M = 0.5

_AUTOPILOT_COMPONENT = 1
_MAV_CMD_NAV_TAKEOFF = 22
_MAV_CMD_DO_SET_MODE = 176
_MAV_RESULT_ACCEPTED = 0
# MAV_MODE_FLAG: custom mode enabled, safety armed.
_CUSTOM_MODE, _ARMED = 1, 128


class VehicleError(CommandError):
    """The vehicle did not do what was asked, or cannot be reached."""


class UrlError(VehicleError):
    """A connection URL cannot be opened."""


@dataclass
class VehicleState:
    """The newest telemetry; NaN before the first."""

    healthy: bool = False
    armed: bool = False
    mode: str = "unknown"
    external_control: bool = False
    landed: LandedState = LandedState.UNKNOWN
    connected: bool = True
    position_ned_m: tuple[float, float, float] = (math.nan, math.nan, math.nan)
    velocity_ned_mps: tuple[float, float, float] = (math.nan, math.nan, math.nan)
    unhealthy: str = "no health report"

    @property
    def speed_mps(self) -> float:
        """Speed in space; NaN before the first report."""
        return math.hypot(*self.velocity_ned_mps)

    @property
    def in_air(self) -> bool:
        """Whether the vehicle reports that it flies."""
        return self.landed in {LandedState.IN_AIR, LandedState.LANDING, LandedState.TAKING_OFF}


class Vehicle:
    """A connected vehicle; made by `gcs_tools.vehicle.connection.connected_vehicle`.

    Args:
        system: MAVSDK's system.
        system_id: of its MAVLink messages.
        profile: of its autopilot.
        interruption: set by an operator who gives up.

    Attributes:
        state: the newest telemetry.
        profile, system, system_id: as given.
    """

    def __init__(
        self, system: Any, system_id: int, profile: AutopilotProfile, interruption: Interruption
    ) -> None:
        self.state = VehicleState()
        self._rest = RestDetector()
        self.profile = profile
        self.system = system
        self.system_id = system_id
        self._interruption = interruption
        self._action = ActionAsync(system)
        self._parameters = ParamAsync(system)
        self._telemetry = TelemetryAsync(system)
        self._direct = MavlinkDirectAsync(system)

    def watchers(self) -> list[Awaitable[None]]:
        """Return the endless tasks that keep ``state`` up to date."""
        telemetry = self._telemetry
        return [
            self._follow(telemetry.subscribe_health_all_ok(), "healthy"),
            self._follow(telemetry.subscribe_armed(), "armed"),
            self._follow(telemetry.subscribe_landed_state(), "landed"),
            self._follow(self.system.is_connected_state(), "connected"),
            self._follow_mode(),
            self._follow_health(),
            self._follow_position(),
        ]

    async def request_rates(self) -> None:
        """Request the telemetry that the commands below wait for."""
        if self.profile.needs_health_request:
            await self._done(self._telemetry.set_rate_health(2.0), "sending its health")
        await self._done(self._telemetry.set_rate_position_velocity_ned(10.0), "position")

    async def wait_healthy(self) -> None:
        """Wait until the autopilot reports that it may be armed."""
        await self.until(
            lambda: self.state.healthy, HEALTH_TIMEOUT_S, lambda: "healthy: " + self.state.unhealthy
        )

    async def arm(self) -> None:
        """Arm, and wait until the vehicle reports it.

        An autopilot that takes off in the mode of our setpoints is switched to it first.
        """
        if self.profile.take_off.in_external_control and not self.state.external_control:
            await self._take_mode(self._external_control)
        await self._done(self._action.arm(), "arming")
        await self.until(lambda: self.state.armed, ARM_TIMEOUT_S, lambda: "armed")

    async def take_off(self, altitude_m: float) -> None:
        """Take off, and wait until the vehicle hovers at ``altitude_m`` above the origin."""
        await self._start_climb(altitude_m)
        await self.until(
            lambda: self.state.in_air and self._hovers_at(altitude_m),
            TAKE_OFF_TIMEOUT_S + TAKE_OFF_TIMEOUT_S_PER_M * altitude_m,
            lambda: (
                f"hovering at {altitude_m:g} m (now {-self.state.position_ned_m[2]:.2f} m, "
                f"{self.state.speed_mps:.2f} m/s)"
            ),
        )

    async def _start_climb(self, altitude_m: float) -> None:
        parameter = self.profile.take_off.height_parameter
        if parameter is None:
            result = await self._command(_MAV_CMD_NAV_TAKEOFF, (*(0.0,) * 6, altitude_m))
            if result != _MAV_RESULT_ACCEPTED:
                raise VehicleError(f"taking off: refused by the vehicle (MAV_RESULT {result})")
        else:
            setting = self._parameters.set_param_float(parameter, altitude_m)
            await self._done(setting, f"setting {parameter}")
            # MAVSDK states no place and no height, so that the parameter counts.
            await self._done(self._action.takeoff(), "taking off")

    @property
    def at_rest(self) -> bool:
        """Whether the vehicle has stood still for a second, as far as its estimate can tell."""
        return self._rest.at_rest

    async def hand_over(self) -> None:
        """Switch to the mode in which the daemon's setpoints fly the vehicle."""
        await self._take_mode(self._external_control)

    @property
    def _external_control(self) -> Mode:
        mode = self.profile.modes.external_control
        if mode is None:
            raise VehicleError(f"{self.profile.name}: no mode is known that obeys setpoints")
        return mode

    async def _take_mode(self, mode: Mode) -> None:
        """Switch to a mode, and wait until the vehicle reports it.

        Autopilots may reject a mode until setpoints have arrived for a while, so the request is
        repeated until `MODE_TIMEOUT_S` has passed.
        """
        result, deadline_s = None, asyncio.get_running_loop().time() + MODE_TIMEOUT_S
        while result != _MAV_RESULT_ACCEPTED:
            if asyncio.get_running_loop().time() > deadline_s:
                raise VehicleError(f"{mode.name}: refused by the vehicle (MAV_RESULT {result})")
            base_mode = float(_CUSTOM_MODE | (_ARMED if self.state.armed else 0))
            result = await self._command(_MAV_CMD_DO_SET_MODE, (base_mode, mode.main, mode.sub))
            self._interruption.check()
            await asyncio.sleep(_RETRY_S if result != _MAV_RESULT_ACCEPTED else 0.0)
        await self.until(
            lambda: self.state.mode == mode.name, MODE_TIMEOUT_S, lambda: f"in {mode.name}"
        )

    async def land(self) -> None:
        """Land, and wait until the vehicle has disarmed itself."""
        await self._done(self._action.land(), "landing")
        await self.until(
            lambda: not self.state.armed, LAND_TIMEOUT_S, lambda: "on the ground and disarmed"
        )

    async def until(
        self,
        condition: Callable[[], bool],
        timeout_s: float,
        what: Callable[[], str],
    ) -> None:
        """Wait for a condition.

        Raises:
            VehicleError: it did not come true in time, or the vehicle is gone.
            Interrupted: the operator gave up.
        """
        loop = asyncio.get_running_loop()
        deadline_s = loop.time() + timeout_s
        while not condition():
            self._interruption.check()
            if not self.state.connected:
                raise VehicleError(f"the vehicle was lost while waiting for it to be {what()}")
            if loop.time() > deadline_s:
                raise VehicleError(f"after {timeout_s:g} s the vehicle is still not {what()}")
            await asyncio.sleep(_POLL_S)

    def _hovers_at(self, altitude_m: float) -> bool:
        height_m = -self.state.position_ned_m[2]
        near = abs(height_m - altitude_m) < _HEIGHT_TOLERANCE_M
        # In the mode of our setpoints, the daemon flies on as soon as the vehicle has climbed.
        return near and (self.profile.take_off.in_external_control or self.at_rest)

    async def _done(self, call: Awaitable[T], what: str) -> T:
        try:
            return await call
        except MavsdkError as error:
            raise VehicleError(f"{what}: refused by the vehicle: {error}") from error

    async def _command(self, command: int, parameters: tuple[float, ...]) -> int | None:
        """Send a COMMAND_LONG; return its MAV_RESULT."""
        fields = {
            "target_system": self.system_id,
            "target_component": 1,
            "command": command,
            "confirmation": 0,
            **{f"param{n}": 0.0 for n in range(1, 8)},
            **{f"param{n}": value for n, value in enumerate(parameters, start=1)},
        }
        message = MavlinkMessage(
            "COMMAND_LONG",
            target_system_id=self.system_id,
            target_component_id=1,
            fields_json=json.dumps(fields),
        )
        ack = await self._done(self._direct.send_command(message), f"command {command}")
        result: int | None = json.loads(ack.fields_json).get("result")
        return result

    async def _follow_mode(self) -> None:
        heartbeats = self._direct.subscribe_message("HEARTBEAT")
        async for message in heartbeats:
            if message.component_id == _AUTOPILOT_COMPONENT:
                custom_mode = int(json.loads(message.fields_json)["custom_mode"])
                modes = self.profile.modes
                self.state.mode = modes.name_of(custom_mode)
                self.state.external_control = modes.is_external_control(custom_mode)

    async def _follow(self, values: AsyncGenerator[Any, None], name: str) -> None:
        async for value in values:
            setattr(self.state, name, value)

    async def _follow_health(self) -> None:
        async for health in self._telemetry.subscribe_health():
            failing = [
                name.removeprefix("is_").removesuffix("_ok").replace("_", " ")
                for name, value in vars(health).items()
                if value is False
            ]
            self.state.unhealthy = ", ".join(failing) or "nothing in particular"

    async def _follow_position(self) -> None:
        async for sample in self._telemetry.subscribe_position_velocity_ned():
            at, going = sample.position, sample.velocity
            self.state.position_ned_m = (at.north_m, at.east_m, at.down_m)
            self.state.velocity_ned_mps = (going.north_m_s, going.east_m_s, going.down_m_s)
            self._rest.add(asyncio.get_running_loop().time(), self.state.position_ned_m)
