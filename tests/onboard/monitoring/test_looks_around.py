"""Which sectors around a place frames have shown, and what their scans may say."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from onboard.monitoring.seen.looks_around import LooksAround
from onboard.monitoring.seen.scan_limits import resolved_m, scan_of
from onboard.perception.detection import DetectionFrame
from onboard.perception.line_of_sight import View
from tests.onboard.contract.example_terms import TERMS

HERE = (3.0, 4.0)


def view(half_deg: float, **scan: object) -> View:
    stated = View((0.0, 0.0), 0.0, math.radians(half_deg), 8.0, (), 0.1)
    return replace(stated, **scan)  # type: ignore[arg-type]  # of a scan


def shown(frame: View, yaw_rad: float = 0.0) -> list[int]:
    """Return the sectors, clockwise from north, that a frame shows."""
    looks = LooksAround()
    looks.note(frame, HERE, yaw_rad, "front", 0.3)
    return [number for number, count in enumerate(looks._shown["front"]) if count]


def test_a_sector_is_shown_that_lies_wholly_in_view() -> None:
    # Sectors of 5 degrees around multiples of 5 degrees.
    assert shown(view(12.6)) == [0, 1, 2, 70, 71]
    assert shown(view(12.4)) == [0, 1, 71]
    assert shown(view(12.6), math.radians(90.0)) == [16, 17, 18, 19, 20]
    assert shown(view(12.6), math.radians(-179.0)) == [35, 36, 37, 38]
    assert len(shown(view(177.4))) == 69
    assert len(shown(view(177.6))) == len(shown(view(180.0))) == 72


def test_a_sector_counts_where_the_scan_knows_something() -> None:
    halves = view(60.0, free_range_m=(0.0, 7.0), scan_half_view_rad=math.radians(60.0))
    assert shown(halves) == list(range(12))
    assert shown(halves, math.radians(10.0)) == list(range(2, 14))
    # A scan of all round, of which only the quarter from 90 to 180 degrees to the right is known.
    quarter = view(180.0, free_range_m=(0.0, 0.0, 0.0, 0.1), scan_half_view_rad=math.pi)
    assert shown(quarter) == list(range(18, 36))


def test_enough_frames_of_one_sensor_at_one_place_show_all_round() -> None:
    looks = LooksAround()
    assert not looks
    for number in range(3):
        for source in ("front", "back"):
            assert not looks.are_all_round(HERE, 0.3, number + 1)
            turn_rad = 0.0 if source == "front" else math.pi
            looks.note(view(92.6), HERE, turn_rad, source, 0.3)
    assert looks
    assert looks.are_all_round(HERE, 0.3, 3)
    assert not looks.are_all_round(HERE, 0.3, 4)
    # Within the distance it is the same place, and the count goes on.
    assert looks.are_all_round((3.3, 4.0), 0.31, 3)
    assert not looks.are_all_round((3.3, 4.0), 0.29, 3)
    looks.note(view(180.0), (3.2, 4.0), 0.0, "front", 0.3)
    assert looks.are_all_round(HERE, 0.3, 3)
    looks.shift(1.0, -2.0)
    assert looks.are_all_round((4.0, 2.0), 0.01, 3)
    looks.note(view(180.0), HERE, 0.0, "front", 0.3)
    assert not looks.are_all_round(HERE, 0.3, 2)
    looks.forget()
    assert not looks
    assert not looks.are_all_round(HERE, 0.3, 0)


def test_what_a_scan_says_without_a_return_and_how_far_it_resolves() -> None:
    frame = DetectionFrame(
        version=1, source="front", sequence=1, stamp_unix_s=0.0, frame="local_ned",
        range_m=12.0, field_of_view_deg=90.0, obstacles=(), free_range_m=(4.0, None, 6.0),
    )  # fmt: skip
    assert scan_of(frame, TERMS) == (4.0, 0.0, 6.0)
    assert scan_of(frame, replace(TERMS, no_return_is_free_to_m=9.0)) == (4.0, 9.0, 6.0)
    assert resolved_m(frame, TERMS) == math.inf
    thin = replace(TERMS, thinnest_obstacle_m=0.02)
    assert resolved_m(frame, thin) == pytest.approx(0.02 / math.radians(30.0))
    without = frame.model_copy(update={"free_range_m": None})
    assert scan_of(without, TERMS) == ()
    assert resolved_m(without, thin) == math.inf
