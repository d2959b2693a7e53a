"""A navigator in a field of stems: its vehicle follows exactly, an ideal sensor sees free space."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from onboard.files.contract_file import Contract
from onboard.files.mission_file import Mission
from onboard.geometry.frames import LegFrame
from onboard.geometry.free_grid import FreeGrid
from onboard.guidance.dense.thread import Thread
from onboard.perception.line_of_sight import View
from onboard.perception.seen_free import SeenFree
from tests.onboard.guidance.perfect_flight import PerfectFlight

FRAME_TICKS: Final = 5  # 10 Hz
SLOW_RADPS: Final = math.radians(21.0)
START_RADIUS_M: Final = 1.2


@dataclass(frozen=True)
class Stem:
    """A tree: centre in NED and radius."""

    north_m: float
    east_m: float
    radius_m: float


def random_field(
    seed: int, stems_per_ha: float, length_m: float = 30.0, half_width_m: float = 9.0
) -> list[Stem]:
    """Return stems at random along a leg to the north, none within 2 m of its ends."""
    random = np.random.default_rng(seed)
    area_m2 = (length_m + 6.0) * 2.0 * half_width_m
    stems = []
    for _ in range(random.poisson(stems_per_ha * area_m2 / 1e4)):
        north_m = float(random.uniform(-3.0, length_m + 3.0))
        east_m = float(random.uniform(-half_width_m, half_width_m))
        if math.hypot(north_m, east_m) > 2.0 < math.hypot(north_m - length_m, east_m):
            stems.append(Stem(north_m, east_m, float(random.uniform(0.05, 0.2))))
    return stems


@dataclass
class IdealSeenSpace:
    """The space that an ideal sensor has seen free.

    Attributes:
        start_known: the operator has confirmed the place of the start.
        relied_on: whether guidance flies by it.
        refusing: no place is confirmed as the start.
        frames_counted: so far.
        frames_needed: K.
        confirmed: how often a start was confirmed by a look all round.
        frame: of the leg.
        stems: where no place is confirmed.
    """

    start_known: bool = False
    relied_on: bool = False
    refusing: bool = False
    frames_counted: int = 0
    frames_needed: int = 3
    confirmed: int = 0
    frame: LegFrame | None = None
    stems: Sequence[Stem] = ()
    _seen: SeenFree = field(default_factory=SeenFree)

    def grid(self) -> FreeGrid:
        return self._seen.grid()

    def confirm_start(self, x_m: float, y_m: float) -> bool:
        is_free = not self.refusing and self._is_clear(x_m, y_m, START_RADIUS_M)
        if is_free:
            self._seen.confirm(x_m, y_m, START_RADIUS_M)
            self.confirmed += 1
        return is_free

    def confirm_by_word(self, north_m: float, east_m: float, radius_m: float) -> None:
        assert self.frame is not None, "a word is about a place, stated once a leg has begun"
        x_m, y_m, _ = self.frame.position_leg((north_m, east_m, 0.0))
        if self._is_clear(x_m, y_m, radius_m):
            self._seen.confirm(x_m, y_m, radius_m)

    def _is_clear(self, x_m: float, y_m: float, radius_m: float) -> bool:
        """Tell whether no stem stands in a disc, leg frame."""
        assert self.frame is not None
        north_m, east_m, _ = self.frame.position_ned((x_m, y_m, 0.0))
        return all(
            math.hypot(stem.north_m - north_m, stem.east_m - east_m) > radius_m + stem.radius_m
            for stem in self.stems
        )

    def begin_leg(self, leg: LegFrame) -> None:
        if self.frame is not None and leg != self.frame:
            x_m, y_m, _ = self.frame.position_leg(leg.origin_ned_m)
            self._seen = self._seen.turned((x_m, y_m), leg.heading_rad - self.frame.heading_rad)
        begins, self.frame = self.frame is None, leg
        if begins and self.start_known and self._is_clear(0.0, 0.0, START_RADIUS_M):
            self._seen.confirm(0.0, 0.0, START_RADIUS_M)

    def limit(self, half_width_m: float) -> None:
        self._seen.limit(half_width_m)

    def see(self, view: View) -> None:
        self._seen.centre_on(*view.position_leg_m)
        self._seen.see(view, "front")
        self.frames_counted += 1

    def shift(self, x_m: float, y_m: float) -> None:
        self._seen.shift(x_m, y_m)


class FieldFlight(PerfectFlight):
    """Flies through stems with best effort.

    Attributes:
        seen: the space seen free.
        blind: the sensor sends nothing.
        adopted_clearance_m: least distance of any adopted plan from any stem, less r + E.
        clearance_m: the same of what was flown.
        uncertified: ticks in which the way to rest held did not certify.
    """

    def __init__(
        self,
        contract: Contract,
        mission: Mission,
        stems: Sequence[Stem],
        seen: IdealSeenSpace | None = None,
    ) -> None:
        super().__init__(contract, mission)
        self.seen = seen or IdealSeenSpace()
        self.seen.stems = stems
        self.navigator.see_by(self.seen)
        self.stems, self.blind = stems, False
        self._stem_array = np.array([(s.north_m, s.east_m, s.radius_m) for s in stems])
        self.adopted_clearance_m = self.clearance_m = math.inf
        self.uncertified = 0
        self._ticks, self._yaw_rad, self._checked = 0, self.pose.yaw_rad, -1

    @property
    def thread(self) -> Thread:
        thread = self.navigator.thread
        assert thread is not None
        return thread

    def tick(self) -> None:
        self._ticks += 1
        if self._ticks % FRAME_TICKS == 0 and not self.blind:
            self._look()
        super().tick()
        way = self.thread.way
        if self.state.in_seen_space and way.certified is not None:
            self.uncertified += not way.certified
        self._check_plans()

    def _look(self) -> None:
        """Report stems in view, and what the frame shows to be free, unless the nose turns fast."""
        rate_radps = abs(self.pose.yaw_rad - self._yaw_rad) / 0.1
        self._yaw_rad = self.pose.yaw_rad
        terms, leg = self.navigator.assessment.terms, self.navigator.leg
        # What is marked is stated in the leg's frame: a new leg turns the set first.
        self.seen.begin_leg(leg)
        north_m, east_m, _ = self.pose.position_ned_m
        boxes = []
        for number, stem in enumerate(self.stems):
            apart_m = math.hypot(stem.north_m - north_m, stem.east_m - east_m)
            if apart_m - stem.radius_m > terms.detection_range_m:
                continue
            bearing_rad = math.atan2(stem.east_m - east_m, stem.north_m - north_m)
            aside = (bearing_rad - self.pose.yaw_rad + math.pi) % (2.0 * math.pi) - math.pi
            width_rad = math.asin(min(1.0, stem.radius_m / max(apart_m, stem.radius_m)))
            if abs(aside) - width_rad <= terms.field_of_view_rad / 2.0:
                size_m = 2.0 * stem.radius_m
                x_m, y_m, _ = leg.position_leg((stem.north_m, stem.east_m, 0.0))
                obstacle = self.see(x_m, y_m, size_m=(size_m, size_m), name=str(number))
                boxes.append(obstacle.measured)
        if rate_radps < SLOW_RADPS:
            x_m, y_m, _ = leg.position_leg(self.pose.position_ned_m)
            self.seen.see(
                View(
                    (x_m, y_m),
                    self.pose.yaw_rad - leg.heading_rad,
                    terms.field_of_view_rad / 2.0,
                    terms.detection_range_m,
                    boxes,
                    terms.position_error_m,
                )
            )

    def _check_plans(self) -> None:
        """Measure the true clearance of what is flown, its way to rest included."""
        body_m = self.navigator.assessment.terms.body_m
        north_m, east_m, _ = self.pose.position_ned_m
        self.clearance_m = min(self.clearance_m, self._room_m([(north_m, east_m)]) - body_m)
        if self.thread.plans != self._checked:
            self._checked = self.thread.plans
            reference = self.situation.reference
            flown = reference.upcoming or reference.current
            assert flown is not None
            times_s = np.linspace(flown.start_s, flown.end_s, 61).tolist()
            leg = self.navigator.leg
            places = [leg.position_ned(flown.sample(t).position_leg_m)[:2] for t in times_s]
            room_m = self._room_m(places) - body_m
            self.adopted_clearance_m = min(self.adopted_clearance_m, room_m)

    def _room_m(self, places: Sequence[tuple[float, float]]) -> float:
        if not len(self._stem_array):
            return math.inf
        apart = np.array(places)[:, None, :] - self._stem_array[None, :, :2]
        return float((np.hypot(apart[..., 0], apart[..., 1]) - self._stem_array[:, 2]).min())
