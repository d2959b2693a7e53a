"""The record of what moves: what it holds, when it is written, and that others may read it."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.autonomy import Autonomy
from onboard.contract.assessment import TICK_S
from onboard.files.contract_file import load_contract
from onboard.files.mission_file import Leg, Mission
from onboard.guidance.departure import RefusalKind
from onboard.recording import movers as builder
from onboard.recording.journal import Journal
from onboard.recording.messages import Record, as_json
from onboard.recording.mover_record import KnownMover, MoversRecord, box_at, extent
from onboard.recording.movers import MOVERS_MAX, PERIOD_S, RUNS_MAX
from onboard.vehicle_state import Pose

CONFIG = Path(__file__).parents[3] / "config"
EPOCH_S = 1_790_000_000.0
RING_TICKS = 5


@dataclass
class Flight:
    """A service that hovers, and whose ring sees people."""

    contract: str = "movers_contract.yaml"
    shown: bool = True
    complete: bool = True
    tick: int = 0
    records: list[Record] = field(default_factory=list)

    def __post_init__(self) -> None:
        contract = load_contract(CONFIG / self.contract)
        leg = Leg(end_ned_m=(20.0, 0.0), target_half_width_m=4.0)
        mission = Mission(altitude_m=3.0, legs=(leg,))
        self.autonomy = Autonomy(contract, mission, epoch_unix_s=EPOCH_S)
        self.journal = Journal(self.autonomy, timed=False, shown=self.shown)

    def run(self, ticks: int, *people: dict[str, Any]) -> list[MoversRecord]:
        """Hover for some ticks, in every fifth of which the ring sees these; return the records."""
        before = len(self.records)
        for _ in range(ticks):
            self.tick += 1
            now_s = self.tick * TICK_S
            pose = Pose(now_s, (0.0, 0.0, -3.0), (0.0, 0.0, 0.0), 0.0, 0.0, 0.0)
            self.autonomy.link.pose = pose
            self.autonomy.supervisor.poses.add(pose)
            if self.tick % RING_TICKS == 0:
                self.see(now_s, people)
            self.autonomy.tick(now_s)
            self.records += self.journal.collect(now_s)
        return [each for each in self.records[before:] if isinstance(each, MoversRecord)]

    def see(self, now_s: float, people: tuple[dict[str, Any], ...]) -> None:
        frame = {
            "version": 2, "source": "ring", "sequence": self.tick, "frame": "local_ned",
            "stamp_unix_s": EPOCH_S + now_s, "range_m": 13.0, "field_of_view_deg": 360.0,
            "frame_complete": self.complete, "obstacles": list(people),
        }  # fmt: skip
        self.autonomy.receive_detection(json.dumps(frame).encode(), now_s)


def person(name: str, north_m: float, east_m: float = 0.0) -> dict[str, Any]:
    return {
        "id": name, "center_m": [north_m, east_m], "size_m": [0.6, 0.6], "yaw_deg": 0.0,
        "uncertainty_m": 0.05, "motion": "moving", "class": "person", "box_whole": True,
        "velocity_mps": [0.0, 1.0],
    }  # fmt: skip


def cells_of(record: MoversRecord) -> list[tuple[int, int]]:
    """Return the cells of a record that hold no mover."""
    runs = zip(record.row, record.column_from, record.column_to, strict=True)
    return [(row, column) for row, first, after in runs for column in range(first, after)]


def test_a_record_says_where_a_mover_was_seen_and_what_it_may_reach() -> None:
    flight = Flight()
    last = flight.run(60, person("anna", 6.0))[-1]
    (anna,) = last.movers
    assert (anna.id, anna.kind, anna.speed_max_mps) == ("ring/anna", "person", 1.2)
    assert anna.velocity_ned_mps == (0.0, 1.0)
    assert anna.seen_s == pytest.approx(last.time_s, abs=RING_TICKS * TICK_S + 1e-6)
    north_min_m, north_max_m, east_min_m, east_max_m = extent(anna.box_ned_m)
    assert (north_min_m, north_max_m) == pytest.approx((5.65, 6.35), abs=0.05)
    assert (east_min_m, east_max_m) == pytest.approx((-0.35, 0.35), abs=0.05)
    # It hovers and holds no way: what is reached is reached by now.
    assert last.until_s == pytest.approx(last.time_s)
    by_now = box_at(anna, last.time_s, last.stamp_error_s)
    assert extent(anna.reach_ned_m) == pytest.approx(extent(by_now), abs=2e-3)
    assert last.yielding is None
    assert not anna.yields_for
    assert last.missing is None


def test_cells_that_hold_no_mover_are_those_of_the_set() -> None:
    flight = Flight()
    last = flight.run(60, person("anna", 6.0))[-1]
    free = flight.autonomy.supervisor.detections.movers.free
    assert free is not None
    assert last.until_s is not None
    now_s = last.until_s - EPOCH_S
    north_m, east_m = last.corner_ned_m
    assert last.row
    cells = cells_of(last)
    for row, column in cells[::50]:
        low = north_m + row * last.cell_m + 1e-3, east_m + column * last.cell_m + 1e-3
        high = low[0] + last.cell_m - 2e-3, low[1] + last.cell_m - 2e-3
        assert free.are_free(np.array([low]), np.array([high]), np.array([now_s]))
    anna = math.floor((6.0 - north_m) / last.cell_m), math.floor(-east_m / last.cell_m)
    assert anna not in cells


def test_it_is_written_on_change_and_not_too_often() -> None:
    flight = Flight()
    records = flight.run(100, person("anna", 6.0))
    assert len(records) == pytest.approx(2.0 / PERIOD_S, abs=2)
    assert all(b.time_s - a.time_s > PERIOD_S - 1e-6 for a, b in pairwise(records))
    # Gone: three complete frames without it, and it is forgotten.
    flight.run(30)
    assert flight.run(50)[-1].movers == []
    # A silent sensor changes nothing: the last record stands, and boxes grow by its times.
    flight.run(2)
    before = len(flight.records)
    for tick in range(flight.tick + 1, flight.tick + 60):
        flight.autonomy.tick(tick * TICK_S)
        flight.records += flight.journal.collect(tick * TICK_S)
    later = [each for each in flight.records[before:] if isinstance(each, MoversRecord)]
    assert len(later) <= 2


def test_what_is_missing_is_told_until_a_place_counts() -> None:
    first, *_, last = Flight().run(60)
    assert first.missing == "no sensor has said where no mover is"
    assert last.missing is None


def test_frames_that_cannot_count_keep_the_vehicle_in_standby_and_say_why() -> None:
    """Without the reason it would wait in flight, for a mover that no sensor has seen."""
    flight = Flight(complete=False)
    last = flight.run(60)[-1]
    assert "frame_complete" in (last.missing or "")
    pose, now_s = flight.autonomy.link.pose, flight.tick * TICK_S
    assert pose is not None
    found = flight.autonomy.authority.departure_refusals(pose, now_s, EPOCH_S + now_s)
    (said,) = [each for each in found if each.subject == "movers"]
    assert said.kind is RefusalKind.DETECTIONS
    assert said.text.startswith("frames of ring show no place free of movers: ")


def test_without_movers_in_the_contract_and_where_none_looks_there_is_none() -> None:
    assert Flight("paper_contract.yaml").run(30, person("anna", 6.0)) == []
    assert Flight(shown=False).run(30, person("anna", 6.0)) == []


def test_a_record_is_bounded_and_keeps_the_nearest() -> None:
    people = [person(str(i), 2.0 + 0.05 * i) for i in range(MOVERS_MAX + 9)]
    last = Flight().run(30, *people)[-1]
    assert (len(last.movers), last.left_out) == (MOVERS_MAX, 9)
    assert {each.id for each in last.movers} == {f"ring/{i}" for i in range(MOVERS_MAX)}
    assert len(last.row) <= RUNS_MAX
    assert len(as_json(last)) < 40_000


def test_cells_are_drawn_larger_where_there_are_too_many_runs() -> None:
    cells = np.ones((180, 180), np.bool_)
    cells[::4, ::8] = False
    coarse, _, cell_m = builder._coarse(cells, (0.0, 0.0), 0.2)
    assert cell_m > 0.4
    assert coarse.sum() * (cell_m / 0.2) ** 2 <= cells.sum()


@given(
    speed_mps=st.floats(0.0, 20.0),
    age_s=st.floats(-1.0, 5.0),
    error_s=st.floats(0.0, 0.1),
)
def test_a_box_grows_by_speed_times_age(speed_mps: float, age_s: float, error_s: float) -> None:
    box = [(1.0, 2.0), (3.0, 2.0), (3.0, 5.0), (1.0, 5.0)]
    mover = KnownMover(id="a", seen_s=100.0, speed_max_mps=speed_mps, box_ned_m=box)
    grown_m = speed_mps * (max(age_s, 0.0) + error_s)
    expected = (1.0 - grown_m, 3.0 + grown_m, 2.0 - grown_m, 5.0 + grown_m)
    assert extent(box_at(mover, 100.0 + age_s, error_s)) == pytest.approx(expected)


def test_a_mover_without_a_box_is_nowhere() -> None:
    assert box_at(KnownMover(id="a", seen_s=1.0), 2.0, 0.0) == []
