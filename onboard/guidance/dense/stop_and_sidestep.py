"""Stop, look, sidestep, go: flown where nothing better certifies, before a pause and before HOLD.

Theorem P of the two-tier theory says where this passes every obstacle; a proof is about what flies,
so it is flown.  Nothing here decides on safety: each motion of `onboard.planning.sidestep` is flown
only if it certifies.  While one is flown, no other plan replaces it, so that what has been gained
along the leg is not given away again.
"""

from __future__ import annotations

import math
from enum import Enum, auto, unique
from typing import TYPE_CHECKING, Final, NamedTuple

from onboard.geometry.frames import wrap_angle
from onboard.guidance.dense.look_round import LookRound, points_at
from onboard.planning.retreat import retreats
from onboard.planning.sidestep import GO_MIN_M, Standstill, go_ahead, looks_aside_rad, sidesteps

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from onboard.geometry.box import Box
    from onboard.geometry.free_grid import FreeGrid
    from onboard.guidance.dense.seen_space import SeenSpace
    from onboard.guidance.dense.way_to_rest import WayToRest
    from onboard.guidance.reference import Reference
    from onboard.guidance.situation import Situation
    from onboard.planning.corridor.horizon import Horizon
    from onboard.planning.rest_certifier import RestLimits
    from onboard.vehicle_state import Pose

# Motions without getting farther along the leg than ever before: then it is for others to try.
MOTIONS_MAX: Final = 8
# Certificates for one decision: a tick has no time for more.
_CANDIDATES_MAX: Final = 4
_FARTHER_M: Final = 0.3
# So often, until it gets farther, the vehicle draws back to see what is too near to be seen.
_RETREATS_MAX: Final = 2
# A go that avoids nothing is flown for so long before another plan may replace it.
_UNDISTURBED_M: Final = 1.0


@unique
class Step(Enum):
    """What a tick of the manoeuvre has come to."""

    GOES_ON = auto()
    FLIES = auto()
    PASSED = auto()
    FAILED = auto()


@unique
class _Stage(Enum):
    IDLE = auto()
    DECIDING = auto()
    LOOKING = auto()
    SIDESTEPPING = auto()
    RETREATING = auto()
    FACING = auto()
    GOING = auto()


class Known(NamedTuple):
    """What is known in this tick.

    Attributes:
        grid: the seen-free set.
        boxes: known obstacles, leg frame.
        position_leg_m: (x, y) of the reference.
        heading_rad: of the nose, measured, from the leg towards its right.
        frames_counted: so far.
    """

    grid: FreeGrid
    boxes: Sequence[Box]
    position_leg_m: tuple[float, float]
    heading_rad: float
    frames_counted: int


def known_of(situation: Situation, seen: SeenSpace, pose: Pose, now_s: float) -> Known:
    """Return what is known now."""
    state = situation.reference.sample(now_s)
    assert state is not None  # noqa: S101  what threads has a reference
    x_m, y_m, _ = state.position_leg_m
    return Known(
        grid=seen.grid(),
        boxes=[obstacle.measured for obstacle in situation.obstacles],
        position_leg_m=(x_m, y_m),
        heading_rad=wrap_angle(pose.yaw_rad - situation.leg.heading_rad),
        frames_counted=seen.frames_counted,
    )


