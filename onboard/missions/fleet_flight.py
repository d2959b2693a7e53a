"""One vehicle's flight in its fleet: what is flown, for `FleetMember`; what may be, for guidance.

The tube bounds what is certified (`leave`); the lane bounds what is planned, since no leave is
asked for beyond it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from onboard.fleet.course import Course, FlightTerms
from onboard.fleet.member import FleetMember
from onboard.geometry.local_frame import GeographicPoint, LocalFrame
from onboard.guidance.dense.limits import run_on_of
from onboard.guidance.departure import STOPPED_MPS
from onboard.guidance.envelope import at_rest_speed_mps
from onboard.guidance.movers.leave import settling_in_tube
from onboard.guidance.movers.mover_guard import settling_of
from onboard.planning.mover_certifier import moving_until_s
from onboard.planning.rest_certifier import velocity_points_mps
from onboard.planning.tube_certifier import occupied_ned_m

if TYPE_CHECKING:
    from onboard.fleet.area import Place
    from onboard.fleet.membership import FleetMembership
    from onboard.geometry.frames import FloatArray
    from onboard.guidance.navigator import Navigator
    from onboard.mavlink.endpoint import MavlinkEndpoint
    from onboard.monitoring.supervisor import MonitorSupervisor
    from onboard.motion.trajectory import Trajectory
    from onboard.vehicle_state import Pose

_DEGREES_E7: Final = 1e-7
_NO_WAY: Final[FloatArray] = np.zeros((0, 4))


class FleetFlight:
    """Flies by leave.

    Args:
        membership: of the fleet.
        boot: of this run of the daemon.
        link: says where the vehicle's local frame is.
        navigator: flies.
        supervisor: sees.

    Attributes:
        member: asks for leave, and gives it.

    Raises:
        ValueError: the contract does not require that every way ends at rest.
    """

    def __init__(
        self,
        membership: FleetMembership,
        boot: str,
        link: MavlinkEndpoint,
        navigator: Navigator,
        supervisor: MonitorSupervisor,
    ) -> None:
        if navigator.thread is None:
            raise ValueError("requirements.stop = false, expected true: nothing keeps to a tube")
        self._link, self._navigator = link, navigator
        self.member = FleetMember(membership, boot, navigator.situation.emit)
        navigator.thread.guard.leave = self.member
        supervisor.detections.is_peer = self.member.is_peer
        body_m = navigator.assessment.terms.body_m
        supervisor.seen.lane_half_width_m = body_m + membership.lane_half_width_m

    def advance(self, pose: Pose | None, now_s: float) -> None:
        """Say what is flown, and learn what may be; before guidance decides."""
        self._find_frame()
        situation = self._navigator.situation
        if pose is None:
            self.member.doubt = "no telemetry"
        else:
            self.member.advance(self._course(pose, now_s), now_s)
        objection = self.member.objection() or (pose and self._beside_lane(pose))
        situation.fleet_objection = None if objection is None else f"fleet: {objection}"

    def _beside_lane(self, pose: Pose) -> str | None:
        """Return that the vehicle is beside the lane that it asks leave for; None if it is not."""
        lane_m = self.member.membership.lane_half_width_m
        _, beside_m, _ = self._navigator.leg.position_leg(pose.position_ned_m)
        if abs(beside_m) <= lane_m:
            return None
        return f"{abs(beside_m):.1f} m beside the leg (lane_half_width_m = {lane_m:g} m)"

    def _find_frame(self) -> None:
        """Take the frame that the vehicle says, where the fleet's file says the same, within A."""
        membership, origin = self.member.membership, self._link.missions.origin
        stated, key = membership.frame, self._link.profile.key
        if origin is None:
            self.member.place_by(None, "the vehicle has not said its GPS_GLOBAL_ORIGIN")
            return
        if key != stated.autopilot:
            text = f"the fleet's file says autopilot: {stated.autopilot}, the vehicle is {key}"
            self.member.place_by(None, text)
            return
        place = GeographicPoint(origin.latitude * _DEGREES_E7, origin.longitude * _DEGREES_E7)
        off_m = math.hypot(*stated.north_east_m(place.latitude_deg, place.longitude_deg))
        if not off_m <= membership.error_m:
            self.member.place_by(
                None,
                f"GPS_GLOBAL_ORIGIN is {off_m:.1f} m from the origin in the fleet's file "
                f"(at most absolute_position_error_m = {membership.error_m:g} m)",
            )
            return
        self.member.place_by(LocalFrame(place, stated.autopilot))

    # ------------------------------------------------------------------ what is flown

    def _course(self, pose: Pose, now_s: float) -> Course:
        situation, terms = self._navigator.situation, self._terms()
        here_ned_m = pose.position_ned_m[:2]
        setpoint = self._navigator.setpoint(now_s)
        if setpoint is None:
            rests = math.hypot(*pose.velocity_ned_mps) < at_rest_speed_mps(situation.assessment)
            # When it will rest, the pilot knows.
            return Course(here_ned_m, pose.time_s, math.inf, rests, _NO_WAY, None, terms)
        way = situation.reference.remaining(now_s)
        position_m: Place = setpoint.position_ned_m[:2]
        position_s = now_s
        if math.dist(position_m, here_ned_m) > situation.assessment.terms.tracking_error_m:
            # An assumption fails: others have to know where it is.
            position_m, position_s = here_ned_m, pose.time_s
        if way is None or _stands(way):
            return Course(position_m, position_s, now_s, True, _NO_WAY, self._leg(), terms)
        settling = settling_in_tube(settling_of(situation.assessment), situation.assessment)
        rests_s = moving_until_s(way, settling) or now_s
        held_m = self._held_m(way)
        return Course(position_m, position_s, rests_s, False, held_m, self._leg(), terms)

    def _held_m(self, way: Trajectory) -> FloatArray:
        points_mps = velocity_points_mps(way)[:, :, :2].reshape(-1, 2)
        run_on = run_on_of(self._navigator.assessment, float(np.hypot(*points_mps.T).max()))
        terms = self._navigator.assessment.terms
        return occupied_ned_m(way, terms.body_m, run_on, self._navigator.leg)

    def _leg(self) -> tuple[Place, Place] | None:
        """Return the leg that the vehicle flies, or is about to."""
        situation = self._navigator.situation
        if not situation.state.flying or situation.state.changes_mission:
            return None
        return situation.leg.origin_ned_m[:2], situation.route.leg.end_ned_m

    def _terms(self) -> FlightTerms:
        assessment = self._navigator.assessment
        terms, limits = assessment.terms, assessment.limits
        settle_s = max(settling_of(assessment).rest_settle_s, terms.attitude_lag_s)
        run_on_s = run_on_of(assessment).reach_m(1.0)
        return FlightTerms(
            terms.body_m,
            terms.cruise_speed_mps,
            limits.brake_mps2,
            terms.attitude_lag_s + terms.reaction_time_s,
            settle_s,
            run_on_s,
        )


def _stands(way: Trajectory) -> bool:
    """Tell whether a trajectory leads nowhere."""
    points_mps = velocity_points_mps(way)[:, :, :2].reshape(-1, 2)
    return float(np.hypot(*points_mps.T).max()) <= STOPPED_MPS
