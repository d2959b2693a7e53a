"""The way that was flown, and the mission back along it."""

import math
import tracemalloc

import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely import LineString, Point

from onboard.files.mission_file import Leg, Mission
from onboard.guidance.returning.flown_way import FlownWay, Place
from tests.onboard.guidance.perfect_flight import mission_to

BODY_M = 1.0
MISSION = mission_to((40.0, 0.0), (40.0, 30.0))


def flown(*stretches: tuple[Leg, list[Place]]) -> FlownWay:
    way = FlownWay()
    for leg, (start, *places) in stretches:
        way.begin_leg(leg, start)
        for place in places:
            way.add(place)
    return way


def line(start: Place, end: Place, count: int = 41) -> list[Place]:
    shares = (index / (count - 1) for index in range(count))
    return [tuple(a + share * (b - a) for a, b in zip(start, end, strict=True)) for share in shares]  # type: ignore[misc]


def ends(mission: Mission | None) -> list[Place]:
    assert mission is not None
    return [leg.end_ned_m for leg in mission.legs]


def test_straight_legs_lead_back_over_their_starts() -> None:
    one, two = MISSION.legs
    way = flown((one, line((0.2, -0.1), (40.0, 0.4))), (two, line((40.0, 0.4), (39.0, 20.0))))
    back = way.mission_back((38.5, 20.5), MISSION, BODY_M)
    assert ends(back) == [(40.0, 0.4), (0.2, -0.1)]
    assert back is not None
    assert back.altitude_m == MISSION.altitude_m
    assert back.start_ned_m == (38.5, 20.5)
    assert Mission.model_validate(back.model_dump()) == back
    assert way.length_m == pytest.approx(39.8 + 19.6, abs=0.2)


def test_each_leg_back_keeps_the_widths_of_the_leg_flown() -> None:
    narrow = MISSION.legs[0].model_copy(update={"corridor_half_width_m": 2.0})
    wide = MISSION.legs[1]
    way = flown((narrow, line((0.0, 0.0), (40.0, 0.0))), (wide, line((40.0, 0.0), (40.0, 20.0))))
    back = way.mission_back((40.0, 20.0), MISSION, BODY_M)
    assert back is not None
    assert [leg.corridor_half_width_m for leg in back.legs] == [None, 2.0]


def test_where_the_way_has_led_aside_the_legs_back_do_too() -> None:
    narrow = MISSION.legs[0].model_copy(update={"corridor_half_width_m": 3.0})
    aside = [*line((0.0, 0.0), (10.0, 2.5)), *line((10.0, 2.5), (20.0, 0.0))]
    corners = ends(flown((narrow, aside)).mission_back((20.0, 0.0), MISSION, BODY_M))
    assert corners == [pytest.approx((10.0, 2.5)), (0.0, 0.0)]


@given(st.lists(st.floats(-6.0, 6.0), min_size=2, max_size=30))
def test_the_corridors_back_enclose_the_way_flown(beside_m: list[float]) -> None:
    leg = MISSION.legs[0].model_copy(update={"corridor_half_width_m": 2.5})
    places = [(2.0 * index, y_m) for index, y_m in enumerate(beside_m)]
    back = flown((leg, places)).mission_back(places[-1], MISSION, BODY_M)
    legs = LineString([places[-1], *ends(back)])
    assert max(legs.distance(Point(place)) for place in places) <= 2.5 - BODY_M + 1e-9
    assert ends(back)[-1] == places[0]


def test_where_nothing_was_flown_nothing_leads_back() -> None:
    assert FlownWay().mission_back((0.0, 0.0), MISSION, BODY_M) is None
    way = flown((MISSION.legs[0], [(0.0, 0.0)]))
    assert way.mission_back((0.05, 0.0), MISSION, BODY_M) is None
    way.add((3.0, 0.0))
    way.clear()
    assert way.mission_back((3.0, 0.0), MISSION, BODY_M) is None


def test_the_way_moves_with_the_estimate() -> None:
    way = flown((MISSION.legs[0], line((0.0, 0.0), (10.0, 0.0))))
    way.shift(1.0, -2.0)
    assert ends(way.mission_back((11.0, -2.0), MISSION, BODY_M)) == [(1.0, -2.0)]


@pytest.mark.parametrize("here", [(12.0, 1.0), (41.0, 11.0)])
def test_what_lies_beyond_a_place_is_forgotten(here: Place) -> None:
    one, two = MISSION.legs
    way = flown((one, line((0.0, 0.0), (40.0, 0.0))), (two, line((40.0, 0.0), (40.0, 20.0))))
    way.cut_at(here)
    nearer_m = here[0] if here[1] < 2.0 else 40.0 + here[1]
    assert way.length_m == pytest.approx(nearer_m, abs=0.6)
    FlownWay().cut_at(here)


def test_a_way_that_leads_round_is_followed_back_round() -> None:
    """The ends of a stretch may coincide: then no line has a direction."""
    ring = [(10.0 * math.sin(a / 10.0), 10.0 - 10.0 * math.cos(a / 10.0)) for a in range(63)]
    back = flown((MISSION.legs[0], [*ring, ring[0]])).mission_back(ring[0], MISSION, BODY_M)
    assert len(ends(back)) >= 2


def test_an_hours_way_takes_little_memory() -> None:
    """The daemon's memory may rise by 2 MB in an hour, which is for the log's index, too."""
    way = FlownWay()
    tracemalloc.start()
    try:
        way.begin_leg(MISSION.legs[0], (0.0, 0.0))
        for number in range(8_000):  # 4 km
            way.add((0.51 * number, 0.1 * (number % 2)))
        taken_bytes, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert way.length_m > 4_000.0
    assert taken_bytes < 200_000
