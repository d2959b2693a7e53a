"""Every fault does what it says, and every broken assumption ends as its scenario expects."""

import json
from pathlib import Path
from typing import Any

import pytest

from gcs_tools.flight_log import read_log
from gcs_tools.result import result_of
from gcs_tools.scenario import load_scenario
from sitl.faults import AMOUNTS, EDITS, Fault, FaultInjector, FaultKind
from sitl.simulation import SimulatedFlight, fly

SCENARIOS = sorted((Path(__file__).parents[2] / "config" / "scenarios").glob("*.yaml"))
HERE_NED_M = (10.0, 0.0, -4.0)


def frame(center_m: tuple[float, float] = (18.0, 1.0)) -> bytes:
    obstacle = {"id": "1", "center_m": list(center_m), "size_m": [1.0, 2.0], "yaw_deg": 0.0}
    return json.dumps(
        {
            "version": 1,
            "stamp_unix_s": 100.0,
            "frame": "local_ned",
            "range_m": 12.0,
            "field_of_view_deg": 120.0,
            "obstacles": [obstacle | {"uncertainty_m": 0.05}],
        }
    ).encode()


def spoilt(kind: FaultKind, amount: float | None = None) -> list[dict[str, Any]]:
    injector = FaultInjector((Fault(kind=kind, amount=amount),), seed=1)
    injector.advance(0.0, "cruise")
    return [json.loads(data) for data in injector.detections([frame()], 0.0, HERE_NED_M)]


@pytest.mark.parametrize(
    ("kind", "amount", "path", "expected"),
    [
        ("detections_short_range", 5.0, ("range_m",), 5.0),
        ("detections_short_range", 5.0, ("obstacles",), []),
        ("detections_narrow_view", 60.0, ("field_of_view_deg",), 60.0),
        ("detections_uncertain", 0.2, ("obstacles", 0, "uncertainty_m"), 0.2),
        ("detections_shifted", 0.03, ("obstacles", 0, "center_m", 1), pytest.approx(0.97)),
        ("detections_oversized", 3.0, ("obstacles", 0, "size_m"), [3.0, 6.0]),
        (
            "detections_wrong_units",
            0.001,
            ("obstacles", 0, "center_m"),
            pytest.approx([0.018, 0.001]),
        ),
        ("detections_ghost", 9.0, ("obstacles", 1, "center_m"), [19.0, 0.0]),
        ("detections_renamed", None, ("obstacles", 0, "id"), "1-0"),
        ("detections_hidden", 5.0, ("obstacles",), []),
        ("detections_hidden", 5.0, ("range_m",), 12.0),
        ("sensor_clock_ahead", 5.0, ("stamp_unix_s",), 105.0),
    ],
)
def test_detections_are_spoilt_as_named(
    kind: FaultKind, amount: float | None, path: tuple[str | int, ...], expected: object
) -> None:
    (value,) = spoilt(kind, amount)
    found: Any = value
    for key in path:
        found = found[key]
    assert found == expected


def test_every_edit_has_an_amount_or_needs_none() -> None:
    assert set(EDITS) - set(AMOUNTS) == {"detections_renamed"}


def test_late_frames_arrive_late_and_in_order() -> None:
    injector = FaultInjector((Fault(kind="detections_late", amount=0.1),), seed=1)
    heard = []
    for step in range(20):
        injector.advance(step * 0.05, "cruise")
        heard += injector.detections(
            [str(step).encode()] if step < 5 else [], step * 0.05, HERE_NED_M
        )
    assert heard == [b"0", b"1", b"2", b"3", b"4"]
    injector = FaultInjector((Fault(kind="detections_late", amount=0.1),), seed=1)
    injector.advance(0.0, "cruise")
    assert injector.detections([frame()], 0.0, HERE_NED_M) == []


def test_slow_sensor_lets_one_frame_in_four_through() -> None:
    injector = FaultInjector((Fault(kind="detections_slow"),), seed=1)
    injector.advance(0.0, "cruise")
    heard = [injector.detections([frame()], 0.0, HERE_NED_M) for _ in range(40)]
    assert sum(map(len, heard)) == 10


def test_window_counts_from_the_named_entry_into_a_phase() -> None:
    fault = Fault(kind="tick_stall", phase="avoid", entry=2, start_s=0.5, duration_s=1.0)
    injector = FaultInjector((fault,), seed=1)
    stalled = []
    for step, phase in enumerate(
        ["cruise", "avoid", "cruise", "avoid", "avoid", "avoid", "cruise"]
    ):
        injector.advance(step * 0.5, phase)
        stalled.append(injector.present("tick_stall"))
    assert stalled == [False, False, False, False, True, True, False]


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.stem)
def test_broken_assumption_ends_as_expected(path: Path, tmp_path: Path) -> None:
    scenario = load_scenario(path)
    flight = SimulatedFlight(
        scenario.contract,
        scenario.mission,
        scenario.sitl_config(seed=1),
        scenario.obstacles,
        faults=scenario.faults,
        time_limit_s=120.0,
    )
    report = fly(flight, tmp_path)
    logs = [read_log(tmp_path / f"{name}.mcap") for name in ("flight", "truth")]
    aborted = None if report.landed else "not landed"
    result = result_of(*logs, seed=1, aborted=aborted)
    assert result.meets(scenario.expect), result
    assert result.collisions == 0
    assert report.landed
