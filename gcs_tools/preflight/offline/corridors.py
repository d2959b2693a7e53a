"""The clause `corridors` (C0): vehicles whose corridors are disjoint need no protocol.

A vehicle whose contract requires `stop` flies only ways that are certified, body and tracking error
included, in the space seen free, of which nothing beyond its geofence is part.  So its corridor is
its geofence, whatever it does from taking control on: avoid, return, or fly another mission.  What
a leg states does not bound it: an avoidance may lead past the end of the strip of
`corridor_half_width_m`, and a way back has strips of its own about what was flown.  Recentring
bounds nothing either: where obstacles stand beside the way, there is no drift back.

Two vehicles never meet if their corridors are farther apart than both margins rho and both errors
A of a position on the Earth together, since each knows its own by its own position.  Heights do
not separate: what fails, falls.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import combinations
from pathlib import Path
from typing import Final

import numpy as np
from shapely import Point, Polygon, get_coordinates, segmentize
from shapely import transform as transformed
from shapely.geometry.base import BaseGeometry

from gcs_tools.preflight.offline.fleet_files import Member, read_fleet
from gcs_tools.preflight.rule import Rule
from onboard.files.contract_file import Contract
from onboard.files.geofence_file import FenceAreaFile, Geofence
from onboard.files.mission_file import Mission
from onboard.geometry.frames import FloatArray
from onboard.geometry.local_frame import LocalFrame
from onboard.mission_items.fence_items import FenceError

# Segments of a quarter of a circle; a polygon around it is larger by 1 / cos(π / 4n).
_QUARTER: Final = 64
_AROUND: Final = 1.0 / math.cos(math.pi / (4.0 * _QUARTER))
# WGS84's curvature is between 6,335 and 6,400 km; distances by the autopilots' spheres of 6,371
# and 6,378 km may be too long by this share.
# and 6,378 km may be too long by this share, so near to the origin of the frame and so far from the
# poles (`FrameOrigin`); farther away, parallels and meridians bend.
_SPHERE_SHARE: Final = 0.007
_AWAY_MAX_M: Final = 20_000.0
# An edge that is straight in one frame is not in another: 1 mm in so much, at 80° of latitude.
_EDGE_MAX_M: Final = 100.0


@dataclass(frozen=True)
class CorridorPair:
    """Two vehicles, and how far apart their regions are.

    Attributes:
        first, second: names.
        required_m: the distance that their regions need.
        apart_m: their distance.
    """

    first: str
    second: str
    required_m: float
    apart_m: float

    @property
    def disjoint(self) -> bool:
        """Whether the vehicles can never meet."""
        return self.apart_m > self.required_m

    def sentence(self) -> str:
        """Return what is wrong, for people."""
        both = f"{self.first} and {self.second}"
        need = f"{self.required_m:.1f} m for bodies and errors"
        if self.apart_m <= 0.0:
            return f"{both} may fly in the same place: their corridors overlap and need {need}"
        return f"{both} fly {self.apart_m:.1f} m apart and need {need}"


@dataclass(frozen=True)
class Corridors:
    """The clause: where each vehicle may be, and every pair.

    Attributes:
        unbounded: a sentence for each vehicle that nothing keeps in a region.
        pairs: every two vehicles that are kept in one.
    """

    unbounded: tuple[str, ...]
    pairs: tuple[CorridorPair, ...]

    @property
    def hold(self) -> bool:
        """Whether all vehicles are bounded and every two disjoint."""
        return not self.sentences

    @cached_property
    def sentences(self) -> tuple[str, ...]:
        """What is wrong, a sentence for each vehicle or pair."""
        met = tuple(pair.sentence() for pair in self.pairs if not pair.disjoint)
        return self.unbounded + met


def check_corridors(members: Sequence[Member]) -> Corridors:
    """Check that no two vehicles of a fleet may meet.

    Raises:
        FenceError: the edges of a geofence's polygon cross each other.
    """
    unbounded, regions = [], []
    common = members[0].frame
    for member in members:
        problem = _without_bound(member)
        if problem is not None:
            unbounded.append(f"{member.name}: {problem}")
            continue
        try:
            region = region_of(member)
        except FenceError as error:
            raise FenceError(f"{member.vehicle.geofence}: {error}") from error
        if (problem := _outside(member, region)) is not None:
            unbounded.append(f"{member.name}: {problem}")
            continue
        region_common = _in_common_frame(region, member.frame, common)
        away_m = max(_farthest_m(region), _farthest_m(region_common))
        if away_m > _AWAY_MAX_M:
            unbounded.append(
                f"{member.name}: its geofence reaches {away_m / 1e3:,.1f} km from its origin or "
                f"that of {members[0].name}: compared within {_AWAY_MAX_M / 1e3:g} km only"
            )
            continue
        regions.append((member, region_common))
    pairs = tuple(
        CorridorPair(
            first.name,
            second.name,
            first.margin_m + second.margin_m + first.error_m + second.error_m,
            float(one.distance(other)) * (1.0 - _SPHERE_SHARE),
        )
        for (first, one), (second, other) in combinations(regions, 2)
    )
    return Corridors(tuple(unbounded), pairs)


def _without_bound(member: Member) -> str | None:
    """Return why nothing keeps a vehicle in a region; None if something does."""
    if not member.assessment.terms.stop:
        return (
            "requirements.stop is false in its contract: nothing keeps its avoidances in a corridor"
        )
    areas = () if member.geofence is None else member.geofence.areas
    if not any(area.keep == "inside" for area in areas):
        return "no geofence keeps it inside an area: an avoidance may lead it anywhere"
    return None


def _outside(member: Member, region: BaseGeometry) -> str | None:
    """Return why a region is not that of a mission; None if it is."""
    room_m = member.assessment.inflation_m()
    mission = member.mission
    places = [("start_ned_m", mission.start_ned_m)]
    places += [(f"legs.{n}.end_ned_m", leg.end_ned_m) for n, leg in enumerate(mission.legs)]
    for key, place_ned_m in places:
        if not region.contains(Point(place_ned_m).buffer(room_m)):
            return (
                f"{key} = {list(place_ned_m)} m has less than {room_m:.2f} m of its corridor around"
                " it: the flight cannot begin or end there"
            )
    return None


def region_of(member: Member) -> BaseGeometry:
    """Return where a vehicle may be by its own position, local NED [m]; at least that.

    Args:
        member: whose geofence keeps it inside an area.
    """
    areas = () if member.geofence is None else member.geofence.areas
    region: BaseGeometry | None = None
    for area in areas:
        if area.keep == "inside":
            polygon = _polygon(area, _AROUND)
            region = polygon if region is None else region.intersection(polygon)
    if region is None:
        raise ValueError("no area of the geofence keeps the vehicle inside")
    for area in areas:
        if area.keep == "outside":
            region = region.difference(_polygon(area, 1.0))
    return region


def _polygon(area: FenceAreaFile, scale: float) -> Polygon:
    if area.center_ned_m is not None and area.radius_m is not None:
        return Point(area.center_ned_m).buffer(area.radius_m * scale, quad_segs=_QUARTER)
    polygon = Polygon(area.corners_ned_m)
    if not polygon.is_valid:
        raise FenceError("its edges cross each other, expected a simple polygon")
    return polygon


def _in_common_frame(region: BaseGeometry, frame: LocalFrame, common: LocalFrame) -> BaseGeometry:
    """Return a region in the local frame of the first vehicle."""
    if frame == common:
        return region
    pieces = segmentize(region, _EDGE_MAX_M)
    return transformed(pieces, partial(_moved, frame=frame, common=common))


def _farthest_m(region: BaseGeometry) -> float:
    """Return how far a region reaches from the origin of its frame."""
    return float(np.hypot(*get_coordinates(region).T).max())


def _moved(places_m: FloatArray, *, frame: LocalFrame, common: LocalFrame) -> FloatArray:
    """Return places in another local frame, by way of the Earth, (N, 2) -> (N, 2)."""
    return np.array(
        [common.north_east_m(*frame.latitude_longitude_deg(*place)) for place in places_m.tolist()]
    )


def corridor_rule(
    path: Path, contract: Contract, mission: Mission | None, geofence: Geofence | None
) -> Rule:
    """Return the rule that no vehicle of a fleet may meet another, for the check of one of them.

    Args:
        path: of the fleet's file.
        contract: of the vehicle that is checked, which has to be of the fleet.
        mission: likewise.
        geofence: likewise.

    Raises:
        FileError: a file of the fleet cannot be used.
        FenceError: the edges of a geofence's polygon cross each other.
    """
    _, members = read_fleet(path)
    checked = contract.sha256, mission, geofence
    offenders = check_corridors(members).sentences
    flown = [(m.assessment.contract.sha256, m.mission, m.geofence) for m in members]
    if checked not in flown:
        offenders += (f"no vehicle of {path.name} flies by this contract, mission and geofence",)
    return Rule(
        "corridors",
        float(len(offenders)),
        0.0,
        "objections",
        "no two vehicles of the fleet may ever be in one place",
        offenders,
        concerns="safety",
    )
