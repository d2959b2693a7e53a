"""The operator's hands on a live vehicle, over MAVSDK: arm, take off, hand over, land.

Every wait has a limit and says what it waited for.  Nothing here is ever cancelled half-way: MAVSDK
hangs when it is closed while one of its calls is in flight, so an interruption is noticed by the
wait in progress, and every call made so far is awaited.  Setpoints are not sent from here: MAVSDK's
offboard plugin repeats the last one on its own, which would defeat the autopilot's failsafe.
"""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import AsyncGenerator, Awaitable, Callable
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, TypeVar

from mavsdk.asyncio import Autopilot, MavsdkError
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.mavlink_direct import MavlinkDirectAsync, MavlinkMessage
from mavsdk.asyncio.plugins.telemetry import FlightMode, LandedState, TelemetryAsync

from gcs_tools.console.errors import CommandError
from gcs_tools.console.interruption import Interruption
from onboard.geometry.rest import RestDetector

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

_MAV_CMD_DO_SET_MODE = 176
_MAV_RESULT_ACCEPTED = 0
_CUSTOM_MODE_ARMED = 129.0

# MAV_CMD_DO_SET_MODE params 2 and 3: PX4's OFFBOARD, ArduCopter's GUIDED.
_OFFBOARD = MappingProxyType({Autopilot.PX4: (6.0, 0.0), Autopilot.ARDUPILOT: (4.0, 0.0)})


class VehicleError(CommandError):
    """The vehicle did not do what was asked, or is not there."""


@dataclass
class VehicleState:
    """What telemetry has said last; NaN and None before it has said anything."""

    healthy: bool = False
    armed: bool = False
    mode: FlightMode = FlightMode.UNKNOWN
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
        """Whether the vehicle says that it flies."""
        return self.landed in {LandedState.IN_AIR, LandedState.LANDING, LandedState.TAKING_OFF}


class Vehicle:
    """A connected vehicle; made by `vehicle_connection.connected_vehicle`.

    Args:
        system: MAVSDK's system.
        system_id: of its MAVLink messages.
        autopilot: which flavour of commands it takes.
        interruption: set by an operator who gives up.

    Attributes:
        state: what telemetry has said last.
        autopilot, system, system_id: as given.
    """

    def __init__(
        self, system: Any, system_id: int, autopilot: Autopilot, interruption: Interruption
    ) -> None:
        self.state = VehicleState()
        self._rest = RestDetector()
        self.autopilot = autopilot
        self.system = system
        self.system_id = system_id
        self._interruption = interruption
        self._action = ActionAsync(system)
        self._telemetry = TelemetryAsync(system)
        self._direct = MavlinkDirectAsync(system)

    def watchers(self) -> list[Awaitable[None]]:
        """Return the endless tasks that keep ``state`` up to date."""
        telemetry = self._telemetry
        return [
            self._follow(telemetry.subscribe_health_all_ok(), "healthy"),
            self._follow(telemetry.subscribe_armed(), "armed"),
            self._follow(telemetry.subscribe_flight_mode(), "mode"),
            self._follow(telemetry.subscribe_landed_state(), "landed"),
            self._follow(self.system.is_connected_state(), "connected"),
            self._follow_health(),
            self._follow_position(),
        ]

    async def request_rates(self) -> None:
        """Ask for the telemetry that is waited for; ArduPilot sends none of it unasked."""
        if self.autopilot is Autopilot.ARDUPILOT:
            await self._done(self._telemetry.set_rate_health(2.0), "sending its health")
        await self._done(self._telemetry.set_rate_position_velocity_ned(10.0), "position")

    async def wait_healthy(self) -> None:
        """Wait until the autopilot calls itself ready to arm."""
        await self.until(
            lambda: self.state.healthy, HEALTH_TIMEOUT_S, lambda: "healthy: " + self.state.unhealthy
        )

    async def arm(self) -> None:
        """Arm, and see it armed."""
        await self._done(self._action.arm(), "arming")
        await self.until(lambda: self.state.armed, ARM_TIMEOUT_S, lambda: "armed")

    async def take_off(self, altitude_m: float) -> None:
        """Take off, and wait until the vehicle hovers at ``altitude_m`` above the origin."""
        await self._done(self._action.set_takeoff_altitude(altitude_m), "take-off altitude")
        await self._done(self._action.takeoff(), "taking off")
        await self.until(
            lambda: self.state.in_air and self._hovers_at(altitude_m),
            TAKE_OFF_TIMEOUT_S + TAKE_OFF_TIMEOUT_S_PER_M * altitude_m,
            lambda: (
                f"hovering at {altitude_m:g} m (now {-self.state.position_ned_m[2]:.2f} m, "
                f"{self.state.speed_mps:.2f} m/s)"
            ),
        )

    @property
    def at_rest(self) -> bool:
        """Whether the vehicle has stood still for a second, as far as its estimate can tell."""
        return self._rest.at_rest

    async def hand_over(self) -> None:
        """Switch to OFFBOARD (ArduPilot: GUIDED), where the daemon's setpoints fly the vehicle.

        Autopilots reject the mode until setpoints have arrived for a while, so it is asked for
        again until `MODE_TIMEOUT_S` has passed.
        """
        main, sub = _OFFBOARD.get(self.autopilot, _OFFBOARD[Autopilot.PX4])
        result, deadline_s = None, asyncio.get_running_loop().time() + MODE_TIMEOUT_S
        while result != _MAV_RESULT_ACCEPTED:
            if asyncio.get_running_loop().time() > deadline_s:
                raise VehicleError(f"OFFBOARD: refused by the vehicle (MAV_RESULT {result})")
            result = await self._command(_MAV_CMD_DO_SET_MODE, (_CUSTOM_MODE_ARMED, main, sub))
            self._interruption.check()
            await asyncio.sleep(_RETRY_S if result != _MAV_RESULT_ACCEPTED else 0.0)
        await self.until(
            lambda: self.state.mode is FlightMode.OFFBOARD, MODE_TIMEOUT_S, lambda: "in OFFBOARD"
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
        # ArduPilot climbs in GUIDED: the daemon flies on as soon as it has climbed.
        guided = self.autopilot is Autopilot.ARDUPILOT
        return near and (guided or self.at_rest)

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
