"""The service with a lidar instead of boxes: from scans in CDR to setpoints, shielded."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from onboard.autonomy import Autonomy
from onboard.contract.assessment import TICK_S
from onboard.files.contract_file import load_contract
from onboard.files.mission_file import Mission
from onboard.files.sensor_sources import AnySource, ObstacleDistanceSource, TrafficSource
from onboard.guidance.phases import Phase
from tests.onboard.conftest import FROZEN
from tests.onboard.perception.ros2.encoding import attachment, scan_all_round
from tests.onboard.perception.sources.scenes import Box, lidar, tilted_ranges
from tests.onboard.perception.sources.test_traffic import KEYS as TRAFFIC
from tests.onboard.perception.sources.test_traffic import adsb, origin, position
from tests.onboard.test_autonomy import EPOCH_UNIX_S, OFFBOARD, Rig

CONTRACT = Path(__file__).parents[2] / "config" / "default_contract.yaml"
KEY = "0/scan/sensor_msgs::msg::dds_::LaserScan_/TypeHashNotSupported"
SCAN_TICKS = 3
# Pillars of any height: tilted by 15 degrees, a beam is 3.2 m higher or lower at 12 m.
# In the open a beam that meets nothing has to show free space, else none ahead is seen.
TALL = lidar(height_band_m=(3.5, 3.5), no_return_is_free_to_m=12.0)


class LidarRig:
    """A vehicle with one lidar among pillars."""

    def __init__(self, boxes: Sequence[Box], sensors: Sequence[AnySource], leg_m: float) -> None:
        leg = {"end_ned_m": [leg_m, 0.0], "target_half_width_m": 8.0}
        document = {"altitude_m": 4.0, "legs": [leg], "start_clear_m": 3.0}
        mission = Mission.model_validate(document)
        contract = load_contract(CONTRACT, (FROZEN,))
        autonomy = Autonomy(contract, mission, epoch_unix_s=EPOCH_UNIX_S, sensors=sensors)
        self.rig = Rig(autonomy, seeing=False, mode=OFFBOARD)
        self.boxes = boxes
        self.path: list[tuple[float, float]] = []

    def fly(self, seconds: float) -> None:
        rig = self.rig
        for tick in range(round(seconds / TICK_S)):
            rig.tick()
            self.path.append(rig.position_ned_m[:2])
            if tick % SCAN_TICKS == 0:
                self.scan()
            if rig.phase is Phase.ARRIVED:
                return

    def scan(self) -> None:
        rig = self.rig
        pose = rig.autonomy.link.pose
        assert pose is not None
        ranges_m = tilted_ranges(self.boxes, pose)
        payload = scan_all_round(ranges_m, stamp_unix_s=EPOCH_UNIX_S + rig.now_s)
        rig.autonomy.sensors.receive("lidar", payload, rig.now_s, key=KEY, attachment=attachment())

    def clearance_m(self) -> float:
        """Return how near the path came to a pillar."""
        path = np.array(self.path)
        nearest = []
        for north, east, length, width, _ in self.boxes:
            away = np.abs(path - (north, east)) - (length / 2.0, width / 2.0)
            nearest.append(float(np.hypot(*np.maximum(away, 0.0).T).min()))
        return min(nearest)


def test_a_scan_leads_around_a_pillar() -> None:
    flight = LidarRig([(20.0, 0.3, 1.0, 1.0, 0.0)], [TALL], 40.0)
    flight.fly(60.0)
    assert flight.rig.phase is Phase.ARRIVED
    assert flight.rig.texts("violation") == []
    assert flight.clearance_m() > 0.3
    assert max(abs(east) for _, east in flight.path) > 1.0


def test_a_hedge_of_50_m_does_not_stop_a_flight_beside_it() -> None:
    flight = LidarRig([(20.0, 9.0, 50.0, 0.6, 0.0)], [TALL], 40.0)
    flight.fly(60.0)
    assert flight.rig.phase is Phase.ARRIVED
    assert flight.rig.texts("violation") == []
    assert len(flight.rig.autonomy.navigator.obstacles) >= 10


def test_a_sensor_that_was_never_heard_is_a_blind_one() -> None:
    flight = LidarRig([], [TALL, lidar(name="rear", topic="/rear")], 40.0)
    flight.fly(6.0)
    assert flight.rig.phase is Phase.STANDBY
    assert any("rear never sent anything" in text for text in flight.rig.texts("refused"))


def test_what_is_refused_is_said_once_by_name_and_reason() -> None:
    flight = LidarRig([], [lidar()], 40.0)
    rig = flight.rig
    for _ in range(3):
        rig.autonomy.sensors.receive("lidar", b"{}", rig.now_s, key=KEY, attachment=attachment())
        rig.tick()
    assert rig.texts("sensor_refused") == ["sensor lidar: messages dropped: not plain CDR"]
    assert rig.autonomy.detections.malformed_frames == 3


def test_scans_before_the_first_telemetry_are_counted_but_no_fault() -> None:
    flight = LidarRig([], [TALL], 40.0)
    rig = flight.rig
    payload = scan_all_round([5.0] * 360, stamp_unix_s=EPOCH_UNIX_S)
    rig.speaking = False
    for _ in range(3):
        rig.autonomy.sensors.receive("lidar", payload, rig.now_s, key=KEY, attachment=attachment())
        rig.tick()
    assert rig.autonomy.detections.malformed_frames == 3
    assert rig.texts("sensor_refused") == []
    rig.speaking = True
    rig.run(1.0)
    payload = scan_all_round([5.0] * 360, stamp_unix_s=EPOCH_UNIX_S - 30.0)
    rig.autonomy.sensors.receive("lidar", payload, rig.now_s, key=KEY, attachment=attachment())
    rig.tick()
    (said,) = rig.texts("sensor_refused")
    assert said == "sensor lidar: messages dropped: no pose at its stamp"


@pytest.mark.parametrize("component", [mavlink.MAV_COMP_ID_AUTOPILOT1, 195])
def test_distances_come_over_the_vehicles_link_from_any_of_its_components(component: int) -> None:
    keys: dict[str, Any] = {"kind": "obstacle_distance", "name": "prox", "range_m": 12.0}
    source = ObstacleDistanceSource.model_validate(keys | {"uncertainty_m": 0.05})
    rig = LidarRig([], [source], 40.0).rig
    rig.run(0.5)
    mav = mavlink.MAVLink(None, 1, component)
    distances = [500 if index in (71, 0, 1) else 1501 for index in range(72)]
    message = mavlink.MAVLink_obstacle_distance_message(
        0, 0, distances, 5, 20, 1500, frame=mavlink.MAV_FRAME_BODY_FRD
    )
    rig.autonomy.receive_mavlink(bytes(message.pack(mav)), rig.now_s)
    rig.tick()
    (known,) = rig.autonomy.navigator.obstacles
    assert known.id.startswith("prox/")
    assert known.measured.x_min_m == pytest.approx(5.0, abs=0.1)
    assert rig.autonomy.supervisor.detections.monitor.sensors.keys() == {"prox"}


def test_a_vehicle_without_such_a_sensor_does_not_listen() -> None:
    rig = LidarRig([], [lidar()], 40.0).rig
    message = mavlink.MAVLink_obstacle_distance_message(0, 0, [500] * 72, 5, 20, 1500)
    rig.autonomy.receive_mavlink(bytes(message.pack(mavlink.MAVLink(None, 1, 1))), rig.now_s)
    assert rig.autonomy.link.take_ranges() == []
    assert math.isinf(rig.autonomy.supervisor.detections.monitor.age_s(1.0))


def test_other_vehicles_are_heard_on_the_link_but_no_flight_relies_on_them() -> None:
    source = TrafficSource.model_validate(TRAFFIC)
    rig = LidarRig([], [source], 40.0).rig
    autonomy = rig.autonomy
    assert autonomy.supervisor.detections.monitor.expected == frozenset()
    rig.run(0.5)
    autonomy.receive_mavlink(origin() + position(30.0, 40.0) + adsb(5.0, 0.0), rig.now_s)
    rig.tick()
    assert autonomy.sensors.frames_read == {"traffic": 2}
    assert autonomy.detections.malformed_frames == 0
    assert "traffic" not in autonomy.supervisor.detections.monitor.sensors
    # The contract has no movers: they are none, and nothing that stands still either.
    assert len(autonomy.navigator.obstacles) == 0
