"""How the vehicle responds to the setpoints sent to it, by all monitors of this room."""

from __future__ import annotations

from typing import Final

from onboard.contract.assessment import Terms
from onboard.mavlink.endpoint import MavlinkEndpoint
from onboard.monitoring.assumptions import Assumption, Violation
from onboard.monitoring.response.second_commander import SecondCommanderMonitor
from onboard.monitoring.response.sent_setpoints import SentSetpoints
from onboard.monitoring.response.tilt import TiltResponseMonitor
from onboard.monitoring.response.tracking import TrackingMonitor
from onboard.monitoring.response.trim import TrimEstimator
from onboard.monitoring.response.wind import WindMonitor
from onboard.monitoring.supervised_flight import SupervisedFlight
from onboard.vehicle_state import Pose

# Another node's setpoint this recent means that two are commanding.
SECOND_COMMANDER_MEMORY_S: Final = 0.5


class VehicleResponse:
    """Compares poses and the autopilot's target with what was asked for.

    Args:
        link: what the autopilot reports.

    Attributes:
        sent: the setpoints of late, kept up to date by what sends them.
        tracking_monitor: how well the vehicle follows its reference.
    """

    def __init__(self, link: MavlinkEndpoint) -> None:
        self._link = link
        self.sent = SentSetpoints()
        self._trim = TrimEstimator()
        self._tilt_monitor = TiltResponseMonitor(self._trim)
        self._wind_monitor = WindMonitor(self._trim)
        self.tracking_monitor = TrackingMonitor()
        self._second_commander_monitor = SecondCommanderMonitor()

    def begin_flight(self) -> None:
        """Forget earlier deviations: a flight departs.  The trim is kept."""
        self.tracking_monitor = TrackingMonitor()
        self._second_commander_monitor = SecondCommanderMonitor()

    def check_tilt(self, pose: Pose, terms: Terms[float]) -> Violation | None:
        """Learn the trim, and check the tilt against what was asked for one attitude lag ago.

        Asked for means sent: the reference of before may have been replaced since.  While the pilot
        flies that is a hover, so the trim is learnt before the vehicle departs.
        """
        if self._link.status.airborne is not True:
            self._trim.forget()
            return None
        asked_ned_mps2 = self.sent.acceleration_ned_mps2(pose.time_s - terms.attitude_lag_s)
        return self._tilt_monitor.check(pose, asked_ned_mps2[:2], terms)

    def check_wind(self, now_s: float, terms: Terms[float]) -> Violation | None:
        """Check the wind, by the trim learnt so far, against the declared one."""
        return self._wind_monitor.check(now_s, terms)

    def check_tracking(self, pose: Pose, flight: SupervisedFlight) -> list[Violation]:
        """Check a new pose against the reference; nothing without one."""
        reference = flight.reference(pose.time_s)
        if reference is None:
            return []
        x_m, y_m, z_m = flight.leg.position_leg(pose.position_ned_m)
        vx_mps, vy_mps, _ = flight.leg.vector_leg(pose.velocity_ned_mps)
        reference_x_m, reference_y_m, reference_z_m = reference.position_leg_m
        return self.tracking_monitor.check(
            (x_m - reference_x_m, y_m - reference_y_m, z_m - reference_z_m),
            (vx_mps, vy_mps),
            (reference.velocity_leg_mps[0], reference.velocity_leg_mps[1]),
            flight.assessment.terms,
            cruising=flight.cruising_freely,
        )

    def check_commander(self, pose: Pose, now_s: float) -> Violation | None:
        """Look for another node's setpoints: heard on the link, or in the autopilot's echo."""
        link = self._link
        if now_s - link.second_commander_heard_s <= SECOND_COMMANDER_MEMORY_S:
            return Violation(
                Assumption.SECOND_COMMANDER, 2.0, 1.0, "commanders", link.second_commander
            )
        return self._second_commander_monitor.check(
            link.target_heard_s,
            link.target,
            self.sent.newest_first(),
            pose,
            gain_max_per_s=link.profile.target_gain_max_per_s,
        )

    def follows_another(self, now_s: float) -> bool:
        """Tell whether the autopilot may no longer follow us, so that a deviation is not ours."""
        return self._second_commander_monitor.suspects(now_s)
