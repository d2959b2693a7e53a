"""The cure of every assumption that can fail in flight (`docs/responses.md` says what follows)."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from gcs_tools.cures.cure import Cure
from onboard.monitoring.assumptions import Assumption

ASSUMPTION_CURES: Final[Mapping[Assumption, Cure]] = MappingProxyType(
    {
        Assumption.DETECTION_AGE: Cure(
            "no frame has arrived for longer than frame_age_max_s: the sensor, its driver or the "
            "network has stopped or stalls",
            "start the sensor again, look for what delays it (load, Wi-Fi, USB power); `clearway "
            "sensor check` measures rate and delay; declare a longer frame_age_max_s only if the "
            "contract still complies",
        ),
        Assumption.REACTION_TIME: Cure(
            "a frame came later after its stamp than reaction_time_s",
            "raise the frame rate or shorten the way of a frame; else declare a longer "
            "reaction_time_s and a lower cruise speed",
        ),
        Assumption.DETECTION_RANGE: Cure(
            "a frame states a shorter range than detection_range_m",
            "declare in the contract the range that the sensor has in this light and weather: "
            "`clearway contract solve --for vehicle.cruise_speed_mps` says how fast that allows",
        ),
        Assumption.FIELD_OF_VIEW: Cure(
            "a frame states a narrower field of view than field_of_view_deg",
            "remove what covers the sensor, or declare the narrower view",
        ),
        Assumption.DETECTION_UNCERTAINTY: Cure(
            "a frame states a larger error of position than position_error_m",
            "calibrate the sensor, or declare the larger error before the flight",
        ),
        Assumption.DETECTION_CONSISTENCY: Cure(
            "sightings of one obstacle are farther apart than their stated errors: a wrong "
            "mounting or scale, a moving obstacle, or an estimate that drifts",
            "measure the mounting (x, y, z, yaw) again; replay the log with `clearway report`; "
            "declare the error that the report shows",
        ),
        Assumption.SENSOR_CLOCK: Cure(
            "stamps lie in the future, go back, or are older than a frame may be",
            "set both computers' clocks by one source (chrony, PTP); let the driver stamp at the "
            "exposure and not at the arrival",
        ),
        Assumption.SENSOR_CONTRADICTION: Cure(
            "an obstacle is reported where all was seen free: the sensor missed it, or reports "
            "what is not there, or it moved",
            "land and look; do not fly with a sensor that misses obstacles: test it with "
            "`clearway sensor check` and a known obstacle",
        ),
        Assumption.OBSTACLE_SIZE: Cure(
            "an obstacle is larger than obstacle_size_max_m",
            "nothing for safety; for a guaranteed arrival declare the larger size, or lead the "
            "mission around it",
        ),
        Assumption.ROI_INTERSECTION: Cure(
            "two obstacles are nearer to each other than obstacle_separation_min_m",
            "nothing for safety; for a guaranteed arrival declare the distance and fly slower, or "
            "accept best effort",
        ),
        Assumption.LATE_FIRST_SIGHT: Cure(
            "an obstacle was first seen inside its region: it was hidden, or the sensor sees less "
            "far than declared",
            "declare the range at which such an obstacle is seen (dark, thin or wet ones count)",
        ),
        Assumption.MOVER_FIRST_SIGHT: Cure(
            "a mover was first seen where none could be: the sensor missed it, or it came out of "
            "hiding",
            "declare hidden: true for its class, or a range at which the sensor misses none",
        ),
        Assumption.MOVER_CLASS: Cure(
            "a mover was faster than speed_max_mps of its class, or larger than size_max_m",
            "declare what it is; `clearway contract show` says what that requires",
        ),
        Assumption.STATIC_CLAIM: Cure(
            "what a sensor says stands still has moved by more than its errors",
            "have the sensor state motion: unknown for what may move, such as parked cars",
        ),
        Assumption.REST_SPEED: Cure(
            "the vehicle moved although its setpoint had rested for rest_settle_s",
            "measure the time from a setpoint at rest to a vehicle at rest, and declare that; "
            "tune the position controller",
        ),
        Assumption.YIELD_TIME: Cure(
            "movers have kept the vehicle waiting for longer than yield_max_s",
            "take over, or `clearway resume` once they are gone; lead the mission elsewhere",
        ),
        Assumption.MOVER_VIEW: Cure(
            "passive_in_view: at rest for so long that movers may have come to the vehicle, out of "
            "the sensor's view",
            "look around the vehicle; `clearway resume` says that no mover is within "
            "start_clear_of_movers_m of it; a sensor that sees all round needs no such word",
        ),
        Assumption.TRACKING_ERROR: Cure(
            "the vehicle was farther from its reference than tracking_error_m: wind, tuning, load, "
            "or a tilt limit of the autopilot",
            "`clearway identify LOG` states the error to declare; tune the position controller, or "
            "fly slower; then take over and hand back",
        ),
        Assumption.TRACKING_ERROR_Z: Cure(
            "the vehicle was farther from the planned height than tracking_error_z_m",
            "`clearway identify LOG` states the error to declare; check barometer cover and "
            "throttle tuning; then take over and hand back",
        ),
        Assumption.VELOCITY_ERROR: Cure(
            "the vehicle was faster than its reference by more than velocity_error_mps",
            "`clearway identify LOG` states the errors to declare; then take over and hand back",
        ),
        Assumption.TILT_RESPONSE: Cure(
            "the vehicle does not accelerate as its setpoints say: a weak motor, a limit of tilt, "
            "more load, or more wind than declared",
            "land and inspect motors and propellers; compare the tilt parameters with `clearway "
            "preflight --vehicle`",
        ),
        Assumption.TELEMETRY_AGE: Cure(
            "no position has arrived for longer than telemetry_timeout_s: link or autopilot",
            "check cable, baud rate and load of the link; `clearway doctor` names what is silent",
        ),
        Assumption.ESTIMATOR_RESET: Cure(
            "the autopilot's position jumped by more than estimator_reset_max_m in all",
            "wait for a steady GNSS solution before take-off; declare a larger "
            "estimator_reset_max_m if such resets are usual; then take over and hand back",
        ),
        Assumption.POSITION_QUALITY: Cure(
            "the autopilot doubts its position, or what confirmed it at the departure is gone",
            "docs/position.md lists the signs; take over; fly where the GNSS or the camera that "
            "the position rests on works",
        ),
        Assumption.HEADING_ERROR: Cure(
            "the heading contradicts the leg, the gyros, the magnetometer or known obstacles",
            "calibrate the compass away from steel, mount it away from power cables; then take "
            "over and hand back",
        ),
        Assumption.WIND: Cure(
            "the trim of the vehicle says that the wind is stronger than wind_max_mps",
            "wait for less wind, or declare more if the contract still complies",
        ),
        Assumption.FLIGHT_TIME: Cure(
            "flight_time_max_s since the take-off is over: the estimate may have drifted farther "
            "than position_drift_mps allows for",
            "land; declare a longer flight_time_max_s with the drift that it brings",
        ),
        Assumption.SECOND_COMMANDER: Cure(
            "another computer commands the vehicle: a ground station, a script, a second daemon",
            "stop the other one; find it by its system id in the .tlog (`clearway export --tlog`)",
        ),
        Assumption.TICK_OVERRUN: Cure(
            "a tick of the daemon came late, once: the computer was busy or asleep",
            "nothing; if it comes back, see late_ticks",
        ),
        Assumption.LATE_TICKS: Cure(
            "a second tick came late within a minute: the computer is overloaded or throttled",
            "give the daemon a core and real-time priority (`clearway service install` does), cool "
            "the computer, stop other work",
        ),
        Assumption.PLAN_EXISTS: Cure(
            "the planner found no way past an obstacle as the contract demands",
            "nothing where a way to rest is held; else take another line, or fly slower",
        ),
        Assumption.NO_PASSAGE: Cure(
            "25 looks on a leg, or 90 s of them from one place, have found no way, or the place of "
            "the start is not seen free",
            "look at the live view: move the leg, reduce radius or tracking error, or fly around "
            "by hand and hand back behind it",
        ),
        Assumption.LEG_END_CLEAR: Cure(
            "an obstacle stands too near to the end of the leg for the vehicle to rest there",
            "move the end of the leg, or widen its target_half_width_m",
        ),
        Assumption.TARGET_REACHED: Cure(
            "the leg ended farther beside its end than target_half_width_m",
            "widen target_half_width_m, or switch recentring on in the contract",
        ),
        Assumption.SELF_CHECK: Cure(
            "a defect of the service itself: an exception, or a rejected certificate",
            "take over and land; report it with the flight's log",
        ),
    }
)
