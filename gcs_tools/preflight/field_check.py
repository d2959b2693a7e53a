"""Checks an obstacle field against a contract, leg by leg, before a flight.

The field is what is known beforehand, for instance a survey; in flight the service knows only what
its sensor reports.  Obstacles far beside the leg count, too: avoidance drifts without recovering
(erratum 16), so the vehicle may reach them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import islice

import numpy as np
from scipy.spatial import KDTree

from gcs_tools.preflight.field_merging import PAIRS_MAX, intersecting_pairs, merge
from gcs_tools.preflight.field_regions import RegionBoxes, region_boxes
from gcs_tools.preflight.rule import ROUND_OFF, Rule
from onboard.contract.assessment import Assessment
from onboard.files.mission_file import Mission
from onboard.files.obstacle_field import ObstacleField
from onboard.geometry.box import Box
from onboard.geometry.frames import FloatArray, LegFrame

# Most offenders that a report names per rule.
OFFENDERS_MAX = 100
MERGED_SHOWN = 5

# The rules about regions, which depend on the cruise speed.
RULES_OF_SPEED = frozenset({"roi_disjoint", "start_clear", "end_clear"})


@dataclass(frozen=True)
class Stretch:
    """One leg without its obstacles.

    Attributes:
        name: for reports.
        frame: origin at the start of the leg.
        start, end: where the leg may begin and end, in its frame: as far beside or beyond its two
            points as the mission allows.
    """

    name: str
    frame: LegFrame
    start: Box
    end: Box


@dataclass(frozen=True)
class LegField:
    """The field as one leg meets it.

    Attributes:
        stretch: the leg.
        single_ids: names of the N obstacles.
        single_boxes_m: the obstacles in the leg frame, (N, 4): x from, x to, y from, y to.
        ids: names of the M obstacles after merging, those of merged ones joined by ``+``.
        boxes_m: the obstacles after merging, (M, 4).
        regions: their regions of influence.
    """

    stretch: Stretch
    single_ids: tuple[str, ...]
    single_boxes_m: FloatArray
    ids: tuple[str, ...]
    boxes_m: FloatArray
    regions: RegionBoxes

    @classmethod
    def of(cls, stretch: Stretch, assessment: Assessment, obstacles: ObstacleField) -> LegField:
        """Transform the obstacles into the leg frame, merge them, and compute their regions."""
        boxes_m = leg_boxes(stretch.frame, obstacles)
        merged = merge(
            boxes_m,
            lambda each_m: region_boxes(assessment, each_m).apart_m,
            assessment.terms.obstacle_size_max_m,
        )
        names = tuple("+".join(obstacles.ids[n] for n in each) for each in merged.members)
        regions = region_boxes(assessment, merged.boxes_m)
        return cls(stretch, obstacles.ids, boxes_m, names, merged.boxes_m, regions)

    @property
    def sizes_m(self) -> FloatArray:
        """Extents of the obstacles along and across the leg, (N, 2)."""
        sizes_m: FloatArray = self.single_boxes_m[:, 1::2] - self.single_boxes_m[:, ::2]
        return sizes_m

    @property
    def centers_m(self) -> FloatArray:
        """Centres of the obstacles after merging, in the leg frame, (M, 2)."""
        centers_m: FloatArray = (self.boxes_m[:, ::2] + self.boxes_m[:, 1::2]) / 2.0
        return centers_m

    def regions_at(self, place: Box) -> list[int]:
        """Return the indices of the obstacles that may be avoided at a place."""
        low_m = np.minimum(self.regions.extent_m, self.regions.manoeuvre_m)
        high_m = np.maximum(self.regions.extent_m, self.regions.manoeuvre_m)
        (x_min_m, _, y_min_m, _), (_, x_max_m, _, y_max_m) = low_m.T, high_m.T
        along = (x_min_m <= place.x_max_m) & (x_max_m >= place.x_min_m)
        across = (y_min_m <= place.y_max_m) & (y_max_m >= place.y_min_m)
        found: list[int] = np.flatnonzero(along & across).tolist()
        return found

    def called(self, name: str) -> str:
        """Return an obstacle's name with that of the leg."""
        return f"{name} ({self.stretch.name})"


@dataclass
class _Count:
    """How many obstacles break a rule, and the names of the first ones."""

    total: int = 0
    offenders: list[str] = field(default_factory=list)

    def add(self, offender: str) -> None:
        self.total += 1
        if len(self.offenders) < OFFENDERS_MAX:
            self.offenders.append(offender)


def check_field(
    assessment: Assessment, obstacles: ObstacleField, mission: Mission | None
) -> tuple[Rule, ...]:
    """Check a field against the contract's assumptions and the induction's conditions.

    Without a mission the one leg runs north from the origin, and its start and end are not checked.
    """
    legs = legs_of(assessment, obstacles, mission)
    rules = (
        _largest(legs, assessment),
        _thinnest(legs, assessment),
        _nearest(legs, assessment),
        _disjoint(legs),
        *_seen_for_certain(obstacles, assessment),
    )
    return rules if mission is None else (*rules, _start_clear(legs), _end_clear(legs))


