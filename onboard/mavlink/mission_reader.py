"""Reads mission, geofence, home and origin of the autopilot, and again when they have changed.

Changes show in MISSION_CURRENT (its ids and its total), in the MISSION_ACK that an autopilot sends
to the ground station that has uploaded, and cannot be missed over an arming: then all is read once
more.  Source: https://mavlink.io/en/services/mission.html.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from onboard.mavlink.list_download import ListDownload, MissionRequest

# After a change the ground station may go on with the next list.
SETTLE_S: Final = 1.0
RETRY_S: Final = 10.0
ORIGIN_PERIOD_S: Final = 5.0
_PLACE_TIMEOUT_S: Final = 1.0
_PLACE_TRIES: Final = 5
_LISTS: Final = {
    mavlink.MAV_MISSION_TYPE_MISSION: "mission",
    mavlink.MAV_MISSION_TYPE_FENCE: "geofence",
}
_HEADER_BYTES: Final = 10  # of MAVLink 2
_HOME: Final = mavlink.MAVLINK_MSG_ID_HOME_POSITION
_ORIGIN: Final = mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN
_PLACES: Final = (_HOME, _ORIGIN)


@dataclass(frozen=True, eq=False)
class ReadMission:
    """What was read, at one time.

    Attributes:
        items, fence: MISSION_ITEM_INT messages, in order.
        home, origin: HOME_POSITION and GPS_GLOBAL_ORIGIN; None where they did not come.
    """

    items: tuple[Any, ...]
    fence: tuple[Any, ...]
    home: Any | None
    origin: Any | None


class MissionReader:
    """Our side of the mission protocol: it downloads only.

    Attributes:
        wanted: whether mission and geofence are read at all.
        read: what was read last; None before.
        origin: GPS_GLOBAL_ORIGIN as heard last; None before.
    """

    def __init__(self) -> None:
        self.wanted = False
        self.read: ReadMission | None = None
        self.origin: Any | None = None
        self._home: Any | None = None
        self._stale, self._begin_s = True, -math.inf
        self._failure: str | None = None
        self._lists: list[ListDownload] = []
        self._place_tries = dict.fromkeys(_PLACES, 0)
        self._place_due_s = -math.inf
        self._armed = False
        self._seen: tuple[int, bytes] | None = None

    @property
    def doubt(self) -> str | None:
        """Why what was read may not be what is on board; None if it is."""
        if not self._stale:
            return None
        if self._failure is not None:
            return f"the vehicle's {self._failure}"
        return "the vehicle's mission is being read"

    # ------------------------------------------------------------------ what to send

    def due(self, now_s: float) -> MissionRequest | None:
        """Return what to send now; the autopilot has been heard."""
        if not self.wanted:
            return self._origin_request(now_s)
        if not self._stale or now_s < self._begin_s:
            return None
        if not self._lists:
            self._lists = [ListDownload(each) for each in _LISTS]
            self._place_tries = dict.fromkeys(_PLACES, 0)
        for download in self._lists:
            if not download.complete:
                request = download.due(now_s)
                if download.failure is not None:
                    self._fail(f"{_LISTS[download.mission_type]} cannot be read", download, now_s)
                return request
        return self._place_request(now_s)

    def _origin_request(self, now_s: float) -> MissionRequest | None:
        """Ask for the origin alone, by which places are known again after a restart."""
        if self.origin is not None or now_s < self._place_due_s:
            return None
        self._place_due_s = now_s + ORIGIN_PERIOD_S
        return MissionRequest("message", number=_ORIGIN)

    def _place_request(self, now_s: float) -> MissionRequest | None:
        """Ask for home and origin; what does not come in time stays unknown."""
        heard = {_HOME: self._home, _ORIGIN: self.origin}
        for message_id in _PLACES:
            if heard[message_id] is None and self._place_tries[message_id] < _PLACE_TRIES:
                if now_s < self._place_due_s:
                    return None
                self._place_due_s = now_s + _PLACE_TIMEOUT_S
                self._place_tries[message_id] += 1
                return MissionRequest("message", number=message_id)
        waits = any(each is None for each in heard.values()) and now_s < self._place_due_s
        if not waits:
            items, fence = (tuple(each.items) for each in self._lists)
            self.read = ReadMission(items, fence, self._home, self.origin)
            self._stale, self._failure, self._lists = False, None, []
        return None

    def _fail(self, what: str, download: ListDownload, now_s: float) -> None:
        self._failure = f"{what}: {download.failure}"
        self._lists, self._begin_s = [], now_s + RETRY_S

    # ------------------------------------------------------------------ what is heard

    def hear(self, message: Any, now_s: float, *, for_us: bool) -> None:
        """Take a message of the protocol from the autopilot.

        Args:
            message: MISSION_COUNT, MISSION_ITEM_INT, MISSION_ACK, MISSION_CURRENT, HOME_POSITION or
                GPS_GLOBAL_ORIGIN.
            now_s: when.
            for_us: whether it is addressed to us, where it is addressed at all.
        """
        kind = message.get_msgId()
        if kind == _HOME:
            self._home = self._moved(self._home, message, now_s)
        elif kind == _ORIGIN:
            self.origin = self._moved(self.origin, message, now_s)
        elif kind == mavlink.MAVLINK_MSG_ID_MISSION_CURRENT:
            seen = (message.total, _ids(message))
            if self._seen is not None and seen != self._seen:
                self._note_change(now_s)
            self._seen = seen
        elif not for_us:
            accepted = mavlink.MAV_MISSION_ACCEPTED
            if kind == mavlink.MAVLINK_MSG_ID_MISSION_ACK and message.type == accepted:
                self._note_change(now_s)
        else:
            self._hear_list(kind, message)

    def _hear_list(self, kind: int, message: Any) -> None:
        for download in self._lists:
            if download.mission_type != message.mission_type or download.complete:
                continue
            if kind == mavlink.MAVLINK_MSG_ID_MISSION_COUNT:
                download.hear_count(message.count)
            elif kind == mavlink.MAVLINK_MSG_ID_MISSION_ITEM_INT:
                download.hear_item(message)
            elif message.type != mavlink.MAV_MISSION_ACCEPTED:
                download.hear_refusal(message.type)

    def hear_armed(self, now_s: float, *, armed: bool) -> None:
        """Take what the heartbeat says; over an arming all is read again."""
        if armed and not self._armed and not self._stale:
            self._stale, self._begin_s = True, now_s
        self._armed = armed

    def _moved(self, before: Any | None, after: Any, now_s: float) -> Any:
        """Return a place; one that has moved changes what the items mean."""
        place = (after.latitude, after.longitude, after.altitude)
        if before is not None and (before.latitude, before.longitude, before.altitude) != place:
            self._note_change(now_s)
        self._place_due_s = now_s  # the other one may be asked for at once
        return after

    def _note_change(self, now_s: float) -> None:
        self._stale, self._lists, self._begin_s = True, [], now_s + SETTLE_S
        self._failure = None


def _ids(current: Any) -> bytes:
    """Return mission_id and fence_id of MISSION_CURRENT, extensions that pymavlink does not know.

    They follow seq, total, mission_state and mission_mode, 4 bytes each; zeros at the end of a
    payload are not sent.
    """
    frame = bytes(current.get_msgbuf())
    payload = frame[_HEADER_BYTES : _HEADER_BYTES + frame[1]]
    return payload[6:14].rstrip(b"\0")
