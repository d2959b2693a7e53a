"""Guide and plan in bounded slices, so that no tick waits for a whole plan."""

from __future__ import annotations

import logging
import math
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from onboard.guidance.dense.standstill_clock import NEARER_M
from onboard.guidance.dense.way_to_rest import moves
from onboard.planning.corridor.guide import Guide
from onboard.planning.corridor.horizon import PIECES
from onboard.planning.corridor.receding_horizon import (
    HorizonPlan,
    HorizonProblem,
    RecedingHorizonPlanner,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Sequence

    from onboard.geometry.box import Box
    from onboard.geometry.frames import FloatArray
    from onboard.geometry.free_grid import FreeGrid
    from onboard.guidance.dense.way_to_rest import WayToRest
    from onboard.guidance.movers.forecast import Forecast
    from onboard.planning.corridor.horizon import Horizon
    from onboard.planning.rest_certifier import RestLimits

log = logging.getLogger(__name__)

# A plan takes about ten slices, and has ten ticks.
SLICES_PER_TICK: Final = 2
# The guide follows what is new after the first of these, and the vehicle after the second.
_GUIDE_PERIOD_S: Final = 0.4
_GUIDE_AGE_MAX_S: Final = 2.0
# As far ahead the guide matters to where the nose points.
_PATH_M: Final = 5.0


class Surroundings(NamedTuple):
    """What a plan is made in.

    Attributes:
        grid: returns the seen-free set as it is.
        boxes: of what is known, leg frame; for the guide.
        revision: changes with the boxes.
        forecast: of movers; None where there are none.
    """

    grid: Callable[[], FreeGrid]
    boxes: Sequence[Box]
    revision: int
    forecast: Forecast | None = None


class Proposal(NamedTuple):
    """A plan, and the version of the plan flown that it was computed from."""

    horizon: Horizon
    version: int


class SlicedPlanning:
    """Plans from the plan flown, a few slices in each tick.

    Args:
        guide: distances to the leg's end.
        limits: what a plan may ask for.

    Attributes:
        guide: as given.
        slices_max: the most slices that one tick has done.
        failures: how often planning has raised an exception; nothing is proposed then.
    """

    def __init__(self, guide: Guide, limits: RestLimits) -> None:
        self.guide, self._limits = guide, limits
        self._planner = RecedingHorizonPlanner(limits)
        self._work: Generator[None, None, HorizonPlan] | None = None
        self._guide_work: Generator[None] | None = None
        self._version = -1
        self._guide_revision, self._guide_s = -1, -math.inf
        # Whether the last plan from rest found nothing that is clear of movers.
        self._nothing_clear = False
        self.slices_max = self.failures = 0

    def advance(self, way: WayToRest, surroundings: Surroundings, now_s: float) -> Proposal | None:
        """Work for one tick on the plan of the next node; return it once it is complete.

        Only a plan that leads elsewhere is returned: the one that is kept needs no decision.
        """
        if way.flown is None or way.decided:
            return None
        if len(way.flown.jerk_mps3) > PIECES + 1:  # a motion that takes longer than plans reach
            return None
        try:
            return self._advance(way, way.flown, surroundings, now_s)
        except Exception:
            # What is held goes on; nothing proposed costs time only.
            if not self.failures:
                log.exception("planning failed")
            self.failures += 1
            self._work = self._guide_work = None
            return None

    def _advance(
        self, way: WayToRest, flown: Horizon, surroundings: Surroundings, now_s: float
    ) -> Proposal | None:
        if self._guide_work is None and self._version != way.version:
            # The work is on another plan than the one flown.
            self._version, self._work = way.version, None
            if not self._begin_guide(flown, surroundings, now_s):
                self._begin_plan(way, surroundings)
        if self._guide_work is not None:
            if next(self._guide_work, True):
                self._guide_work = None
                self._version, self._work = way.version, None
                self._begin_plan(way, surroundings)
            return None
        return None if self._work is None else self._slices(way)

    def path_leg_m(self, position_leg_m: tuple[float, float]) -> FloatArray | None:
        """Return the guide's path from a position; None where none leads on, or is known yet."""
        return self.guide.path_leg_m(position_leg_m, _PATH_M)

    def forget_guide(self) -> None:
        """Compute the guide again with the next plan: a place now costs more."""
        self._guide_revision = -1

    def _slices(self, way: WayToRest) -> Proposal | None:
        assert self._work is not None  # noqa: S101  the caller checked
        for count in range(1, SLICES_PER_TICK + 1):
            self.slices_max = max(self.slices_max, count)
            try:
                next(self._work)
            except StopIteration as done:
                self._work = None
                plan: HorizonPlan = done.value
                self._nothing_clear = plan.kind == "kept" and not self._nothing_clear
                if plan.kind == "kept" or not is_finite(plan.horizon):
                    return None
                return Proposal(plan.horizon, way.version)
        return None

    def _begin_plan(self, way: WayToRest, surroundings: Surroundings) -> None:
        assert way.flown is not None  # noqa: S101  the caller checked
        grid = surroundings.grid()
        # At rest, every other plan without success is made as if nothing moved: where movers are
        # what speaks against it, the vehicle waits for them.
        forecast = surroundings.forecast
        if forecast is not None and not (way.still and self._nothing_clear):
            grid = forecast.clear_of(grid)
        problem = HorizonProblem(way.flown, grid, self.guide, self._limits, way.height_m)
        self._work = self._planner.plan(problem)

    def _begin_guide(self, flown: Horizon, surroundings: Surroundings, now_s: float) -> bool:
        """Begin to update the guide where it is due, a slice a tick; tell whether it is due."""
        age_s = now_s - self._guide_s
        news = surroundings.revision != self._guide_revision or surroundings.forecast is not None
        if not (age_s > _GUIDE_AGE_MAX_S or (news and age_s >= _GUIDE_PERIOD_S)):
            return False
        x_m, y_m = flown.nodes[0, 0].tolist()
        self._guide_work = self.guide.updating(
            (x_m, y_m), surroundings.boxes, surroundings.forecast
        )
        self._guide_revision, self._guide_s = surroundings.revision, now_s
        return True


def is_finite(plan: Horizon) -> bool:
    """Tell whether a plan is made of numbers."""
    return bool(np.isfinite(plan.nodes).all() and np.isfinite(plan.jerk_mps3).all())


def leads_on(plan: Horizon) -> bool:
    """Tell whether a plan is worth setting off for, from rest."""
    x_m, y_m = (plan.nodes[-1, 0] - plan.nodes[0, 0]).tolist()
    return moves(plan) and math.hypot(x_m, y_m) >= NEARER_M
