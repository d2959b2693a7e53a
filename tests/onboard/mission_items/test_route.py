"""What becomes of each item of a ground station's mission."""

from __future__ import annotations

import math

import pytest

from onboard.geometry.local_frame import Autopilot, GeographicPoint, LocalFrame
from onboard.mission_items.commands import CANNOT_FLY, NOT_DONE, command_name
from onboard.mission_items.planned_flight import FileItem
from onboard.mission_items.route import Route, Site, route_of
from tests.gcs_tools.missions.ground_station import HOME, LAND, RETURN, TAKE_OFF, WAYPOINT, north

STEP_M = math.radians(1e-3) * 6_371_000.0


def item(
    command: int, place: tuple[float, ...] = (0.0, 0.0, 0.0), frame: int = 3, first: float = 0.0
) -> FileItem:
    return FileItem("item", command, frame, (first, 0.0, 0.0, math.nan), GeographicPoint(*place))


def site(
    home: tuple[float, ...] = HOME,
    origin: tuple[float, ...] | None = None,
    autopilot: Autopilot = "px4",
) -> Site:
    at = GeographicPoint(*home)
    return Site(LocalFrame(at if origin is None else GeographicPoint(*origin), autopilot), at)


def flown(*items: FileItem, altitude_m: float | None = None, **where: object) -> Route:
    return route_of(items, site(**where), altitude_m)  # type: ignore[arg-type]


def refusal(route: Route) -> str:
    (remark,) = route.refusals
    return remark.text


def test_waypoints_become_legs_from_home() -> None:
    route = flown(item(WAYPOINT, north(1.0)), item(WAYPOINT, north(1.0, east=1.0)))
    assert not route.refusals
    assert [each.kind for each in route.remarks] == ["leg", "leg"]
    ends = [each.end_ned_m for each in route.legs]
    assert ends[0] == pytest.approx((STEP_M, 0.0), abs=1e-3)
    east_m = STEP_M * math.cos(math.radians(HOME[0] + 1e-3))
    assert ends[1] == pytest.approx((STEP_M, east_m), abs=2e-3)
    assert route.height_m == 10.0


def test_the_route_crosses_the_antimeridian() -> None:
    home = (-16.5, 179.9995, 3.0)
    route = flown(item(WAYPOINT, (-16.5, -179.9995, 10.0)), home=home)
    (leg,) = route.legs
    assert leg.end_ned_m[1] == pytest.approx(STEP_M * math.cos(math.radians(16.5)), abs=1e-2)


# ---------------------------------------------------------------------------- heights


def test_heights_count_from_home_from_sea_level_and_from_a_given_origin() -> None:
    above_sea = item(WAYPOINT, north(1.0, 498.0), frame=0)
    assert flown(above_sea).height_m == pytest.approx(10.0)
    assert flown(above_sea, item(WAYPOINT, north(2.0), frame=6)).refusals == []
    origin = (*HOME[:2], 485.5)
    assert flown(above_sea, origin=origin).height_m == pytest.approx(12.5)
    assert flown(item(WAYPOINT, north(1.0)), origin=origin).height_m == pytest.approx(12.5)


def test_places_count_from_the_origin_and_the_flight_begins_at_home() -> None:
    route = flown(item(WAYPOINT, north(2.0)), origin=north(-1.0, 488.0))
    assert route.site.start_ned_m == pytest.approx((STEP_M, 0.0), abs=1e-3)
    assert route.legs[0].end_ned_m == pytest.approx((3.0 * STEP_M, 0.0), abs=1e-3)
    assert "111.2 m long" not in route.remarks[0].text  # its length counts from home
    assert f"{2.0 * STEP_M:.1f} m long" in route.remarks[0].text


@pytest.mark.parametrize("frame", [10, 11])
def test_terrain_is_not_known(frame: int) -> None:
    above_terrain = item(WAYPOINT, north(1.0), frame=frame)
    assert "terrain" in refusal(flown(above_terrain))
    route = flown(above_terrain, altitude_m=7.0)
    assert (route.height_m, route.refusals) == (7.0, [])


@pytest.mark.parametrize(
    ("place", "frame", "where", "words"),
    [
        (north(1.0, math.nan), 3, {}, "states no altitude"),
        (north(1.0, 480.0), 0, {}, "is -8.0, expected above 0"),
        (north(1.0, 0.0), 3, {}, "is 0.0, expected above 0"),
        (north(1.0, 498.0), 0, {"home": HOME[:2]}, "sea level"),
        (north(1.0), 3, {"origin": HOME[:2]}, "need altitudes"),
        (north(1.0), 1, {}, "frame 1"),
        ((math.nan, 8.5, 10.0), 3, {}, "states no latitude"),
        ((0.0, 0.0, 10.0), 3, {}, "states no latitude"),
        ((97.0, 8.5, 10.0), 3, {}, "latitude [°] = 97"),
        ((48.9, 8.5, 10.0), 3, {}, "km from the local origin"),
    ],
)
def test_a_place_that_cannot_be_flown_to(
    place: tuple[float, ...], frame: int, where: dict[str, object], words: str
) -> None:
    assert words in refusal(flown(item(WAYPOINT, place, frame), **where))  # type: ignore[arg-type]


