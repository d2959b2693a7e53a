"""Which heights a vehicle fills that flies at one height, and what has to be seen of them.

An obstacle that does not meet the band of heights around the flight is not in its way (theory K).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from onboard.contract.agility import GRAVITY_MPS2
from onboard.contract.clause import Clause

if TYPE_CHECKING:
    from onboard.contract.arithmetic import Arithmetic
    from onboard.contract.derivation import Derived
    from onboard.contract.terms import Terms
    from onboard.geometry.frames import Q

# What is flown may be this far from the height of its leg, and counts as level all the same.
LEVEL_M: Final = 0.05
# The edge of a view is known no better than this.
VIEW_EDGE_RAD: Final = math.radians(2.0)


@dataclass(frozen=True)
class HeightBand:
    """Every height that a part of the vehicle may be at, errors included, in local NED.

    Attributes:
        top_m, bottom_m: positive down, top <= bottom; infinite where obstacles count as pillars.
    """

    top_m: float = -math.inf
    bottom_m: float = math.inf

    @classmethod
    def around(cls, down_m: float, half_m: float) -> HeightBand:
        """Return the band around the height of a leg.

        Args:
            down_m: of the leg.
            half_m: `half_band_m` of the contract.
        """
        return cls(down_m - half_m, down_m + half_m)

    def meets(self, down_m: tuple[float, float]) -> bool:
        """Tell whether an obstacle reaches into the band; to touch it is to meet it.

        Args:
            down_m: its top and bottom, errors included; infinite where unknown.
        """
        top_m, bottom_m = down_m
        return top_m <= self.bottom_m and bottom_m >= self.top_m


def half_band_m(terms: Terms[float]) -> float:
    """Return r_z + E_z, how far a part of the vehicle may be above or below its leg, in metres.

    E_z is what control and the estimate add: the vehicle is `tracking_error_z_m` off in the
    estimate, and that drifts between the sight of an obstacle and its passing.  Infinite where
    obstacles count as pillars.
    """
    if terms.radius_z_m is None or terms.height_drift_m is None:
        return math.inf
    return terms.radius_z_m + terms.tracking_error_z_m + terms.height_drift_m + LEVEL_M


def ground_below_m(terms: Terms[Q]) -> Q:
    """Return how high a mission has to be above its origin for the ground, errors included.

    The height drifts from the start on: by `height_drift_flight_m` where that is stated.
    """
    body_m = terms.radius_m if terms.radius_z_m is None else terms.radius_z_m
    found_m = body_m + terms.tracking_error_z_m + terms.estimator_reset_max_m
    drift_m = terms.height_drift_flight_m
    if drift_m is None:
        drift_m = terms.height_drift_m
    for more_m in (drift_m, terms.terrain_max_m, terms.terrain_error_m):
        if more_m is not None:
            found_m = found_m + more_m
    return found_m


def flown_over_from_m(terms: Terms[Q], top_max_m: float) -> Q:
    """Return from which height of a leg on what moves on the ground is below the band (theory K).

    Args:
        terms: of a contract with heights.
        top_max_m: how high above the ground it is at most.
    """
    return ground_below_m(terms) + (top_max_m + LEVEL_M)


def flown_over_clauses(terms: Terms[Q]) -> tuple[Clause[Q], ...]:
    """Return what being flown over requires of each class that stays on the ground (theory K).

    None where the height of the mission is not known, as of the ground itself.
    """
    if terms.mission_altitude_m is None:
        return ()
    return tuple(
        Clause(
            f"flown_over.{mover.kind}",
            flown_over_from_m(terms, mover.top_max_m),
            terms.mission_altitude_m,
            "m",
            "the mission must be flown above all that moves: near by, the view does not show it",
        )
        for mover in terms.movers
        if mover.top_max_m is not None
    )


def view_needed_rad(terms: Terms[Q], derived: Derived[Q], ops: Arithmetic[Q]) -> Q | None:
    """Return the view up and down that shows the band before it is flown into; None for pillars.

    At the range less the fixed margin the whole band must be in view, top and bottom of what
    reaches into it included, while the body tilts against its own drag and the wind.
    """
    r_z_m, drift_m, e_z_m = terms.radius_z_m, terms.height_drift_m, terms.position_error_z_m
    if r_z_m is None or drift_m is None or e_z_m is None:
        return None
    wind_mps = terms.cruise_speed_mps if terms.wind_max_mps is None else terms.wind_max_mps
    if terms.wind_max_mps is None:
        wind_mps = wind_mps * 0.0
    # The sensor is within the body, and that within its error of the leg.
    high_m = 2.0 * (r_z_m + terms.tracking_error_z_m + drift_m) + 2.0 * e_z_m
    ahead_m = terms.detection_range_m - derived.margin_m - terms.tracking_error_m
    trim_mps2 = terms.drag_per_s * (terms.cruise_speed_mps + wind_mps)
    gravity_mps2 = trim_mps2 * 0.0 + GRAVITY_MPS2
    return ops.atan2(high_m, ahead_m) + ops.atan2(trim_mps2, gravity_mps2) + VIEW_EDGE_RAD
