"""What of THREAD and PAUSE is recorded and shown."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from onboard.guidance.dense.limits import shown_half_view_rad
from onboard.guidance.dense.pause import PAUSES_MAX
from onboard.guidance.phases import FlightState
from onboard.planning.corridor.look import Outlook

if TYPE_CHECKING:
    from onboard.geometry.frames import FloatArray
    from onboard.geometry.free_grid import FreeGrid
    from onboard.guidance.dense.level import Level
    from onboard.guidance.dense.nose import Nose
    from onboard.guidance.dense.seen_space import SeenSpace
    from onboard.guidance.dense.threaded_leg import ThreadedLeg
    from onboard.guidance.dense.way_to_rest import WayToRest
    from onboard.guidance.movers.mover_guard import MoverGuard
    from onboard.guidance.situation import Situation
    from onboard.motion.trajectory import Trajectory, Vector


class ThreadRecord:
    """Reads the state of `Thread`, which decides."""

    way: WayToRest
    guard: MoverGuard
    nose: Nose
    _situation: Situation
    _seen: SeenSpace
    _leg: ThreadedLeg
    _level: Level
    _path_leg_m: FloatArray | None
    _confirming: bool

    @property
    def turns_nose(self) -> bool:
        """Whether the nose may still be on its way to where it was told to point."""
        return self._situation.state.in_seen_space and not self.nose.steady

    @property
    def confirms_start(self) -> bool:
        """Whether the place where the vehicle hovers has still to be seen, at the leg's height."""
        return self._confirming or self._level.changing

    @property
    def slices_max(self) -> int:
        """The most slices of planning that one tick has done on this leg."""
        return self._leg.planning.slices_max

    @property
    def pauses(self) -> int:
        """Pauses on this leg."""
        return self._leg.pause.count

    @property
    def free_grid(self) -> FreeGrid | None:
        """The seen-free set, leg frame, for the record."""
        return self._seen.grid() if self.way.flown is not None else None

    @property
    def held_way(self) -> Trajectory | None:
        """The way to rest that is flown, for the record."""
        return None if self.way.flown is None else self._situation.reference.current

    @property
    def guide_path_leg_m(self) -> FloatArray | None:
        """The way to try, (k, 2), for the record; None where no way leads on."""
        return self._path_leg_m

    @property
    def pause_reason(self) -> str | None:
        """Why the vehicle rests; None while it flies on."""
        if self._situation.state is FlightState.YIELDING:
            return f"yielding: {self.guard.reason}"
        if self._situation.state is not FlightState.LOOKING:
            return None
        if self._level.changing:
            return "going to the height of the leg"
        if self._confirming:
            return "looking round: the start has to be seen"
        if self._leg.manoeuvre.looking:
            return "looking aside, to sidestep what is ahead"
        return f"nothing certifies (pause {self.pauses} of {PAUSES_MAX}): looking"

    # ------------------------------------------------------------------ what is the case

    @property
    def _is_along_leg(self) -> bool:
        """Whether what plans ask for holds with the nose along the leg only."""
        return math.isinf(self._leg.limits.acceleration_disc_mps2)

    def _here(self) -> Vector:
        flown = self.way.flown
        assert flown is not None  # noqa: S101  what threads holds a way to rest
        x_m, y_m = flown.nodes[0, 0].tolist()
        return x_m, y_m, self.way.height_m

    def _outlook(self) -> Outlook:
        situation, (x_m, y_m, _) = self._situation, self._here()
        return Outlook(
            position_leg_m=(x_m, y_m),
            heading_rad=situation.reference.heading_rad,
            half_view_rad=situation.assessment.terms.field_of_view_rad / 2.0,
            path_leg_m=self._path_leg_m,
            grid=self._seen.grid(),
            body_radius_m=self._leg.limits.body_radius_m,
            shown_half_rad=shown_half_view_rad(situation.assessment),
        )
