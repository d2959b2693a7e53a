"""What the monitors need to know of the flight, and how they act on it: the seam to guidance."""

from __future__ import annotations

from typing import Protocol

from onboard.contract.assessment import Assessment
from onboard.geometry.frames import LegFrame, Vector
from onboard.monitoring.assumptions import Violation
from onboard.motion.trajectory import State
from onboard.perception.obstacle_map import Obstacle, ObstacleMap
from onboard.vehicle_state import Pose


class SupervisedFlight(Protocol):
    """A flight under a contract; `onboard.guidance.navigator` implements it."""

    @property
    def assessment(self) -> Assessment:
        """The contract as it is flown now: as declared, or solved again for what was seen."""
        ...

    @property
    def obstacles(self) -> ObstacleMap:
        """What is known of the surroundings."""
        ...

    @property
    def leg(self) -> LegFrame:
        """Frame of the present leg."""
        ...

    @property
    def flying(self) -> bool:
        """Whether the guarantee is at stake: the vehicle is on its way."""
        ...

    @property
    def moving(self) -> bool:
        """Whether the vehicle is on its way along a leg, its nose aligned."""
        ...

    @property
    def in_seen_space(self) -> bool:
        """Whether the vehicle holds a certified way to rest in the space seen free."""
        ...

    @property
    def pointing_rad(self) -> float | None:
        """Where the nose is told to point, clockwise from north; None while it turns."""
        ...

    @property
    def cruising_freely(self) -> bool:
        """Whether the vehicle cruises outside every Region of Influence."""
        ...

    def reference(self, time_s: float) -> State | None:
        """Return the reference at a time, leg frame; None in STANDBY."""
        ...

    def obstacles_to_meet(self, now_s: float) -> list[Obstacle]:
        """Return the obstacles whose properties matter now."""
        ...

    def respond_to(self, violation: Violation, now_s: float, measured: Pose | None = None) -> None:
        """Adapt the contract to a failed assumption, or brake to hover.

        Args:
            violation: what failed.
            now_s: when.
            measured: brake from this pose, where the reference itself cannot be believed.
        """
        ...

    def recheck_plan(self, obstacle: Obstacle, now_s: float) -> None:
        """Check what is flown against an obstacle that is new or has grown."""
        ...

    def shift(self, shift_ned_m: Vector) -> None:
        """Move everything remembered into the present local frame, which a reset has moved."""
        ...

    def fly_on_after_shift(self, violation: Violation, now_s: float) -> None:
        """Certify again what is flown after a `shift`; stop for the violation if that fails."""
        ...

    def hover_at(self, pose: Pose, now_s: float) -> None:
        """Hover at a pose, if the vehicle hovers, rather than fly back in one step."""
        ...


def in_control(flight: SupervisedFlight, now_s: float) -> bool:
    """Tell whether the service commands the vehicle: without a reference it is in STANDBY."""
    return flight.reference(now_s) is not None
