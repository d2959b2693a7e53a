"""What the report says of movers: boxes and reach, how long was yielded, the truth beside it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from gcs_tools.flight_report.command import write_report
from gcs_tools.flight_report.document import document_of
from gcs_tools.flight_report.flight import Flight, read_flight
from gcs_tools.flight_report.movers import (
    FREE_SETS_MAX,
    MOMENTS_MAX,
    SUMMARY_MAX,
    mover_moments,
    mover_summary,
    movers_during,
    true_movers,
)
from gcs_tools.logs.flight_log import read_log
from onboard.files.obstacle_field import ObstacleField
from onboard.files.truth_record import TrueMover, TrueMoversRecord
from onboard.recording.flight_log import FlightLog
from onboard.recording.messages import Record, StateRecord
from onboard.recording.mover_record import KnownMover, MoversRecord, corners
from sitl.environment.movers.config import MoverConfig
from sitl.environment.movers.movers import Movers
from sitl.environment.truth_log import TruthLog
from sitl.environment.world import World
from sitl.plant.truth import VehicleTruth
from tests.gcs_tools.browser import chromium

BEGAN_S = 1_790_000_000.0
STATES = [
    StateRecord(
        time_s=BEGAN_S + 0.1 * n,
        phase="yield" if 20 <= n < 50 else "cruise",
        armed=True,
        position_ned_m=(0.05 * n, 0.0, -3.0),
        velocity_ned_mps=(0.5, 0.0, 0.0),
        tracking_error_m=0.05,
        cruising=False,
        velocity_error_mps=(0.02, 0.01),
    )
    for n in range(100)
]


def moment(after_s: float, *, yields: bool = False) -> MoversRecord:
    """A walker who comes from the east at 1 m/s."""
    east_m = 6.0 - after_s
    walker = KnownMover(
        id="ring/1",
        kind="person",
        seen_s=BEGAN_S + after_s,
        speed_max_mps=1.2,
        box_ned_m=corners(3.7, 4.3, east_m - 0.3, east_m + 0.3),
        reach_ned_m=corners(2.0, 6.0, east_m - 2.0, east_m + 2.0),
        yields_for=yields,
    )
    return MoversRecord(
        time_s=BEGAN_S + after_s,
        until_s=BEGAN_S + after_s + 1.4,
        stamp_error_s=0.0,
        movers=[walker],
        yielding="mover ring/1 may be on the way" if yields else None,
        corner_ned_m=(-4.0, -4.0),
        cell_m=0.4,
        row=[1, 2],
        column_from=[0, 0],
        column_to=[5, 6],
    )


RECORDS = [moment(0.25 * n, yields=8 <= n < 20) for n in range(36)]


def test_moments_have_boxes_reach_and_reason_in_seconds_since_departure() -> None:
    found = mover_moments(RECORDS, BEGAN_S + 1.0)
    (walker,) = found[8]["movers"]
    assert (found[8]["time_s"], found[8]["until_s"], walker["seen_s"]) == (1.0, 2.4, 1.0)
    assert walker["box_m"] == pytest.approx([3.7, 4.3, 3.7, 4.3])
    assert walker["reach_m"] == pytest.approx([2.0, 6.0, 2.0, 6.0])
    assert walker["yields_for"]
    assert found[8]["yielding"] == "mover ring/1 may be on the way"
    assert found[7]["yielding"] is None
    assert found[0]["free"]["column_to"] == [5, 6]


def test_a_long_flight_is_thinned() -> None:
    found = mover_moments([moment(0.25 * n) for n in range(5 * MOMENTS_MAX)], BEGAN_S)
    assert len(found) == MOMENTS_MAX
    assert sum(each["free"] is not None for each in found) <= FREE_SETS_MAX
    assert found[0]["free"] is not None
    # Also between those that are kept, records have come in time.
    assert all(each["renewed"] for each in found)
    assert not mover_moments(RECORDS, BEGAN_S)[-1]["renewed"]


def test_a_mover_whose_box_is_not_known_is_left_out() -> None:
    nowhere = MoversRecord(time_s=BEGAN_S, movers=[KnownMover(id="a", seen_s=BEGAN_S)])
    assert mover_moments([nowhere], BEGAN_S)[0]["movers"] == []


def test_the_summary_says_when_each_was_seen_and_how_long_it_was_yielded_for() -> None:
    (walker,) = mover_summary(RECORDS, BEGAN_S)
    assert (walker["id"], walker["kind"], walker["speed_max_mps"]) == ("ring/1", "person", 1.2)
    assert (walker["first_s"], walker["last_s"]) == (0.0, 8.75)
    assert walker["yielded_s"] == pytest.approx(3.0)
    assert mover_summary([], BEGAN_S) == []


def test_of_very_many_movers_those_that_were_yielded_for_are_named() -> None:
    many = [
        KnownMover(
            id=f"ring/{n}", seen_s=BEGAN_S, box_ned_m=corners(0, 1, 0, 1), yields_for=n == 99
        )
        for n in range(100)
    ]
    records = [MoversRecord(time_s=BEGAN_S + 0.25 * n, movers=many) for n in range(4)]
    found = mover_summary(records, BEGAN_S)
    assert len(found) == SUMMARY_MAX
    assert [one["id"] for one in found if one["yielded_s"]] == ["ring/99"]


def test_only_what_is_shown_of_the_flight_counts() -> None:
    assert len(movers_during([moment(-1.0), moment(1.0), moment(99.0)], STATES)) == 1


def test_the_truth_has_places_over_time() -> None:
    records = [
        TrueMoversRecord(
            time_unix_s=BEGAN_S + 0.1 * n,
            movers=[TrueMover(id="w", position_ned_m=(4.0, 6.0 - 0.1 * n), half_m=0.3)],
        )
        for n in range(-5, 90)
    ]
    (walker,) = true_movers(records, STATES, BEGAN_S)
    assert (walker["id"], walker["half_m"]) == ("w", 0.3)
    assert walker["time_s"][:2] == [0.0, 0.1]
    assert walker["places_ned_m"][10] == [4.0, 5.0]


# ---------------------------------------------------------------------------- files, the page


def truth_log(path: Path, *configs: MoverConfig) -> None:
    """Write the truth of a vehicle that hovers for eight seconds, with these movers."""
    movers, world = Movers(configs, 0.3, 1), World(ObstacleField.of([]), 0.3)
    at_rest = VehicleTruth(
        *(0.0, (0.0, 0.0, -3.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)),
        *((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)),
    )
    with TruthLog(path, BEGAN_S) as log:
        for tick in range(400):
            movers.advance(tick / 50.0, (0.0, 0.0), (0.0, 0.0), airborne=True)
            log.write(at_rest._replace(time_s=tick / 50.0), world, movers)


@pytest.fixture
def flight(tmp_path: Path) -> Flight:
    """A flight that yields for a walker, who touches the vehicle at rest."""
    with FlightLog(tmp_path / "flight.mcap", {}) as log:
        records: list[Record] = [*STATES, *RECORDS]
        log.write(sorted(records, key=lambda record: record.time_s))
    walker = {
        "id": "walker", "class": "person", "speed_mps": 1.0, "size_m": 0.6,
        "path": {"kind": "waypoints", "places_ned_m": [[0.0, 6.0], [0.0, -9.0]]},
    }  # fmt: skip
    truth_log(tmp_path / "truth.mcap", MoverConfig.model_validate(walker))
    return read_flight(tmp_path)


def test_a_flight_without_movers_has_none_of_them_in_its_truth(tmp_path: Path) -> None:
    truth_log(tmp_path / "truth.mcap")
    read = read_log(tmp_path / "truth.mcap")
    assert (len(read.truths), read.true_movers, read.problems) == (400, (), ())


def test_the_truth_is_read_beside_the_flight(flight: Flight) -> None:
    document = document_of(flight)
    (walker,) = document["true_movers"]
    assert len(walker["time_s"]) == pytest.approx(80, abs=2)
    assert walker["places_ned_m"][-1][1] < walker["places_ned_m"][0][1] - 7.0
    assert ("touched at rest by a mover", "1, which is no collision") in document["facts"]
    assert ("collisions", "0") in document["facts"]
    (mark,) = document["marks"]
    assert (mark["kind"], mark["time_s"]) == ("touch", pytest.approx(5.42, abs=0.1))


def test_the_page_draws_movers_what_they_may_reach_and_why_the_vehicle_yields(
    tmp_path: Path, flight: Flight
) -> None:
    write_report([document_of(flight)], tmp_path / "report.html")
    with chromium(tmp_path / "profile") as page:
        page.look_like(390, 844, theme="dark")
        page.open((tmp_path / "report.html").as_uri())

        def d_of(selector: str) -> list[float]:
            path = page.evaluate(f"document.querySelector('#map {selector}').getAttribute('d')")
            return [float(each) for each in re.findall(r"-?[\d.]+", path)]

        page.evaluate("seek(4.1)")
        # The moment of 4.0 s: east 2 m; the next one came in time.
        assert d_of(".mover.yielded")[:2] == pytest.approx([3.7, 1.7], abs=1e-6)
        assert d_of(".reach.yielded")[:2] == pytest.approx([2.0, 0.0])
        assert d_of(".mover-way") == pytest.approx([n for k in range(17) for n in (4, 6 - k / 4)])
        assert d_of(".true-mover")[:2] == pytest.approx([-0.3, 1.6], abs=0.02)
        assert d_of(".mover-free")
        words = page.evaluate("document.getElementById('readout').textContent")
        assert "yield for ring/1: mover ring/1 may be on the way" in words
        assert page.evaluate("document.querySelectorAll('#map .mark').length") == 0
        page.evaluate("seek(9.5)")
        # The last moment was 0.75 s ago, since when it grows at 1.2 m/s.
        assert d_of(".mover")[:2] == pytest.approx([2.8, -3.95], abs=1e-6)
        page.evaluate("seek(7.0)")
        assert page.evaluate("document.querySelectorAll('#map .mover.yielded').length") == 0
        assert page.evaluate("document.querySelectorAll('#map .mover').length") == 1
        assert page.evaluate("document.querySelectorAll('#map .mark.touch').length") == 1
        why = page.evaluate("document.getElementById('why').textContent")
        assert "touches the vehicle at rest: no collision" in why
        table = page.evaluate("document.getElementById('movers').textContent")
        assert "ring/1person0.00 s8.75 s1.2 m/s3.00 s" in table
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        assert page.complaints == []
