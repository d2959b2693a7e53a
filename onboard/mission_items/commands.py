"""What Clearway does with each mission command (MAV_CMD) of a ground station."""

from __future__ import annotations

from typing import Final

WAYPOINT: Final = 16
LOITER_UNLIMITED: Final = 17
LOITER_TIME: Final = 19
RETURN_TO_LAUNCH: Final = 20
LAND: Final = 21
TAKE_OFF: Final = 22

# Commands that move the vehicle in a way that legs at one height do not.
CANNOT_FLY: Final[dict[int, str]] = {
    18: "circles around a point are not flown",
    23: "local places are not read",
    24: "local places are not read",
    31: "a mission flies one height: fly another mission for another one",
    33: "nothing is followed in flight",
    82: "legs are straight: put waypoints along the curve",
    83: "nothing waits for a height",
    84: "only multirotors are flown",
    85: "only multirotors are flown",
    92: "control is not handed to another companion",
    94: "nothing descends to place a payload",
    113: "a mission flies one height: fly another mission for another one",
    176: "the pilot chooses the mode",
    177: "legs are flown once: repeat the waypoints",
    179: "home must stay where it is: altitudes and the local frame count from it",
    185: "the flight is not terminated by a mission",
    192: "places are reached by legs: add a waypoint",
    193: "a mission is not paused by itself",
    208: "a parachute is not released by a mission",
    223: "motors are not switched by a mission",
    252: "nothing descends to place a payload",
    601: "legs are flown once: repeat the waypoints",
}
# Commands that change nothing about the way: the autopilot, which flies setpoints, skips them too.
NOT_DONE: Final[dict[int, str]] = {
    93: "does not wait",
    112: "does not wait",
    114: "does not wait",
    115: "the nose points along the leg or the path (mission key heading)",
    178: "the speed is the contract's cruise_speed_mps",
    189: "marks where a landing begins: no leg",
    201: "the nose points along the leg or the path (mission key heading)",
    207: "the geofence stays as the autopilot has it",
    222: "the limits are the contract's",
    600: "a tag: no leg",
    **dict.fromkeys((181, 182, 183, 184), "relays and servos are not switched"),
    **dict.fromkeys((195, 196, 197), "the nose points along the leg or the path"),
    **dict.fromkeys((200, 202, 203, 204, 205, 206, 214), "camera and gimbal are not commanded"),
    **dict.fromkeys((1000, 1001), "camera and gimbal are not commanded"),
    **dict.fromkeys((530, 531, 532, 533, 534), "camera and gimbal are not commanded"),
    **dict.fromkeys((2000, 2001, 2003, 2500, 2501), "camera and gimbal are not commanded"),
    **dict.fromkeys((211, 212), "gripper and winch are not commanded"),
}


def command_name(command: int) -> str:
    """Return a command as MAVLink names it, without its prefix."""
    # Loads thousands of message definitions, which other parts of the command do not need.
    from pymavlink.dialects.v20 import common  # noqa: PLC0415  slow to load

    entry = common.enums["MAV_CMD"].get(command)
    return f"command {command}" if entry is None else str(entry.name).removeprefix("MAV_CMD_")
