"""What the onboard service asks of each flavour arrives, at the rates that it needs."""

import pytest

from onboard.mavlink.endpoint import MavlinkEndpoint
from onboard.monitoring.estimator.position_quality import PositionQualityMonitor
from sitl.config import VehicleConfig
from sitl.vehicle.vehicle import SimulatedVehicle

TICK_S = 0.02


@pytest.mark.parametrize(
    ("flavour", "estimator"), [("px4", "ESTIMATOR_STATUS"), ("ardupilot", "EKF_STATUS_REPORT")]
)
def test_position_and_its_quality_arrive_as_asked(flavour: str, estimator: str) -> None:
    # In the air: at rest on the ground PX4 says that it makes its position up.
    config = {"flavour": flavour, "start": {"position_ned_m": [0.0, 0.0, -4.0]}}
    vehicle = SimulatedVehicle(VehicleConfig.model_validate(config))
    vehicle.autopilot.open_link(0)
    endpoint = MavlinkEndpoint(system_id=1)
    positions: list[float] = []
    asked_bytes = 0
    for tick in range(round(10.0 / TICK_S)):
        now_s = tick * TICK_S
        vehicle.advance(now_s)
        endpoint.receive(vehicle.bytes_to_send(0), now_s)
        if endpoint.pose is not None and endpoint.pose.time_s == now_s:
            positions.append(now_s)
        endpoint.keep_alive(now_s, active=False)
        data = endpoint.bytes_to_send()
        vehicle.receive(data, 0)
        asked_bytes = max(asked_bytes, len(data)) if now_s > 8.0 else 0
    reports = endpoint.position_reports
    assert sum(now_s > 5.0 for now_s in positions) >= 0.95 * 5.0 / TICK_S
    assert reports.estimator.report is not None
    assert reports.estimator.report.name == estimator
    assert reports.estimator.interval_s == pytest.approx(0.2, abs=0.03)
    assert reports.gps.interval_s < 0.23  # PX4 sends it faster unasked, and is left alone
    assert reports.health.interval_s < 0.55
    assert PositionQualityMonitor(reports).departure_failures(10.0) == []
    assert asked_bytes < 100  # all has come: only a heartbeat is sent
