"""The way to rest that is held: what is flown if nothing better certifies from now on.

The invariant (two-tier theory, section 4.2): at every time the service holds a certified plan that
starts on the reference and ends at rest in the space seen free.  A plan replaces it only if it is
certified for the set as it is, starts on the plan that is flown, and is in time; else that one
goes on.
"""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from onboard.planning.certifier import Certificate
from onboard.planning.corridor.horizon import PIECE_S, Horizon
from onboard.planning.rest_certifier import RestLimits, certify_rest, has_room

if TYPE_CHECKING:
    from collections.abc import Callable

    from onboard.geometry.free_grid import FreeGrid
    from onboard.guidance.movers.mover_guard import MoverGuard
    from onboard.guidance.reference import Reference
    from onboard.motion.trajectory import Trajectory, Vector

# A plan whose nodes are all slower than this stays where it is.
STILL_MPS: Final = 0.05
# A reference slower than this has come to rest: so much may it jump where a leg begins.
AT_REST_MPS: Final = 0.01
_ROUND_OFF_S: Final = 1e-9
# How much larger the body may be, in metres: the steps in which the margin is stated.
_MARGINS_M: Final = (0.05, 0.1, 0.2, 0.4)


class WayToRest:
    """Holds the plan that is flown, in nodes, and the one that takes over at the next node.

    A certified trajectory of any other kind is followed to its rest, and nodes go on from there.

    Args:
        reference: follows the plan.
        guard: tells what movers speak against a plan; None where nothing moves.

    Attributes:
        flown: the plan that is flown; its first node is the last that has passed, or where the
            trajectory that is followed comes to rest.
        version: of the plan flown; a plan that was computed from another one is dropped.
        certified: whether the plan flown is free in the set as it was at the last node; None
            before the first certificate.
        margin_m: by how much the body could be larger in that, in steps; None if it is not.
    """

    def __init__(self, reference: Reference, guard: MoverGuard | None = None) -> None:
        self._reference, self._guard = reference, guard
        self._height_m = 0.0
        self.flown: Horizon | None = None
        self._next: Horizon | None = None
        # What is followed before the first node; None once it has come to rest.
        self._followed: Trajectory | None = None
        self.version = 0
        self.certified: bool | None = None
        self.margin_m: float | None = None

    @property
    def height_m(self) -> float:
        """Height of the plan, z in the leg frame."""
        return self._height_m

    @property
    def decided(self) -> bool:
        """Whether a plan takes over at the next node."""
        return self._next is not None

    @property
    def follows(self) -> bool:
        """Whether a trajectory that was certified elsewhere is still followed to its rest."""
        return self._followed is not None

    @property
    def still(self) -> bool:
        """Whether the vehicle is at rest and stays so."""
        if self._followed is not None or self._next is not None:
            return False
        return self.flown is not None and not moves(self.flown)

    @property
    def ended(self) -> bool:
        """Whether the vehicle has come to rest, but for what no setpoint can show."""
        if self.flown is None or not self.still:
            return False
        return bool(np.abs(self.flown.nodes[0, 1]).max() <= AT_REST_MPS)

    def begin(self, now_s: float, position_leg_m: Vector) -> None:
        """Stay at a place from now on."""
        x_m, y_m, self._height_m = position_leg_m
        self.flown, self._next = Horizon.at_rest(now_s, x_m, y_m), None
        self._followed = None
        self.version += 1
        self.certified = self.margin_m = None
        self._reference.fly(self.flown.trajectory(self._height_m))

    def follow(self, trajectory: Trajectory, now_s: float) -> None:
        """Follow a trajectory from its start to its rest, and stay there.

        Args:
            trajectory: certified by the caller for the present set; starts on what is flown, now
                or before the next tick.
            now_s: the time.
        """
        x_m, y_m, self._height_m = trajectory.final.position_leg_m
        self.flown, self._next = Horizon.at_rest(trajectory.end_s, x_m, y_m), None
        self._followed = trajectory
        self.version += 1
        self.certified, self.margin_m = True, None
        if trajectory.start_s > now_s:
            self._reference.schedule(trajectory, now_s)
        else:
            self._reference.fly(trajectory)

    def end(self) -> None:
        """Hold nothing: the pilot flies."""
        self.flown = self._next = self._followed = None
        self.version += 1
        self.certified = self.margin_m = None

    def pass_nodes(self, now_s: float) -> bool:
        """Go on to the plan that is due; tell whether a node has been passed."""
        passed = False
        self._reference.hand_over(now_s)
        if self._followed is not None and now_s >= self._followed.end_s:
            self._followed = None
        while self.flown is not None and now_s >= self.flown.start_s + PIECE_S - _ROUND_OFF_S:
            self.flown, self._next = self._next or self.flown.next_node(), None
            self.version += 1
            passed = True
        if passed and self.flown is not None:
            self._fill_up(self.flown)
        return passed

    def adopt(
        self, plan: Horizon, version: int, now_s: float, limits: RestLimits, grid: FreeGrid
    ) -> Certificate | None:
        """Have a plan take over at its first node if it certifies for the present set.

        Args:
            plan: starts at the next node of the plan flown.
            version: of the plan that it was computed from.
            now_s: the time.
            limits: as the certifier checks them.
            grid: the present seen-free set.

        Returns:
            The certificate, valid or not; None if the plan comes too late to be checked at all.
        """
        start = self._reference.sample(plan.start_s)
        if version != self.version or now_s > plan.start_s or start is None:
            return None
        trajectory = plan.trajectory(self._height_m)
        certificate = certify_rest(trajectory, start, plan.start_s, limits, grid)
        if certificate.valid and self._guard is not None:
            certificate = Certificate(self._guard.failures(trajectory, limits, now_s))
        if certificate.valid:
            self._next = plan
            self._reference.schedule(trajectory, now_s)
            self.certified = True
        return certificate

    def recheck(self, limits: RestLimits, grid: FreeGrid) -> None:
        """Check the plan flown against the set as it is now, independently of how it was found."""
        if self.flown is None:
            return
        self.certified = self._certifies(limits, grid)
        self.margin_m = None
        if self.certified:
            body_m, way = limits.body_radius_m, self._way
            self.margin_m = largest_margin_m(
                lambda more_m: has_room(way, replace(limits, body_radius_m=body_m + more_m), grid)
            )

    def shift(self, shift_leg_m: Vector) -> None:
        """Move with the estimate, as the reference and the set do."""
        *plan_m, z_m = shift_leg_m
        self._height_m += z_m
        self.version += 1
        self.flown, self._next = (
            None if plan is None else _shifted(plan, plan_m) for plan in (self.flown, self._next)
        )
        if self._followed is not None:
            self._followed = self._followed.shifted_by(shift_leg_m)

    @property
    def _way(self) -> Trajectory:
        assert self.flown is not None  # noqa: S101  the callers checked
        return self._followed or self.flown.trajectory(self._height_m)

    def _certifies(self, limits: RestLimits, grid: FreeGrid) -> bool:
        trajectory = self._way
        start = trajectory.sample(trajectory.start_s)
        return certify_rest(trajectory, start, trajectory.start_s, limits, grid).valid

    def _fill_up(self, flown: Horizon) -> None:
        """Have the reference stay at rest where its trajectory ends: it would coast on for ever."""
        current = self._reference.current
        ends = current is not None and current.end_s <= flown.start_s + PIECE_S
        if ends and self._reference.upcoming is None and not moves(flown):
            self._reference.fly(flown.trajectory(self._height_m))


def largest_margin_m(certifies: Callable[[float], bool]) -> float:
    """Return the largest stated margin that a way to rest has beyond its body; 0 without any.

    Args:
        certifies: whether the way certifies with a body that is larger by this; if it does, it does
            with any smaller one, so that two of four certificates mostly tell.
    """
    passed = bisect_left(_MARGINS_M, 1, key=lambda margin_m: 0 if certifies(margin_m) else 1)
    return (0.0, *_MARGINS_M)[passed]


def moves(plan: Horizon) -> bool:
    """Tell whether a plan leads anywhere."""
    return bool(np.abs(plan.nodes[:, 1]).max() > STILL_MPS)


def _shifted(plan: Horizon, shift_m: list[float]) -> Horizon:
    nodes = plan.nodes.copy()
    nodes[:, 0] += shift_m
    return Horizon(plan.start_s, nodes, plan.jerk_mps3)
