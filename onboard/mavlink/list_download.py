"""Downloads one list from an autopilot, without I/O: a mission, or a geofence.

Source: https://mavlink.io/en/services/mission.html#download_mission.
"""

from __future__ import annotations

import math
from typing import Any, Final, Literal, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

# As the protocol recommends: of the list, of an item; and how often each is asked for.
LIST_TIMEOUT_S: Final = 1.5
ITEM_TIMEOUT_S: Final = 0.5
TRIES: Final = 6
# Autopilots keep some hundreds; a count beyond this is a fault, or an attack on our memory.
ITEMS_MAX: Final = 1000


class MissionRequest(NamedTuple):
    """What to send to the autopilot next.

    Attributes:
        kind: MISSION_REQUEST_LIST, MISSION_REQUEST_INT, MISSION_ACK, or MAV_CMD_REQUEST_MESSAGE.
        mission_type: MAV_MISSION_TYPE of the list.
        number: of the item, or the id of the message.
    """

    kind: Literal["list", "item", "done", "message"]
    mission_type: int = mavlink.MAV_MISSION_TYPE_MISSION
    number: int = 0


class ListDownload:
    """One list on its way.

    Args:
        mission_type: MAV_MISSION_TYPE of the list.

    Attributes:
        items: MISSION_ITEM_INT messages so far, in order.
        failure: why the list cannot be read; None while it can.
    """

    def __init__(self, mission_type: int) -> None:
        self.mission_type = mission_type
        self.items: list[Any] = []
        self.failure: str | None = None
        self._count: int | None = None
        self._tries, self._due_s = 0, -math.inf
        self._acknowledged = False

    @property
    def complete(self) -> bool:
        """Whether every item has arrived, and the autopilot was told so."""
        return self._acknowledged

    def due(self, now_s: float) -> MissionRequest | None:
        """Return what to send now, if anything; it counts as sent."""
        if self.failure is not None or self._acknowledged:
            return None
        if self._count is not None and len(self.items) >= self._count:
            self._acknowledged = True
            return MissionRequest("done", self.mission_type)
        if now_s < self._due_s:
            return None
        if self._tries >= TRIES:
            what = "its list" if self._count is None else f"item {len(self.items)}"
            self.failure = f"{what} was asked for {TRIES} times and did not come"
            return None
        self._tries += 1
        if self._count is None:
            self._due_s = now_s + LIST_TIMEOUT_S
            return MissionRequest("list", self.mission_type)
        self._due_s = now_s + ITEM_TIMEOUT_S
        return MissionRequest("item", self.mission_type, len(self.items))

    def hear_count(self, count: int) -> None:
        """Take MISSION_COUNT."""
        if self._count is not None:
            return
        if count > ITEMS_MAX:
            self.failure = f"it has {count} items (limit {ITEMS_MAX})"
            return
        self._count = count
        self._expect_next()

    def hear_item(self, item: Any) -> None:
        """Take MISSION_ITEM_INT; any but the next one is a repetition."""
        if self._count is not None and item.seq == len(self.items) < self._count:
            self.items.append(item)
            self._expect_next()

    def hear_refusal(self, result: int) -> None:
        """Take a MISSION_ACK that ends the download."""
        entry = mavlink.enums["MAV_MISSION_RESULT"].get(result)
        self.failure = f"refused: {result if entry is None else entry.name}"

    def _expect_next(self) -> None:
        self._tries, self._due_s = 0, -math.inf