def _seen_for_certain(obstacles: ObstacleField, assessment: Assessment) -> tuple[Rule, ...]:
    """Check that no known obstacle is thinner than the sensor is declared to see for certain."""
    thinnest_m = assessment.terms.thinnest_obstacle_m
    if thinnest_m is None:
        return ()
    sides_m = 2.0 * obstacles.half_size_m.min(axis=1, initial=math.inf)
    thin = np.flatnonzero(sides_m < thinnest_m * (1.0 - ROUND_OFF))
    rule = Rule(
        "thinnest_obstacle",
        thinnest_m,
        float(sides_m.min(initial=math.inf)),
        "m",
        "what the sensor may miss is taken for free space",
        tuple(f"{obstacles.ids[n]}: {sides_m[n]:.2f} m" for n in thin[:OFFENDERS_MAX].tolist()),
        concerns="safety",
    )
    return (rule,)


def legs_of(
    assessment: Assessment, obstacles: ObstacleField, mission: Mission | None
) -> tuple[LegField, ...]:
    """Return the field as each leg of a mission meets it."""
    return tuple(LegField.of(each, assessment, obstacles) for each in _stretches(mission))


def regions_clear(legs: tuple[LegField, ...]) -> bool:
    """Tell whether the rules about regions hold, as soon as that is known."""
    places = [(leg, place) for leg in legs for place in (leg.stretch.start, leg.stretch.end)]
    occupied = any(leg.regions_at(place) for leg, place in places)
    return not occupied and not any(any(intersecting_pairs(leg.regions.apart_m)) for leg in legs)


def _stretches(mission: Mission | None) -> Iterator[Stretch]:
    if mission is None:
        nowhere = Box(math.inf, math.inf, 0.0, 0.0)
        yield Stretch("heading north", LegFrame((0.0, 0.0, 0.0), 0.0), nowhere, nowhere)
        return
    start_ned_m = np.array([(*mission.start_ned_m, 0.0)])
    point_ned_m = mission.start_ned_m
    for number, leg in enumerate(mission.legs, start=1):
        frame = LegFrame.between((*point_ned_m, 0.0), (*leg.end_ned_m, 0.0))
        length_m, half_m = math.dist(point_ned_m, leg.end_ned_m), leg.target_half_width_m
        # After an avoidance near the end the vehicle may only be able to stop beyond it.
        end_m = np.array([(length_m, -half_m, 0.0), (length_m + half_m, half_m, 0.0)])
        start_m = frame.position_leg_from_ned(start_ned_m)
        yield Stretch(f"leg {number}", frame, _enclosing(start_m), _enclosing(end_m))
        # The next leg may begin wherever this one may end, and runs in another direction.
        start_ned_m, point_ned_m = frame.position_ned_from_leg(end_m), leg.end_ned_m


def _enclosing(points_m: FloatArray) -> Box:
    """Return the smallest box around points (N, 3)."""
    (x_min_m, y_min_m, _), (x_max_m, y_max_m, _) = points_m.min(axis=0), points_m.max(axis=0)
    return Box(float(x_min_m), float(x_max_m), float(y_min_m), float(y_max_m))


def leg_boxes(frame: LegFrame, obstacles: ObstacleField) -> FloatArray:
    """Return the axis-aligned boxes in the leg frame that enclose the obstacles, (N, 4)."""
    turn_rad = obstacles.yaw_rad - frame.heading_rad
    cosine, sine = np.abs(np.cos(turn_rad)), np.abs(np.sin(turn_rad))
    along_m, across_m = obstacles.half_size_m.T
    half_x_m, half_y_m = cosine * along_m + sine * across_m, sine * along_m + cosine * across_m
    down_m = np.zeros((len(obstacles), 1))
    x_m, y_m, _ = frame.position_leg_from_ned(np.hstack((obstacles.center_ned_m, down_m))).T
    return np.column_stack((x_m - half_x_m, x_m + half_x_m, y_m - half_y_m, y_m + half_y_m))


def _largest(legs: tuple[LegField, ...], assessment: Assessment) -> Rule:
    allowed_m = assessment.terms.obstacle_size_max_m
    largest_m, count = 0.0, _Count()
    for leg in legs:
        sizes_m = leg.sizes_m.max(axis=1)
        largest_m = max(largest_m, float(sizes_m.max(initial=0.0)))
        for index in np.flatnonzero(sizes_m > allowed_m * (1.0 + ROUND_OFF)).tolist():
            count.add(f"{leg.called(leg.single_ids[index])}: {sizes_m[index]:.2f} m")
    return Rule(
        "obstacle_size_max",
        largest_m,
        allowed_m,
        "m",
        "no obstacle may be larger, in the leg frame, than the contract assumes",
        tuple(count.offenders),
    )


