"""What the service sends to the autopilot, without I/O: setpoints, heartbeats, texts, requests."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from onboard.files.mavlink_frames import FrameWriter
from onboard.mavlink.list_download import MissionRequest
from onboard.mavlink.signing import LinkSigning
from onboard.mavlink.status_text import chunks
from onboard.vehicle_state import Setpoint

COMPONENT_ID: Final = mavlink.MAV_COMP_ID_OBSTACLE_AVOIDANCE
HEARTBEAT_PERIOD_S: Final = 1.0

# Every field of the setpoint is meant except the yaw rate.
_TYPE_MASK: Final = mavlink.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE
# Of OBSTACLE_DISTANCE: 72 sectors.
SECTOR_DEG: Final = 5
SECTOR_MIN_CM: Final = 10
SECTOR_MAX_CM: Final = 6_000
# Of STATUSTEXT: together a tenth of what a serial line at 57,600 baud carries.
_TEXT_PERIOD_S: Final = 0.1
_TEXTS_MAX: Final = 100
_TEXT_ID_MAX: Final = 0xFFFF
_MESSAGES_MAX: Final = 1000


class Transmitter:
    """Encodes messages for one autopilot and queues them until the link takes them.

    Args:
        system_id: MAVLink id of the vehicle, and ours.
        signing: signs every message; None for none.
        instance: of this process, by which others tell it from another daemon of the same ids.
    """

    def __init__(
        self, system_id: int, signing: LinkSigning | None = None, instance: int = 0
    ) -> None:
        self._system_id, self._instance = system_id, instance
        self._outgoing: deque[bytes] = deque(maxlen=_MESSAGES_MAX)
        self._mavlink = FrameWriter(_Sink(self._outgoing, signing), system_id, COMPONENT_ID)
        self._heartbeat_due_s = -math.inf
        # Severity, chunk, id of the text, number of the chunk.
        self._texts: deque[tuple[int, bytes, int, int]] = deque(maxlen=_TEXTS_MAX)
        self._text_due_s = -math.inf
        self._text_id = 0

    def bytes_to_send(self) -> bytes:
        """Return and forget what is to be sent."""
        data = b"".join(self._outgoing)
        self._outgoing.clear()
        return data

    def keep_alive(self, now_s: float, *, active: bool) -> None:
        """Queue the heartbeat and the next chunk of text, where they are due.

        Args:
            now_s: the time.
            active: whether the heartbeat states MAV_STATE_ACTIVE, rather than STANDBY.
        """
        if now_s >= self._heartbeat_due_s:
            self._heartbeat_due_s = now_s + HEARTBEAT_PERIOD_S
            state = mavlink.MAV_STATE_ACTIVE if active else mavlink.MAV_STATE_STANDBY
            kind, autopilot = mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID
            # Only an autopilot has a mode: the field is free otherwise (HEARTBEAT.custom_mode).
            self._mavlink.heartbeat_send(kind, autopilot, 0, self._instance, state)
        if self._texts and now_s >= self._text_due_s:
            self._text_due_s = now_s + _TEXT_PERIOD_S
            self._mavlink.statustext_send(*self._texts.popleft())

    def request(self, requests_hz: Iterable[tuple[int, float]]) -> None:
        """Queue a MAV_CMD_SET_MESSAGE_INTERVAL for each message id and its rate [Hz]."""
        for message_id, rate_hz in requests_hz:
            self._mavlink.command_long_send(
                self._system_id,
                mavlink.MAV_COMP_ID_AUTOPILOT1,
                mavlink.MAV_CMD_SET_MESSAGE_INTERVAL,
                0,
                message_id,
                1e6 / rate_hz,
                *(0,) * 5,
            )

    def send_mission_request(self, request: MissionRequest) -> None:
        """Queue one message of the mission protocol, to the autopilot."""
        autopilot = self._system_id, mavlink.MAV_COMP_ID_AUTOPILOT1
        if request.kind == "list":
            self._mavlink.mission_request_list_send(*autopilot, request.mission_type)
        elif request.kind == "item":
            item = *autopilot, request.number, request.mission_type
            self._mavlink.mission_request_int_send(*item)
        elif request.kind == "done":
            accepted = mavlink.MAV_MISSION_ACCEPTED
            self._mavlink.mission_ack_send(*autopilot, accepted, request.mission_type)
        else:
            command = mavlink.MAV_CMD_REQUEST_MESSAGE
            self._mavlink.command_long_send(*autopilot, command, 0, request.number, *(0,) * 6)

    def send_setpoint(self, setpoint: Setpoint, now_s: float) -> None:
        """Queue one SET_POSITION_TARGET_LOCAL_NED."""
        self._mavlink.set_position_target_local_ned_send(
            int(now_s * 1000.0) & 0xFFFFFFFF,
            self._system_id,
            mavlink.MAV_COMP_ID_AUTOPILOT1,
            mavlink.MAV_FRAME_LOCAL_NED,
            _TYPE_MASK,
            *setpoint.position_ned_m,
            *setpoint.velocity_ned_mps,
            *setpoint.acceleration_ned_mps2,
            setpoint.yaw_ned_rad,
            0.0,
        )

    def send_obstacle_distance(self, sectors_cm: list[int], time_unix_s: float) -> None:
        """Queue one OBSTACLE_DISTANCE around the body.

        Args:
            sectors_cm: 72 distances clockwise from the nose; 65535 where nothing is known.
            time_unix_s: of the map.
        """
        self._mavlink.obstacle_distance_send(
            round(time_unix_s * 1e6),
            mavlink.MAV_DISTANCE_SENSOR_UNKNOWN,
            sectors_cm,
            SECTOR_DEG,
            SECTOR_MIN_CM,
            SECTOR_MAX_CM,
            float(SECTOR_DEG),
            0.0,
            mavlink.MAV_FRAME_BODY_FRD,
        )

    def send_text(self, severity: int, text: str) -> None:
        """Queue a text for the operator.

        It leaves chunk by chunk with `keep_alive`: a burst of texts must not crowd setpoints out
        of a slow link.

        Args:
            severity: MAV_SEVERITY.
            text: as long as it needs to be; `status_text.chunks` shortens it to the limit.
        """
        parts = chunks(text)
        text_id = 0
        if len(parts) > 1:
            self._text_id = text_id = self._text_id % _TEXT_ID_MAX + 1
        self._texts.extend((severity, part, text_id, n) for n, part in enumerate(parts))


class _Sink:
    """The write-only file that pymavlink wants."""

    def __init__(self, queue: deque[bytes], signing: LinkSigning | None) -> None:
        self._queue, self._signing = queue, signing

    def write(self, data: bytes) -> None:
        frame = bytes(data)
        self._queue.append(frame if self._signing is None else self._signing.sign(frame))
