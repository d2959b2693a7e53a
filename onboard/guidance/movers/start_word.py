"""The operator's word that no mover is near, which comes with control where no ring sees who is.

It is said as control is seen to be granted, and wears off at v_o from then on, whatever keeps the
vehicle waiting (THEORY.md, M5).  A mover that is seen where it says that none is ends it, since out
of view that one may be anywhere near; and a daemon that begins with control has heard none.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from onboard.contract.movers import start_clear_of_movers_m
from onboard.guidance.departure import Refusal, RefusalKind

if TYPE_CHECKING:
    from collections.abc import Callable

    from onboard.contract.assessment import Assessment
    from onboard.vehicle_state import Pose

_AGAIN = "take control back, and grant it while no mover is near"


class StartWord:
    """Remembers when and where it was given.

    Attributes:
        said: the pose and the time; None while no word holds.
        withheld: whether the autopilot has said since that control is not granted.
    """

    def __init__(self) -> None:
        self.said: tuple[Pose, float] | None = None
        self.withheld = False

    def control_is_granted(self, pose: Pose, now_s: float) -> None:
        """Take the word if control has been withheld until now."""
        if self.withheld:
            self.said, self.withheld = (pose, now_s), False

    def left_m(
        self, assessment: Assessment, radius_m: float, pose: Pose, now_s: float
    ) -> tuple[float, str | None]:
        """Return within how much of the radius that was stated none can be now.

        Args:
            assessment: of a contract without a ring.
            radius_m: as the mission states.
            pose: the newest.
            now_s: the time.

        Returns:
            The rest of the radius, and what speaks against departing with it.
        """
        if self.said is None:
            return 0.0, f"no word on movers holds: {_AGAIN}"
        terms, (there, said_s) = assessment.terms, self.said
        worn_m = (now_s - said_s) * max(each.speed_max_mps for each in terms.movers)
        worn_m += math.dist(pose.position_ned_m[:2], there.position_ned_m[:2])
        needed_m = start_clear_of_movers_m(terms, assessment.inflated)
        left_m = radius_m - worn_m
        if left_m >= min(needed_m, radius_m):  # too small a radius is refused by itself
            return left_m, None
        text = f"the word on movers of {now_s - said_s:.1f} s ago clears {max(left_m, 0.0):.1f} m"
        return left_m, f"{text} by now (needed {needed_m:.1f} m): {_AGAIN}"

    def end_if_contradicted(self, refusals: list[Refusal]) -> None:
        """End the word where a mover was seen within it."""
        if any(each.kind is RefusalKind.START_WORD and each.subject for each in refusals):
            self.said = None


def near_refusals(near: Callable[[float], list[str]], radius_m: float) -> list[Refusal]:
    """Return a refusal for each mover within a radius.

    Args:
        near: tells which are.
        radius_m: within which none may be.
    """
    return [
        Refusal(RefusalKind.START_WORD, f"mover {track} is within {radius_m:.3g} m", track)
        for track in near(radius_m)
    ]
