"""The record of the seen-free set, and when it is written."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.autonomy import Autonomy
from onboard.contract.assessment import TICK_S
from onboard.files.contract_file import load_contract
from onboard.files.mission_file import Mission
from onboard.files.yaml_file import load_yaml
from onboard.geometry.frames import FloatArray, LegFrame
from onboard.geometry.free_grid import FreeGrid
from onboard.motion.trajectory import Trajectory
from onboard.perception.seen_free import SeenFree
from onboard.planning.corridor.horizon import Horizon
from onboard.recording.journal import Journal
from onboard.recording.messages import SeenSpace, as_json
from onboard.recording.seen_space import (
    PERIOD_S,
    RUNS_MAX,
    SeenSpaceJournal,
    free_runs,
    seen_space,
)

CONFIG = Path(__file__).parents[3] / "config"
T = 1_790_000_000.0
LEG = LegFrame((10.0, 20.0, -4.0), math.radians(30.0))


def disc(radius_m: float = 2.0) -> FreeGrid:
    seen = SeenFree()
    seen.confirm(1.0, -1.0, radius_m)
    return seen.grid()


@dataclass
class Guidance:
    """A scripted source."""

    free_grid: FreeGrid | None = field(default_factory=disc)
    held_way: Trajectory | None = field(
        default_factory=lambda: Horizon.at_rest(0.0, 1.0, -1.0).trajectory(0.0)
    )
    guide_path_leg_m: FloatArray | None = field(
        default_factory=lambda: np.array([(1.0, -1.0), (9.0, 0.0)])
    )
    pause_reason: str | None = None


def recorded(guidance: Guidance) -> SeenSpace:
    assert guidance.free_grid is not None
    return seen_space(guidance, guidance.free_grid, LEG, T)


def middles_leg_m(record: SeenSpace) -> FloatArray:
    """Middles of the recorded cells, in the leg frame, (n, 2)."""
    cells = [
        (row + 0.5, column + 0.5)
        for row, first, after in zip(record.row, record.column_from, record.column_to, strict=True)
        for column in range(first, after)
    ]
    corner_m = LEG.position_leg_from_ned(np.array([(*record.corner_ned_m, 0.0)]))[0, :2]
    middles_m: FloatArray = corner_m + np.array(cells) * record.cell_m
    return middles_m


def test_a_record_shows_the_set_where_it_is() -> None:
    record = recorded(Guidance())
    middles_m = middles_leg_m(record)
    assert record.heading_rad == pytest.approx(LEG.heading_rad)
    assert record.height_m == 4.0
    assert record.cell_m == pytest.approx(0.2)
    assert float(np.hypot(*(middles_m - (1.0, -1.0)).T).max()) <= 2.0
    assert len(middles_m) * record.cell_m**2 == pytest.approx(math.pi * 4.0, rel=0.15)


@given(st.integers(0, 2**16), st.integers(1, 4))
def test_no_recorded_cell_holds_an_unknown_one(seed: int, factor: int) -> None:
    unknown = np.random.default_rng(seed).random((11, 13)) < 0.2
    table = np.zeros((12, 14), np.int32)
    table[1:, 1:] = unknown.cumsum(axis=0).cumsum(axis=1)
    grid = FreeGrid((0.0, 0.0), 0.1, table)
    found = set()
    for row, first, after in zip(*free_runs(grid, factor), strict=True):
        found |= {(row, column) for column in range(first, after)}
    for i in range(11 // factor):
        for j in range(13 // factor):
            block = unknown[i * factor : (i + 1) * factor, j * factor : (j + 1) * factor]
            assert ((i, j) in found) is not bool(block.any())


def test_a_record_is_bounded() -> None:
    chequered = np.indices((400, 400)).sum(axis=0) // 5 % 2 == 0
    table = np.zeros((401, 401), np.int32)
    table[1:, 1:] = chequered.cumsum(axis=0).cumsum(axis=1)
    record = recorded(Guidance(free_grid=FreeGrid((0.0, 0.0), 0.1, table)))
    assert len(record.row) <= RUNS_MAX
    assert len(as_json(record)) < 60_000


def test_the_way_to_rest_and_the_guide_are_seen_from_above() -> None:
    record = recorded(Guidance(pause_reason="nothing better certifies"))
    place = LEG.position_ned_from_leg(np.array([(1.0, -1.0, 0.0)]))[0, :2]
    for point in (*record.way_to_rest_ned_m, record.guide_ned_m[0]):
        assert point == pytest.approx(place)
    assert (len(record.guide_ned_m), record.pause) == (2, "nothing better certifies")
    bare = recorded(Guidance(held_way=None, guide_path_leg_m=None))
    assert (bare.way_to_rest_ned_m, bare.guide_ned_m) == ([], [])


def test_it_is_written_when_it_has_changed_and_at_most_twice_a_second() -> None:
    journal, guidance = SeenSpaceJournal(), Guidance()
    written_s = []
    for tick in range(200):
        now_s = tick * TICK_S
        if tick < 100:  # then nothing changes any more
            guidance.free_grid = disc(1.0 + 0.01 * tick)
        if journal.collect(guidance, LEG, T + now_s, now_s) is not None:
            written_s.append(now_s)
    assert all(after - before >= PERIOD_S - 1e-9 for before, after in pairwise(written_s))
    assert len(written_s) == 5
    guidance.pause_reason = "looking"
    assert journal.collect(guidance, LEG, T + 9.0, 9.0) is not None


def test_guidance_without_a_set_writes_nothing() -> None:
    assert SeenSpaceJournal().collect(None, LEG, T, 0.0) is None
    assert SeenSpaceJournal().collect(Guidance(free_grid=None), LEG, T, 0.0) is None


def test_the_journal_of_a_service_has_it(monkeypatch: pytest.MonkeyPatch) -> None:
    contract = load_contract(CONFIG / "paper_contract.yaml", ("requirements.progress=best_effort",))
    mission = load_yaml(CONFIG / "paper_mission.yaml", Mission)
    service = Autonomy(contract, mission, epoch_unix_s=T)
    for name, value in vars(Guidance()).items():
        monkeypatch.setattr(type(service.navigator.thread), name, value)
    service.tick(0.0)
    records = Journal(service, timed=False).collect(0.0)
    assert sum(isinstance(record, SeenSpace) for record in records) == 1
    unseen = Journal(service, timed=False, shown=False).collect(0.0)
    assert not any(isinstance(record, SeenSpace) for record in unseen)
