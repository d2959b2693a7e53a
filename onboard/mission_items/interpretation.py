"""What an autopilot has on board as a mission and a geofence of ours, or why it cannot be flown."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

from onboard.files.daemon_config import VehicleMission
from onboard.files.geofence_file import FenceAreaFile
from onboard.files.mission_file import Leg, Mission
from onboard.geometry.local_frame import GeographicPoint, LocalFrame
from onboard.mission_items.on_board import OnBoard, OnBoardError, planned_of
from onboard.mission_items.planned_flight import GeographicArea, PlannedFlight
from onboard.mission_items.route import Route, Site, route_of


class FlyableMission(NamedTuple):
    """A mission from the vehicle.

    Attributes:
        mission: in local NED.
        areas: of the geofence on board, in local NED.
        not_done: what is not done of it, one sentence an item.
    """

    mission: Mission
    areas: tuple[FenceAreaFile, ...]
    not_done: tuple[str, ...]

    @property
    def summary(self) -> str:
        """Legs, length, height, geofence, and how many items are not done."""
        points = [self.mission.start_ned_m, *(leg.end_ned_m for leg in self.mission.legs)]
        length_m = math.fsum(math.dist(*leg) for leg in pairwise(points))
        legs, areas = len(self.mission.legs), len(self.areas)
        text = (
            f"{legs} {'leg' if legs == 1 else 'legs'}, {length_m:.0f} m, at "
            f"{self.mission.altitude_m:.1f} m above the local origin"
        )
        if areas:
            text += f"; geofence of {areas} {'area' if areas == 1 else 'areas'}"
        return f"{text}; not done: {'; '.join(self.not_done)}" if self.not_done else text


def flyable(on_board: OnBoard, stated: VehicleMission) -> FlyableMission:
    """Interpret what is on board, as ``clearway mission import`` does.

    Args:
        on_board: what the autopilot has sent.
        stated: what a mission on board does not state.

    Raises:
        OnBoardError: it cannot be flown; the message names each item.
    """
    planned = planned_of(on_board)
    site = _site(planned)
    route = route_of(planned.items, site, stated.altitude_m)
    if route.refusals:
        raise OnBoardError("; ".join(f"{each.item}: {each.text}" for each in route.refusals))
    if not route.legs or route.height_m is None:
        raise OnBoardError("the mission on board has no leg: no item leads elsewhere")
    not_done = [f"{each.item}: {each.text}" for each in route.remarks if each.kind == "not done"]
    try:
        mission = _mission(route, route.height_m, stated)
        areas = tuple(_areas(planned.fence, site))
    except ValueError as error:  # pydantic's: what no file could state either
        raise OnBoardError(f"the mission on board is none of ours: {error}") from error
    return FlyableMission(mission, areas, tuple(not_done))


def _site(planned: PlannedFlight) -> Site:
    if planned.autopilot is None:
        raise OnBoardError("only the local frames of PX4 and ArduPilot are known")
    home, origin = planned.home, planned.origin
    for name, place in (("HOME_POSITION", home), ("GPS_GLOBAL_ORIGIN", origin)):
        if place is None:
            raise OnBoardError(f"the vehicle has not sent {name}, by which its items are placed")
        if (problem := place.problem()) is not None:
            raise OnBoardError(f"{name}: {problem}")
    assert home is not None  # noqa: S101  checked above
    assert origin is not None  # noqa: S101  checked above
    return Site(LocalFrame(origin, planned.autopilot), home)


def _mission(route: Route, height_m: float, stated: VehicleMission) -> Mission:
    widths = stated.target_half_width_m, stated.corridor_half_width_m
    return Mission(
        start_ned_m=_rounded(route.site.start_ned_m),
        altitude_m=round(height_m, 2),
        climb_max_m=stated.climb_max_m,
        heading=stated.heading,
        start_clear_m=stated.start_clear_m,
        start_clear_of_movers_m=stated.start_clear_of_movers_m,
        on_end=stated.on_end,
        energy=stated.energy,
        legs=tuple(
            Leg(
                end_ned_m=_rounded(leg.end_ned_m),
                target_half_width_m=widths[0],
                corridor_half_width_m=widths[1],
            )
            for leg in route.legs
        ),
    )


def _areas(fence: tuple[GeographicArea, ...], site: Site) -> Iterator[FenceAreaFile]:
    for area in fence:
        for corner in area.corners:
            if (problem := corner.problem()) is not None:
                raise OnBoardError(f"the geofence of the vehicle: {problem}")
        corners_ned_m = [_placed(corner, site) for corner in area.corners]
        circle = area.radius_m is not None
        yield FenceAreaFile(
            keep="inside" if area.keeps_in else "outside",
            corners_ned_m=() if circle else tuple(corners_ned_m),
            center_ned_m=corners_ned_m[0] if circle else None,
            radius_m=area.radius_m,
        )


def _placed(corner: GeographicPoint, site: Site) -> tuple[float, float]:
    return site.frame.north_east_m(corner.latitude_deg, corner.longitude_deg)


def _rounded(place_ned_m: tuple[float, float]) -> tuple[float, float]:
    """Return a place to the millimetre, so that a mission that is read again is the same."""
    north_m, east_m = place_ned_m
    return round(north_m, 3) + 0.0, round(east_m, 3) + 0.0
