"""When each message is due on a link, and which messages each of the old data streams contains."""

from __future__ import annotations

import math
from collections.abc import Mapping

from pymavlink.dialects.v20 import ardupilotmega as mavlink


class StreamSchedule:
    """When each message is due on one link.

    Args:
        default_rates_hz: what the link gets without a request.
    """

    def __init__(self, default_rates_hz: Mapping[int, float]) -> None:
        self._default_rates_hz = dict(default_rates_hz)
        self._interval_s: dict[int, float] = {}
        self._next_s: dict[int, float] = {}
        self._earliest_s = math.inf
        for message_id, rate_hz in default_rates_hz.items():
            self.set_interval(message_id, 1.0 / rate_hz, 0.0)

    def set_interval(self, message_id: int, interval_s: float, now_s: float) -> None:
        """Send the message at this interval from now on; ``inf`` stops it."""
        self._interval_s[message_id] = interval_s
        if math.isfinite(interval_s):
            self._next_s[message_id] = now_s
        else:
            self._next_s.pop(message_id, None)
        self._earliest_s = min(self._next_s.values(), default=math.inf)

    def reset_interval(self, message_id: int, now_s: float) -> None:
        """Send the message at its default interval."""
        rate_hz = self._default_rates_hz.get(message_id, 0.0)
        self.set_interval(message_id, 1.0 / rate_hz if rate_hz else math.inf, now_s)

    def interval_s(self, message_id: int) -> float:
        """Interval of a message; ``inf`` if it is not streamed."""
        return self._interval_s.get(message_id, math.inf)

    def due(self, now_s: float) -> list[int]:
        """Return the messages to send now; each call takes them off the schedule."""
        if self._earliest_s > now_s + 1e-6:
            return []
        ids = [message_id for message_id, next_s in self._next_s.items() if next_s <= now_s + 1e-6]
        for message_id in ids:
            interval_s = self._interval_s[message_id]
            # Keep the phase, but never owe more than one message.
            self._next_s[message_id] = max(self._next_s[message_id] + interval_s, now_s)
        self._earliest_s = min(self._next_s.values())
        return ids


_DATA_STREAMS = {
    mavlink.MAV_DATA_STREAM_EXTENDED_STATUS: (
        mavlink.MAVLINK_MSG_ID_SYS_STATUS,
        mavlink.MAVLINK_MSG_ID_MISSION_CURRENT,
        mavlink.MAVLINK_MSG_ID_GPS_RAW_INT,
        mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED,
    ),
    mavlink.MAV_DATA_STREAM_POSITION: (
        mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    ),
    mavlink.MAV_DATA_STREAM_EXTRA1: (mavlink.MAVLINK_MSG_ID_ATTITUDE,),
    mavlink.MAV_DATA_STREAM_EXTRA2: (mavlink.MAVLINK_MSG_ID_VFR_HUD,),
    mavlink.MAV_DATA_STREAM_EXTRA3: (
        mavlink.MAVLINK_MSG_ID_SYSTEM_TIME,
        mavlink.MAVLINK_MSG_ID_BATTERY_STATUS,
        mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
    ),
}


def messages_of_data_stream(stream: int) -> tuple[int, ...]:
    """Return the messages of one of ArduPilot's data streams, or of all of them."""
    if stream == mavlink.MAV_DATA_STREAM_ALL:
        return tuple(message for group in _DATA_STREAMS.values() for message in group)
    return _DATA_STREAMS.get(stream, ())
