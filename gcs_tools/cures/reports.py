"""The cure of every refusal to depart or to resume, and of every kind of event."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from gcs_tools.cures.cure import Cure
from onboard.events import EventName
from onboard.guidance.departure import RefusalKind

_NOTHING: Final = "nothing"

REFUSAL_CURES: Final[Mapping[RefusalKind, Cure]] = MappingProxyType(
    {
        RefusalKind.HOLDING: Cure(
            "the hold before this one has not been ended by the pilot",
            "switch to another mode and back: the pilot takes over and hands back",
        ),
        RefusalKind.NOT_HOLDING: Cure(
            "`clearway resume` ends a hold, and the daemon does not hold",
            "hand over the mode instead: the daemon departs by itself",
        ),
        RefusalKind.FAILED: Cure(
            "what ended the flight has not held again for 3 s, or only the pilot may end this hold",
            "cure the assumption that it names, below; else take over and hand back",
        ),
        RefusalKind.MISSION_CHANGED: Cure(
            "another mission was received in the hold",
            "take over and hand back: the daemon then flies the new mission",
        ),
        RefusalKind.CONTRACT: Cure(
            "a clause of the contract does not hold, or the autopilot brakes otherwise after the "
            "setpoint stream ends than the contract says",
            "`clearway preflight --contract F` names the least change that satisfies each clause; "
            "`clearway init --vehicle px4|ardupilot` has the model of each autopilot",
        ),
        RefusalKind.PREFLIGHT: Cure(
            "require_preflight is set, and no check of this contract has passed lately",
            "`clearway preflight --contract F --mission F --vehicle URL --zenoh-config F`, with "
            "the contract that the daemon has",
        ),
        RefusalKind.NO_WAY_BACK: Cure(
            "`clearway return` was asked where no way back is held, or not in flight",
            "take over and fly back by hand, or land",
        ),
        RefusalKind.ENERGY: Cure(
            "the battery does not suffice for the mission and the certified return",
            "charge it, or shorten the mission",
        ),
        RefusalKind.GEOFENCE: Cure(
            "the legs with their avoidances leave the geofence", "move the legs, or widen the fence"
        ),
        RefusalKind.OTHER_DAEMON: Cure(
            "a second daemon of the same system id and component 196 is on the vehicle's link",
            "stop one of both; one daemon flies one vehicle (docs/connecting.md)",
        ),
        RefusalKind.START_WORD: Cure(
            "passive_in_view needs the operator's word, as departure or resume is granted, that no "
            "mover is near the vehicle, and a mover is seen there, or too little is vouched for",
            "state start_clear_of_movers_m in the mission, as far as pre-flight says, and grant "
            "control once no mover is so near; or fly with a sensor that sees all round",
        ),
        RefusalKind.MISSION: Cure(
            "the mission is read from the vehicle, and what is on board was not read, or cannot be "
            "flown",
            "upload a mission of items that docs/missions.md lists as flown; state vehicle_mission "
            "in the daemon's file for what it does not state",
        ),
        RefusalKind.LEFT_FLIGHT: Cure(
            "the daemon was restarted in flight, at a later leg of its mission",
            "`clearway resume`, or take over and hand back to begin at the first leg",
        ),
        RefusalKind.NO_PROGRESS: Cure(
            "`clearway resume` was asked on the ground or in standby, and no flight was left",
            "hand over the mode: the mission begins at its first leg",
        ),
        RefusalKind.PROGRESS_VOID: Cure(
            "mission, contract or home have changed since the flight that was left",
            "fly the mission from its start, or state again what was changed",
        ),
        RefusalKind.DETECTIONS: Cure(
            "a sensor has not been heard, its newest frame is too old or stamped wrongly, or its "
            "frames do not tell where no mover is",
            "`clearway doctor` names the silent sensor, `clearway sensor check` what its messages "
            "lack",
        ),
        RefusalKind.CONTRADICTION: Cure(
            "sightings of an obstacle contradict each other",
            "wait 2 s; if it stays, measure the mounting of the sensor again",
        ),
        RefusalKind.TELEMETRY: Cure(
            "no position has been received lately",
            "check mavlink.url, cable and baud rate; `clearway doctor` says what arrives instead",
        ),
        RefusalKind.POSITION: Cure(
            "the autopilot does not vouch for its position, or nothing confirms it",
            "wait for the estimator with a view of the sky; let the autopilot send "
            "ESTIMATOR_STATUS or EKF_STATUS_REPORT, GPS_RAW_INT and SYS_STATUS; docs/position.md",
        ),
        RefusalKind.WIND: Cure(
            "the wind is stronger than wind_max_mps",
            "wait, or declare more wind if the contract still complies",
        ),
        RefusalKind.FLIGHT_TIME: Cure(
            "flight_time_max_s since the take-off is over", "land, and take off again"
        ),
        RefusalKind.BEFORE_LEG: Cure(
            "the vehicle hovers too far before the start of the leg",
            "fly to the mission's start_ned_m, or set that to where the vehicle is",
        ),
        RefusalKind.LEG_FLOWN: Cure(
            "the vehicle is at the end of the leg already", "send another mission, or land"
        ),
        RefusalKind.BESIDE_LEG: Cure(
            "the vehicle hovers too far beside the leg",
            "fly back to the line of the leg, or widen the leg's target_half_width_m",
        ),
        RefusalKind.OFF_HEIGHT: Cure(
            "the vehicle hovers above or below the mission's altitude_m",
            "take off to altitude_m before the daemon is given the mode",
        ),
        RefusalKind.MOVING: Cure(
            "the vehicle is not at rest", "let it come to rest, with centred sticks"
        ),
        RefusalKind.INSIDE_REGION: Cure(
            "the vehicle hovers inside the region of influence of an obstacle",
            "fly back along the leg until it is outside, or accept best effort",
        ),
        RefusalKind.FLEET: Cure(
            "in a fleet the vehicle may not take off from where it is: its place on the Earth is "
            "not known, another one may be there, or has given no leave",
            "correct what the text names; set the origin of the fleet's file "
            "(SET_GPS_GLOBAL_ORIGIN), and start the daemon where the vehicle stands",
        ),
        RefusalKind.ENVIRONMENT: Cure(
            "what is seen from here breaks the contract's environment",
            "cure the assumption that it names, below, or begin elsewhere",
        ),
    }
)

EVENT_CURES: Final[Mapping[EventName, Cure]] = MappingProxyType(
    {
        EventName.ACCEPTED: Cure(
            "the operator has accepted that the next flight may not arrive", _NOTHING
        ),
        EventName.ADAPTED: Cure(
            "the contract was solved again for what was measured; the vehicle flies slower",
            "declare before the next flight what was measured",
        ),
        EventName.BATTERY: Cure(
            "the battery is at its reserve: the vehicle returns along the flown way, or lands",
            "let it return; land, and charge it",
        ),
        EventName.BLOCKED: Cure(
            "other vehicles of the fleet have given no leave for `yield_max_s` (60 s where the "
            "contract does not state it); the vehicle waits at rest and goes on by itself",
            "move away the vehicle that the text names, or end its flight: it gives up what it "
            "holds; if its daemon does not run, start it where it stands",
        ),
        EventName.CERTIFICATE: Cure(
            "a trajectory did not certify and was not flown", "report it with the flight's log"
        ),
        EventName.COMMAND_REFUSED: Cure(
            "an operator's command was not authentic, or was a replay",
            "give the command the daemon's operator key; set both clocks (they may differ by 30 s)",
        ),
        EventName.DELAYED: Cure(
            "the vehicle slows down, stops or looks round on the way that it holds", _NOTHING
        ),
        EventName.CLOCK_STEP: Cure(
            "this computer's clock was set; the daemon follows while disarmed",
            "set the clock before arming: order the daemon after time-sync.target",
        ),
        EventName.ESTIMATOR_RESET: Cure(
            "the estimate jumped within estimator_reset_max_m; map and plan have moved along",
            _NOTHING,
        ),
        EventName.FAILSAFE: Cure(
            "the autopilot's own failsafe has taken the mode",
            "let it act, or take over; the ground station names its cause (battery, radio, fence)",
        ),
        EventName.FLEET_REFUSED: Cure(
            "a message of the fleet was dropped, or not sent; the text says why",
            "give all vehicles the same fleet.yaml, its contracts and the fleet's key; restart",
        ),
        EventName.FLIGHT_LEFT: Cure(
            "the last flight of this mission was left before its end",
            "`clearway resume` goes on there; without it the mission begins at its first leg",
        ),
        EventName.FLIGHT_RESUMED: Cure(
            "the flight that was left goes on, as soon as control is granted", _NOTHING
        ),
        EventName.HANDED_OVER: Cure(
            "the position is gone: the vehicle is left to the autopilot's failsafe",
            "take over by hand",
        ),
        EventName.HOLD_REPLANNED: Cure(
            "the way to the hold was planned again", "see the violation before it"
        ),
        EventName.LINK_REFUSED: Cure(
            "MAVLink messages were refused for their signature, or the vehicle signs and no key "
            "is set",
            "configure the vehicle's signing key in the daemon's file",
        ),
        EventName.LOG_ENDED: Cure(
            "the log cannot be written; the flight goes on",
            "free the disk, or set log_directory and log_quota_mb",
        ),
        EventName.MERGED: Cure(
            "two obstacles whose regions intersect are avoided as one",
            "for a guaranteed arrival see roi_intersection",
        ),
        EventName.MISSION_CHANGED: Cure("another mission was accepted", _NOTHING),
        EventName.MISSION_READ: Cure(
            "mission and geofence on board have been read, or have changed", _NOTHING
        ),
        EventName.MISSION_REFUSED: Cure(
            "a mission at another altitude was received in flight, one leaves the geofence, or the "
            "one on board cannot be flown",
            "correct what the text names; at another altitude, send it before the take-off",
        ),
        EventName.PEER_DEVIATES: Cure(
            "another vehicle of the fleet is outside of what it has leave for: its pilot flies it, "
            "or it is astray; this one rests where that one may come",
            "land it, or leave it at rest: it then asks for leave to be where it is",
        ),
        EventName.PEER_SILENT: Cure(
            "nothing is heard of another vehicle of the fleet; what it held stays its own",
            "start its daemon; see that both are on one Zenoh network (docs/fleet.md)",
        ),
        EventName.PHASE: Cure("the automaton has changed its phase", _NOTHING),
        EventName.PLAN_KEPT: Cure(
            "an avoidance that was planned before is flown, as nothing better certifies", _NOTHING
        ),
        EventName.POST_CONDITION: Cure(
            "an avoidance did not end as the induction needs",
            "report it with the flight's log; the vehicle brakes to hover",
        ),
        EventName.PRE_CONDITION: Cure(
            "an avoidance begins outside of what the induction needs",
            "see the violation beside it; the step is planned from where the vehicle is",
        ),
        EventName.REFUSED: Cure(
            "the daemon does not depart, or does not resume", "see the refusals above"
        ),
        EventName.REPLANNED: Cure("an avoidance was planned again for what is seen", _NOTHING),
        EventName.SENSOR_REFUSED: Cure(
            "messages of a sensor were dropped; the text says which rule they break",
            "correct the driver: `clearway sensor check` shows each kind with its count",
        ),
        EventName.SUSPICION: Cure(
            "the vehicle goes astray as it would under a second commander",
            "stop every other program that sends setpoints or missions",
        ),
        EventName.VIOLATION: Cure("an assumption has failed", "see the assumptions below"),
        EventName.VIRTUAL_OBSTACLES: Cure(
            "a sensor of kind field_file shows obstacles that are not there, and nothing that is",
            "fly in open ground only; to fly among real ones, state a real sensor in `sources`",
        ),
    }
)
