"""A flight among virtual obstacles avoids them, and nothing lets it be taken for a real one."""

from __future__ import annotations

import io
import json
import math
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from gcs_tools.doctor.command import _status_lines
from gcs_tools.flight_report.document import document_of
from gcs_tools.flight_report.flight import Flight
from gcs_tools.logs.flight_log import Log, log_of
from gcs_tools.watch.terminal import _state
from onboard.events import EventName
from onboard.files.contract_file import load_contract
from onboard.files.mission_file import Mission
from onboard.files.obstacle_field import ObstacleField
from onboard.files.sensor_sources import FieldFileSource
from onboard.recording.messages import EventRecord, Record, StateRecord
from sitl.config import SitlConfig
from sitl.virtual.simulation import SimulatedFlight, Simulation, ticks
from tests.gcs_tools.running import CONFIG

CONTRACT = load_contract(CONFIG / "ardupilot_contract.yaml")
# Where the only obstacle is, from home.
NORTH_M, EAST_M, HALF_M = 25.0, 1.0, 0.8


def simulation(tmp_path: Path, **keys: Any) -> Simulation:
    field = tmp_path / "virtual.yaml"
    center, size = f"[{NORTH_M}, {EAST_M}]", f"[{2 * HALF_M}, {2 * HALF_M}]"
    field.write_text(f"- {{id: shed, center_ned_m: {center}, size_m: {size}}}\n", encoding="utf-8")
    sensor = CONTRACT.sensor
    source = FieldFileSource.model_validate(
        {
            "kind": "field_file", "name": "virtual", "field": field, "relative_to": "home",
            "range_m": sensor.detection_range_m, "uncertainty_m": sensor.position_error_m,
            "field_of_view_deg": sensor.field_of_view_deg, **keys,
        }
    )  # fmt: skip
    mission = Mission.model_validate(
        {"altitude_m": 5.0, "legs": [{"end_ned_m": (40.0, 0.0), "target_half_width_m": 20.0}]}
    )
    parameters = {"GUID_TIMEOUT": 0.5, "PSC_JERK_XY": 20.0, "WPNAV_ACCEL": 600.0}
    sitl = SitlConfig.model_validate(
        {"flavour": "ardupilot", "parameters": parameters, "sensors": []}
    )
    return Simulation(
        SimulatedFlight(CONTRACT, mission, sitl, ObstacleField.of([]), sources=(source,))
    )


def test_it_avoids_what_is_not_there_and_says_so_everywhere(tmp_path: Path) -> None:
    flown, nearest_m = simulation(tmp_path), math.inf
    records: list[Record] = []
    for of_tick in ticks(flown):
        records += of_tick
        north_m, east_m, _ = flown.scene.vehicle.truth.position_ned_m
        away_m = math.hypot(
            max(abs(north_m - NORTH_M) - HALF_M, 0.0), max(abs(east_m - EAST_M) - HALF_M, 0.0)
        )
        nearest_m = min(nearest_m, away_m)
    assert flown.aborted is None
    assert flown.scene.vehicle.truth.position_ned_m[0] > 38.0
    assert CONTRACT.vehicle.radius_m < nearest_m < 8.0

    states = [each for each in records if isinstance(each, StateRecord)]
    assert all(state.virtual_obstacles for state in states)
    said = [each for each in records if isinstance(each, EventRecord)]
    virtual = [each for each in said if each.name == EventName.VIRTUAL_OBSTACLES]
    assert [each.text for each in virtual] == ["VIRTUAL OBSTACLES: real ones are not seen"]
    assert not any("adapted" in each.name or "refused" in each.name for each in said)

    assert ("sees", "VIRTUAL OBSTACLES: real ones are not seen") in _status_lines("v", states[-1])
    screen = Console(width=120, record=True, file=io.StringIO())
    screen.print(_state(states[-1], None, None, states[-1].time_s))
    assert "VIRTUAL OBSTACLES" in screen.export_text()
    report = document_of(Flight("virtual", log_of(records), Log(), None))
    assert report["problems"][0].startswith("VIRTUAL OBSTACLES")


@pytest.mark.parametrize(("beside", "taken"), [(False, False), (True, True)])
def test_a_real_sensor_is_not_taken_unless_stated(
    tmp_path: Path, *, beside: bool, taken: bool
) -> None:
    autonomy = simulation(tmp_path, beside_real_sensors=beside).autonomy
    frame = {
        "version": 1, "source": "front", "sequence": 1, "stamp_unix_s": autonomy.epoch_unix_s,
        "frame": "local_ned", "range_m": 15.0, "field_of_view_deg": 120.0, "obstacles": [],
    }  # fmt: skip
    autonomy.receive_detection(json.dumps(frame).encode(), 0.0)
    autonomy.tick(0.0)
    refused = [each.text for each in autonomy.events() if each.name == EventName.SENSOR_REFUSED]
    assert any("beside_real_sensors" in text for text in refused) is not taken
