"""One simulated vehicle in virtual time: plant, controller, autopilot, battery and wind."""

from __future__ import annotations

import functools
import math
import random

from sitl.autopilot.decisions import Actuation, Drive
from sitl.autopilot.modes import Mode
from sitl.autopilot.settings import FlightSettings
from sitl.config import StartConfig, VehicleConfig
from sitl.plant.battery import Battery
from sitl.plant.controller import ControllerGains
from sitl.plant.inner_loop import ACCELERATION, MEMORY, STATE, UNTRIMMED, Flight, fly, spin
from sitl.plant.kinematic import follow
from sitl.plant.multirotor import (
    GRAVITY_MPS2,
    RotorSpeeds,
    Wind,
    hover_speed_rpm,
    rotate_frd_from_ned,
    standing_state,
)
from sitl.plant.setpoint import Setpoint, ahead
from sitl.plant.truth import VehicleTruth
from sitl.plant.wind import Gust, WindModel
from sitl.vehicle.autopilot import Autopilot

TICK_RATE_HZ = 100
_TICK_S = 1.0 / TICK_RATE_HZ
_TICKS_PER_BATTERY = 20  # charge changes slowly


class SimulatedVehicle:
    """A vehicle that is commanded over MAVLink; time advances only by `advance` and `fly_on`.

    Attributes:
        truth: true state at the current instant.
        autopilot: commander, parameters and estimator.
        velocity_error_ned_mps: horizontal, of the kinematic plant.
    """

    def __init__(
        self,
        config: VehicleConfig,
        seed: int = 0,
        start_unix_s: float = 0.0,
        ticks_per_decision: int = 1,
    ) -> None:
        """Put the vehicle at its start.

        Args:
            config: body, autopilot and surroundings.
            seed: of everything random about the vehicle.
            start_unix_s: time of day at simulation time zero.
            ticks_per_decision: the autopilot decides, and sends telemetry, every so many ticks of
                10 ms; in between the controller follows the setpoint's own motion.

        Raises:
            ParameterError: a configured autopilot parameter does not exist or is out of range.
        """
        self._parameters = config.multirotor.parameters()
        self._step_s = 1.0 / config.physics_rate_hz
        self._steps_per_tick = config.physics_rate_hz // TICK_RATE_HZ
        self._ticks_per_decision = ticks_per_decision
        self._ticks = self._drained_ticks = 0
        north_m, east_m, down_m = config.start.position_ned_m
        self._flight = Flight.of(
            standing_state(
                north_m,
                east_m,
                down_m,
                math.radians(config.start.yaw_deg),
                hover_speed_rpm(self._parameters) if down_m < 0.0 else 0.0,
            )
        )
        self._battery = Battery(config.battery)
        self._pinned_m = (0.0, 0.0)
        self._kinematic = config.tracking.kinematic
        self.velocity_error_ned_mps = (0.0, 0.0)
        self._wind_model = WindModel(config.wind, random.Random(f"{seed} wind"))
        self.truth = self._observe()
        self.autopilot = Autopilot(config, self.truth, self._battery.reading, start_unix_s, seed)
        self._actuation = Actuation(Drive.OFF)
        self._settings: FlightSettings | None = None
        self._controller_gains = ControllerGains()

    def receive(self, data: bytes, link: int = 0) -> None:
        """Take MAVLink bytes that arrive on a link now."""
        self.autopilot.receive(data, link, self.truth.time_s)

    def bytes_to_send(self, link: int = 0) -> bytes:
        """Return and clear the MAVLink bytes queued for a link."""
        return self.autopilot.bytes_to_send(link)

    def advance(self, until_s: float) -> None:
        """Fly on in whole ticks of 10 ms, as far as they fit before ``until_s``."""
        while self.fly_on(until_s):
            pass

    def fly_on(self, until_s: float, pause_s: float = math.inf) -> bool:
        """Fly on in whole ticks of 10 ms, to the autopilot's next decision at most.

        Args:
            until_s: not beyond this.
            pause_s: not beyond the first tick from this on.

        Returns:
            Whether there was time to.
        """
        ticks = min(
            math.floor(until_s * TICK_RATE_HZ + 1e-6) - self._ticks,
            self._ticks_per_decision - self._ticks_since_decision,
        )
        if pause_s < (self._ticks + ticks) * _TICK_S:
            # At least one: what round-off keeps from happening in this tick happens in the next.
            ticks = min(ticks, max(math.ceil(pause_s * TICK_RATE_HZ - 1e-7) - self._ticks, 1))
        if ticks > 0:
            self._fly(ticks)
        return ticks > 0

    def pin_tracking_error(self, north_m: float, east_m: float) -> None:
        """Put the vehicle this far from where a setpoint wants it at this instant.

        The controller does not see the error, and so does not correct it.
        """
        self._pinned_m = (north_m, east_m)
        setpoint = self._actuation.setpoint
        followed = self.autopilot.commander.mode is Mode.OFFBOARD
        if setpoint is None or not followed or math.isnan(setpoint.north_m + setpoint.east_m):
            return
        ticks = self._ticks_since_decision or self._ticks_per_decision
        wanted = ahead(setpoint, ticks * _TICK_S)
        place_m = (wanted.north_m + north_m, wanted.east_m + east_m)
        self._flight = Flight((*place_m, *self._flight.values[2:]))
        self.truth = self._observe()

    @property
    def wanted_velocity_ned_mps(self) -> tuple[float, float]:
        """Horizontal velocity that the setpoint wants now; 0 where it wants none."""
        setpoint = self._actuation.setpoint
        if setpoint is None:
            return 0.0, 0.0
        ticks = self._ticks_since_decision or self._ticks_per_decision
        wanted = ahead(setpoint, ticks * _TICK_S)
        north_mps, east_mps = wanted.velocity_north_mps, wanted.velocity_east_mps
        return (0.0, 0.0) if math.isnan(north_mps + east_mps) else (north_mps, east_mps)

    def add_gust(self, gust: Gust) -> None:
        """Add one gust."""
        self._wind_model.add(gust)

    def _fly(self, ticks: int) -> None:
        if self._ticks_since_decision == 0:
            self._actuation = self.autopilot.step(
                self.truth,
                self._battery.reading,
                self._thrust_share(),
                self._ticks_per_decision * _TICK_S,
            )
        wind = self._wind_model.sample(
            self.truth.time_s,
            ticks * _TICK_S,
            -self.truth.position_ned_m[2],
            self.truth.velocity_ned_mps,
        )
        self._flight = self._moved(self._actuation, wind, ticks * self._steps_per_tick)
        self._ticks += ticks
        if self._ticks >= self._drained_ticks + _TICKS_PER_BATTERY:
            power_w = self._battery.drive_power_w(self._flight.state, self._parameters)
            self._battery.drain(power_w, (self._ticks - self._drained_ticks) * _TICK_S)
            self._drained_ticks = self._ticks
        self.truth = self._observe()

    @property
    def estimate(self) -> VehicleTruth:
        """The autopilot's estimate at the current instant."""
        return self.autopilot.estimator.estimate(self.truth)

    @property
    def _lost(self) -> bool:
        """Whether the autopilot flies without a valid position."""
        commander = self.autopilot.commander
        return self.autopilot.realism.levels_when_lost and not commander.position_valid

    @property
    def _ticks_since_decision(self) -> int:
        return self._ticks % self._ticks_per_decision

    def _moved(self, actuation: Actuation, wind: Wind, steps: int) -> Flight:
        """Fly some steps of plant and controller."""
        state, memory = self._flight.values[STATE], self._flight.values[MEMORY]
        if self.autopilot.commander.on_ground or self._lost or _is_open_loop(actuation.setpoint):
            memory = UNTRIMMED  # the ground's support must not be trimmed out
        if actuation.drive is Drive.FLY and actuation.setpoint is not None:
            if self._kinematic:
                return follow(
                    self._flight,
                    self._with_position(actuation.setpoint),
                    self._ticks_since_decision * _TICK_S,
                    steps * self._step_s,
                    self.velocity_error_ned_mps,
                )
            return fly(
                state,
                memory,
                self._with_position(actuation.setpoint),
                self._gains(),
                self._parameters,
                self.autopilot.commander.failures.rotor_shares,
                wind,
                self._step_s,
                steps,
                self._ticks_since_decision * _TICK_S,
                self.autopilot.estimator.error,
            )
        # Idle rotors that have failed stand still, which makes no difference on the ground.
        idle_rpm = self._parameters.rotor_speed_min_rpm if actuation.drive is Drive.IDLE else 0.0
        command = RotorSpeeds(idle_rpm, idle_rpm, idle_rpm, idle_rpm)
        return spin(state, command, self._parameters, wind, self._step_s, steps)

    def _with_position(self, setpoint: Setpoint) -> Setpoint:
        """Return the part of a setpoint that can be flown: without a position, heights only."""
        if not self._lost:
            north_m, east_m = self._pinned_m
            if self.autopilot.commander.mode is not Mode.OFFBOARD or not (north_m or east_m):
                return setpoint
            return setpoint._replace(
                north_m=setpoint.north_m + north_m, east_m=setpoint.east_m + east_m
            )
        nan = math.nan
        return setpoint._replace(
            north_m=nan,
            east_m=nan,
            velocity_north_mps=nan,
            velocity_east_mps=nan,
            acceleration_north_mps2=0.0,
            acceleration_east_mps2=0.0,
            jerk_north_mps3=0.0,
            jerk_east_mps3=0.0,
        )

    def _gains(self) -> ControllerGains:
        """Controller gains and limits of the autopilot's settings."""
        settings = self.autopilot.commander.settings
        if settings is not self._settings:
            self._settings, realism = settings, self.autopilot.realism
            self._controller_gains = ControllerGains(
                roll_per_s=settings.roll_gain_per_s,
                pitch_per_s=settings.pitch_gain_per_s,
                position_per_s=settings.position_gain_per_s,
                velocity_per_s=settings.velocity_gain_per_s,
                jerk_share=realism.jerk_share,
                drag_share=realism.drag_share,
                trim_time_s=realism.trim_time_s,
                rate_per_s=realism.rate_per_s,
                tilt_max_rad=settings.tilt_max_rad,
                body_rate_max_radps=settings.body_rate_max_radps,
                speed_max_mps=settings.speed_max_mps,
                climb_max_mps=settings.climb_max_mps,
                sink_max_mps=settings.sink_max_mps,
            )
        return self._controller_gains

    def _thrust_share(self) -> float:
        first, second, third, fourth = self.truth.rotor_speeds_rpm
        squares = first * first + second * second + third * third + fourth * fourth
        thrust_n = self._parameters.thrust_coefficient_n_per_rpm2 * squares
        return thrust_n / (self._parameters.mass_kg * GRAVITY_MPS2)

    def _observe(self) -> VehicleTruth:
        values = self._flight.values
        n, e, d, vn, ve, vd, w, x, y, z, p, q, r, *rotors_rpm = values[STATE]
        front_right_rpm, rear_left_rpm, front_left_rpm, rear_right_rpm = rotors_rpm
        an, ae, ad = values[ACCELERATION]
        return VehicleTruth(
            time_s=self._ticks * _TICK_S,
            position_ned_m=(n, e, d),
            velocity_ned_mps=(vn, ve, vd),
            acceleration_ned_mps2=(an, ae, ad),
            attitude_quaternion=(w, x, y, z),
            body_rates_radps=(p, q, r),
            rotor_speeds_rpm=(front_right_rpm, rear_left_rpm, front_left_rpm, rear_right_rpm),
        )


@functools.cache
def warm_up() -> None:
    """Load the compiled inner loop, or compile it, so that no vehicle stalls in mid-air.

    Costs seconds once after installation, a fraction of a second later, nothing without Numba.
    """
    for down_m in (0.0, -1.0):
        start = StartConfig(position_ned_m=(0.0, 0.0, down_m))
        SimulatedVehicle(VehicleConfig(start=start)).advance(2.0 * _TICK_S)
    rotate_frd_from_ned(1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def _is_open_loop(setpoint: Setpoint | None) -> bool:
    """Whether neither place nor velocity is controlled: then PX4 trims nothing out, either."""
    if setpoint is None:
        return False
    return math.isnan(setpoint.north_m) and math.isnan(setpoint.velocity_north_mps)
