"""The figures of a soak, from records made by hand; the soak itself takes an hour."""

from __future__ import annotations

import json
from collections import Counter
from typing import Any

import pytest

from onboard.files.mission_file import Leg, Mission
from tests.tools.soak.__main__ import soak_scenario, to_and_fro
from tests.tools.soak.figures import (
    LateTick,
    Sample,
    Soak,
    failures,
    late_ticks,
    rise_mb_per_h,
    table,
)

BEGAN_UNIX_S = 1.79e9


def soak(
    rise_mb_per_h: float = 0.0,
    stolen_s: float = 0.0,
    pages_mb_per_h: float = 0.0,
    **changes: Any,
) -> Soak:
    """Return an hour's record: memory settles in ten minutes, and rises from then on.

    Args:
        rise_mb_per_h: of the daemon's own memory.
        stolen_s: what the hypervisor took after half an hour.
        pages_mb_per_h: rise of the pages of files.
        changes: of the record.
    """
    samples = []
    for time_s in range(0, 3600, 10):
        settled_bytes = 140e6 - 10e6 * max(0.0, 1.0 - time_s / 600.0)
        grown_bytes = rise_mb_per_h * 1e6 * time_s / 3600.0
        stolen = stolen_s if time_s >= 1800 else 0.0
        own_bytes = settled_bytes + grown_bytes
        resident_bytes = own_bytes + 30e6 + pages_mb_per_h * 1e6 * time_s / 3600.0
        memory = (resident_bytes, own_bytes, 280e6)
        samples.append(Sample(float(time_s), *memory, 0.15 * time_s, stolen))
    metrics = {
        "clearway_tick_duration_seconds_count": 180_000.0,
        "clearway_tick_duration_seconds_sum": 270.0,
        "clearway_tick_duration_max_seconds": 0.015,
    }
    values: dict[str, Any] = {
        "samples": samples, "metrics": metrics, "legs": 80,
        "phases": Counter(thread=3500, pause=90), "clearance_min_m": 0.8,
    }  # fmt: skip
    return Soak(BEGAN_UNIX_S, **(values | changes))


def test_memory_that_settles_is_flat_and_memory_that_leaks_is_not() -> None:
    steady = soak(pages_mb_per_h=5.0)
    rises = [rise_mb_per_h(steady.samples, f"daemon_{key}") for key in ("anonymous_bytes", "bytes")]
    assert rises == pytest.approx([0.0, 5.0], abs=0.01)
    assert list(failures(steady)) == []
    assert list(failures(soak(rise_mb_per_h=3.0))) == [
        "the daemon's memory rises by 3.00 MB/h (limit 2)"
    ]


@pytest.mark.parametrize(
    ("tick", "stolen_s", "fails"),
    [
        (LateTick(BEGAN_UNIX_S + 1800.0, 0.06, own=True), 0.0, True),
        (LateTick(BEGAN_UNIX_S + 1800.0, 0.06, own=False), 0.0, False),
        # The hypervisor had taken the processor just then.
        (LateTick(BEGAN_UNIX_S + 1799.0, 0.06, own=True), 0.05, False),
        (LateTick(BEGAN_UNIX_S + 900.0, 0.06, own=True), 0.05, True),
    ],
)
def test_a_late_tick_fails_unless_the_machine_explains_it(
    tick: LateTick, stolen_s: float, fails: bool
) -> None:
    record = soak(stolen_s=stolen_s, late=[tick])
    record.samples = [
        sample._replace(stolen_s=stolen_s if sample.time_s >= 1800.0 else 0.0)
        for sample in (
            *record.samples,
            record.samples[179]._replace(time_s=1799.0),
            record.samples[180]._replace(time_s=1801.0),
        )
    ]
    record.samples.sort()
    assert bool(list(failures(record))) is fails
    rows = dict(table(record))
    assert rows["late ticks, our own"].startswith("1, the latest 60 ms" if fails else "0")
    assert rows["late ticks, starved"].startswith("0" if fails else "1, the latest 60 ms")


def test_late_ticks_are_read_from_the_daemons_messages() -> None:
    own = "tick 77 ms late (the daemon itself took too long): the last took 1 ms, waits 0 ms"
    starved = "tick 43 ms late (other processes had the processor): the last took 1 ms"
    lines = [
        json.dumps({"time_unix_s": 1.5, "message": own}),
        json.dumps({"time_unix_s": 2.5, "message": "ready: udpin"}),
        "not json",
        json.dumps({"time_unix_s": 3.5, "message": starved}),
    ]
    assert list(late_ticks(lines)) == [
        LateTick(1.5, 0.077, own=True),
        LateTick(3.5, 0.043, own=False),
    ]


def test_a_collision_or_a_flight_that_stood_fails() -> None:
    assert list(failures(soak(collisions=1, legs=0))) == ["1 collisions", "no leg was flown"]


def test_the_table_names_every_figure() -> None:
    rows = dict(table(soak(holds=["holding: late_ticks"])))
    assert rows["duration"] == "59.8 min, 80 legs flown"
    assert rows["ticks"] == "180000, mean 1.50 ms, longest 15 ms"
    assert rows["holds"] == "1; holding: late_ticks"
    assert rows["processor, daemon"] == "15.0%"


def test_the_mission_lasts_and_the_battery_too() -> None:
    mission = Mission(altitude_m=5.0, legs=(Leg(end_ned_m=(100.0, 0.0)),))
    legs = to_and_fro(mission, 60.0).legs
    assert len(legs) * 35.7 > 3600.0, "100 m at 2.8 m/s take 35.7 s"
    assert [leg.end_ned_m for leg in legs[:3]] == [(100.0, 0.0), (0.0, 0.0), (100.0, 0.0)]
    scenario = soak_scenario(60.0)
    assert scenario.plant.battery.capacity_ah == 65.0
    assert scenario.contract.requirements.progress == "best_effort"
