"""Reads mission and geofence from an autopilot, by MAVLink's mission protocol.

Source: https://mavlink.io/en/services/mission.html.
"""

from __future__ import annotations

import asyncio
from typing import Final

from mavsdk.asyncio import MavsdkError
from mavsdk.asyncio.plugins.mavlink_direct import MavlinkDirectAsync
from mavsdk.asyncio.plugins.mission_raw import MissionRawAsync

from gcs_tools.console.errors import CommandError
from gcs_tools.console.interruption import interruptible
from gcs_tools.vehicle.connection import CONNECT_TIMEOUT_S, connected_vehicle
from gcs_tools.vehicle.query import answer
from onboard.mission_items.on_board import OnBoard, OnBoardError, planned_of
from onboard.mission_items.planned_flight import PlannedFlight

_HOME_POSITION: Final = (242, "HOME_POSITION")
_GPS_GLOBAL_ORIGIN: Final = (49, "GPS_GLOBAL_ORIGIN")


def read_vehicle(url: str, system_id: int | None) -> PlannedFlight:
    """Read the mission and the geofence that are on board.

    Args:
        url: MAVSDK connection URL.
        system_id: of the vehicle; None if there is only one on the connection.

    Raises:
        CommandError: the vehicle cannot be reached, sends nothing, or has no mission.
        Interrupted: the operator gave up.
    """
    try:
        return planned_of(asyncio.run(_download(url, system_id)))
    except OnBoardError as error:
        raise CommandError(str(error)) from error


async def _download(url: str, system_id: int | None) -> OnBoard:
    with interruptible() as interruption:
        async with connected_vehicle(
            url, interruption, CONNECT_TIMEOUT_S, system_id=system_id
        ) as vehicle:
            raw, direct = MissionRawAsync(vehicle.system), MavlinkDirectAsync(vehicle.system)
            try:
                items, fence = await raw.download_mission(), await raw.download_geofence()
            except MavsdkError as error:
                raise CommandError(f"{url}: the mission cannot be read: {error}") from error
            home = await answer(direct, vehicle.system_id, *_HOME_POSITION)
            origin = await answer(direct, vehicle.system_id, *_GPS_GLOBAL_ORIGIN)
            return OnBoard(vehicle.profile.key, items, fence, home, origin)
