"""`flight.png`: what is drawn of a flight, and what is missing in one that went wrong."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

from gcs_tools.fly.picture import (
    _column,
    _departure_s,
    _free_runs,
    _obstacle_corners,
    _regions,
    _shade_phases,
    _title,
    draw_flight,
)
from gcs_tools.logs.flight_log import log_of
from gcs_tools.scenario import load_scenario
from onboard.files.obstacle_field import Obstacle, ObstacleField
from onboard.files.truth_record import TruthRecord
from onboard.recording.messages import Obstacles, SeenSpace, StateRecord
from tests.gcs_tools.campaign.oracles.evidence import result
from tests.gcs_tools.logs.raw_log import made, truth_record
from tests.gcs_tools.running import CONFIG

PAPER = load_scenario(CONFIG / "paper.yaml")
BEGAN_S = 1_790_000_000.0


def states(*phases: str) -> list[StateRecord]:
    return [
        StateRecord(
            time_s=BEGAN_S + number,
            phase=phase,
            position_ned_m=(float(number), 0.0, -4.0),
            reference_position_ned_m=(float(number), 0.0, -4.0),
            tracking_error_m=0.05,
        )
        for number, phase in enumerate(phases)
    ]


def truths(count: int, clearance_m: float | None = 2.0) -> list[TruthRecord]:
    return [
        truth_record(
            {
                "time_unix_s": BEGAN_S + number,
                "position_ned_m": [float(number), 0.1, -4.0],
                "clearance_m": clearance_m,
            }
        )
        for number in range(count)
    ]


def obstacles(**region_north_m: float) -> Obstacles:
    known = [
        {"id": name, "region_ned_m": [[north_m, -3.0], [north_m, 3.0], [9.0, 3.0]]}
        for name, north_m in region_north_m.items()
    ]
    return made(Obstacles, {"time_s": BEGAN_S, "obstacles": known})


def drawn(path: Path, flight: list[StateRecord], truth: list[TruthRecord]) -> int:
    log = log_of([*flight, obstacles(a=5.0)])
    draw_flight(PAPER, log, log_of(truth), result(), path)
    assert path.read_bytes().startswith(b"\x89PNG")
    return path.stat().st_size


def test_a_flight_is_a_picture(tmp_path: Path) -> None:
    phases = ("standby", *("cruise",) * 5, *("avoid",) * 4, "cruise", "arrived")
    assert drawn(tmp_path / "flight.png", states(*phases), truths(12)) > 20_000


@pytest.mark.parametrize(
    ("flight", "truth"),
    [
        (states("standby", "standby"), []),
        (states("cruise", "cruise"), truths(2, None)),
        ([replace(state, position_ned_m=None) for state in states("cruise", "cruise")], truths(3)),
        ([replace(state, reference_position_ned_m=None) for state in states("hold", "hold")], []),
    ],
)
def test_a_flight_that_hardly_took_place_is_still_a_picture(
    tmp_path: Path, flight: list[StateRecord], truth: list[TruthRecord]
) -> None:
    assert drawn(tmp_path / "flight.png", flight, truth) > 5_000


def test_a_picture_that_cannot_be_written_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="No such file"):
        drawn(tmp_path / "nowhere" / "flight.png", states("cruise", "cruise"), truths(2))


def test_the_title_tells_the_outcome() -> None:
    title = _title(PAPER, result(clearance_min_m=0.281, tracking_error_max_m=0.03))
    assert title == (
        "paper: arrived, 1 avoided, 0 collisions, clearance 0.28 m, tracking error 0.03 m"
    )
    assert "no obstacle near" in _title(PAPER, replace(result(), clearance_min_m=None))


def test_time_begins_with_the_departure() -> None:
    assert _departure_s(states("standby", "standby", "cruise")) == BEGAN_S + 2.0
    assert _departure_s(states("standby")) == BEGAN_S
    assert _departure_s([]) == 0.0


def test_phases_are_shaded_and_named_where_there_is_room() -> None:
    axes = Figure().subplots()
    _shade_phases(axes, states("cruise", "cruise", "cruise", "avoid", "hold", "unheard"), BEGAN_S)
    assert len(axes.patches) == 3  # an unknown phase has no colour
    assert [text.get_text() for text in axes.texts] == ["cruise"]


def test_a_region_is_drawn_as_it_was_last_known() -> None:
    log = log_of([obstacles(a=1.0), obstacles(b=2.0), obstacles(a=3.0)])
    assert [region[0].tolist() for region in _regions(log)] == [[3.0, -3.0], [2.0, -3.0]]


def test_an_obstacle_is_turned_about_its_centre() -> None:
    box = Obstacle(id="1", center_ned_m=(10.0, 5.0), size_m=(4.0, 2.0), yaw_deg=90.0)
    (corners,) = _obstacle_corners(ObstacleField.of([box]))
    assert corners.mean(axis=0) == pytest.approx((10.0, 5.0))
    assert np.ptp(corners, axis=0) == pytest.approx((2.0, 4.0))


def test_a_run_of_free_cells_lies_where_its_record_says() -> None:
    seen = SeenSpace(
        time_s=BEGAN_S, corner_ned_m=(10.0, 5.0), heading_rad=math.pi / 2.0, cell_m=0.5,
        row=[2], column_from=[4], column_to=[10],
    )  # fmt: skip
    (corners,) = _free_runs([seen])
    # The leg leads east: along it is east, to its right is south.
    assert corners[:, 0].min() == pytest.approx(10.0 - 5.0)
    assert corners[:, 0].max() == pytest.approx(10.0 - 2.0)
    assert corners[:, 1].min() == pytest.approx(5.0 + 1.0)
    assert corners[:, 1].max() == pytest.approx(5.0 + 1.5)


def test_what_was_seen_free_is_drawn_instead_of_regions_where_the_flight_rests_on_it(
    tmp_path: Path,
) -> None:
    free = SeenSpace(
        time_s=BEGAN_S, corner_ned_m=(-3.0, -3.0), cell_m=1.0,
        row=list(range(12)), column_from=[0] * 12, column_to=[6] * 12,
    )  # fmt: skip
    pictures = []
    for seen in ([], [free]):
        log = log_of([*states("pause", "thread", "thread"), obstacles(a=50.0), *seen])
        draw_flight(PAPER, log, log_of(truths(3)), result(), tmp_path / "flight.png")
        pictures.append(imread(tmp_path / "flight.png"))
    without, with_set = pictures
    blue = np.array((0xE6, 0xEF, 0xF8)) / 255.0
    assert not np.isclose(without[:300, :, :3], blue, atol=0.01).all(axis=2).sum() > 1_000
    assert np.isclose(with_set[:300, :, :3], blue, atol=0.01).all(axis=2).sum() > 1_000


def test_a_vector_that_is_missing_is_not_a_number() -> None:
    column = _column([(1.0, 2.0, 3.0), None])
    assert column[0].tolist() == [1.0, 2.0, 3.0]
    assert all(math.isnan(value) for value in column[1])
    assert _column([]).shape == (0, 3)
