"""The profile of an autopilot: everything that the software knows of one kind of autopilot.

A profile is data: modes, messages to request, how its estimator reports trouble, take-off, and the
rules on its parameters.  `onboard.mavlink.profiles.registry` finds the profile by the MAV_AUTOPILOT
value of a heartbeat, and tells how to add one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, Literal, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from onboard.mavlink.profiles.parameter_rules import (
    ContractDemands,
    Failsafe,
    MissionDemands,
    ParameterRule,
    Release,
    ReportedParameters,
)

POSITION_RATE_HZ: Final = 50.0
# Its interval shares no divisor with that of setpoints, 20 ms: an echo in step with ours would
# leave just after each of them, and never show another commander's.
TARGET_RATE_HZ: Final = 1000.0 / 37.0

# Message ids and rates that the service needs of every autopilot; one sends GPS data no more often
# than its receiver does.
COMMON_REQUESTS_HZ: Final = (
    (mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED, POSITION_RATE_HZ),
    (mavlink.MAVLINK_MSG_ID_ATTITUDE, POSITION_RATE_HZ),
    (mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE, 5.0),
    (mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED, TARGET_RATE_HZ),
    (mavlink.MAVLINK_MSG_ID_GPS_RAW_INT, 5.0),
    (mavlink.MAVLINK_MSG_ID_SYS_STATUS, 2.0),
)
ESTIMATOR_RATE_HZ: Final = 5.0


class EstimatorMessage(NamedTuple):
    """A message by which an estimator reports on itself, and the names of its fields.

    Attributes:
        message_id: number of the message.
        name: of the message.
        velocity, position, height, heading: fields with the ratio of innovations to where the
            estimator rejects them.
        accuracy: field with the horizontal accuracy [m]; None if the message has none.
    """

    message_id: int
    name: str
    velocity: str
    position: str
    height: str
    heading: str
    accuracy: str | None


# https://mavlink.io/en/messages/common.html#ESTIMATOR_STATUS
ESTIMATOR_STATUS: Final = EstimatorMessage(
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS,
    "ESTIMATOR_STATUS",
    "vel_ratio",
    "pos_horiz_ratio",
    "pos_vert_ratio",
    "mag_ratio",
    "pos_horiz_accuracy",
)
# https://mavlink.io/en/messages/ardupilotmega.html#EKF_STATUS_REPORT
EKF_STATUS_REPORT: Final = EstimatorMessage(
    mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
    "EKF_STATUS_REPORT",
    "velocity_variance",
    "pos_horiz_variance",
    "pos_vert_variance",
    "compass_variance",
    None,
)
ESTIMATOR_MESSAGES: Final = (ESTIMATOR_STATUS, EKF_STATUS_REPORT)

# ESTIMATOR_STATUS_FLAGS and EKF_STATUS_FLAGS agree up to PRED_POS_HORIZ_ABS.  A position is good
# only if one flag of each of these is set.
NEEDED_ESTIMATOR_FLAGS: Final = (
    (mavlink.ESTIMATOR_ATTITUDE, "attitude"),
    (mavlink.ESTIMATOR_VELOCITY_HORIZ, "horizontal velocity"),
    (mavlink.ESTIMATOR_VELOCITY_VERT, "vertical velocity"),
    (
        mavlink.ESTIMATOR_POS_HORIZ_ABS | mavlink.ESTIMATOR_POS_HORIZ_REL,
        "horizontal position",
    ),
    (mavlink.ESTIMATOR_POS_VERT_ABS | mavlink.ESTIMATOR_POS_VERT_AGL, "vertical position"),
)
# Both sets of flags share this one too: the estimator assumes that the vehicle does not move.
CONSTANT_POSITION: Final[Mapping[int, str]] = MappingProxyType(
    {mavlink.ESTIMATOR_CONST_POS_MODE: "constant position mode"}
)


@dataclass(frozen=True, eq=False)
class EstimatorFacts:
    """How an autopilot reports what its position is worth.

    Attributes:
        message: in which its estimator reports on itself.
        made_up_flags: each means that the position is made up, in flight.
        doubt_flags: each means that the estimator doubts a sensor.
        ratio_max: greatest innovation ratio of velocity, position and height.
        position_health: SYS_STATUS bits that stand for the position estimate itself.
        texts: STATUSTEXT, lower case, that says that the estimate is in trouble.
        cleared: words in such a text that say the opposite.
        constant_at_rest: whether it assumes a constant position whenever the vehicle rests.
    """

    message: EstimatorMessage
    made_up_flags: Mapping[int, str]
    doubt_flags: Mapping[int, str]
    ratio_max: float
    position_health: int
    texts: tuple[str, ...]
    cleared: tuple[str, ...] = ("cleared", "dead reckoning stopped", "is using")
    constant_at_rest: bool = False


class Mode(NamedTuple):
    """A flight mode as MAV_CMD_DO_SET_MODE takes it.

    Attributes:
        name: for people; the same that `Modes.name_of` returns.
        main, sub: parameters 2 and 3 of the command.
    """

    name: str
    main: float
    sub: float = 0.0


@dataclass(frozen=True, eq=False)
class Modes:
    """How an autopilot encodes its flight modes.

    Attributes:
        name_of: returns the name of a HEARTBEAT.custom_mode.
        external_control: the mode that obeys our setpoints; None if it is not known.
        hold: the mode in which the vehicle stays where it is; None if it is not known.
    """

    name_of: Callable[[int], str]
    external_control: Mode | None = None
    hold: Mode | None = None

    def is_external_control(self, custom_mode: int) -> bool:
        """Tell whether a HEARTBEAT.custom_mode obeys our setpoints."""
        wanted = self.external_control
        return wanted is not None and self.name_of(custom_mode) == wanted.name


@dataclass(frozen=True)
class TakeOff:
    """How the operator makes the vehicle take off, by MAV_CMD_NAV_TAKEOFF.

    Attributes:
        in_external_control: whether it takes off in the mode that obeys our setpoints.  Then the
            service may fly on as soon as the height is reached; else the vehicle comes to rest
            first, in a mode of its own.
        height_parameter: the parameter that sets the height [m]; None if the command carries the
            height above the local origin.
    """

    in_external_control: bool = False
    height_parameter: str | None = None


@dataclass(frozen=True)
class TakeOver:
    """How a pilot takes the vehicle over from the service, for the operator to read.

    Attributes:
        with_radio: by what, while the vehicle hears a radio.
        without_radio: by what else.
        sticks_ignored: name and value of the parameter that makes it ignore a radio's sticks;
            None if there is none.
    """

    with_radio: str
    without_radio: str
    sticks_ignored: tuple[str, float] | None = None


class Measured(NamedTuple):
    """Firmware that flew with this service.

    Attributes:
        release: major and minor number.
        stages: of development, as AUTOPILOT_VERSION states them.
        text: the same for people.
    """

    release: Release
    stages: tuple[str, ...]
    text: str


@dataclass(frozen=True)
class Firmware:
    """Which firmware is known.

    Attributes:
        measured: what flew with this service.
        oldest, newest: releases whose parameter lists the rules were written from.
    """

    measured: Measured
    oldest: Release
    newest: Release


@dataclass(frozen=True, eq=False)
class ParameterFacts:
    """The parameters of an autopilot that matter to this service, and the rules on them.

    Attributes:
        setpoint_timeout: name of the time without setpoints after which the autopilot acts [s].
        no_radio: name and value of the parameter that says that the vehicle has no radio.
        fence_prefixes: how the names of parameters of its geofence begin.
        rules: returns what a contract demands of the parameters.
        fence_rules: returns what a mission demands of them.
        failsafes: what its failsafes do.
        energy_rules: returns what a reserve of the battery, from 0 to 1, demands of them.
        fence_count: name of the number of items of a geofence that is kept like a mission; None
            if there is none.
    """

    setpoint_timeout: str
    no_radio: tuple[str, float]
    fence_prefixes: tuple[str, ...]
    rules: Callable[[ContractDemands, ReportedParameters], list[ParameterRule]]
    fence_rules: Callable[[MissionDemands, ReportedParameters], list[ParameterRule]]
    failsafes: tuple[Failsafe, ...] = ()
    energy_rules: Callable[[float, ReportedParameters], list[ParameterRule]] | None = None
    fence_count: str | None = None


@dataclass(frozen=True, eq=False)
class AutopilotProfile:
    """Everything that the software knows of one kind of autopilot.

    Attributes:
        autopilot: MAV_AUTOPILOT, as its heartbeat states it.
        key: in configuration files, in lower case.
        name: for people.
        modes: how it encodes its flight modes.
        estimator: how it reports what its position is worth.
        take_off: how it takes off.
        take_over: how the pilot takes it over.
        target_gain_max_per_s: POSITION_TARGET_LOCAL_NED may show the velocity that we asked for
            plus the position error times a gain up to this; 0 if it echoes setpoints as they are.
        after_setpoint_loss: how it runs on when the setpoint stream stops, as a contract's
            setpoint_loss.model; None if that is not known.
        needs_health_request: whether it sends nothing of its health unless asked.
        firmware: which is known; None if none is.
        parameters: None if they are not known.
    """

    autopilot: int
    key: str
    name: str
    modes: Modes
    estimator: EstimatorFacts
    take_off: TakeOff
    take_over: TakeOver
    target_gain_max_per_s: float
    after_setpoint_loss: Literal["coast", "frozen"] | None = None
    needs_health_request: bool = False
    firmware: Firmware | None = None
    parameters: ParameterFacts | None = None

    @property
    def requested_hz(self) -> tuple[tuple[int, float], ...]:
        """Message ids that the service requests, with their rates [Hz]."""
        return (*COMMON_REQUESTS_HZ, (self.estimator.message.message_id, ESTIMATOR_RATE_HZ))