class StopAndSidestep:
    """Flies the manoeuvre on one leg.

    Args:
        reference: whose heading is commanded.
        way: the way to rest that is held.
        limits: what a motion may ask for.
        margin_m: that boxes are grown by to keep-outs of the reference.
        goal_leg_m: end of the leg.
        looks_rad: headings to look at before a sidestep, the last along the leg.
        frames_needed: frames that have to count at each.
    """

    def __init__(
        self,
        reference: Reference,
        way: WayToRest,
        limits: RestLimits,
        *,
        margin_m: float,
        goal_leg_m: tuple[float, float],
        looks_rad: Sequence[float],
        frames_needed: int,
    ) -> None:
        self._reference, self._way, self._limits = reference, way, limits
        self._margin_m, self._goal_leg_m = margin_m, goal_leg_m
        self._looks_rad, self._needed = tuple(looks_rad), frames_needed
        self._stage = _Stage.IDLE
        self._round = LookRound((), 0)
        self._back_m = 2.0 * limits.body_radius_m
        # No plan replaces what is flown before this x.
        self._passed_x_m = math.inf
        self._farthest_x_m, self._motions, self._retreats = -math.inf, 0, 0
        self._tried_leg_m: list[tuple[float, float]] = []
        self._may_look = self._has_looked = False

    @property
    def active(self) -> bool:
        """Whether it decides what is flown."""
        return self._stage is not _Stage.IDLE

    @property
    def looking(self) -> bool:
        """Whether the vehicle looks aside from where it rests."""
        return self._stage is _Stage.LOOKING

    @property
    def moving(self) -> bool:
        """Whether a motion of it is flown."""
        return self._stage in (_Stage.SIDESTEPPING, _Stage.RETREATING, _Stage.GOING)

    def begin(self, *, may_look: bool) -> bool:
        """Begin where the vehicle rests; tell whether there is any use in it.

        Args:
            may_look: look aside if nothing certifies at once.
        """
        if not self._way.still:
            return False
        x_m, _ = self._place_leg_m()
        if x_m >= self._farthest_x_m + _FARTHER_M:
            self._farthest_x_m, self._motions, self._retreats = x_m, 0, 0
            self._tried_leg_m.clear()
        if self._motions >= MOTIONS_MAX:
            return False
        self._stage, self._may_look, self._has_looked = _Stage.DECIDING, may_look, False
        return True

    def cancel(self) -> None:
        """Decide nothing any more; what is flown comes to rest."""
        self._stage = _Stage.IDLE

    def advance(self, known: Known, now_s: float) -> Step:
        """Decide for one tick, or look.

        Args:
            known: what is known.
            now_s: the time.
        """
        if self._stage is _Stage.GOING:
            return self._go_on(known.position_leg_m[0])
        if self._stage is _Stage.SIDESTEPPING:
            if self._way.still:
                self._stage, self._round = _Stage.FACING, LookRound((0.0,), self._needed)
            return Step.GOES_ON
        if self._stage is _Stage.RETREATING:
            if self._way.still:
                self._look()
            return Step.GOES_ON
        if self._stage is _Stage.DECIDING:
            return self._decide(known, now_s)
        looked = self._round.advance(self._reference, known.heading_rad, known.frames_counted)
        if looked:
            self._has_looked |= self._stage is _Stage.LOOKING
            self._stage = _Stage.DECIDING
        return Step.GOES_ON

    def _go_on(self, x_m: float) -> Step:
        if x_m < self._passed_x_m and not self._way.still:
            return Step.GOES_ON
        self._stage = _Stage.IDLE
        return Step.PASSED

    def _decide(self, known: Known, now_s: float) -> Step:
        """Go if that certifies, else sidestep, else look, else draw back to look, else give up."""
        if self._way.decided or self._way.flown is None:
            return Step.GOES_ON
        at = self._standstill(self._way.flown, known)
        if self._points_ahead(known.heading_rad) and self._motions < MOTIONS_MAX:
            if self._fly_first(go_ahead(at), known, now_s):
                self._stage, self._passed_x_m = _Stage.GOING, self._end_of_go_m(at)
                return Step.FLIES
            if at.place_leg_m not in self._tried_leg_m:
                self._tried_leg_m.append(at.place_leg_m)
            if self._fly_first(sidesteps(at), known, now_s):
                self._stage, self._has_looked = _Stage.SIDESTEPPING, False
                return Step.FLIES
        if self._may_look and not self._has_looked:
            self._look()
            return Step.GOES_ON
        if self._may_retreat(known) and self._fly_first(retreats(at, self._back_m), known, now_s):
            self._stage, self._retreats = _Stage.RETREATING, self._retreats + 1
            return Step.FLIES
        self._stage = _Stage.IDLE
        return Step.FAILED

    def _look(self) -> None:
        self._stage = _Stage.LOOKING
        self._round = LookRound(self._looks_rad, self._needed)

    def _may_retreat(self, known: Known) -> bool:
        fresh = self._retreats < _RETREATS_MAX and self._motions < MOTIONS_MAX
        return self._may_look and fresh and self._points_ahead(known.heading_rad)

    def _fly_first(self, motions: Iterator[Horizon], known: Known, now_s: float) -> bool:
        """Fly the first motion that certifies, of a few."""
        for _, motion in zip(range(_CANDIDATES_MAX), motions, strict=False):
            certificate = self._way.adopt(
                motion, self._way.version, now_s, self._limits, known.grid
            )
            if certificate is not None and certificate.valid:
                self._motions += 1
                return True
        return False

    def _end_of_go_m(self, at: Standstill) -> float:
        """Return the x up to which a go is flown undisturbed: past what stands beside it."""
        x_m, y_m = at.place_leg_m
        reach_m = self._margin_m + 2.0 * _UNDISTURBED_M
        beside_m = [
            box.x_max_m + self._margin_m
            for box in at.boxes
            if box.y_min_m - reach_m < y_m < box.y_max_m + reach_m
            and box.x_min_m - self._margin_m <= x_m + _UNDISTURBED_M
        ]
        return max([x_m + max(_UNDISTURBED_M, GO_MIN_M), *beside_m])

    def _standstill(self, flown: Horizon, known: Known) -> Standstill:
        return Standstill(
            flown=flown,
            grid=known.grid,
            boxes=known.boxes,
            limits=self._limits,
            margin_m=self._margin_m,
            goal_leg_m=self._goal_leg_m,
            tried_leg_m=self._tried_leg_m,
        )

    def _points_ahead(self, heading_rad: float) -> bool:
        """Tell whether the nose is where the limits hold: along the leg, or anywhere."""
        if math.isfinite(self._limits.acceleration_disc_mps2):
            return True
        return points_at(heading_rad, 0.0) and points_at(self._reference.heading_rad, 0.0)

    def _place_leg_m(self) -> tuple[float, float]:
        assert self._way.flown is not None  # noqa: S101  the caller checked
        x_m, y_m = self._way.flown.nodes[0, 0].tolist()
        return x_m, y_m


def looks_before_sidestep_rad(
    shown_half_rad: float, radius_m: float, tracking_error_m: float
) -> tuple[float, ...]:
    """Return where to look before a sidestep, the nose back along the leg at the end."""
    return (*looks_aside_rad(shown_half_rad, radius_m, tracking_error_m), 0.0)
