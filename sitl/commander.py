"""The autopilot's decisions: arming, modes, failsafes, and the setpoint that follows from them.

PX4's split between what the user intends and what is flown: after the loss of the offboard stream
the intention stays OFFBOARD while another mode is flown, and offboard resumes by itself when the
stream does.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.battery import BatteryReading
from sitl.controller import Setpoint
from sitl.land_detector import LandDetector, climbs
from sitl.modes import LandedState, Mode
from sitl.navigator import MotionLimits, MotionReference
from sitl.offboard import OffboardStream
from sitl.parameters import ParameterStore
from sitl.truth import Vector, VehicleTruth

_ESTIMATOR_START_S = 1.0
_STREAM_RETURN_S = 0.25  # an unbroken stream this long ends the offboard-loss failsafe
_ARMING_TILT_MAX_RAD = math.radians(30.0)
_LANDING_NEAR_GROUND_M = 5.0
_HEIGHT_MAX_M = 10_000.0


class Drive(enum.Enum):
    """What the rotors do."""

    OFF = enum.auto()
    IDLE = enum.auto()
    FLY = enum.auto()


@dataclass(frozen=True)
class Actuation:
    """What the controller is to do until the next decision; ``setpoint`` is there to FLY."""

    drive: Drive
    setpoint: Setpoint | None = None


class Verdict(enum.IntEnum):
    """Answer to a request, as MAV_RESULT."""

    ACCEPTED = mavlink.MAV_RESULT_ACCEPTED
    TEMPORARILY_REJECTED = mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    DENIED = mavlink.MAV_RESULT_DENIED
    UNSUPPORTED = mavlink.MAV_RESULT_UNSUPPORTED


class Commander:
    """Modes, arming and failsafes of one vehicle.

    Attributes:
        armed: whether the rotors may turn.
        mode: the mode flown, as HEARTBEAT shows it.
        failsafe: whether a failsafe chose the mode.
        offboard: the setpoint stream.
        home_ned_m: where return goes; set on arming.
        announcements: (MAV_SEVERITY, text) not yet told to the operators.
    """

    def __init__(self, parameters: ParameterStore, truth: VehicleTruth) -> None:
        on_ground = truth.position_ned_m[2] >= 0.0
        self.armed = not on_ground
        self.mode = Mode.HOLD
        self.failsafe = False
        self.offboard = OffboardStream()
        self.home_ned_m: Vector = (truth.position_ned_m[0], truth.position_ned_m[1], 0.0)
        self.announcements: list[tuple[int, str]] = []
        self._parameters = parameters
        self._intention = Mode.HOLD
        self._truth = truth
        self._battery_remaining = 1.0
        self._land_detector = LandDetector(on_ground=on_ground, down_m=truth.position_ned_m[2])
        self._reference = MotionReference(truth)
        self._setpoint: Setpoint | None = None
        self._target_ned_m: Vector | None = None
        self._cruise_speed_mps: float | None = None
        self._armed_since_s = 0.0
        self._has_flown = not on_ground
        self._sinks_without_pilot = False
        self._battery_warned = False

    # --- what others may know -------------------------------------------------------------

    @property
    def landed_state(self) -> LandedState:
        """Where the vehicle is between ground and air."""
        if self.on_ground:
            starting = self._setpoint is not None and self.armed
            return LandedState.TAKEOFF if starting else LandedState.ON_GROUND
        if self.mode is Mode.TAKEOFF:
            return LandedState.TAKEOFF
        return LandedState.LANDING if self.mode is Mode.LAND else LandedState.IN_AIR

    @property
    def on_ground(self) -> bool:
        """Whether the vehicle stands, as far as the land detector can tell."""
        return self._land_detector.on_ground

    @property
    def setpoint(self) -> Setpoint | None:
        """What the controller flies now; None while it does not."""
        return self._setpoint

    @property
    def estimator_ready(self) -> bool:
        """Whether position and attitude are known."""
        return self._truth.time_s >= _ESTIMATOR_START_S or self.armed

    def prearm_failures(self) -> list[str]:
        """Reasons not to arm now; empty if there are none."""
        failures = []
        if not self.estimator_ready:
            failures.append("estimator not ready")
        if self._truth.tilt_rad > _ARMING_TILT_MAX_RAD:
            failures.append("vehicle not level")
        if self._battery_remaining < self._parameters["BAT_CRIT_THR"]:
            failures.append("battery too low")
        if self._intention is Mode.OFFBOARD and not self._offboard_alive():
            failures.append("no offboard signal")
        return failures

    # --- requests -------------------------------------------------------------------------

    def arm(self, *, force: bool) -> Verdict:
        """Arm; ``force`` skips the checks."""
        if self.armed:
            return Verdict.ACCEPTED
        failures = [] if force else self.prearm_failures()
        if failures:
            self._say(mavlink.MAV_SEVERITY_CRITICAL, f"Arming denied: {', '.join(failures)}")
            return Verdict.TEMPORARILY_REJECTED
        self.armed = True
        self._armed_since_s = self._truth.time_s
        self._has_flown = False
        self.home_ned_m = self._truth.position_ned_m
        self._reference = MotionReference(self._truth)
        self._say(mavlink.MAV_SEVERITY_INFO, "Armed")
        return Verdict.ACCEPTED

    def disarm(self, *, force: bool) -> Verdict:
        """Disarm on the ground; in flight only by ``force``."""
        if self.armed and not force and not self.on_ground:
            self._say(mavlink.MAV_SEVERITY_CRITICAL, "Disarming denied: not landed")
            return Verdict.TEMPORARILY_REJECTED
        if self.armed:
            self._disarm("by command")
        return Verdict.ACCEPTED

    def set_mode(self, mode: Mode) -> Verdict:
        """Change the mode on the user's behalf."""
        if mode.needs_sticks:
            self._say(mavlink.MAV_SEVERITY_CRITICAL, f"{mode.name} needs manual control")
            return Verdict.TEMPORARILY_REJECTED
        if mode is Mode.MISSION:
            self._say(mavlink.MAV_SEVERITY_CRITICAL, "No valid mission available")
            return Verdict.TEMPORARILY_REJECTED
        airborne = self.armed and not self.on_ground
        if mode is Mode.OFFBOARD and airborne and not self._offboard_alive():
            self._say(mavlink.MAV_SEVERITY_CRITICAL, "OFFBOARD denied: no offboard signal")
            return Verdict.TEMPORARILY_REJECTED
        if mode is Mode.TAKEOFF:
            return self.take_off(None)
        self._intention = mode
        self._enter(mode, failsafe=False)
        return Verdict.ACCEPTED

    def take_off(self, altitude_m: float | None) -> Verdict:
        """Climb to ``altitude_m`` above here, by default MIS_TAKEOFF_ALT; needs arming too."""
        if not self.on_ground:
            return Verdict.TEMPORARILY_REJECTED
        height_m = self._parameters["MIS_TAKEOFF_ALT"] if altitude_m is None else altitude_m
        if not 0.0 < height_m <= _HEIGHT_MAX_M:
            return Verdict.DENIED
        north_m, east_m, down_m = self._truth.position_ned_m
        self._intention = Mode.TAKEOFF
        self._enter(Mode.TAKEOFF, failsafe=False)
        self._target_ned_m = (north_m, east_m, down_m - height_m)
        return Verdict.ACCEPTED

    def go_to(self, target_ned_m: Vector, yaw_rad: float, speed_mps: float | None) -> Verdict:
        """Fly to a position in hold; a yaw that is no number keeps the heading."""
        if not self.armed or self.on_ground:
            return Verdict.TEMPORARILY_REJECTED
        if not 0.0 <= -target_ned_m[2] <= _HEIGHT_MAX_M:
            return Verdict.DENIED
        self._intention = Mode.HOLD
        self._enter(Mode.HOLD, failsafe=False)
        self._target_ned_m = target_ned_m
        if math.isfinite(yaw_rad):
            self._reference.yaw_rad = yaw_rad
        if speed_mps is not None:
            self._cruise_speed_mps = speed_mps
        return Verdict.ACCEPTED

    def set_speed(self, speed_mps: float) -> Verdict:
        """Change the autonomous speed until the next mode change."""
        if not 0.0 < speed_mps <= self._parameters["MPC_XY_VEL_MAX"]:
            return Verdict.DENIED
        self._cruise_speed_mps = speed_mps
        return Verdict.ACCEPTED

    def terminate(self) -> Verdict:
        """Stop the rotors at once, wherever the vehicle is."""
        if self.armed:
            self._disarm("flight terminated")
        return Verdict.ACCEPTED

    # --- the tick -------------------------------------------------------------------------

    def update(
        self, truth: VehicleTruth, battery: BatteryReading, thrust_share: float, period_s: float
    ) -> Actuation:
        """Decide for the next period; called at the autopilot's own rate."""
        self._truth = truth
        self._battery_remaining = battery.remaining
        was_on_ground = self.on_ground
        self._land_detector.update(truth, self._setpoint, thrust_share)
        if self.armed:
            self._note_landing(was_on_ground)
            self._check_offboard()
            self._check_battery()
            self._disarm_when_due()
        if not self.armed:
            self._setpoint = None
            return Actuation(Drive.OFF)
        wanted = self._wanted(period_s)
        if self.on_ground and not self._leaves_ground(wanted):
            self._setpoint = None
            self._reference = MotionReference(truth)
            return Actuation(Drive.IDLE)
        self._setpoint = wanted
        return Actuation(Drive.FLY, wanted)

    def _leaves_ground(self, wanted: Setpoint) -> bool:
        if self.mode is Mode.OFFBOARD:
            return climbs(wanted, self._truth)
        return self.mode is Mode.TAKEOFF

    def _wanted(self, period_s: float) -> Setpoint:
        if self.mode is Mode.OFFBOARD:
            return self.offboard.setpoint(self._truth.time_s, self._reference.yaw_rad)
        self._steer_reference(period_s)
        return self._reference.setpoint()

    def _steer_reference(self, period_s: float) -> None:
        reference, limits = self._reference, self._limits()
        match self.mode:
            case Mode.TAKEOFF if self._target_ned_m is not None:
                target_ned_m = self._target_ned_m
                self._go_to(target_ned_m, "MPC_TKO_SPEED", period_s)
                if reference.is_at(target_ned_m):
                    self._intention = Mode.HOLD
                    self._enter(Mode.HOLD, failsafe=False)
                    self._target_ned_m = target_ned_m
            case Mode.LAND:
                reference.steer((0.0, 0.0, self._landing_speed_mps()), limits, period_s)
            case Mode.RTL:
                self._return_home(period_s)
            case Mode.POSCTL if self._sinks_without_pilot:
                sink_mps = self._parameters["MPC_LAND_SPEED"]
                reference.steer((0.0, 0.0, sink_mps), limits, period_s)
            case _ if self._target_ned_m is not None:
                self._go_to(self._target_ned_m, "MPC_Z_VEL_MAX_UP", period_s)
            case _:
                reference.steer((0.0, 0.0, 0.0), limits, period_s)

    def _return_home(self, period_s: float) -> None:
        """Climb, fly home, land: the return mode's three legs."""
        north_m, east_m, down_m = self._reference.position_ned_m
        if self._target_ned_m is None:
            height_m = self._parameters["RTL_RETURN_ALT"]
            self._target_ned_m = (north_m, east_m, min(down_m, self.home_ned_m[2] - height_m))
        self._go_to(self._target_ned_m, "MPC_Z_VEL_MAX_UP", period_s)
        if not self._reference.is_at(self._target_ned_m):
            return
        above_home = (self.home_ned_m[0], self.home_ned_m[1], self._target_ned_m[2])
        if self._target_ned_m == above_home:
            self._enter(Mode.LAND, failsafe=self.failsafe)
        else:
            self._target_ned_m = above_home

    def _go_to(self, target_ned_m: Vector, climb_key: str, period_s: float) -> None:
        parameters, reference = self._parameters, self._reference
        cruise_mps = self._cruise_speed_mps or parameters["MPC_XY_CRUISE"]
        climbs_there = target_ned_m[2] < reference.position_ned_m[2]
        reference.go_to(
            target_ned_m,
            min(cruise_mps, parameters["MPC_XY_VEL_MAX"]),
            parameters[climb_key if climbs_there else "MPC_Z_VEL_MAX_DN"],
            self._limits(),
            period_s,
        )

    def _limits(self) -> MotionLimits:
        return MotionLimits(
            self._parameters["MPC_ACC_HOR"],
            min(self._parameters["MPC_ACC_UP_MAX"], self._parameters["MPC_ACC_DOWN_MAX"]),
            self._parameters["MPC_JERK_AUTO"],
        )

    def _landing_speed_mps(self) -> float:
        """Sink fast far above home, at landing speed near the ground."""
        height_m = self.home_ned_m[2] - self._truth.position_ned_m[2]
        far = height_m > _LANDING_NEAR_GROUND_M
        return self._parameters["MPC_Z_VEL_MAX_DN" if far else "MPC_LAND_SPEED"]

    # --- failsafes and transitions --------------------------------------------------------

    def _offboard_alive(self) -> bool:
        return self.offboard.age_s(self._truth.time_s) <= self._parameters["COM_OF_LOSS_T"]

    def _check_offboard(self) -> None:
        if self.mode is Mode.OFFBOARD and not self._offboard_alive():
            self._react_to_offboard_loss()
        elif (
            self.failsafe
            and self._intention is Mode.OFFBOARD
            and self._offboard_alive()
            and self.offboard.unbroken_s(self._truth.time_s) >= _STREAM_RETURN_S
        ):
            self._say(mavlink.MAV_SEVERITY_INFO, "Offboard signal regained")
            self._enter(Mode.OFFBOARD, failsafe=False)

    def _react_to_offboard_loss(self) -> None:
        action = int(self._parameters["COM_OBL_RC_ACT"])
        self._say(mavlink.MAV_SEVERITY_CRITICAL, "No offboard control data")
        if action in {6, 7}:
            self._disarm("offboard signal lost")
            return
        self._enter(
            {3: Mode.RTL, 4: Mode.LAND, 5: Mode.HOLD}.get(action, Mode.POSCTL), failsafe=True
        )
        # Without remote control PX4's manual modes let the vehicle sink.
        self._sinks_without_pilot = self.mode is Mode.POSCTL

    def _check_battery(self) -> None:
        if not self._battery_warned and self._battery_remaining < self._parameters["BAT_LOW_THR"]:
            self._battery_warned = True
            self._say(mavlink.MAV_SEVERITY_WARNING, "Low battery level")

    def _note_landing(self, was_on_ground: bool) -> None:
        on_ground = self.on_ground
        if on_ground and not was_on_ground:
            self._say(mavlink.MAV_SEVERITY_INFO, "Landing detected")
        elif was_on_ground and not on_ground:
            self._has_flown = True
            self._say(mavlink.MAV_SEVERITY_INFO, "Takeoff detected")

    def _disarm_when_due(self) -> None:
        if not self.on_ground or self._setpoint is not None:
            return
        delay_s = self._parameters["COM_DISARM_LAND" if self._has_flown else "COM_DISARM_PRFLT"]
        since_s = max(self._armed_since_s, self._land_detector.since_s)
        if 0.0 <= delay_s <= self._truth.time_s - since_s:
            self._disarm("landed" if self._has_flown else "no take-off")

    def _disarm(self, reason: str) -> None:
        self.armed = False
        self._setpoint = None
        self._say(mavlink.MAV_SEVERITY_INFO, f"Disarmed: {reason}")
        if self.mode is not Mode.OFFBOARD:
            self._intention = Mode.HOLD
            self._enter(Mode.HOLD, failsafe=False)

    def _enter(self, mode: Mode, *, failsafe: bool) -> None:
        if Mode.OFFBOARD in (
            mode,
            self.mode,
        ):  # the reference did not lead the vehicle, or will not
            self._reference = MotionReference(self._truth)
        if mode is not self.mode:
            self._cruise_speed_mps = None
        self.mode = mode
        self.failsafe = failsafe
        self._target_ned_m = None
        self._sinks_without_pilot = False

    def _say(self, severity: int, text: str) -> None:
        self.announcements.append((severity, text))
