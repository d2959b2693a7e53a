"""What a planner returns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from onboard.motion.trajectory import Trajectory
    from onboard.planning.certifier import Certificate
    from onboard.planning.problem import Side


@dataclass(frozen=True)
class Plan:
    """A certified plan.

    Attributes:
        kind: where it came from.
        trajectory: what to fly, leg frame.
        side: side on which the obstacle is passed; None when braking.
        cost: `onboard.planning.problem.cost`; infinite when braking.
        certificate: the certifier's verdict, always valid.
        crossing_s: absolute time of the crossing, for a QP plan; where replanning starts from.
    """

    kind: Literal["qp", "vertex", "brake"]
    trajectory: Trajectory
    side: Side | None
    cost: float
    certificate: Certificate
    crossing_s: float | None = None


@dataclass(frozen=True)
class NoPlan:
    """No plan certifies.

    Attributes:
        reasons: why, one sentence for each attempt.
    """

    reasons: tuple[str, ...]


def reason(attempt: str, certificate: Certificate) -> str:
    """Say why an attempt at a plan was rejected."""
    return f"{attempt}: {', '.join(certificate.failures)}"
