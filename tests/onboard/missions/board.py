"""A vehicle that keeps a mission and a geofence on board, and states home and origin."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.onboard.test_autonomy import Rig

# Degrees north that make a metre in PX4's local frame.
M_DEG: Final = math.degrees(1.0 / 6_371_000.0)
HOME_E7: Final = (473_977_420, 85_455_940)
WAYPOINT, TAKE_OFF, JUMP = 16, 22, 177
MISSION, FENCE = mavlink.MAV_MISSION_TYPE_MISSION, mavlink.MAV_MISSION_TYPE_FENCE


def north_e7(north_m: float) -> int:
    """Return the latitude so far north of home."""
    return HOME_E7[0] + round(north_m * M_DEG * 1e7)


def item(command: int, north_m: float, up_m: float = 4.0, param1: float = 0.0) -> tuple[Any, ...]:
    """Return what MISSION_ITEM_INT says of an item, after its number."""
    numbers = (param1, 0.0, 0.0, math.nan)
    return (3, command, 0, 1, *numbers, north_e7(north_m), HOME_E7[1], up_m)


STANDARD = (item(TAKE_OFF, 0.0), item(WAYPOINT, 12.0), item(WAYPOINT, 24.0))


@dataclass
class Board(Rig):
    """A rig whose autopilot answers the mission protocol.

    Attributes:
        lists: items on board, by MAV_MISSION_TYPE.
        origin_e7: latitude and longitude of GPS_GLOBAL_ORIGIN; None to state none.
        deaf: how many requests are lost before one is heard.
        refusal: MAV_MISSION_RESULT that answers every request; None to answer.
        asked: every message of the protocol that the service has sent.
    """

    lists: dict[int, tuple[tuple[Any, ...], ...]] = field(
        default_factory=lambda: {MISSION: STANDARD, FENCE: ()}
    )
    origin_e7: tuple[int, int] | None = HOME_E7
    deaf: int = 0
    refusal: int | None = None
    asked: list[Any] = field(default_factory=list)

    def hear(self, message: Any) -> None:
        kind = message.get_type()
        places = kind == "COMMAND_LONG" and message.command == mavlink.MAV_CMD_REQUEST_MESSAGE
        if places or kind.startswith("MISSION_"):
            self.asked.append(message)
            if self.deaf:
                self.deaf -= 1
            elif places:
                self._state_place(int(message.param1))
            else:
                self._answer(kind, message)

    def _answer(self, kind: str, message: Any) -> None:
        us, which = (message.get_srcSystem(), message.get_srcComponent()), message.mission_type
        if self.refusal is not None:
            self._mav.send(mavlink.MAVLink_mission_ack_message(*us, self.refusal, which))
        elif kind == "MISSION_REQUEST_LIST":
            count = len(self.lists[which])
            self._mav.send(mavlink.MAVLink_mission_count_message(*us, count, which))
        elif kind == "MISSION_REQUEST_INT":
            content = self.lists[which][message.seq]
            sent = mavlink.MAVLink_mission_item_int_message(*us, message.seq, *content, which)
            self._mav.send(sent)

    def _state_place(self, message_id: int) -> None:
        if self.origin_e7 is None:
            return
        if message_id == mavlink.MAVLINK_MSG_ID_HOME_POSITION:
            still = (0.0,) * 10
            self._mav.send(mavlink.MAVLink_home_position_message(*self.origin_e7, 0, *_home(still)))
        else:
            self._mav.send(mavlink.MAVLink_gps_global_origin_message(*self.origin_e7, 0))

    def be_uploaded(self, which: int, *items: tuple[Any, ...]) -> None:
        """Have a ground station upload, which the autopilot acknowledges to it."""
        self.lists[which] = items
        self._mav.send(mavlink.MAVLink_mission_ack_message(255, 190, 0, which))


def _home(still: tuple[float, ...]) -> tuple[Any, ...]:
    """Return position, attitude and approach of HOME_POSITION."""
    return (*still[:3], [1.0, 0.0, 0.0, 0.0], *still[3:6])
