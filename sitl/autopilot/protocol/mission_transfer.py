"""The mission protocol: upload, download, clear, set current; one transfer at a time.

Missions, geofences and rally points; parts of them can be written where the flavour does so.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.mission import ITEMS_MAX, MissionItem, MissionStore

Reply = Callable[[Any], None]
_ASK_AGAIN_S = 0.5
_GIVE_UP_S = 5.0
_MISSION = mavlink.MAV_MISSION_TYPE_MISSION


class ItemStore(Protocol):
    """Where the items of one type are kept."""

    @property
    def items(self) -> tuple[MissionItem, ...]:
        """As uploaded."""

    def refusal(self, number: int, item: MissionItem) -> int | None:
        """Return why an item is not taken, as MAV_MISSION_RESULT; None if it is."""

    def is_current(self, number: int) -> bool:
        """Whether an item is flown, or to be flown next."""

    def replace(self, items: tuple[MissionItem, ...]) -> None:
        """Take new items, or none."""


@dataclass
class _Upload:
    """An upload under way; ``before`` and ``after`` are the items that it keeps around its own."""

    reply: Reply
    sender: tuple[int, int]
    mission_type: int
    count: int
    heard_s: float
    asked_s: float
    before: tuple[MissionItem, ...] = ()
    after: tuple[MissionItem, ...] = ()
    items: list[MissionItem] = field(default_factory=list)

    @property
    def wanted(self) -> int:
        """Number of the item to ask for."""
        return len(self.before) + len(self.items)


class MissionTransfer:
    """The vehicle's side of the protocol.

    Args:
        mission: takes the mission.
        places: takes the other lists, by their MAV_MISSION_TYPE.
        partial: whether MISSION_WRITE_PARTIAL_LIST is understood.
    """

    def __init__(
        self, mission: MissionStore, places: Mapping[int, ItemStore], *, partial: bool
    ) -> None:
        self._mission = mission
        self._stores: dict[int, ItemStore] = {_MISSION: mission, **places}
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
            "MISSION_ACK": self._on_ack,
        }
        if partial:
            self._handlers["MISSION_WRITE_PARTIAL_LIST"] = self._on_write_partial

    @property
    def messages(self) -> tuple[str, ...]:
        """Names of the messages that :meth:`receive` understands."""
        return tuple(self._handlers)

    def receive(self, message: Any, reply: Reply, now_s: float) -> None:
        """Take one message of the protocol; ``reply`` sends back to where it came from."""
        self._handlers[message.get_type()](message, reply, now_s)

    def step(self, now_s: float) -> None:
        """Request a missing item again; after a while, cancel the upload."""
        upload = self._upload
        if upload is None:
            return
        if now_s - upload.heard_s > _GIVE_UP_S:
            self._end_upload(mavlink.MAV_MISSION_OPERATION_CANCELLED)
        elif now_s - upload.asked_s > _ASK_AGAIN_S:
            self._ask(upload, now_s)

    # --- upload ---------------------------------------------------------------------------

    def _on_count(self, message: Any, reply: Reply, now_s: float) -> None:
        if message.count > ITEMS_MAX:
            _acknowledge(message, reply, mavlink.MAV_MISSION_NO_SPACE)
        else:
            self._begin_upload(message, reply, now_s, message.count)

    def _on_write_partial(self, message: Any, reply: Reply, now_s: float) -> None:
        """Take new items from ``start_index`` to ``end_index``, both of which exist."""
        store = self._stores.get(message.mission_type)
        items = () if store is None else store.items
        first, last = message.start_index, message.end_index
        if store is not None and not 0 <= first <= last < len(items):
            _acknowledge(message, reply, mavlink.MAV_MISSION_ERROR)
        else:
            kept = items[:first], items[last + 1 :]
            self._begin_upload(message, reply, now_s, last - first + 1, *kept)

    def _begin_upload(
        self,
        message: Any,
        reply: Reply,
        now_s: float,
        count: int,
        before: tuple[MissionItem, ...] = (),
        after: tuple[MissionItem, ...] = (),
    ) -> None:
        if message.mission_type not in self._stores:
            _acknowledge(message, reply, mavlink.MAV_MISSION_UNSUPPORTED)
        elif self._upload is not None and self._upload.sender != _sender(message):
            _acknowledge(message, reply, mavlink.MAV_MISSION_DENIED)
        else:
            self._upload = _Upload(
                reply, _sender(message), message.mission_type, count, now_s, now_s, before, after
            )
            self._continue_upload(self._upload, now_s)

    def _on_ack(self, message: Any, _: Reply, __: float) -> None:
        """Forget the upload that its sender gives up; other acknowledgements end downloads."""
        upload = self._upload
        if upload is None or message.type == mavlink.MAV_MISSION_ACCEPTED:
            return
        if (upload.sender, upload.mission_type) == (_sender(message), message.mission_type):
            self._upload = None

    def _on_item(self, message: Any, reply: Reply, now_s: float) -> None:
        upload = self._upload
        answers = (_sender(message), message.mission_type)
        if upload is None or (upload.sender, upload.mission_type) != answers:
            _acknowledge(message, reply, mavlink.MAV_MISSION_ERROR)
            return
        upload.heard_s = now_s
        if message.seq != upload.wanted:
            return  # a repetition: `step` requests the right one again
        item = MissionItem.of(message)
        refusal = self._stores[upload.mission_type].refusal(message.seq, item)
        if refusal is not None:
            self._end_upload(refusal)
            return
        upload.items.append(item)
        self._continue_upload(upload, now_s)

    def _continue_upload(self, upload: _Upload, now_s: float) -> None:
        if len(upload.items) < upload.count:
            self._ask(upload, now_s)
        else:
            items = (*upload.before, *upload.items, *upload.after)
            self._stores[upload.mission_type].replace(items)
            self._end_upload(mavlink.MAV_MISSION_ACCEPTED)

    def _ask(self, upload: _Upload, now_s: float) -> None:
        upload.asked_s = now_s
        upload.reply(
            mavlink.MAVLink_mission_request_int_message(
                *upload.sender, upload.wanted, upload.mission_type
            )
        )

    def _end_upload(self, result: int) -> None:
        if self._upload is not None:
            upload, self._upload = self._upload, None
            upload.reply(
                mavlink.MAVLink_mission_ack_message(*upload.sender, result, upload.mission_type)
            )

    # --- download and the rest ------------------------------------------------------------

    def _on_request_list(self, message: Any, reply: Reply, _: float) -> None:
        store = self._stores.get(message.mission_type)
        if store is None:
            _acknowledge(message, reply, mavlink.MAV_MISSION_UNSUPPORTED)
            return
        count = mavlink.MAVLink_mission_count_message(
            *_sender(message), len(store.items), message.mission_type
        )
        reply(count)

    def _on_request(self, message: Any, reply: Reply, _: float) -> None:
        store = self._stores.get(message.mission_type)
        if store is None or message.seq >= len(store.items):
            _acknowledge(message, reply, mavlink.MAV_MISSION_INVALID_SEQUENCE)
            return
        item = store.items[message.seq]
        reply(
            mavlink.MAVLink_mission_item_int_message(
                *_sender(message),
                message.seq,
                item.frame,
                item.command,
                int(store.is_current(message.seq)),
                item.autocontinue,
                *item[3:],
                message.mission_type,
            )
        )

    def _on_clear_all(self, message: Any, reply: Reply, _: float) -> None:
        if message.mission_type not in {*self._stores, mavlink.MAV_MISSION_TYPE_ALL}:
            _acknowledge(message, reply, mavlink.MAV_MISSION_UNSUPPORTED)
            return
        for mission_type, store in self._stores.items():
            if message.mission_type in {mission_type, mavlink.MAV_MISSION_TYPE_ALL}:
                store.replace(())
        _acknowledge(message, reply, mavlink.MAV_MISSION_ACCEPTED)

    def _on_set_current(self, message: Any, reply: Reply, _: float) -> None:
        if not self._mission.select(message.seq):
            _acknowledge(message, reply, mavlink.MAV_MISSION_INVALID_SEQUENCE)


def _sender(message: Any) -> tuple[int, int]:
    return message.get_srcSystem(), message.get_srcComponent()


def _acknowledge(message: Any, reply: Reply, result: int) -> None:
    mission_type = getattr(message, "mission_type", _MISSION)
    reply(mavlink.MAVLink_mission_ack_message(*_sender(message), result, mission_type))