def _thinnest(legs: tuple[LegField, ...], assessment: Assessment) -> Rule:
    assumed_m = assessment.terms.obstacle_size_min_m
    thinnest_m, count = math.inf, _Count()
    for leg in legs:
        sizes_m = leg.sizes_m[:, 0]
        thinnest_m = min(thinnest_m, float(sizes_m.min(initial=math.inf)))
        for index in np.flatnonzero(sizes_m < assumed_m * (1.0 - ROUND_OFF)).tolist():
            count.add(f"{leg.called(leg.single_ids[index])}: {sizes_m[index]:.2f} m")
    return Rule(
        "obstacle_size_min",
        assumed_m,
        thinnest_m,
        "m",
        "no obstacle may be thinner along the leg than the contract assumes",
        tuple(count.offenders),
    )


def _nearest(legs: tuple[LegField, ...], assessment: Assessment) -> Rule:
    """Return the rule about the distance of any two obstacles.

    Where the contract states a pair [along, across] the leg, two obstacles have to be apart by one
    of the two: their distance is then counted in shares of it.
    """
    box_m = assessment.contract.environment.separation_box_m
    assumed_m = assessment.terms.obstacle_separation_min_m
    scale_m = (1.0, 1.0) if box_m is None else box_m
    assumed, norm = (assumed_m, 2.0) if box_m is None else (1.0, math.inf)
    nearest, pairs = math.inf, {}
    for leg in legs:
        distance, neighbour = _nearest_neighbours(leg.centers_m / scale_m, norm)
        nearest = min(nearest, float(distance.min(initial=math.inf)))
        near = np.flatnonzero(distance < assumed * (1.0 - ROUND_OFF))
        for i, j in zip(near.tolist(), neighbour[near].tolist(), strict=True):
            apart_m = np.abs(leg.centers_m[i] - leg.centers_m[j]).tolist()
            pairs[leg.ids[min(i, j)], leg.ids[max(i, j)]] = apart_m
    first = list(pairs.items())[:OFFENDERS_MAX]
    if box_m is None:
        unit, reason = "m", "no two obstacles may stand closer, centre to centre, than the contract"
        offenders = [f"{one} and {other}: {math.hypot(*m):.2f} m" for (one, other), m in first]
    else:
        unit = f"of {box_m[0]:g} m along or {box_m[1]:g} m across"
        reason = "any two obstacles must be apart, along or across the leg, as far as the contract"
        offenders = [
            f"{one} and {other}: {along_m:.2f} m along, {across_m:.2f} m across"
            for (one, other), (along_m, across_m) in first
        ]
    return Rule("separation", assumed, nearest, unit, f"{reason} assumes", tuple(offenders))


def _nearest_neighbours(points_m: FloatArray, norm: float = 2.0) -> tuple[FloatArray, FloatArray]:
    """Return distance and index of each point's nearest neighbour; (N, 2) -> (N,), (N,)."""
    if len(points_m) < 2:
        return np.full(len(points_m), math.inf), np.full(len(points_m), -1)
    distance_m, index = KDTree(points_m).query(points_m, k=2, p=norm)
    # Of two points in one place, the query may list either one first.
    itself_first = index[:, 0] == np.arange(len(points_m))
    return distance_m[:, 1], np.where(itself_first, index[:, 1], index[:, 0])


def _disjoint(legs: tuple[LegField, ...]) -> Rule:
    count = _Count()
    for leg in legs:
        for i, j in islice(intersecting_pairs(leg.regions.apart_m), PAIRS_MAX - count.total):
            count.add(f"{leg.ids[i]} and {leg.called(leg.ids[j])}")
    rule = _none_of(
        count,
        "roi_disjoint",
        "pairs",
        "the region of influence of an obstacle must be free of any other: the induction needs one "
        "at a time",
    )
    return replace(rule, note=_merging_note(legs, counted_all=count.total < PAIRS_MAX))


def _merging_note(legs: tuple[LegField, ...], *, counted_all: bool) -> str:
    names = [
        leg.called(name)
        for leg in legs
        if len(leg.ids) < len(leg.single_ids)
        for name in sorted(set(leg.ids) - set(leg.single_ids))
    ]
    notes = []
    if names:
        first = "; ".join(names[:MERGED_SHOWN])
        more = "; …" if len(names) > MERGED_SHOWN else ""
        notes.append(f"close obstacles are avoided as one: {first}{more}")
    if not counted_all:
        notes.append(f"counting stopped at {PAIRS_MAX}")
    return ", ".join(notes)


def _start_clear(legs: tuple[LegField, ...]) -> Rule:
    count = _Count()
    for leg in legs:
        _count_regions_at(leg, leg.stretch.start, count)
    return _none_of(
        count,
        "start_clear",
        "regions",
        "a leg must start outside every region of influence (pre-condition)",
    )


def _end_clear(legs: tuple[LegField, ...]) -> Rule:
    count = _Count()
    for leg in legs:
        _count_regions_at(leg, leg.stretch.end, count)
    return _none_of(
        count,
        "end_clear",
        "regions",
        "a leg must end outside every region of influence (post-condition)",
    )


def _count_regions_at(leg: LegField, place: Box, count: _Count) -> None:
    for index in leg.regions_at(place):
        count.add(leg.called(leg.ids[index]))


def _none_of(count: _Count, name: str, unit: str, reason: str) -> Rule:
    """Return a rule that holds only without any offender."""
    return Rule(name, float(count.total), 0.0, unit, reason, tuple(count.offenders))
