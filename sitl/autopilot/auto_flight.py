"""Motion of the modes that fly by themselves: hold, take-off, landing, return, sticks, missions."""

from __future__ import annotations

import math

from sitl.autopilot.manual_control import ManualControl
from sitl.autopilot.mission import MissionItem, MissionStore, target_ned_m
from sitl.autopilot.modes import Mode
from sitl.autopilot.motion_reference import MotionLimits, MotionReference
from sitl.autopilot.plan.rally import RallyStore
from sitl.autopilot.settings import FlightSettings
from sitl.plant.setpoint import Setpoint
from sitl.plant.truth import Vector, VehicleTruth

_LANDING_NEAR_GROUND_M = 5.0
_STRAIGHT = 0.95  # cosine of the widest turn that is flown through without slowing down
_TURN_DISTANCE_M = 1.0  # closer to its target than this the vehicle keeps its heading


class AutoFlight:
    """Steer the reference that the controller follows, as the mode requires.

    Attributes:
        reference: where the vehicle should be.
        settings: speeds and limits.
        home_ned_m: where return goes.
        target_ned_m: where the present mode goes; None to stop here.
        cruise_speed_mps: chosen by command or mission; None for the parameter's.
        mission: what MISSION flies.
        rally: where a return may end.
        landing: whether a mission has come to its landing.
    """

    def __init__(
        self,
        settings: FlightSettings,
        truth: VehicleTruth,
        mission: MissionStore,
        rally: RallyStore,
    ) -> None:
        self.settings = settings
        self.reference = MotionReference(truth)
        self.home_ned_m: Vector = (truth.position_ned_m[0], truth.position_ned_m[1], 0.0)
        self.target_ned_m: Vector | None = None
        self.cruise_speed_mps: float | None = None
        self.mission = mission
        self.rally = rally
        self._destination_m = self.home_ned_m[:2]
        self.landing = False
        self._dwelling_since_s: float | None = None
        self._item_number = mission.current
        self._period_s = 0.01

    def restart(self, truth: VehicleTruth) -> None:
        """Begin where the vehicle is and as it moves."""
        self.reference = MotionReference(truth)

    def begin(self, mode: Mode, truth: VehicleTruth) -> None:
        """Forget the target of another mode."""
        self.target_ned_m = None
        self.landing = False
        self._dwelling_since_s = None
        if mode is Mode.MISSION:
            self.mission.resume()
            if self.mission.starts_without_take_off and truth.position_ned_m[2] > -0.5:
                self._climb_first(truth)

    def fly(self, mode: Mode, truth: VehicleTruth, period_s: float) -> Mode | None:
        """Move the reference on for ``period_s``; return the mode that follows, when it is due."""
        self._period_s = period_s
        match mode:
            case Mode.TAKEOFF if self.target_ned_m is not None:
                self.go_to(self.target_ned_m, self.settings.take_off_speed_mps)
                return Mode.HOLD if self.reference.is_at(self.target_ned_m) else None
            case Mode.LAND:
                self.steer((0.0, 0.0, self._landing_speed_mps(truth)))
            case Mode.RTL:
                return self._return_home()
            case Mode.MISSION:
                return self._fly_mission(truth)
            case _:
                self.hold()
        return None

    def setpoint(self) -> Setpoint:
        """Return what the controller is to fly until the next call."""
        return self.reference.setpoint()

    def hold(self) -> None:
        """Go to the target, or brake where there is none."""
        if self.target_ned_m is None:
            self.steer((0.0, 0.0, 0.0))
        else:
            self.go_to(self.target_ned_m, self.settings.climb_speed_mps)

    def sink(self) -> None:
        """Descend at landing speed, as with the throttle stick at its bottom."""
        self.steer((0.0, 0.0, self.settings.landing_speed_mps))

    def follow_sticks(self, sticks: ManualControl, period_s: float) -> None:
        """Fly as the pilot's sticks command."""
        self._period_s = period_s
        settings, reference = self.settings, self.reference
        reference.yaw_rad += sticks.yaw_rate_radps * period_s
        self.steer(
            sticks.velocity_ned_mps(
                reference.yaw_rad,
                settings.stick_speed_mps,
                settings.climb_max_mps,
                settings.sink_max_mps,
            )
        )

    def steer(self, velocity_ned_mps: Vector) -> None:
        """Change the reference's velocity towards a wanted one."""
        self.reference.steer(velocity_ned_mps, self._limits(), self._period_s)

    def go_to(self, target_ned_m: Vector, climb_mps: float, ahead_m: float = 0.0) -> None:
        """Fly straight to a position and stop there, or as much as ``ahead_m`` behind it."""
        settings = self.settings
        climbs = target_ned_m[2] < self.reference.position_ned_m[2]
        self.reference.go_to(
            target_ned_m,
            min(self.cruise_speed_mps or settings.cruise_speed_mps, settings.speed_max_mps),
            climb_mps if climbs else settings.sink_speed_mps,
            self._limits(),
            self._period_s,
            ahead_m,
        )

    def _limits(self) -> MotionLimits:
        settings = self.settings
        return MotionLimits(
            settings.acceleration_mps2, settings.acceleration_vertical_mps2, settings.jerk_mps3
        )

    def _landing_speed_mps(self, truth: VehicleTruth) -> float:
        """Sink fast far above home, at landing speed near the ground."""
        far = self.home_ned_m[2] - truth.position_ned_m[2] > _LANDING_NEAR_GROUND_M
        return self.settings.sink_speed_mps if far else self.settings.landing_speed_mps

    def _return_home(self) -> Mode | None:
        """Climb, fly home or to a rally point, land: the return mode's three legs."""
        north_m, east_m, down_m = here_m = self.reference.position_ned_m
        if self.target_ned_m is None:
            settings = self.settings
            self._destination_m = self.rally.destination_m(
                here_m, self.home_ned_m, settings.rally_limit_m, or_home=settings.rally_or_home
            )
            height_m = settings.return_height_m
            self.target_ned_m = (north_m, east_m, min(down_m, self.home_ned_m[2] - height_m))
        self.go_to(self.target_ned_m, self.settings.climb_speed_mps)
        if not self.reference.is_at(self.target_ned_m):
            return None
        above_home = (*self._destination_m, self.target_ned_m[2])
        if self.target_ned_m == above_home:
            return Mode.LAND
        self.target_ned_m = above_home
        return None

    # --- missions -------------------------------------------------------------------------

    def _climb_first(self, truth: VehicleTruth) -> None:
        """Take off before a mission whose first item does not."""
        north_m, east_m, down_m = truth.position_ned_m
        self.target_ned_m = (north_m, east_m, down_m - self.settings.take_off_height_m)

    def _fly_mission(self, truth: VehicleTruth) -> Mode | None:
        item = self.mission.current_item
        if self.mission.current != self._item_number:
            self._begin_item()
        if self.target_ned_m is not None and not self.landing:
            self.go_to(self.target_ned_m, self.settings.take_off_speed_mps)
            if self.reference.is_at(self.target_ned_m):
                self.target_ned_m = None
            return None
        if item is None or self.mission.finished:
            self.steer((0.0, 0.0, 0.0))
            return None
        if item.returns_home:
            return Mode.RTL
        if (speed_mps := item.speed_mps) is not None:
            self.cruise_speed_mps = speed_mps
            self.mission.item_done()
        elif (jump := item.jump) is not None:
            self.mission.jump(*jump)
        elif self.landing:
            self.steer((0.0, 0.0, self._landing_speed_mps(truth)))
        else:
            self._fly_item(item, truth)
        return None

    def _begin_item(self) -> None:
        self._item_number = self.mission.current
        self._dwelling_since_s = None
        if self.landing:  # the operator has selected another item meanwhile
            self.landing = False
            self.target_ned_m = None

    def _fly_item(self, item: MissionItem, truth: VehicleTruth) -> None:
        here = self.reference.position_ned_m  # what an item without coordinates means
        target = target_ned_m(item, self.mission.origin, self.home_ned_m, here)
        self._face(target, item.yaw_rad)
        climb_mps = (
            self.settings.take_off_speed_mps if item.takes_off else self.settings.climb_speed_mps
        )
        self.go_to(target, climb_mps, self._straight_on_m(item, target))
        if not self._reached(item, target):
            return
        if item.lands:
            self.landing = True
            self.target_ned_m = target
        elif self._dwelt(item.dwell_s, truth.time_s):
            self.mission.item_done()

    def _face(self, target: Vector, yaw_rad: float | None) -> None:
        """Turn to the item's heading, else to the direction of flight."""
        north_m = target[0] - self.reference.position_ned_m[0]
        east_m = target[1] - self.reference.position_ned_m[1]
        if yaw_rad is not None:
            self.reference.yaw_rad = yaw_rad
        elif math.hypot(north_m, east_m) > _TURN_DISTANCE_M:
            self.reference.yaw_rad = math.atan2(east_m, north_m)

    def _stops_at(self, item: MissionItem) -> bool:
        return item.dwell_s > 0.0 or item.lands or item.takes_off or self.mission.stops_here

    def _straight_on_m(self, item: MissionItem, target: Vector) -> float:
        """Length of the next leg if the flight goes straight on past the item, else 0."""
        following = self.mission.following
        if following is None or not following.has_place or self._stops_at(item):
            return 0.0
        there = target_ned_m(following, self.mission.origin, self.home_ned_m, target)
        here = self.reference.position_ned_m
        way = (target[0] - here[0], target[1] - here[1])
        leg = (there[0] - target[0], there[1] - target[1])
        along = way[0] * leg[0] + way[1] * leg[1]
        straight = along > _STRAIGHT * math.hypot(*way) * math.hypot(*leg)
        return math.hypot(*leg) if straight else 0.0

    def _reached(self, item: MissionItem, target: Vector) -> bool:
        if self._stops_at(item):
            return self.reference.is_at(target)
        radius_m = item.acceptance_radius_m or self.settings.acceptance_radius_m
        return math.dist(self.reference.position_ned_m, target) < radius_m

    def _dwelt(self, dwell_s: float, now_s: float) -> bool:
        if self._dwelling_since_s is None:
            self._dwelling_since_s = now_s
        return now_s - self._dwelling_since_s >= dwell_s
