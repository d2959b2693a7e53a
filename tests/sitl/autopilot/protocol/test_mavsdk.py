"""The real `mavsdk` package against the simulator as a process: what its plugins send and await."""

from __future__ import annotations

import asyncio
import json
import lzma
import socket
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest
from mavsdk.asyncio import ComponentType, Configuration, Mavsdk
from mavsdk.asyncio.plugins.action import ActionAsync, ActionError
from mavsdk.asyncio.plugins.component_metadata import ComponentMetadataAsync, MetadataType
from mavsdk.asyncio.plugins.failure import FailureAsync, FailureError, FailureType, FailureUnit
from mavsdk.asyncio.plugins.ftp import FtpAsync, FtpError
from mavsdk.asyncio.plugins.info import InfoAsync
from mavsdk.asyncio.plugins.mission import MissionAsync, MissionItem, MissionPlan
from mavsdk.asyncio.plugins.offboard import OffboardAsync, PositionNedYaw, VelocityNedYaw
from mavsdk.asyncio.plugins.param import ParamAsync, ParamError
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync

from tests.sitl.process import configured, free_port, running

LIMIT_S = 60.0
SPEED = 4.0


def talk(directory: Path, script: Callable[[Any], Awaitable[None]], **config: Any) -> None:
    """Run a client's script against a simulator of its own."""
    url = f"udpout://127.0.0.1:{free_port(socket.SOCK_DGRAM)}"
    path, _ = configured(directory, mavlink=[url], speed_factor=SPEED, **config)

    async def connected() -> None:
        identity = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
        async with Mavsdk(identity) as sdk:
            await sdk.add_any_connection(url.replace("udpout", "udpin"))
            system = await sdk.first_autopilot(timeout_s=60.0)
            assert system is not None
            await script(system)

    with running(path):
        asyncio.run(asyncio.wait_for(connected(), LIMIT_S))


async def healthy(telemetry: TelemetryAsync) -> None:
    async for ok in telemetry.subscribe_health_all_ok():
        if ok:
            return


async def at(
    telemetry: TelemetryAsync, position_ned_m: tuple[float, float, float], within_m: float = 0.4
) -> None:
    """Wait until the vehicle is near a position."""
    async for motion in telemetry.subscribe_position_velocity_ned():
        here = (motion.position.north_m, motion.position.east_m, motion.position.down_m)
        if here == pytest.approx(position_ned_m, abs=within_m):
            return


async def disarmed(telemetry: TelemetryAsync) -> None:
    async for armed in telemetry.subscribe_armed():
        if not armed:
            return


async def files_and_metadata(system: Any, directory: Path) -> None:
    files, metadata = FtpAsync(system), ComponentMetadataAsync(system)
    listing = await files.list_directory("/etc/extras")
    names = {entry.name for entry in listing.entries}
    assert names == {"component_general.json.xz", "parameters.json.xz"}
    async for _ in files.download("/etc/extras/parameters.json.xz", str(directory), True):
        pass
    content = (directory / "parameters.json.xz").read_bytes()
    described = json.loads(lzma.decompress(content))["parameters"]
    with pytest.raises(FtpError, match="FILE_DOES_NOT_EXIST"):
        await files.list_directory("/fs/microsd")
    await metadata.request_autopilot_component()
    async for found in metadata.subscribe_metadata_available():
        if found.type == MetadataType.PARAMETER:
            assert json.loads(found.json_metadata)["parameters"] == described
            break


async def parameters_and_identity(system: Any) -> None:
    info, params = InfoAsync(system), ParamAsync(system)
    version = await info.get_version()
    assert (version.flight_sw_major, version.flight_sw_minor) == (1, 15)
    every = await params.get_all_params()
    values = {one.name: one.value for one in (*every.int_params, *every.float_params)}
    assert values["COM_OF_LOSS_T"] == pytest.approx(1.0)
    assert values["COM_OBL_RC_ACT"] == 5
    await params.set_param_float("MPC_XY_CRUISE", 3.5)
    assert await params.get_param_float("MPC_XY_CRUISE") == pytest.approx(3.5)
    await params.set_param_int("NAV_DLL_ACT", 2)
    assert await params.get_param_int("NAV_DLL_ACT") == 2
    with pytest.raises(ParamError, match="DOES_NOT_EXIST"):
        await params.get_param_float("NO_SUCH_PARAM")
    with pytest.raises(FailureError, match=r"DISABLED|DENIED"):
        await FailureAsync(system).inject(FailureUnit.SENSOR_GPS, FailureType.OFF, 0)
    await params.set_param_int("SYS_FAILURE_EN", 1)
    await FailureAsync(system).inject(FailureUnit.SENSOR_GPS, FailureType.OFF, 0)
    telemetry, action = TelemetryAsync(system), ActionAsync(system)
    async for gps in telemetry.subscribe_gps_info():
        if gps.num_satellites == 0:
            break
    with pytest.raises(ActionError):
        await action.arm()


