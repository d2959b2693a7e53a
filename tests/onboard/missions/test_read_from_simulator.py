"""The mission protocol against the simulated autopilots, uploaded as a ground station does it."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from onboard.autonomy import Autonomy
from onboard.files.contract_file import Contract
from onboard.files.daemon_config import VehicleMission
from onboard.missions.from_vehicle import PLACEHOLDER
from sitl.config import HomeConfig, VehicleConfig
from sitl.vehicle.vehicle import SimulatedVehicle
from tests.onboard.test_autonomy import EPOCH_UNIX_S

STEP_S = 0.02
DAEMON, STATION = 0, 1
HOME = HomeConfig()
FENCE = mavlink.MAV_MISSION_TYPE_FENCE


class Both:
    """The daemon's service and a ground station, each on a link of the vehicle."""

    def __init__(self, contract: Contract, flavour: str) -> None:
        self.vehicle = SimulatedVehicle(VehicleConfig.model_validate({"flavour": flavour}))
        for link in (DAEMON, STATION):
            self.vehicle.autopilot.open_link(link)
        self.service = Autonomy(contract, PLACEHOLDER, epoch_unix_s=EPOCH_UNIX_S)
        self.service.fly_mission_on_board(VehicleMission(target_half_width_m=8.0))
        self._codec = mavlink.MAVLink(None, 255, 190)
        self._reader = mavlink.MAVLink(None)
        self.texts: list[str] = []
        self.heard: list[Any] = []
        self.now_s = 0.0

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP_S)):
            self.now_s += STEP_S
            self.vehicle.advance(self.now_s)
            self.service.receive_mavlink(self.vehicle.bytes_to_send(DAEMON), self.now_s)
            self.service.tick(self.now_s)
            self.vehicle.receive(self.service.mavlink_to_send(), DAEMON)
            self.heard += self._reader.parse_buffer(self.vehicle.bytes_to_send(STATION)) or []
            self.texts += [event.text for event in self.service.events()]

    def upload(self, which: int, *items: tuple[int, float, float, float]) -> None:
        """Upload items: command, first parameter, steps north and east of home."""
        self.say(mavlink.MAVLink_mission_count_message(1, 1, len(items), which))
        for number, (command, param1, north, east) in enumerate(items):
            place = (int((HOME.latitude_deg + north) * 1e7), int((HOME.longitude_deg + east) * 1e7))
            frame = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
            content = (frame, command, 0, 1, param1, 0.0, 0.0, 0.0, *place, 5.0)
            self.say(mavlink.MAVLink_mission_item_int_message(1, 1, number, *content, which))
        self.run(0.2)
        acknowledged = [each for each in self.heard if each.get_type() == "MISSION_ACK"]
        results = [each.type for each in acknowledged if each.mission_type == which][-1:]
        assert results == [mavlink.MAV_MISSION_ACCEPTED]

    def say(self, message: Any) -> None:
        self.vehicle.receive(bytes(message.pack(self._codec)), STATION)
        self.run(STEP_S)


@pytest.mark.parametrize("flavour", ["px4", "ardupilot"])
def test_mission_and_geofence_are_read_and_their_change_is_noticed(
    contract: Contract, flavour: str
) -> None:
    both = Both(contract, flavour)
    home = [(16, 0.0, 0.0, 0.0)] if flavour == "ardupilot" else []
    both.upload(0, *home, (22, 0.0, 0.0, 0.0), (16, 0.0, 3e-4, 0.0), (16, 0.0, 3e-4, 3e-4))
    corners = [(-1e-3, -1e-3), (1e-3, -1e-3), (1e-3, 1e-3), (-1e-3, 1e-3)]
    both.upload(FENCE, *((5001, 4.0, north, east) for north, east in corners))
    both.run(6.0)
    assert both.service.navigator.situation.mission_doubt is None
    summary = both.service.vehicle_mission.summary if both.service.vehicle_mission else ""
    assert summary.startswith("2 legs, 56 m, at 5.0 m above the local origin; geofence of 1 area")
    assert both.service.navigator.situation.mission_doubt is None
    both.upload(0, *home, (22, 0.0, 0.0, 0.0), (16, 0.0, 4e-4, 0.0))
    both.run(4.0)
    assert any(text.startswith("mission read from the vehicle: 1 leg, ") for text in both.texts)
