"""Every fault does what it says, and every broken assumption ends as its scenario expects."""

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20.common import MAVLink

from gcs_tools.logs.flight_log import read_log
from gcs_tools.logs.result import result_of
from gcs_tools.scenario import Scenario, load_scenario
from sitl.config import StartConfig
from sitl.vehicle.vehicle import SimulatedVehicle
from sitl.virtual.faults.plant import PlantFaults
from sitl.virtual.faults.schedule import AMOUNTS, EDITS, Fault, FaultInjector, FaultKind
from sitl.virtual.simulation import SimulatedFlight, Simulation, fly

SCENARIOS = sorted((Path(__file__).parents[3] / "config" / "scenarios").glob("*.yaml"))
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
        ("detections_split", None, ("obstacles", 0, "center_m"), [17.75, 1.0]),
        ("detections_split", None, ("obstacles", 1, "size_m"), [0.5, 2.0]),
        ("detections_wrong_frame", None, ("frame",), "body_frd"),
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
    assert set(EDITS) - set(AMOUNTS) == {
        "detections_renamed",
        "detections_split",
        "detections_merged",
        "detections_swapped",
        "detections_wrong_frame",
    }


def two_boxes() -> bytes:
    seen = json.loads(frame())
    other = {**seen["obstacles"][0], "id": "2", "center_m": [18.0, 9.0]}
    return json.dumps({**seen, "obstacles": [seen["obstacles"][0], other]}).encode()


def injector_of(kind: FaultKind, amount: float | None = None) -> FaultInjector:
    injector = FaultInjector((Fault(kind=kind, amount=amount),), seed=1)
    injector.advance(0.0, "cruise")
    return injector


def test_merged_boxes_are_enclosed_by_one() -> None:
    (data,) = injector_of("detections_merged").detections([two_boxes()], 0.0, HERE_NED_M)
    (merged,) = json.loads(data)["obstacles"]
    assert merged["center_m"] == pytest.approx([18.0, 5.0])
    assert merged["size_m"][1] >= 8.0 + 2.0


def test_swapped_boxes_exchange_their_names() -> None:
    injector = injector_of("detections_swapped")
    names = []
    for _ in range(2):
        (data,) = injector.detections([two_boxes()], 0.0, HERE_NED_M)
        names.append([box["id"] for box in json.loads(data)["obstacles"]])
    assert sorted(names) == [["1", "2"], ["2", "1"]]


def test_a_skewed_clock_runs_away() -> None:
    injector = FaultInjector((Fault(kind="sensor_clock_skewed", amount=0.1),), seed=1)
    stamps = []
    for now_s in (1.0, 2.0, 3.0):
        injector.advance(now_s, "cruise")
        (data,) = injector.detections([frame()], now_s, HERE_NED_M)
        stamps.append(json.loads(data)["stamp_unix_s"])
    assert stamps == pytest.approx([100.0, 100.1, 100.2])


def test_a_frame_out_of_order_follows_the_next() -> None:
    injector = injector_of("detections_out_of_order", 1.0)
    one, other = frame((1.0, 0.0)), frame((2.0, 0.0))
    assert injector.detections([one, other], 0.0, HERE_NED_M) == [other, one]


def through(kind: FaultKind, amount: float) -> tuple[list[bytes], list[bytes]]:
    """What arrives of 200 datagrams, down and up."""
    injector, down, up = FaultInjector((Fault(kind=kind, amount=amount),), seed=1), [], []
    for step in range(220):
        injector.advance(step * 0.02, "cruise")
        sent = b"%05d" % step if step < 200 else b""
        down.append(injector.telemetry(sent))
        up.append(injector.setpoints(sent))
    return [d for d in down if d], [d for d in up if d]


def test_a_misreported_position_drifts_off_and_back() -> None:
    fault = Fault(kind="position_misreported", start_s=1.0, duration_s=3.0, amount=0.42)
    injector, out, back = FaultInjector((fault,), seed=1), MAVLink(None, 1, 1), MAVLink(None)
    told_m = []
    for step in range(300):
        injector.advance(step * 0.02, "cruise")
        position = out.local_position_ned_encode(20 * step, *(0.0,) * 6)
        (heard,) = back.parse_buffer(injector.telemetry(position.pack(out)))
        told_m.append(heard.y)
    assert max(abs(later - before) for before, later in pairwise(told_m)) <= 0.5 * 0.02 + 1e-6
    assert told_m[49] == told_m[-1] == 0.0
    assert told_m[100] == pytest.approx(0.42)


def test_links_lose_and_double_as_named() -> None:
    expected: tuple[tuple[FaultKind, int, int], ...] = (
        ("link_lossy", 110, 170),
        ("link_duplicating", 230, 290),
    )
    for kind, low, high in expected:
        for arrived in through(kind, 0.3):
            assert low < len(b"".join(arrived)) // 5 < high
    assert through("link_partitioned", 0.0) == ([], [])
    for arrived in through("link_reordering", 0.5):
        whole = b"".join(arrived)
        assert len(whole) == 1000
        assert whole != b"".join(b"%05d" % step for step in range(200))
    for arrived in through("link_corrupting", 0.3):
        assert b"".join(arrived) != b"".join(b"%05d" % step for step in range(200))