def test_info_param_and_failure_plugins(tmp_path: Path) -> None:
    async def script(system: Any) -> None:
        await files_and_metadata(system, tmp_path)
        await parameters_and_identity(system)

    talk(tmp_path, script)


async def mission(system: Any) -> None:
    telemetry, missions, action = (
        TelemetryAsync(system),
        MissionAsync(system),
        ActionAsync(system),
    )
    await healthy(telemetry)
    home = await anext(telemetry.subscribe_home())
    north = 8.0 / 111_195.0  # degrees
    places = [(home.latitude_deg + north, 4.0), (home.latitude_deg, 6.0)]
    items = [
        MissionItem(
            latitude_deg=latitude_deg,
            longitude_deg=home.longitude_deg,
            relative_altitude_m=height_m,
            speed_m_s=4.0,
            is_fly_through=True,
        )
        for latitude_deg, height_m in places
    ]
    await missions.set_return_to_launch_after_mission(False)
    await missions.upload_mission(MissionPlan(items))
    downloaded = (await missions.download_mission()).mission_items
    assert [item.latitude_deg for item in downloaded] == pytest.approx(
        [latitude_deg for latitude_deg, _ in places], abs=1e-6
    )
    await action.arm()
    await missions.start_mission()
    progress = []
    async for step in missions.subscribe_mission_progress():
        progress.append((step.current, step.total))
        if step.current == step.total:
            break
    assert progress[-1] == (2, 2)
    assert (1, 2) in progress
    assert await missions.is_mission_finished()
    await at(telemetry, (0.0, 0.0, -6.0))
    await missions.set_current_mission_item(0)
    await missions.start_mission()
    await at(telemetry, (8.0, 0.0, -4.0), within_m=2.2)  # flown through
    await missions.pause_mission()
    await missions.clear_mission()
    await action.land()
    await disarmed(telemetry)


def test_mission_plugin_uploads_downloads_and_flies(tmp_path: Path) -> None:
    talk(tmp_path, mission)


async def offboard(system: Any) -> None:
    telemetry, stream, action = (
        TelemetryAsync(system),
        OffboardAsync(system),
        ActionAsync(system),
    )
    for set_rate in (telemetry.set_rate_health, telemetry.set_rate_position_velocity_ned):
        await set_rate(10.0)
    await healthy(telemetry)
    await stream.set_position_ned(PositionNedYaw(0.0, 0.0, -3.0, 0.0))
    await stream.start()
    assert await stream.is_active()
    await stream.set_position_ned(PositionNedYaw(6.0, 2.0, -3.0, 90.0))
    await at(telemetry, (6.0, 2.0, -3.0))
    await stream.set_velocity_ned(VelocityNedYaw(-2.0, 0.0, 0.0, 90.0))
    await at(telemetry, (1.0, 2.0, -3.0))
    await stream.stop()
    await action.hold()
    await action.return_to_launch()
    await disarmed(telemetry)


def test_offboard_and_action_plugins_fly_px4(tmp_path: Path) -> None:
    start = {"position_ned_m": [0.0, 0.0, -3.0]}
    parameters = {"RTL_RETURN_ALT": 4.0, "COM_DISARM_LAND": 0.1}
    talk(tmp_path, offboard, start=start, parameters=parameters)


async def copter(system: Any) -> None:
    telemetry, action = TelemetryAsync(system), ActionAsync(system)
    await telemetry.set_rate_health(4.0)
    await telemetry.set_rate_position_velocity_ned(20.0)
    await telemetry.set_rate_position(5.0)
    await healthy(telemetry)
    await action.set_takeoff_altitude(3.0)
    with pytest.raises(ActionError):
        await action.takeoff()  # not armed
    await action.arm()
    await action.takeoff()
    await at(telemetry, (0.0, 0.0, -3.0))
    home = await anext(telemetry.subscribe_position())
    north = 5.0 / 111_195.0
    above_sea_m = home.absolute_altitude_m + 1.0
    await action.goto_location(home.latitude_deg + north, home.longitude_deg, above_sea_m, 0.0)
    await at(telemetry, (5.0, 0.0, -4.0))
    await action.land()
    await disarmed(telemetry)


def test_action_plugin_flies_ardupilot(tmp_path: Path) -> None:
    talk(tmp_path, copter, flavour="ardupilot")
