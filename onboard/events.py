"""What the service reports to the operator, the log and Zenoh."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum, StrEnum

from pydantic import JsonValue
from typing_extensions import TypedDict  # pydantic refuses that of `typing` before Python 3.12


class Severity(IntEnum):
    """MAV_SEVERITY, the levels in use (https://mavlink.io/en/messages/common.html)."""

    CRITICAL = 2
    ERROR = 3
    WARNING = 4
    NOTICE = 5
    INFO = 6


class EventName(StrEnum):
    """Every kind of event; the value is its name in the log and on Zenoh."""

    ACCEPTED = "accepted"
    ADAPTED = "adapted"
    CERTIFICATE = "certificate"
    DELAYED = "delayed"
    BATTERY = "battery"
    BLOCKED = "blocked"
    CLOCK_STEP = "clock_step"
    COMMAND_REFUSED = "command_refused"
    ESTIMATOR_RESET = "estimator_reset"
    FAILSAFE = "failsafe"
    FLEET_REFUSED = "fleet_refused"
    FLIGHT_LEFT = "flight_left"
    FLIGHT_RESUMED = "flight_resumed"
    HANDED_OVER = "handed_over"
    HOLD_REPLANNED = "hold_replanned"
    LINK_REFUSED = "link_refused"
    LOG_ENDED = "log_ended"
    MERGED = "merged"
    MISSION_CHANGED = "mission_changed"
    MISSION_READ = "mission_read"
    MISSION_REFUSED = "mission_refused"
    PEER_DEVIATES = "peer_deviates"
    PEER_SILENT = "peer_silent"
    PHASE = "phase"
    PLAN_KEPT = "plan_kept"
    POST_CONDITION = "post_condition"
    PRE_CONDITION = "pre_condition"
    REFUSED = "refused"
    REPLANNED = "replanned"
    SENSOR_REFUSED = "sensor_refused"
    SUSPICION = "suspicion"
    VIOLATION = "violation"
    VIRTUAL_OBSTACLES = "virtual_obstacles"


class RefusalReason(TypedDict):
    """One reason for not leaving STANDBY."""

    kind: str
    subject: str
    text: str


# The numbers behind an event; which keys it has depends on its name.  Functional, since ``from`` is
# a keyword.
EventData = TypedDict(
    "EventData",
    {
        # violation
        "assumption": str,
        "measured": float | None,
        "limit": float,
        "unit": str,
        "subject": str,
        # phase
        "from": str,
        "to": str,
        "trigger": str,
        # estimator_reset
        "shift_ned_m": tuple[float, float, float],
        "flight_m": float,
        # mission_changed
        "mission": dict[str, JsonValue],
        # refused
        "reasons": list[RefusalReason],
        # clock_step
        "step_s": float,
        "followed": bool,
    },
    total=False,
)


@dataclass(frozen=True)
class Event:
    """One event.

    Attributes:
        time_s: on the service's clock.
        name: what kind, for programs.
        severity: how bad.
        text: one line for the operator.
        data: the numbers behind it.
    """

    time_s: float
    name: EventName
    severity: Severity
    text: str
    data: EventData = field(default_factory=EventData)
