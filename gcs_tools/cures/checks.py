"""The cure of every clause, rule and finding of the pre-flight check, by its name."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from gcs_tools.cures.cure import Cure
from onboard.monitoring.assumptions import Assumption

_SOLVE: Final = "the check prints the least change of each key that satisfies it"

# Clauses of the contract, and rules of field, mission and geofence.
RULE_CURES: Final[Mapping[str, Cure]] = MappingProxyType(
    {
        "thrust": Cure(
            "height cannot be kept at the roll and pitch limits together",
            "lower roll_max_deg and pitch_max_deg, or state the measured thrust_to_weight",
        ),
        "wind": Cure("the wind takes more tilt than the contract has", f"fly slower; {_SOLVE}"),
        "ground_clearance": Cure(
            "the mission is lower than body, height error and resets together",
            "raise the mission's altitude_m",
        ),
        "terrain": Cure(
            "the mission is lower than the highest ground, body, height error and drift together",
            "raise the mission's altitude_m, or survey the ground and state terrain_max_m",
        ),
        "top_visibility": Cure(
            "the view up and down is too narrow for the heights flown at",
            f"a sensor of a taller view, smaller height errors, or fly slower; {_SOLVE}",
        ),
        "detection_range": Cure(
            "an obstacle is seen too late to be avoided at this speed", f"fly slower; {_SOLVE}"
        ),
        "edge_visibility": Cure(
            "the edges of the largest obstacle are not seen in time", f"fly slower; {_SOLVE}"
        ),
        "field_of_view": Cure(
            "the view is too narrow for the edges of the largest obstacle",
            f"a wider sensor, or smaller obstacles; {_SOLVE}",
        ),
        "seen_free_view": Cure(
            "too little is seen at once for a way to rest in seen-free space",
            "a sensor of a wider view; requirements.stop rests on it",
        ),
        "stop": Cure("the vehicle cannot stop within its range", f"fly slower; {_SOLVE}"),
        "sensor_silence": Cure(
            "the vehicle cannot stop in time after the last frame",
            f"shorten frame_age_max_s, or fly slower; {_SOLVE}",
        ),
        "passive_safety": Cure(
            "the run after the setpoint stream ends leads beyond what is seen",
            f"shorten the autopilot's setpoint-loss time and setpoint_loss_timeout_s; {_SOLVE}",
        ),
        "stoppable": Cure(
            "braking for a mover reaches into a region that was not to be entered yet",
            "nothing for safety: the vehicle stops more often",
        ),
        "emergence": Cure(
            "movers hide behind obstacles, and these stand too near to each other to be passed "
            "with room for who comes out",
            f"nothing for safety: the vehicle waits; fly slower; {_SOLVE}",
        ),
        "emergence_range": Cure(
            "movers hide behind obstacles, and the sensor sees too little ahead to pass these with "
            "room for who comes out",
            f"nothing for safety: the vehicle waits; a longer range, or slower; {_SOLVE}",
        ),
        "recentring": Cure(
            "the view is too narrow to drift back to the line of the leg",
            f"switch recentring off, or take it slower; {_SOLVE}",
        ),
        "separation": Cure(
            "obstacles stand nearer to each other than avoiding one needs",
            f"fly slower, or accept best effort; {_SOLVE}",
        ),
        "seen_free_range": Cure(
            "even at 0.5 m/s the vehicle cannot stop within what is seen free",
            "a longer range, a shorter setpoint-loss time, or smaller errors",
        ),
        "start_clear": Cure(
            "the start lies in a region of influence, or the operator's word start_clear_m is too "
            "small for the first hover",
            "move the start, or make sure that nothing stands within the stated radius and say so",
        ),
        "start_clear_of_movers": Cure(
            "passive_in_view: the operator vouches for too little around the start, or for "
            "nothing, where the sensor does not see who is beside or behind",
            "make sure, as control is granted, that no mover is within the stated radius, and say "
            "so: start_clear_of_movers_m; or fly with a sensor that sees all round",
        ),
        "start_room": Cure(
            "an obstacle stands where the vehicle first hovers", "move the mission's start_ned_m"
        ),
        "end_clear": Cure("a leg ends in a region of influence", "move the end of that leg"),
        "obstacle_size_max": Cure(
            "the field has a larger obstacle than declared", "declare obstacle_size_max_m"
        ),
        "obstacle_size_min": Cure(
            "the field has a smaller obstacle than declared", "declare obstacle_size_min_m"
        ),
        "thinnest_obstacle": Cure(
            "the field has a thinner obstacle than the sensor resolves",
            "declare thinnest_obstacle_m, and a sensor or a range that resolves it",
        ),
        "placement": Cure(
            "the field is not where the mission is",
            "give the field in metres north and east of the mission's origin, in this order",
        ),
        "roi_disjoint": Cure(
            "regions of influence of two obstacles intersect, so that no passage is guaranteed",
            "fly slower (the check prints the fastest compliant cruise), lead the legs elsewhere, "
            "or accept best effort: --accept-no-progress",
        ),
        "geofence": Cure(
            "legs with their avoidances leave the geofence", "widen the fence, or move the legs"
        ),
        "corridors": Cure(
            "vehicles of a fleet may meet, or no geofence keeps one of them in a corridor",
            "give each a geofence of its own, or move the legs apart",
        ),
    }
)

_MESSAGE_RATE: Final = Cure(
    "the message comes too seldom on this link",
    "raise its rate (PX4: `mavlink stream`; ArduPilot: MAVn_*, SRn_*), or the baud rate",
)
_RAISE_SENSOR: Final = "lower the speed, or declare what the sensor can do"

# Findings on vehicle, sensors and daemon; those on parameters are named after the parameter.
FINDING_CURES: Final[Mapping[str, Cure]] = MappingProxyType(
    {
        "connection": Cure(
            "no autopilot was heard, or several were",
            "check the URL, and that the autopilot or a router sends to it; --system-id selects",
        ),
        "identity": Cure("which vehicle it is", "nothing"),
        "health": Cure(
            "the autopilot is not ready to arm",
            "wait for GNSS and estimator; the ground station shows what is not ready",
        ),
        "firmware": Cure(
            "this firmware is older than, or newer than, those whose parameters are known",
            "docs/vehicles.md says which versions were measured",
        ),
        "ATTITUDE": _MESSAGE_RATE,
        "LOCAL_POSITION_NED": _MESSAGE_RATE,
        "link delay": Cure(
            "an answer takes longer than reaction_time_s",
            "shorten the link, or state its time in reaction_time_s",
        ),
        "clock": Cure(
            "the clock jumps, or stamps lie in the future of the daemon's",
            "take what sets the clock off the link; set clocks by one source (chrony, PTP)",
        ),
        "estimator": Cure(
            "the estimator is not sure of itself",
            "wait; calibrate; keep the compass away from steel: docs/position.md",
        ),
        "setpoint_loss": Cure(
            "the contract states how another autopilot brakes when the setpoints end",
            "take the contract of this autopilot: `clearway init --vehicle px4|ardupilot`",
        ),
        "parameters": Cure(
            "no rules are known for this autopilot",
            'add a profile (CONTRIBUTING.md, "an autopilot profile")',
        ),
        "take-over": Cure(
            "it is not known how the pilot takes over", "switch the radio on, ask again"
        ),
        "home": Cure(
            "home and local origin are at different heights",
            "start the estimator where the vehicle stands: reboot the autopilot there",
        ),
        "start": Cure(
            "the vehicle does not stand at the start of the mission",
            "carry it there, or change the mission",
        ),
        "battery": Cure(
            "the charge is too little for the mission, or unknown",
            "charge it, or state the hover time: `clearway preflight --endurance S`",
        ),
        "failsafes": Cure("what the autopilot's failsafes will do", "read it before the flight"),
        "geofence": Cure(
            "no geofence is set by parameters, or it is too small", "set it, or shorten the legs"
        ),
        "geofence areas": Cure(
            "the legs with their avoidances cross an area of the fence on board",
            "correct the fence in the ground station and upload it",
        ),
        "contract": Cure(
            "the daemon has another contract, or did not answer",
            "start the daemon again, so that it reads the file: `systemctl restart clearway`",
        ),
        "detections": Cure(
            "the daemon's newest frame is too old",
            "start the silent sensor again; `clearway sensor check`",
        ),
        "mission": Cure(
            "the mission on board was not read, or cannot be flown",
            "upload a mission of items that docs/missions.md lists as flown",
        ),
        "telemetry": Cure(
            "the position on the daemon's link is too old",
            "check mavlink.url and cable; raise the baud rate",
        ),
        "VIRTUAL OBSTACLES": Cure(
            "a sensor of kind field_file shows obstacles that are not there, and nothing that is",
            "fly in open ground only; among real obstacles, state a real sensor in `sources`",
        ),
        "flight authorization": Cure(
            "the check has not passed, or the daemon did not confirm it",
            "cure the other findings; let --zenoh-config reach the daemon",
        ),
        "frames": Cure(
            "no detection frame was heard",
            "start the sensor, and let it connect to the daemon's zenoh.listen",
        ),
        "format": Cure("frames were malformed", "correct the message as the text says"),
        "age": Cure(
            "the newest frame is too old at times", f"raise the frame rate; {_RAISE_SENSOR}"
        ),
        "reaction": Cure(
            "an object is reported too late", f"shorten the way of a frame; {_RAISE_SENSOR}"
        ),
        "order": Cure("stamps do not increase", "stamp each frame once, at its exposure"),
        "resolution": Cure(
            "bearings are farther apart than the thinnest obstacle is wide",
            "more bearings, a shorter detection_range_m, or a wider thinnest_obstacle_m",
        ),
        "declares": Cure("what the sensor states agrees with the contract", "nothing"),
        "all_round": Cure(
            "no sensor with a view of 360 degrees is heard in time, which movers require",
            "start it; its frames state field_of_view_deg: 360, or all its sectors are known",
        ),
        "no_return_is_free_to_m": Cure(
            "what returns nothing shows no place free of movers, so that none is in the open",
            "state how far a beam without a return surely shows free space",
        ),
        "frame_complete": Cure(
            "frames of the sensor that sees all round show no place free of movers",
            "name everything within range and view in each frame, and say so: frame_complete: true",
        ),
        "range_m": Cure("the sensor sees less far than the contract says", _RAISE_SENSOR),
        "uncertainty_m": Cure("the sensor errs more than position_error_m", _RAISE_SENSOR),
        "box_max_m": Cure(
            "boxes may become larger than obstacle_size_max_m", "lower box_max_m of the sensor"
        ),
        "field of view": Cure(
            "blind sectors and mounting leave less than field_of_view_deg around the nose",
            "turn the sensor, or declare the narrower view",
        ),
        "latency_s": Cure(
            "the sensor's declared latency takes all of reaction_time_s",
            "declare a longer reaction_time_s",
        ),
        "height_band_m": Cure(
            "the scan leaves the heights that every obstacle spans, or meets the ground",
            "state height_band_m as the field is, or fly higher, or tilt less",
        ),
        "sensor": Cure(
            "the daemon does not hear a sensor of its file", "`clearway sensor check` says why"
        ),
        Assumption.DETECTION_RANGE.value: Cure(
            "a frame states a shorter range than the contract", _RAISE_SENSOR
        ),
        Assumption.FIELD_OF_VIEW.value: Cure(
            "a frame states a narrower view than the contract", _RAISE_SENSOR
        ),
        Assumption.DETECTION_UNCERTAINTY.value: Cure(
            "a frame states a larger error than the contract", _RAISE_SENSOR
        ),
    }
)


def cure_of_finding(name: str) -> str:
    """Return what to do about a finding that does not hold.

    Args:
        name: of the finding; a parameter's is in capitals.  Names of sensors may come before it.
    """
    known = next((c for key, c in FINDING_CURES.items() if f" {name}".endswith(f" {key}")), None)
    if known is not None:
        return known.cure
    if name.isupper() and "_" in name:
        return f"set {name} as it says, in the ground station or by `param set`"
    return FINDING_CURES["sensor"].cure
