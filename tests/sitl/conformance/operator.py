"""An operator of a simulated vehicle over MAVLink bytes: waits, missions and flights."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.geodesy import geographic_from_ned
from sitl.config import VehicleConfig
from sitl.plant.truth import Vector
from sitl.vehicle.vehicle import SimulatedVehicle
from tests.sitl.mavlink_client import NAN, Client

ACCEPTED, DENIED = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_DENIED
REJECTED = mavlink.MAV_RESULT_TEMPORARILY_REJECTED
UNSUPPORTED, FAILED = mavlink.MAV_RESULT_UNSUPPORTED, mavlink.MAV_RESULT_FAILED
GROUND_STATION = (255, mavlink.MAV_COMP_ID_MISSIONPLANNER)
_STEP_S = 0.1
_DECISION_TICKS = 2
# What would otherwise take most of the time: decoding fifty messages a second.
_FAST_MESSAGES = ("ATTITUDE", "LOCAL_POSITION_NED", "POSITION_TARGET_LOCAL_NED")


class Item(NamedTuple):
    """One mission item: where it is from the origin, in metres, and four parameters."""

    command: int
    north_m: float = 0.0
    east_m: float = 0.0
    height_m: float = 0.0
    parameters: tuple[float, float, float, float] = (0.0, 0.0, 0.0, NAN)
    frame: int = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT


def waypoint(north_m: float, east_m: float, height_m: float, radius_m: float = 0.0) -> Item:
    parameters = (0.0, radius_m, 0.0, NAN)
    return Item(mavlink.MAV_CMD_NAV_WAYPOINT, north_m, east_m, height_m, parameters)


RETURN = Item(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)


class Operator(Client):
    """A ground station beside a vehicle that stands, its estimator ready."""

    def __init__(self, *, fast: bool = True, **config: Any) -> None:
        """Start a vehicle, ideal unless ``realism`` says otherwise; ``fast`` stops its streams."""
        vehicle = VehicleConfig.model_validate({"realism": "ideal", **config})
        system, component = GROUND_STATION
        super().__init__(
            SimulatedVehicle(vehicle, ticks_per_decision=_DECISION_TICKS),
            system=system,
            component=component,
        )
        self.home = vehicle.home
        self.wait(1.5, lambda _: self.beat())
        for name in _FAST_MESSAGES if fast else ():
            self.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, message_id(name), -1.0)
        self.received.clear()

    def beat(self) -> None:
        """Send a heartbeat."""
        self.send(mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, 8, 0, 0, 0, 3))

    @property
    def position_ned_m(self) -> Vector:
        return self.vehicle.truth.position_ned_m

    @property
    def height_m(self) -> float:
        return -self.position_ned_m[2]

    @property
    def armed(self) -> bool:
        return bool(self.last("HEARTBEAT").base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)

    @property
    def landed_state(self) -> int:
        return int(self.last("EXTENDED_SYS_STATE").landed_state)

    def last(self, name: str) -> Any:
        return self.of(name)[-1]

    def request(self, name_or_id: str | int, index: float = 0.0) -> int:
        """Ask for a message once; return the result of the command."""
        number = message_id(name_or_id) if isinstance(name_or_id, str) else name_or_id
        return self.command(mavlink.MAV_CMD_REQUEST_MESSAGE, number, index)

    def until(
        self, reached: Callable[[], bool], limit_s: float, each: Callable[[], None] | None = None
    ) -> None:
        """Let time pass until a condition holds; fail when it takes longer than ``limit_s``."""
        end_s = self.now_s + limit_s
        while not reached():
            assert self.now_s < end_s, (self.position_ned_m, self.texts())
            if each is not None:
                each()
            self.vehicle.advance(self.now_s + _STEP_S)
            self.collect()

    def until_disarmed(self, limit_s: float, each: Callable[[], None] | None = None) -> None:
        self.until(lambda: not self.vehicle.autopilot.commander.armed, limit_s, each)

    def until_at(self, place_ned_m: Vector, within_m: float, limit_s: float) -> None:
        self.until(lambda: math.dist(self.position_ned_m, place_ned_m) < within_m, limit_s)

    def until_hovering(self) -> None:
        in_air = mavlink.MAV_LANDED_STATE_IN_AIR
        self.until(
            lambda: bool(self.of("EXTENDED_SYS_STATE")) and self.landed_state == in_air, 45.0
        )

    def take_off(self, height_m: float) -> None:
        """Arm, take off as PX4 does, and wait until the vehicle hovers."""
        self.parameter("MIS_TAKEOFF_ALT", height_m)
        assert self.arm() == ACCEPTED
        assert self.command(mavlink.MAV_CMD_NAV_TAKEOFF, *(NAN,) * 7) == ACCEPTED
        self.until(lambda: self.height_m > height_m - 0.1, 30.0)
        self.until_hovering()

    def place(self, north_m: float, east_m: float) -> tuple[int, int]:
        """Return latitude and longitude of a local place, in 1e-7 degrees."""
        there = geographic_from_ned(self.home, (north_m, east_m, 0.0))
        return round(there.latitude_deg * 1e7), round(there.longitude_deg * 1e7)

    def item(self, number: int, item: Item, mission_type: int = 0) -> Any:
        """Return the message of an item."""
        place = self.place(item.north_m, item.east_m)
        return mavlink.MAVLink_mission_item_int_message(
            *(1, 1, number, item.frame, item.command, 0, 1),
            *(*item.parameters, *place, item.height_m, mission_type),
        )

    def upload(self, items: Sequence[Item], mission_type: int = 0) -> int:
        """Answer the vehicle's requests; return the result of its acknowledgement."""
        self.received.clear()
        self.send(mavlink.MAVLink_mission_count_message(1, 1, len(items), mission_type))
        while not self.of("MISSION_ACK"):
            wanted = self.last("MISSION_REQUEST_INT").seq
            self.send(self.item(wanted, items[wanted], mission_type))
        return int(self.last("MISSION_ACK").type)

    def fly_mission(self, items: Sequence[Item]) -> None:
        """Upload a mission, arm, and begin it."""
        assert self.upload(items) == mavlink.MAV_MISSION_ACCEPTED
        assert self.arm() == ACCEPTED
        assert self.command(mavlink.MAV_CMD_MISSION_START) == ACCEPTED

    @property
    def finished(self) -> bool:
        """Whether the mission has been flown."""
        current = self.of("MISSION_CURRENT")
        return bool(current) and current[-1].mission_state == mavlink.MISSION_STATE_COMPLETE


def number_of(message: Any) -> int:
    """Return the id of a received message, also of one that pymavlink's dialect lacks."""
    name = message.get_type()
    return int(name.removeprefix("UNKNOWN_")) if "UNKNOWN_" in name else int(message.get_msgId())


def payload_of(operator: Operator, number: int) -> bytes:
    """Return the payload of the one message with this id, the zeros at its end cut off."""
    (message,) = [one for one in operator.received if number_of(one) == number]
    frame = bytes(message.get_msgbuf())
    return frame[10 : 10 + frame[1]]


def message_id(name: str) -> int:
    """Return the id of a message."""
    return int(getattr(mavlink, f"MAVLINK_MSG_ID_{name}"))
