"""The autopilot's decisions: arming, modes, failsafes, and the setpoint that follows from them.

What PX4 and ArduPilot have in common; ``px4_commander`` and ``ardupilot_commander`` differ from it.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Any, ClassVar

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.arming import Arming, PrearmInputs, prearm_failures
from sitl.autopilot.auto_flight import AutoFlight
from sitl.autopilot.decisions import Actuation, Drive, Verdict
from sitl.autopilot.failsafes import MODE_OF_REACTION, FailsafeInputs, Failsafes
from sitl.autopilot.failures import Failures
from sitl.autopilot.land_detector import LandDetector
from sitl.autopilot.manual_control import ManualControl
from sitl.autopilot.mission import MissionStore
from sitl.autopilot.modes import LandedState, Mode
from sitl.autopilot.plan.fence import FenceStore
from sitl.autopilot.plan.rally import RallyStore
from sitl.autopilot.settings import FlightSettings, Reaction
from sitl.config import HomeConfig
from sitl.plant.battery import BatteryReading
from sitl.plant.estimator import Estimator
from sitl.plant.setpoint import Setpoint
from sitl.plant.truth import Vector, VehicleTruth

_ESTIMATOR_START_S = 1.0
_HEIGHT_MAX_M = 10_000.0
_CHECK_PERIOD_S = 0.1  # between two checks of the failsafes


class Commander(ABC):
    """Modes, arming and failsafes of one vehicle.

    Attributes:
        refusal: result of a request that cannot be met now.
        position_lost_texts: (MAV_SEVERITY, text), gravest last, when the position is lost.
        settings: meaning of the parameters; replaced when one of them changes.
        mode: the mode flown, as HEARTBEAT shows it.
        failsafe: whether a failsafe chose the mode.
        mission: the items on board.
        fence, rally: the other places on board.
        failures: which failures are present.
        sticks: the pilot's manual control.
        announcements: (MAV_SEVERITY, text) not yet sent to the operators.
    """

    refusal: ClassVar[Verdict]
    first_mode: ClassVar[Mode]
    position_lost_texts: ClassVar[tuple[tuple[int, str], ...]] = (
        (mavlink.MAV_SEVERITY_CRITICAL, "Position estimate lost: descending"),
    )

    def __init__(
        self,
        settings: FlightSettings,
        truth: VehicleTruth,
        origin: HomeConfig,
        estimator: Estimator,
        first_item: int,
    ) -> None:
        on_ground = truth.position_ned_m[2] >= 0.0
        self.settings = settings
        self.mode = self.first_mode if on_ground else Mode.HOLD
        self.failsafe = False
        self.mission = MissionStore(origin, first_item)
        self.failures = Failures()
        self._estimator = estimator
        self.sticks = ManualControl()
        self.announcements: list[tuple[int, str]] = []
        self.fence, self.rally = FenceStore(origin), RallyStore(origin)
        self._auto = AutoFlight(settings, truth, self.mission, self.rally)
        self._failsafes = Failsafes()
        self._truth = truth
        self._battery_remaining = 1.0
        self._ground_heard_s = -math.inf
        self._land_detector = LandDetector(on_ground=on_ground, down_m=truth.position_ned_m[2])
        self._setpoint: Setpoint | None = None
        self._arming = Arming(on_ground=on_ground)
        self._checked_s = -math.inf

    @property
    def armed(self) -> bool:
        """Whether the rotors may turn."""
        return self._arming.armed

    @property
    def landed_state(self) -> LandedState:
        """Where the vehicle is between ground and air."""
        if self.on_ground:
            starting = self._setpoint is not None and self.armed
            return LandedState.TAKEOFF if starting else LandedState.ON_GROUND
        if self.mode is Mode.TAKEOFF:
            return LandedState.TAKEOFF
        landing = self.mode is Mode.LAND or self._auto.landing
        return LandedState.LANDING if landing else LandedState.IN_AIR

    @property
    def intention(self) -> Mode:
        """The mode that the user asked for."""
        return self.mode

    @property
    def on_ground(self) -> bool:
        """Whether the vehicle stands, according to the land detector."""
        return self._land_detector.on_ground

    @property
    def airborne(self) -> bool:
        """Whether the vehicle flies."""
        return self.armed and not self.on_ground

    @property
    def setpoint(self) -> Setpoint | None:
        """What the controller flies now; None while it does not."""
        return self._setpoint

    @property
    def home_ned_m(self) -> Vector:
        """Where return goes; set on arming."""
        return self._auto.home_ned_m

    @home_ned_m.setter
    def home_ned_m(self, position_ned_m: Vector) -> None:
        self._auto.home_ned_m = position_ned_m

    @property
    def estimator_ready(self) -> bool:
        """Whether position and attitude are known."""
        started = self._truth.time_s >= _ESTIMATOR_START_S or self.armed
        return started and self.position_valid

    @property
    def position_valid(self) -> bool:
        """Whether the estimate of the position is still valid."""
        return self._estimator.position_valid

    def prearm_failures(self) -> list[str]:
        """Reasons not to arm now; empty if there are none."""
        return prearm_failures(
            PrearmInputs(
                estimator_ready=self.estimator_ready,
                sensor_failed=bool(self.failures.failed_sensors),
                tilt_rad=self._truth.tilt_rad,
                battery_remaining=self._battery_remaining,
                battery_critical=self.settings.battery_critical,
            )
        )

    def arm(self, *, force: bool) -> Verdict:
        """Arm; ``force`` skips the checks."""
        if self.armed:
            return Verdict.ACCEPTED
        failures = [] if force else self.prearm_failures()
        if failures:
            self.say(mavlink.MAV_SEVERITY_CRITICAL, f"Arming denied: {', '.join(failures)}")
            return self.refusal
        self._arming.arm(self._truth.time_s)
        self._auto.home_ned_m = self._truth.position_ned_m
        self._auto.restart(self._truth)
        self.say(mavlink.MAV_SEVERITY_INFO, "Armed")
        return Verdict.ACCEPTED

    def disarm(self, *, force: bool, reason: str = "by command") -> Verdict:
        """Disarm on the ground; in flight only by ``force``."""
        if self.airborne and not force:
            self.say(mavlink.MAV_SEVERITY_CRITICAL, "Disarming denied: not landed")
            return self.refusal
        if self.armed:
            self._disarm(reason)
        return Verdict.ACCEPTED

    def set_mode(self, mode: Mode) -> Verdict:
        """Change the mode on the user's behalf."""
        refusal = "Mode rejected" if self.failures.modes_refused else self._mode_refusal(mode)
        if refusal is not None:
            self.say(mavlink.MAV_SEVERITY_CRITICAL, refusal)
            return self.refusal
        self._choose(mode)
        return Verdict.ACCEPTED

    def take_off(self, height_m: float | None) -> Verdict:
        """Climb to ``height_m`` above here, by default the take-off parameter's."""
        if not self.on_ground:
            return self.refusal
        height_m = self.settings.take_off_height_m if height_m is None else height_m
        if not 0.0 < height_m <= _HEIGHT_MAX_M:
            return Verdict.DENIED
        north_m, east_m, down_m = self._truth.position_ned_m
        self._choose(Mode.TAKEOFF)
        self._auto.target_ned_m = (north_m, east_m, down_m - height_m)
        return Verdict.ACCEPTED

    def go_to(self, target_ned_m: Vector, yaw_rad: float, speed_mps: float | None) -> Verdict:
        """Fly to a position; a NaN yaw keeps the heading."""
        if not self.airborne:
            return self.refusal
        if not 0.0 <= -target_ned_m[2] <= _HEIGHT_MAX_M:
            return Verdict.DENIED
        self._choose(self._go_to_mode)
        self._auto.target_ned_m = target_ned_m
        if math.isfinite(yaw_rad):
            self._auto.reference.yaw_rad = yaw_rad
        if speed_mps is not None:
            self._auto.cruise_speed_mps = speed_mps
        return Verdict.ACCEPTED

    def set_speed(self, speed_mps: float) -> Verdict:
        """Change the autonomous speed until the next mode change."""
        if not 0.0 < speed_mps <= self.settings.speed_max_mps:
            return Verdict.DENIED
        self._auto.cruise_speed_mps = speed_mps
        return Verdict.ACCEPTED

    def start_mission(self, first_item: int) -> Verdict:
        """Fly the mission from an item on."""
        if not self.mission.select(first_item):
            return Verdict.DENIED
        return self.set_mode(Mode.MISSION)

    @abstractmethod
    def receive_setpoint(self, message: Any, now_s: float) -> None:
        """Take a setpoint addressed to this vehicle: position, velocity, ... or an attitude."""

    def receive_sticks(self, message: Any, now_s: float) -> None:
        """Take a MANUAL_CONTROL."""
        if self.settings.manual_allowed and not self.failures.sticks_cut:
            self.sticks.receive(message, now_s)

    def hear_ground_station(self, now_s: float) -> None:
        """Note a ground station's heartbeat."""
        self._ground_heard_s = now_s

    def say(self, severity: int, text: str) -> None:
        """Queue a text for the operators."""
        self.announcements.append((severity, text))

    def update(
        self, truth: VehicleTruth, battery: BatteryReading, thrust_share: float, period_s: float
    ) -> Actuation:
        """Decide for the next period; called at the autopilot's own rate.

        Args:
            truth: the estimated state.
            battery: reading of the pack.
            thrust_share: rotor thrust over weight.
            period_s: time until the next call.
        """
        self._truth = truth
        self._auto.settings = self.settings
        self._battery_remaining = battery.remaining
        was_on_ground = self.on_ground
        self._land_detector.update(
            truth, self._setpoint, thrust_share, position_valid=self.position_valid
        )
        on_ground = self.on_ground
        if self.armed:
            if on_ground is not was_on_ground:
                self._note_landing(on_ground=on_ground)
            self._check_setpoints()
            if truth.time_s - self._checked_s >= _CHECK_PERIOD_S - 1e-9:
                self._checked_s = truth.time_s
                self._check_failsafes()
            if on_ground:
                self._disarm_when_due()
        if not self.armed:
            self._setpoint = None
            return Actuation(Drive.OFF)
        wanted = self._wanted(period_s)
        if on_ground and not self._leaves_ground(wanted):
            self._setpoint = None
            self._auto.restart(truth)
            return Actuation(Drive.IDLE)
        self._setpoint = wanted
        return Actuation(Drive.FLY, wanted)

    def _leaves_ground(self, wanted: Setpoint) -> bool:
        if self.mode is Mode.OFFBOARD:
            return self._setpoints_lift(wanted)
        if self.mode is Mode.MISSION:
            return not (self._auto.landing or self.mission.finished)
        if self.mode.needs_sticks:
            return self.sticks_alive and self.sticks.climbs
        return self.mode is Mode.TAKEOFF

    def _wanted(self, period_s: float) -> Setpoint:
        if self.mode is Mode.OFFBOARD:
            return self._follow_setpoints(period_s)
        if not self.mode.needs_sticks:
            following = self._auto.fly(self.mode, self._truth, period_s)
            if following is not None:
                self._continue_with(following)
        elif self.sticks_alive:
            self._auto.follow_sticks(self.sticks, period_s)
        else:
            self._auto.sink()
        return self._auto.setpoint()

    @property
    def sticks_alive(self) -> bool:
        """Whether a pilot's manual control is present."""
        return self.sticks.age_s(self._truth.time_s) <= self.settings.manual_timeout_s

    @property
    @abstractmethod
    def _go_to_mode(self) -> Mode:
        """Mode that flies to a commanded position."""

    @abstractmethod
    def _mode_refusal(self, mode: Mode) -> str | None:
        """Why the user may not have this mode now; None if they may."""

    @abstractmethod
    def _check_setpoints(self) -> None:
        """React to a setpoint stream that has ended or returned."""

    @abstractmethod
    def _follow_setpoints(self, period_s: float, /) -> Setpoint:
        """What to fly in OFFBOARD for the next period."""

    @abstractmethod
    def _setpoints_lift(self, wanted: Setpoint, /) -> bool:
        """Whether a setpoint takes a standing vehicle off the ground."""

    def _check_failsafes(self) -> None:
        if self.failures.attitude_lost:
            self._disarm("attitude lost")
            return
        now_s, settings = self._truth.time_s, self.settings
        self.fence.watch(self._truth.position_ned_m, self.home_ned_m, settings)
        inputs = FailsafeInputs(
            battery_remaining=self._battery_remaining,
            ground_silence_s=now_s - self._ground_heard_s,
            sticks_silence_s=self.sticks.age_s(now_s),
            sticks_needed=self.mode.needs_sticks,
            position_valid=self.position_valid,
            fence_breached=self.fence.breached,
        )
        for trigger in self._failsafes.check(inputs, settings):
            own = ((trigger.severity, trigger.text),)
            self.announcements.extend(own if trigger.text else self.position_lost_texts)
            self.react(trigger.reaction)

    def react(self, reaction: Reaction) -> None:
        """Carry out the reaction of a failsafe; never replace a landing by a milder reaction."""
        if reaction is Reaction.DISARM:
            self._disarm("failsafe")
        elif reaction is not Reaction.NONE and self.mode is not Mode.LAND:
            self._enter(MODE_OF_REACTION[reaction], failsafe=True)

    def _note_landing(self, *, on_ground: bool) -> None:
        """Announce a landing or a take-off."""
        if on_ground:
            self.say(mavlink.MAV_SEVERITY_INFO, "Landing detected")
            if self.mode is Mode.MISSION and self._auto.landing:
                self.mission.item_done()
        else:
            self._arming.note_take_off()
            self.say(mavlink.MAV_SEVERITY_INFO, "Takeoff detected")

    def _disarm_when_due(self) -> None:
        if not self.armed or self._setpoint is not None:
            return
        reason = self._arming.reason_to_disarm(
            self._truth.time_s, self._land_detector.since_s, self.settings
        )
        if reason is not None:
            self._disarm(reason)

    def _disarm(self, reason: str) -> None:
        self._arming.disarm()
        self._setpoint = None
        self.say(mavlink.MAV_SEVERITY_INFO, f"Disarmed: {reason}")

    def _choose(self, mode: Mode) -> None:
        """Enter a mode on the user's behalf."""
        self._enter(mode, failsafe=False)

    def _continue_with(self, mode: Mode) -> None:
        """Enter the mode that follows one that is done, and stay on its target."""
        target_ned_m = self._auto.target_ned_m
        climbed = self.mode is Mode.TAKEOFF
        self._enter(mode, failsafe=self.failsafe)
        if climbed:
            self._auto.target_ned_m = target_ned_m

    def _enter(self, mode: Mode, *, failsafe: bool) -> None:
        if Mode.OFFBOARD in (mode, self.mode):  # in OFFBOARD the reference does not lead
            self._auto.restart(self._truth)
        if mode is not self.mode:
            self._auto.cruise_speed_mps = None
        self.mode = mode
        self.failsafe = failsafe
        self._auto.begin(mode, self._truth)
