"""The mission protocol: upload, download, clear, set current; one transfer at a time.

Only missions proper: there is no geofence and no rally point on board, so that their lists are
empty and cannot be uploaded.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.mission import ITEMS_MAX, MissionItem, MissionStore

Reply = Callable[[Any], None]
_ASK_AGAIN_S = 0.5
_GIVE_UP_S = 5.0
_MISSION = mavlink.MAV_MISSION_TYPE_MISSION


@dataclass
class _Upload:
    """An upload under way."""

    reply: Reply
    sender: tuple[int, int]
    count: int
    heard_s: float
    asked_s: float
    items: list[MissionItem] = field(default_factory=list)


class MissionTransfer:
    """The vehicle's side of the protocol."""

    def __init__(self, store: MissionStore) -> None:
        self._store = store
        self._upload: _Upload | None = None
        self._handlers: dict[str, Callable[[Any, Reply, float], None]] = {
            "MISSION_COUNT": self._on_count,
            "MISSION_ITEM_INT": self._on_item,
            "MISSION_ITEM": self._on_item,
            "MISSION_REQUEST_LIST": self._on_request_list,
            "MISSION_REQUEST_INT": self._on_request,
            "MISSION_REQUEST": self._on_request,
            "MISSION_CLEAR_ALL": self._on_clear_all,
            "MISSION_SET_CURRENT": self._on_set_current,
        }

    @property
    def messages(self) -> tuple[str, ...]:
        """Names of the messages that :meth:`receive` understands."""
        return tuple(self._handlers)

    def receive(self, message: Any, reply: Reply, now_s: float) -> None:
        """Take one message of the protocol; ``reply`` sends back to where it came from."""
        self._handlers[message.get_type()](message, reply, now_s)

    def step(self, now_s: float) -> None:
        """Ask again for an item that does not come; in the end, give up."""
        upload = self._upload
        if upload is None:
            return
        if now_s - upload.heard_s > _GIVE_UP_S:
            self._end_upload(mavlink.MAV_MISSION_OPERATION_CANCELLED)
        elif now_s - upload.asked_s > _ASK_AGAIN_S:
            self._ask(upload, now_s)

    # --- upload ---------------------------------------------------------------------------

    def _on_count(self, message: Any, reply: Reply, now_s: float) -> None:
        if message.mission_type != _MISSION:
            _acknowledge(message, reply, mavlink.MAV_MISSION_UNSUPPORTED)
        elif self._upload is not None and self._upload.sender != _sender(message):
            _acknowledge(message, reply, mavlink.MAV_MISSION_DENIED)
        elif message.count > ITEMS_MAX:
            _acknowledge(message, reply, mavlink.MAV_MISSION_NO_SPACE)
        else:
            self._upload = _Upload(reply, _sender(message), message.count, now_s, now_s)
            self._continue_upload(self._upload, now_s)

    def _on_item(self, message: Any, reply: Reply, now_s: float) -> None:
        upload = self._upload
        if upload is None or upload.sender != _sender(message) or message.mission_type != _MISSION:
            _acknowledge(message, reply, mavlink.MAV_MISSION_ERROR)
            return
        upload.heard_s = now_s
        if message.seq != len(upload.items):
            return  # a repetition: the right one is asked for again in time
        item = MissionItem.of(message)
        is_home = message.seq < self._store.first
        refusal = None if is_home else item.refusal(self._store.origin)
        if refusal is not None:
            self._end_upload(refusal)
            return
        upload.items.append(item)
        self._continue_upload(upload, now_s)

    def _continue_upload(self, upload: _Upload, now_s: float) -> None:
        if len(upload.items) < upload.count:
            self._ask(upload, now_s)
        else:
            self._store.replace(tuple(upload.items))
            self._end_upload(mavlink.MAV_MISSION_ACCEPTED)

    def _ask(self, upload: _Upload, now_s: float) -> None:
        upload.asked_s = now_s
        number = len(upload.items)
        upload.reply(mavlink.MAVLink_mission_request_int_message(*upload.sender, number, _MISSION))

    def _end_upload(self, result: int) -> None:
        if self._upload is not None:
            upload, self._upload = self._upload, None
            upload.reply(mavlink.MAVLink_mission_ack_message(*upload.sender, result, _MISSION))

    # --- download and the rest ------------------------------------------------------------

    def _on_request_list(self, message: Any, reply: Reply, _: float) -> None:
        count = len(self._store.items) if message.mission_type == _MISSION else 0
        reply(mavlink.MAVLink_mission_count_message(*_sender(message), count, message.mission_type))

    def _on_request(self, message: Any, reply: Reply, _: float) -> None:
        known = message.mission_type == _MISSION and message.seq < len(self._store.items)
        if not known:
            _acknowledge(message, reply, mavlink.MAV_MISSION_INVALID_SEQUENCE)
            return
        item = self._store.items[message.seq]
        reply(
            mavlink.MAVLink_mission_item_int_message(
                *_sender(message),
                message.seq,
                item.frame,
                item.command,
                int(message.seq == self._store.current),
                item.autocontinue,
                *item[3:],
                _MISSION,
            )
        )

    def _on_clear_all(self, message: Any, reply: Reply, _: float) -> None:
        if message.mission_type in {_MISSION, mavlink.MAV_MISSION_TYPE_ALL}:
            self._store.replace(())
        _acknowledge(message, reply, mavlink.MAV_MISSION_ACCEPTED)

    def _on_set_current(self, message: Any, reply: Reply, _: float) -> None:
        if not self._store.select(message.seq):
            _acknowledge(message, reply, mavlink.MAV_MISSION_INVALID_SEQUENCE)


def _sender(message: Any) -> tuple[int, int]:
    return message.get_srcSystem(), message.get_srcComponent()


def _acknowledge(message: Any, reply: Reply, result: int) -> None:
    mission_type = getattr(message, "mission_type", _MISSION)
    reply(mavlink.MAVLink_mission_ack_message(*_sender(message), result, mission_type))