def test_a_mission_flies_one_height() -> None:
    items = (
        item(WAYPOINT, north(1.0)),
        item(WAYPOINT, north(2.0, 10.05)),
        item(WAYPOINT, north(3.0, 12.0)),
    )
    text = refusal(flown(*items))
    assert "12.0 m" in text
    assert "first leg 10.0 m" in text
    route = flown(*items, altitude_m=11.0)
    assert (len(route.legs), route.height_m, route.refusals) == (3, 11.0, [])


# ---------------------------------------------------------------------------- first and last


def test_take_off_climbs_at_home() -> None:
    route = flown(item(TAKE_OFF, north(0.0, 5.0)), item(WAYPOINT, north(1.0)))
    assert [each.kind for each in route.remarks] == ["start", "leg"]
    assert len(route.legs) == 1


def test_only_px4_flies_to_the_place_of_a_take_off() -> None:
    items = item(TAKE_OFF, north(0.5)), item(WAYPOINT, north(1.0))
    assert len(flown(*items).legs) == 2
    route = flown(*items, autopilot="ardupilot")
    assert len(route.legs) == 1
    assert "ArduPilot ignores its place" in route.remarks[0].text


def test_take_off_comes_first() -> None:
    assert "flies already" in refusal(flown(item(WAYPOINT, north(1.0)), item(TAKE_OFF)))


@pytest.mark.parametrize("last", [item(RETURN), item(LAND), item(17, north(1.0))])
def test_the_mission_ends_in_a_hover(last: FileItem) -> None:
    route = flown(item(WAYPOINT, north(1.0)), last, item(178))
    assert not route.refusals
    assert len(route.legs) == 1
    kinds = [each.kind for each in route.remarks]
    assert "end" in kinds
    assert kinds[-1] == "not done"


def test_a_landing_elsewhere_is_one_more_leg() -> None:
    route = flown(item(WAYPOINT, north(1.0)), item(LAND, north(2.0, 0.0)))
    assert len(route.legs) == 2
    assert [each.kind for each in route.remarks] == ["leg", "leg", "end"]
    assert "before any waypoint" in refusal(flown(item(LAND, north(2.0, 0.0))))
    assert len(flown(item(LAND, north(2.0, 0.0)), altitude_m=4.0).legs) == 1


def test_nothing_comes_after_the_end() -> None:
    route = flown(item(WAYPOINT, north(1.0)), item(RETURN), item(WAYPOINT, north(2.0)))
    assert "after the end of the mission" in refusal(route)


def test_two_items_at_one_place_are_one_leg() -> None:
    route = flown(item(WAYPOINT, north(1.0)), item(WAYPOINT, north(1.0)))
    assert len(route.legs) == 1
    assert [each.kind for each in route.remarks] == ["leg", "not done"]


@pytest.mark.parametrize("command", [WAYPOINT, 19])
def test_waiting_is_not_done_and_said(command: int) -> None:
    route = flown(item(command, north(1.0), first=12.0))
    assert [each.kind for each in route.remarks] == ["leg", "not done"]
    assert "12 s" in route.remarks[1].text


# ---------------------------------------------------------------------------- other commands


@pytest.mark.parametrize("command", [*CANNOT_FLY, 43_000])
def test_what_cannot_be_flown_is_refused(command: int) -> None:
    assert refusal(flown(item(command, north(1.0)), item(WAYPOINT, north(1.0))))


@pytest.mark.parametrize("command", NOT_DONE)
def test_what_changes_no_way_is_only_said(command: int) -> None:
    route = flown(item(command), item(WAYPOINT, north(1.0)))
    assert (len(route.legs), route.refusals) == (1, [])
    assert route.remarks[0].kind == "not done"


def test_the_tables_are_of_different_commands_that_mavlink_knows() -> None:
    known = {WAYPOINT, 17, 19, RETURN, LAND, TAKE_OFF}
    assert not CANNOT_FLY.keys() & NOT_DONE.keys()
    assert not known & (CANNOT_FLY.keys() | NOT_DONE.keys())
    foreign = {83}  # ArduPilot's own
    names = {each: command_name(each) for each in (*known, *CANNOT_FLY, *NOT_DONE)}
    assert {each for each, name in names.items() if name.startswith("command ")} <= foreign
    assert names[18] == "NAV_LOITER_TURNS"
