"""Runs every monitor in every tick, and has the flight respond to what they find.

The order of the checks is the order of the responses: the first violation that ends a flight is
the one that the operator reads.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Final

from onboard.events import Event
from onboard.mavlink.endpoint import MavlinkEndpoint
from onboard.monitoring.adaptation import costs_progress_only
from onboard.monitoring.assumptions import Assumption, Violation, check_obstacle
from onboard.monitoring.detection_evaluation import DetectionEvaluator
from onboard.monitoring.estimator.heading import HeadingMonitor
from onboard.monitoring.estimator.position_quality import PositionQualityMonitor, Sign
from onboard.monitoring.estimator.resets import EstimatorReset, PoseMonitor, ResetLedger
from onboard.monitoring.flight_time import FlightTimeMonitor
from onboard.monitoring.loop_overrun import LoopOverrunMonitor
from onboard.monitoring.movers.rest_speed import RestSpeedMonitor
from onboard.monitoring.response.vehicle_response import VehicleResponse
from onboard.monitoring.resumption import FailureTimes
from onboard.monitoring.seen.seen_space import DOUBTS
from onboard.monitoring.supervised_flight import SupervisedFlight, in_control
from onboard.monitoring.violation_log import ViolationLog
from onboard.perception.detection import DetectionFrame
from onboard.perception.intake import DetectionCounters
from onboard.perception.pose_history import PoseHistory
from onboard.vehicle_state import Pose

# A reference that has moved by less than this has stayed where it was.
STAYED_M: Final = 0.05


class MonitorSupervisor:
    """Checks the contract's assumptions, reports each violation once, and has the flight respond.

    Args:
        link: what the autopilot reports.
        flight: what is flown; it responds to violations.
        emit: takes the events.
        telemetry_timeout_s: telemetry older than this is ignored.
        counters: count frames that cannot be placed.

    Attributes:
        position_sign: the sign that the position is not to be believed, of this tick; None without.
        wind_violation: more wind than the contract declares, of this tick; None without.
        flight_time: since take-off.
        flight_time_violation: the flight has lasted too long, of this tick; None before.
        detections: what every sensor saw, and when.
        seen: the space around the vehicle that has been seen free.
        response: how the vehicle responds to what is sent to it.
        failures: when each assumption failed last.
    """

    def __init__(
        self,
        link: MavlinkEndpoint,
        flight: SupervisedFlight,
        emit: Callable[[Event], None],
        *,
        telemetry_timeout_s: float,
        counters: DetectionCounters,
    ) -> None:
        self._link, self._flight, self._emit = link, flight, emit
        self._log = ViolationLog(emit)
        self.failures = FailureTimes()
        self._poses, self._resets = PoseHistory(), ResetLedger()
        self._pose_monitor = PoseMonitor(telemetry_timeout_s)
        self._checked_pose: Pose | None = None
        self.detections = DetectionEvaluator(
            flight,
            self._poses,
            self._resets.placements_m,
            counters,
            self._resets.are_all_heard,
        )
        self.seen = self.detections.seen
        self.position_quality = PositionQualityMonitor(link.position_reports)
        self.position_sign: Sign | None = None
        self.wind_violation: Violation | None = None
        self.flight_time = FlightTimeMonitor()
        self.flight_time_violation: Violation | None = None
        self._loop_monitor = LoopOverrunMonitor()
        self.response = VehicleResponse(link)
        self._heading_monitor = HeadingMonitor()
        self._rest_speed = RestSpeedMonitor()

    @property
    def poses(self) -> PoseHistory:
        """Where the body was, for sensors that are placed by it."""
        return self._poses

    # ------------------------------------------------------------------ departure and landing

    def begin_flight(self, now_s: float) -> None:
        """Start the checks of a flight, which relies on what confirms its position now."""
        self._log.begin_flight()
        self._resets.begin_flight()
        self.position_quality.depart(now_s)
        self.position_sign = None
        self.response.begin_flight()
        self._heading_monitor = HeadingMonitor()
        self.detections.movers.begin_flight()
        # The estimator may have aligned its heading since: in the climb, magnetometers recover.
        self.detections.bearings.forget()

    def end_flight(self) -> None:
        """Stop checking the position until the next departure: the vehicle has landed."""
        self.position_quality.forget_flight()

    def resume_flight(self) -> None:
        """Report again what fails from now on: the operator has ended a hold."""
        self._log.begin_flight()

    # ------------------------------------------------------------------ what arrives

    def take_pose(self, pose: Pose) -> None:
        """Remember a pose that has just arrived, and notice whether the estimator was reset."""
        reset = self._pose_monitor.check_jump(pose)
        if reset is not None:
            self._resets.add(reset)
            if reset.measured:
                self._poses.shift(reset.shift_ned_m)
            else:
                self._poses.forget()
        self._poses.add(pose)

    def take_frames(
        self, frames: Iterable[DetectionFrame], now_s: float, epoch_unix_s: float
    ) -> None:
        """Evaluate the detection frames of a tick, and see what is free.

        Args:
            frames: in the order of their arrival.
            now_s: the time.
            epoch_unix_s: Unix time at its zero.
        """
        for frame in frames:
            stamp_s = frame.stamp_unix_s - epoch_unix_s
            for violation in self.detections.evaluate(frame, stamp_s, now_s, self._heading_monitor):
                self.report_and_respond(violation, now_s)
        contradiction = self.seen.advance(self._link.pose, trusted=self.position_sign is None)
        if contradiction is not None and self.seen.relied_on:
            self.report_and_respond(contradiction, now_s)

    # ------------------------------------------------------------------ one tick

    def check_loop(self, now_s: float) -> None:
        """Check that this tick is on time, and that late ones in motion are rare."""
        overrun = self._loop_monitor.check(now_s)
        if overrun is None:
            return
        self.report_and_respond(overrun, now_s)
        flight, silent_s = self._flight, overrun.measured
        was, now = flight.reference(now_s - silent_s), flight.reference(now_s)
        if was is None or now is None or not flight.in_seen_space:
            return
        if math.dist(was.position_leg_m, now.position_leg_m) <= STAYED_M:
            return
        again = self._loop_monitor.count_in_motion(now_s)
        timeout_s = flight.assessment.terms.setpoint_loss_timeout_s
        if silent_s > timeout_s:
            # The autopilot stops by itself then.  What is held has gone on without the vehicle:
            # the straight way after it is certified by nothing.
            sentence = f"no setpoint was sent for {silent_s:.2f} s (limit {timeout_s:g} s)"
            lost = Violation(Assumption.SELF_CHECK, silent_s, timeout_s, "s", sentence=sentence)
            self.report_and_respond(lost, now_s, measured=self._link.pose)
        elif again is not None:
            self.report_and_respond(again, now_s)

    def report_defect(self, now_s: float) -> None:
        """Respond to an exception in the service's own decisions."""
        defect = Violation(Assumption.SELF_CHECK, 1.0, 0.0, "exceptions")
        self.report_and_respond(defect, now_s)

    def respond_to_resets(self, now_s: float) -> bool:
        """Move what is remembered with the estimate, for every reset since the last tick.

        Returns:
            Whether there was one.
        """
        resets = self._resets.take_pending()
        for reset in resets:
            self._respond_to_reset(reset, now_s)
        return bool(resets)

    def _respond_to_reset(self, reset: EstimatorReset, now_s: float) -> None:
        """Move what is remembered, then fly on if the contract declares the reset.

        After a silence the vector is unknown: the vehicle stops, or hovers, where the estimator
        places it.
        """
        flight, pose = self._flight, self._link.pose
        assert pose is not None  # noqa: S101  a reset is seen on one
        self.detections.bearings.forget()
        if reset.measured:
            flight.shift(reset.shift_ned_m)
        if not flight.flying:
            self.seen.void("the estimator was reset")
            if not reset.measured:
                flight.hover_at(pose, now_s)
            if in_control(flight, now_s):
                self._report(reset.violation(), now_s)
            return
        ended = self._resets.count(reset, flight.assessment.terms.estimator_reset_max_m)
        if ended is not None:
            self.seen.void("the estimator was reset")
            self.report_and_respond(ended, now_s, measured=None if reset.measured else pose)
            return
        self.seen.shift(reset.shift_ned_m)
        self._emit(self._resets.event(reset, len(flight.obstacles), now_s))
        flight.fly_on_after_shift(reset.violation(), now_s)

    def check_position(self, now_s: float) -> None:
        """Find this tick's sign that the position is not to be believed, or no longer."""
        self.position_sign = self.position_quality.check(now_s)
        terms = self._flight.assessment.terms
        took_off = self.flight_time.follow(self._link.status.airborne, now_s)
        if took_off and terms.drift_m > 0.0:
            self.seen.void("it was seen before take-off, and the position drifts")
        self.flight_time_violation = self.flight_time.check(now_s, terms.flight_time_max_s)

    def check(self, pose: Pose, now_s: float) -> None:
        """Check every assumption against what has been seen.

        Args:
            pose: the newest.
            now_s: the time.
        """
        moved = pose is not self._checked_pose
        self._checked_pose = pose
        terms = self._flight.assessment.terms
        tilt = self.response.check_tilt(pose, terms) if moved else None
        self.wind_violation = self.response.check_wind(now_s, terms)
        if self._flight.flying:
            self._check_flight(pose, tilt, now_s, moved=moved)
            return
        if moved:
            # What has been seen before the departure is flown into after it.
            for doubt in self._heading_violations(pose, now_s):
                if doubt is not None:
                    self.seen.void(str(doubt))
        if in_control(self._flight, now_s):
            if self.position_sign is not None:
                self._report(self.position_sign.violation(), now_s)
            if self.flight_time_violation is not None:
                self._report(self.flight_time_violation, now_s)
            if moved:
                self._check_hover(pose, tilt, now_s)

    def _check_flight(
        self, pose: Pose, tilt: Violation | None, now_s: float, *, moved: bool
    ) -> None:
        sign, terms = self.position_sign, self._flight.assessment.terms
        heading = self._heading_violations(pose, now_s) if moved else []
        found = (
            None if sign is None else sign.violation(),
            self.detections.monitor.check(now_s, terms),
            self.telemetry_age_violation(pose, now_s),
            self.response.check_commander(pose, now_s),
            self.wind_violation,
            self.flight_time_violation,
            self.detections.movers.check_ring(now_s),
            self._check_rest(pose, now_s),
            *heading,
            *self.environment_violations(now_s),
        )
        for violation in found:
            if violation is not None:
                self.report_and_respond(violation, now_s)
        if moved:
            self._check_tracking(pose, tilt, now_s)

    def _check_rest(self, pose: Pose, now_s: float) -> Violation | None:
        """Tell whether the vehicle moves although its setpoint rests."""
        flight = self._flight
        assessment, reference = flight.assessment, flight.reference(now_s)
        rest_speed_mps = assessment.contract.vehicle.rest_speed_mps
        return self._rest_speed.check(pose, reference, now_s, assessment.terms, rest_speed_mps)

    def _check_hover(self, pose: Pose, tilt: Violation | None, now_s: float) -> None:
        """Report a second commander of a vehicle that hovers; there is no other response left."""
        commanded = self.response.check_commander(pose, now_s)
        if commanded is not None:
            self._report(commanded, now_s)
        self._check_tracking(pose, tilt, now_s)

    def report_and_respond(
        self, violation: Violation, now_s: float, measured: Pose | None = None
    ) -> None:
        """Report a violation once per flight, and respond to it, while the guarantee is at stake.

        Args:
            violation: what failed.
            now_s: when.
            measured: respond from this pose, where the reference itself cannot be believed.
        """
        self.failures.note(violation, now_s)
        if violation.assumption in DOUBTS:
            self.seen.void(str(violation))
        flight = self._flight
        terms = flight.assessment.terms
        if flight.in_seen_space and costs_progress_only(violation.assumption, terms):
            self._log.report_delay(violation, now_s)
            flight.respond_to(violation, now_s, measured)
        elif flight.flying:
            self._log.report(violation, now_s)
            flight.respond_to(violation, now_s, measured)

    def _report(self, violation: Violation, now_s: float) -> None:
        """Report a violation to which there is no other response left."""
        self.failures.note(violation, now_s)
        self._log.report(violation, now_s)

    # ------------------------------------------------------------------ single checks

    def telemetry_age_violation(self, pose: Pose, now_s: float) -> Violation | None:
        """Tell whether the position or the autopilot's latest heartbeat is too old."""
        return self._pose_monitor.check_age(pose, now_s, self._link.status.heard_s)

    def environment_violations(self, now_s: float) -> list[Violation]:
        """Check the obstacles that the flight is about to meet; others are not constrained."""
        flight = self._flight
        found: list[Violation] = []
        for obstacle in flight.obstacles_to_meet(now_s):
            conflict = next(flight.obstacles.conflicts(obstacle), None)
            found += check_obstacle(obstacle, conflict, flight.assessment.terms)
            if flight.flying and flight.obstacles.is_several(obstacle):
                # Avoiding the obstacles as one has responded to it already.
                separation_min_m = flight.assessment.terms.obstacle_separation_min_m
                self._log.report_merger(obstacle.id, separation_min_m, now_s)
        return found

    def _heading_violations(self, pose: Pose, now_s: float) -> list[Violation | None]:
        """Check the heading: by its command where that is steady, magnetometer and gyros."""
        monitor, flight = self._heading_monitor, self._flight
        drift = monitor.check_drift(self._link.heading_drift, now_s, flight.assessment.terms)
        compass = monitor.check_compass(self._link.compass_ratio, now_s)
        return [compass, drift, monitor.check_pointing(pose, flight.pointing_rad)]

    def _check_tracking(self, pose: Pose, tilt: Violation | None, now_s: float) -> None:
        """Respond to tracking errors, as far as the autopilot follows us.

        If it does not, the next heartbeat tells whom it follows: the pilot, and we are out, or a
        second commander.  Until then the deviation is only reported.
        """
        found = self.response.check_tracking(pose, self._flight)
        for violation in found if tilt is None else [*found, tilt]:
            if self.response.follows_another(now_s):
                self._log.report_suspicion(violation, now_s)
            else:
                self.report_and_respond(violation, now_s)