def flown(*faults: Fault, until_s: float) -> Simulation:
    scenario = load_scenario(SCENARIOS[0].with_name("daemon_dead.yaml"))
    simulation = Simulation(
        SimulatedFlight(
            scenario.contract,
            scenario.mission,
            scenario.sitl_config(seed=1),
            scenario.obstacles,
            faults=faults,
        )
    )
    while simulation.now_s < until_s:
        simulation.advance()
    return simulation


def flight_of(scenario: Scenario, time_limit_s: float) -> SimulatedFlight:
    return SimulatedFlight(
        scenario.contract,
        scenario.mission,
        scenario.sitl_config(seed=1),
        scenario.obstacles,
        faults=scenario.faults,
        time_limit_s=time_limit_s,
    )


def test_the_vehicle_breaks_and_is_mended() -> None:
    """All at once on the ground: what each does in flight is the campaign's to say."""
    kinds: tuple[FaultKind, ...] = (
        "parameter_changed",
        "attitude_slow",
        "gps_lost",
        "mode_rejected",
        "thrust_lost",
    )
    faults = tuple(Fault(kind=kind, start_s=0.5, duration_s=1.0) for kind in kinds)
    broken, mended = flown(*faults, until_s=1.0), flown(*faults, until_s=2.0)
    for simulation, present in ((broken, True), (mended, False)):
        autopilot = simulation.scene.vehicle.autopilot
        failures = autopilot.commander.failures
        assert failures.modes_refused is present
        assert failures.gps_has_fix is not present
        assert (failures.rotor_shares.rotor1_rpm == pytest.approx(0.9)) is present
        assert (autopilot.parameters["MPC_TILTMAX_AIR"] == 20.0) is present
        assert (autopilot.commander.settings.roll_gain_per_s == 3.0) is present


def test_a_height_estimate_jumps_and_the_vehicle_follows_it_the_other_way() -> None:
    scenario = load_scenario(next(path for path in SCENARIOS if path.stem == "tracking_error"))
    config = scenario.sitl_config().model_copy(
        update={"start": StartConfig(position_ned_m=(0.0, 0.0, -6.0))}
    )
    vehicle = SimulatedVehicle(config)
    vehicle.autopilot.open_link(1)
    faults = FaultInjector((Fault(kind="height_reset", start_s=1.0, amount=2.0),), seed=1)
    plant_faults = PlantFaults(vehicle, 1, "px4", 1)
    heights_m = []
    for tick in range(600):
        now_s = tick * 0.02
        faults.advance(now_s, "cruise")
        plant_faults.apply(faults, now_s)
        vehicle.advance(now_s)
        heights_m.append((-vehicle.truth.position_ned_m[2], -vehicle.estimate.position_ned_m[2]))
    assert heights_m[49] == pytest.approx((6.0, 6.0), abs=0.1)
    assert heights_m[55] == pytest.approx((6.0, 8.0), abs=0.3)
    assert heights_m[-1] == pytest.approx((4.0, 6.0), abs=0.2)  # it descends, and believes to hold
    assert vehicle.autopilot.estimator.resets == 1


def test_a_failed_motor_brings_a_quadrotor_down() -> None:
    height_m = -flown(until_s=7.0).scene.vehicle.truth.position_ned_m[2]
    assert height_m > 3.0
    fallen = flown(Fault(kind="motor_failed", start_s=7.0), until_s=12.0)
    assert -fallen.scene.vehicle.truth.position_ned_m[2] < 0.5


def test_a_gust_pushes_to_the_east() -> None:
    gust = Fault(kind="gust", start_s=7.0, amount=9.0)
    east_m = [
        flown(*faults, until_s=8.5).scene.vehicle.truth.position_ned_m[1]
        for faults in ((), (gust,))
    ]
    assert east_m[1] - east_m[0] > 0.045


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


def test_a_reset_of_the_estimate_does_not_fly_the_vehicle_aside(tmp_path: Path) -> None:
    """What it is asked to hold is where it believes to be, 3 m beside where it is."""
    scenario = load_scenario(next(path for path in SCENARIOS if path.stem == "estimator_reset"))
    flight = flight_of(scenario, time_limit_s=120.0)
    fly(flight, tmp_path)
    truths = read_log(tmp_path / "truth.mcap").truths
    assert max(abs(truth.position_ned_m[1]) for truth in truths) < 1.0


@pytest.mark.parametrize(
    ("scenario_name", "event", "texts"),
    [
        ("disk_full", "log_ended", ["flying on without a log: [Errno 28] No space left on device"]),
        ("mission_changed", "mission_changed", ["another mission is flown now"]),
    ],
)
def test_what_breaks_no_assumption_is_said_once(
    tmp_path: Path, scenario_name: str, event: str, texts: list[str]
) -> None:
    scenario = load_scenario(next(path for path in SCENARIOS if path.stem == scenario_name))
    flight = flight_of(scenario, time_limit_s=30.0)
    fly(flight, tmp_path)
    events = read_log(tmp_path / "flight.mcap").events
    assert [e.text for e in events if e.name == event] == texts


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.stem)
def test_broken_assumption_ends_as_expected(path: Path, tmp_path: Path) -> None:
    scenario = load_scenario(path)
    flight = flight_of(scenario, time_limit_s=120.0)
    report = fly(flight, tmp_path)
    logs = [read_log(tmp_path / f"{name}.mcap") for name in ("flight", "truth")]
    result = result_of(*logs, seed=1, aborted=report.aborted)
    assert result.meets(scenario.expect), result
    assert result.collisions == 0
    assert report.virtual_s < 120.0
