"""Who flies: the pilot, the service, or the autopilot by itself.

The mode is the pilot's: the service commands only while the vehicle is airborne, armed and in a
mode that obeys setpoints, and gives control back as soon as one of these ends.  Control that is
granted is taken when nothing speaks against departing; until then the service holds the vehicle
where it is.  A vehicle that hovers without a position is left to the autopilot, whose failsafe does
better, and taken back once the position has returned.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from onboard.events import Event, EventName, Severity
from onboard.guidance.departure import (
    NOT_OF_WAY_BACK,
    REFUSAL_PERIOD_S,
    STOPPED_MPS,
    Refusal,
    RefusalKind,
    RefusalReport,
    refused,
    resume_refusals,
    return_refusals,
)
from onboard.guidance.envelope import broken_clauses
from onboard.guidance.movers.start_word import StartWord, near_refusals
from onboard.guidance.navigator import Navigator
from onboard.guidance.phases import Phase
from onboard.mavlink.endpoint import MavlinkEndpoint
from onboard.mavlink.profiles.setpoint_loss import loss_model_refusal
from onboard.monitoring.energy import SILENCE_S, EnergyMonitor, at_reserve, shortage
from onboard.monitoring.estimator.position_quality import DEAD_RECKONING_S
from onboard.monitoring.flight_authorization import FlightAuthorizationGate
from onboard.monitoring.supervisor import MonitorSupervisor
from onboard.vehicle_state import AUTOPILOT_SILENCE_S, Pose, Setpoint

# A hover without a position for longer than this is left to the autopilot.
HANDOVER_AFTER_S: Final = 2.0
# And is taken back once the position has been there for so long: it may flicker.
TAKE_BACK_AFTER_S: Final = 1.0


class ControlAuthority:
    """Takes control, gives it back, and says why it does not take it.

    Args:
        link: what the autopilot reports.
        navigator: flies while the service is in control.
        supervisor: finds what speaks against departing.
        authorization: says whether the pre-flight check has passed.
        emit: takes the events.
        fly_outside_contract: depart although the contract does not comply.
    """

    def __init__(
        self,
        link: MavlinkEndpoint,
        navigator: Navigator,
        supervisor: MonitorSupervisor,
        authorization: FlightAuthorizationGate,
        emit: Callable[[Event], None],
        *,
        fly_outside_contract: bool,
    ) -> None:
        self._link, self._navigator, self._supervisor = link, navigator, supervisor
        self._authorization, self._emit = authorization, emit
        self._fly_outside_contract = fly_outside_contract
        self._refusals = RefusalReport()
        # Where the vehicle is held while control is granted and not taken.
        self._standby_setpoint: Setpoint | None = None
        # Whether a hold has ended without the pilot, who alone may end it.
        self._hold_stands = False
        self._left_to_autopilot, self._position_lost_s = False, -math.inf
        self._energy, self._return_due_s, self._land_asked = EnergyMonitor(), -math.inf, False
        self._word = StartWord()

    # ------------------------------------------------------------------ control granted or taken

    def follow_mode(self, pose: Pose, now_s: float, now_unix_s: float) -> None:
        """Take control where it is granted and nothing speaks against it; else give it back.

        Args:
            pose: the newest.
            now_s: the time.
            now_unix_s: the same in Unix time, for the age of the pre-flight check.
        """
        if self._navigator.phase is Phase.STANDBY:
            accepted = self._authorization.accepts_no_progress(now_unix_s)
            if self._navigator.accept_no_progress(accepted=accepted) and accepted:
                text = "the next flight is not guaranteed to arrive, which was accepted"
                self._emit(Event(now_s, EventName.ACCEPTED, Severity.NOTICE, text))
        if not self._granted(now_s):
            self._give_back(pose, now_s)
        elif self._navigator.phase is Phase.STANDBY:
            self._word.control_is_granted(pose, now_s)
            # A daemon that restarts in flight finds itself in control: it holds where it is.
            self._standby_setpoint = self._standby_setpoint or hovering_at(pose)
            self._depart(pose, now_s, now_unix_s)

    def _heard(self, now_s: float) -> bool:
        return now_s - self._link.status.heard_s <= AUTOPILOT_SILENCE_S

    def _granted(self, now_s: float) -> bool:
        status = self._link.status
        obeys = status.armed and status.external_control and status.airborne is True
        return obeys and (self._heard(now_s) or self._comes_to_rest(now_s))

    def _comes_to_rest(self, now_s: float) -> bool:
        """Tell whether the reference moves, and the vehicle may still follow it.

        A silent autopilot may still follow: it is led to rest on the way that is held, before
        control counts as ended.
        """
        if self._left_to_autopilot or self._navigator.phase is Phase.STANDBY:
            return False
        setpoint = self._navigator.setpoint(now_s)
        return setpoint is not None and math.hypot(*setpoint.velocity_ned_mps) > STOPPED_MPS

    def _give_back(self, pose: Pose, now_s: float) -> None:
        status, navigator, heard = self._link.status, self._navigator, self._heard(now_s)
        doubted = navigator.flying and self._supervisor.position_sign is not None
        # Only the pilot ends a hold, or a flight on a bad position: neither an autopilot that is
        # silent nor one whose failsafe acts has handed anything back.
        stands = self._hold_stands or navigator.phase is Phase.HOLD or doubted
        self._hold_stands = stands and (not heard or status.failsafe)
        self._word.withheld |= heard  # a silent one has handed nothing back
        # A silent autopilot may still follow: it keeps the last place, not one that drifts with it.
        if not heard:
            self._standby_setpoint = navigator.setpoint(now_s) or self._standby_setpoint
        if heard or self._standby_setpoint is None:
            self._standby_setpoint = hovering_at(pose)
        if navigator.phase is not Phase.STANDBY:
            if heard and status.failsafe:
                text = f"the autopilot's failsafe has taken over ({status.mode})"
                self._emit(Event(now_s, EventName.FAILSAFE, Severity.WARNING, text))
            navigator.release_control(now_s)
        if status.airborne is not True:
            self._supervisor.end_flight()
            self._authorization.end_flight()
        self._refusals.end()

    def _depart(self, pose: Pose, now_s: float, now_unix_s: float) -> None:
        refusals = self.departure_refusals(pose, now_s, now_unix_s)
        if not refusals:
            self._supervisor.begin_flight(now_s)
            if self._word.said is not None:
                self._take_word_on_movers(*self._word.said)
            self._authorization.begin_flight(now_unix_s)
            self._energy.begin_flight(self._link.battery.charge(now_s, SILENCE_S), now_s)
            self._land_asked = False
            self._refusals.end()
            self._navigator.take_control(pose, now_s)
            return
        self._word.end_if_contradicted(refusals)
        if (news := self._refusals.news(refusals, now_s)) is not None:
            self._emit(news)

    def _take_word_on_movers(self, pose: Pose, said_s: float) -> None:
        """Take what the operator said, by having the vehicle fly on, of movers around it."""
        radius_m = self._navigator.situation.route.mission.start_clear_of_movers_m
        if radius_m is not None:
            self._supervisor.detections.movers.take_word(pose, radius_m, said_s)

    def _word_refusals(self, now_s: float) -> list[Refusal]:
        """Return what speaks against the operator's word on movers, which wears off at v_o."""
        assessment, movers = self._navigator.assessment, self._supervisor.detections.movers
        radius_m = self._navigator.situation.route.mission.start_clear_of_movers_m or 0.0
        pose, in_view = self._link.pose, assessment.terms.movers_level == "passive_in_view"
        departs = self._navigator.phase is Phase.STANDBY and not self._word.withheld
        if in_view and departs and pose is not None:
            radius_m, worn = self._word.left_m(assessment, radius_m, pose, now_s)
            if worn is not None:
                return [Refusal(RefusalKind.START_WORD, worn)]
        return near_refusals(lambda within_m: movers.near(pose, within_m, now_s), radius_m)

    def resume(self, pose: Pose | None, now_s: float, now_unix_s: float) -> list[Refusal]:
        """End a hold by the operator's command, where nothing speaks against it.

        Args:
            pose: the newest; None before the first one.
            now_s: the time.
            now_unix_s: the same in Unix time.

        Returns:
            Every reason not to; empty if the flight goes on.
        """
        situation = self._navigator.situation
        refusals = resume_refusals(situation, self._supervisor.failures, now_s)
        if pose is None:
            refusals.append(Refusal(RefusalKind.TELEMETRY, "no telemetry"))
        elif self._navigator.phase is Phase.HOLD:
            refusals += self.departure_refusals(pose, now_s, now_unix_s)
        if self._left_to_autopilot:
            text = "the vehicle is left to the autopilot: the pilot has to take over first"
            refusals.append(Refusal(RefusalKind.POSITION, text))
        if refusals or pose is None:
            self._emit(refused("not resuming", refusals, now_s))
        else:
            self._supervisor.resume_flight()
            self._take_word_on_movers(pose, now_s)
            self._navigator.resume(pose, now_s)
        return refusals

    def fly_back(
        self,
        pose: Pose | None,
        now_s: float,
        now_unix_s: float,
        cause: str = "the operator's command",
    ) -> list[Refusal]:
        """Return along the way flown, from flight or from rest.

        The arguments are those of `resume`, and why, for the operator.

        Returns:
            Every reason not to; empty if the vehicle returns.
        """
        navigator = self._navigator
        refusals = return_refusals(navigator.situation, self._supervisor.failures, now_s)
        at_rest = navigator.phase in (Phase.HOLD, Phase.ARRIVED)
        if pose is None:
            refusals.append(Refusal(RefusalKind.TELEMETRY, "no telemetry"))
        elif at_rest:
            against = self.departure_refusals(pose, now_s, now_unix_s)
            refusals += [each for each in against if each.kind not in NOT_OF_WAY_BACK]
        if self._left_to_autopilot:
            text = "the vehicle is left to the autopilot: the pilot has to take over first"
            refusals.append(Refusal(RefusalKind.POSITION, text))
        if not refusals and not navigator.fly_back(cause, now_s):
            refusals = [Refusal(RefusalKind.NO_WAY_BACK, "the vehicle is where it began")]
        if refusals or pose is None:
            self._emit(refused("not returning", refusals, now_s))
        elif at_rest:
            self._supervisor.resume_flight()
            navigator.resume(pose, now_s)
        return refusals

    def keep_energy(self, pose: Pose | None, now_s: float, now_unix_s: float) -> None:
        """Return in time for the battery; at its reserve, have the pilot land.

        The arguments are those of `resume`.
        """
        navigator = self._navigator
        budget, phase = navigator.situation.route.mission.energy, navigator.phase
        self._link.wants_battery = budget is not None
        self._link.battery.in_flight = self._link.status.armed
        if budget is None or phase is Phase.STANDBY:
            return
        charge = self._link.battery.charge(now_s, SILENCE_S)
        if (exhausted := at_reserve(budget, charge)) is not None and not self._land_asked:
            self._land_asked = True
            self._emit(Event(now_s, EventName.BATTERY, Severity.CRITICAL, exhausted))
        if navigator.situation.route.returning or now_s < self._return_due_s:
            return
        cause = self._energy.return_cause(budget, charge, now_s)
        if cause is None:
            return
        self._return_due_s = now_s + REFUSAL_PERIOD_S
        if phase is Phase.HOLD:  # only the operator or the pilot ends it
            text = f"{cause}: the pilot has to take over"
            self._emit(Event(now_s, EventName.BATTERY, Severity.CRITICAL, text))
        else:
            self.fly_back(pose, now_s, now_unix_s, cause)

    # ------------------------------------------------------------------ what speaks against it

    def departure_refusals(self, pose: Pose, now_s: float, now_unix_s: float) -> list[Refusal]:
        """Return every reason not to take control that is granted; empty if there is none.

        The arguments are those of `follow_mode`.
        """
        supervisor, assessment = self._supervisor, self._navigator.assessment
        found = []
        if self._hold_stands:
            text = "holding: the pilot has to take over first"
            found.append(Refusal(RefusalKind.HOLDING, text))
        if (other := self._link.other_daemon(now_s)) is not None:
            found.append(Refusal(RefusalKind.OTHER_DAEMON, other))
        broken = broken_clauses(assessment)
        if broken and not self._fly_outside_contract:
            text = f"the contract does not comply ({', '.join(broken)})"
            found.append(Refusal(RefusalKind.CONTRACT, text))
        wrong_loss = loss_model_refusal(self._link.profile, assessment.contract)
        if wrong_loss is not None and not self._fly_outside_contract:
            found.append(Refusal(RefusalKind.CONTRACT, wrong_loss, "setpoint_loss"))
        unauthorized = self._authorization.refusal(now_unix_s)
        if unauthorized is not None:
            found.append(Refusal(RefusalKind.PREFLIGHT, unauthorized))
        found += self._detection_refusals(now_s)
        if supervisor.telemetry_age_violation(pose, now_s) is not None:
            found.append(Refusal(RefusalKind.TELEMETRY, "no fresh telemetry"))
        found += [
            Refusal(RefusalKind.POSITION, text)
            for text in supervisor.position_quality.departure_failures(now_s)
        ]
        if supervisor.wind_violation is not None:
            text = f"more wind than {assessment.terms.wind_max_mps:g} m/s"
            found.append(Refusal(RefusalKind.WIND, text))
        if supervisor.flight_time_violation is not None:
            text = supervisor.flight_time_violation.sentence
            found.append(Refusal(RefusalKind.FLIGHT_TIME, text))
        found += self._energy_refusals(now_s)
        found += self._navigator.departure_refusals(pose)
        if not self._fly_outside_contract:
            found += [
                Refusal(RefusalKind.ENVIRONMENT, str(violation), violation.key)
                for violation in supervisor.environment_violations(now_s)
            ]
        return found

    def _energy_refusals(self, now_s: float) -> list[Refusal]:
        mission = self._navigator.situation.route.mission
        if mission.energy is None or self._navigator.phase is not Phase.STANDBY:
            return []
        charge = self._link.battery.charge(now_s, SILENCE_S)
        speed_mps = self._navigator.assessment.terms.cruise_speed_mps
        short = shortage(mission.energy, charge, mission, speed_mps)
        return [] if short is None else [Refusal(RefusalKind.ENERGY, short)]

    def _detection_refusals(self, now_s: float) -> list[Refusal]:
        detections = self._supervisor.detections
        blind = detections.monitor.check(now_s, self._navigator.assessment.terms)
        found = []
        if blind is not None:
            text = f"no fresh detection frames: {blind.note}"
            found.append(Refusal(RefusalKind.DETECTIONS, text, blind.key))
        if (uncounted := detections.movers.refusal) is not None:
            found.append(Refusal(RefusalKind.DETECTIONS, uncounted, "movers"))
        ring = detections.movers.check_ring(now_s)
        if ring is not None:
            text = "no fresh frames of a sensor that sees all round, which movers require"
            found.append(Refusal(RefusalKind.DETECTIONS, text, ring.key))
        found += self._word_refusals(now_s)
        found += [
            Refusal(RefusalKind.CONTRADICTION, f"sightings of {track} contradict each other", track)
            for track in detections.consistency.contradicted(now_s)
        ]
        return found

    # ------------------------------------------------------------------ what is commanded

    def setpoint(self, now_s: float) -> Setpoint | None:
        """Return what to command now; None where the vehicle is another's to fly.

        On the ground nothing is commanded, or ArduPilot would not take off.
        """
        if self._link.status.airborne is not True or self._is_left_to_autopilot(now_s):
            return None
        # Two that hold the vehicle in two places would both command it.
        if self._navigator.phase is Phase.STANDBY and self._link.hears_other_daemon(now_s):
            return None
        return self._navigator.setpoint(now_s) or self._standby_setpoint

    def follow_reset(self, pose: Pose) -> None:
        """Hover, in STANDBY, where the estimator says after a reset that the vehicle is."""
        self._standby_setpoint = hovering_at(pose)

    def _is_left_to_autopilot(self, now_s: float) -> bool:
        """Tell whether the vehicle hovers without a position: its failsafe does better then."""
        navigator, pose = self._navigator, self._link.pose
        lost = None if navigator.flying else self._position_loss(now_s)
        if lost is not None:
            self._position_lost_s = now_s
        lately = now_s - self._position_lost_s < TAKE_BACK_AFTER_S
        before, self._left_to_autopilot = self._left_to_autopilot, lately and not navigator.flying
        handed_over = self._left_to_autopilot and not before
        if lost is not None and handed_over and navigator.phase is not Phase.STANDBY:
            text = f"{lost}: leaving the vehicle to the autopilot"
            self._emit(Event(now_s, EventName.HANDED_OVER, Severity.CRITICAL, text))
        if before and not self._left_to_autopilot and pose is not None:
            # Where the autopilot has taken the vehicle meanwhile, rather than back in one step.
            self._standby_setpoint = hovering_at(pose)
            navigator.hover_at(pose, now_s)
        return self._left_to_autopilot

    def _position_loss(self, now_s: float) -> str | None:
        """Return why the position is gone, or None.

        Dead reckoning is good for a stop; once that is over, or has had its time, it is not.
        """
        pose, sign = self._link.pose, self._supervisor.position_sign
        if pose is None or now_s - pose.time_s > HANDOVER_AFTER_S:
            return "no position"
        if sign is None:
            return None
        setpoint = self._navigator.setpoint(now_s)
        speed_mps = 0.0 if setpoint is None else math.hypot(*setpoint.velocity_ned_mps)
        allowed_s = DEAD_RECKONING_S * (2.0 if speed_mps > STOPPED_MPS else 1.0)
        lost_for_s = self._supervisor.position_quality.lost_for_s(sign, now_s)
        return sign.sentence if lost_for_s > allowed_s else None


def hovering_at(pose: Pose) -> Setpoint:
    """Return the setpoint that keeps a vehicle where it is and points, at rest."""
    still = (0.0, 0.0, 0.0)
    return Setpoint(pose.position_ned_m, still, still, pose.yaw_rad)
