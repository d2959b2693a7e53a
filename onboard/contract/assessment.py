"""The contract: what is required, what is declared, and the verdict.

A contract file states limits and assumptions; `assess` derives the Region of Influence from them
and checks every requirement against what is declared.  Two readings are computed: *nominal*, the
paper's point mass without errors, and *inflated*, with radius, errors, reaction time, attitude lag
and run-on included.  The clauses use the inflated one.  Proofs: THEORY.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

from onboard.contract.agility import AccelerationLimits, reserved_trim_mps2
from onboard.contract.arithmetic import SCALAR
from onboard.contract.clauses import TICK_S, Clause, clauses, recentring_drift
from onboard.contract.derivation import (
    Derived,
    derive,
    face_error_m,
    stop_region,
    worst_encounter,
)
from onboard.contract.emergence import emergence_m
from onboard.contract.mover_avoidance import passing_levels
from onboard.contract.movers import Level, levels
from onboard.contract.recentring import Corridor
from onboard.contract.region import RegionOfInfluence, overhang
from onboard.contract.terms import Terms
from onboard.files.contract_file import Contract, InputSet
from onboard.geometry.box import Box

__all__ = [
    "TICK_S",
    "Assessment",
    "Clause",
    "Derived",
    "Terms",
    "assess",
    "assess_terms",
    "clauses",
    "derive",
    "worst_encounter",
]


@dataclass(frozen=True)
class Assessment:
    """A contract's verdict and everything behind it.

    Attributes:
        contract: what was assessed.
        terms: its numbers in SI units.
        limits: admissible accelerations.
        nominal: the paper's idealisation.
        inflated: with all errors; what the clauses use.
        clauses: every requirement.
    """

    contract: Contract
    terms: Terms[float]
    limits: AccelerationLimits
    nominal: Derived[float]
    inflated: Derived[float]
    clauses: tuple[Clause[float], ...]

    @property
    def compliant(self) -> bool:
        """Whether every clause holds."""
        return all(clause.holds for clause in self.clauses)

    @property
    def binding(self) -> Clause[float]:
        """The clause that takes up the largest part of what is declared for it."""
        return max(self.clauses, key=lambda clause: clause.required / clause.declared)

    @cached_property
    def corridor(self) -> Corridor | None:
        """What has to be free for a drift back to the leg line; None where none is to be flown."""
        if not (self.compliant and self.terms.recentring_speed_mps > 0.0):
            return None
        drift = recentring_drift(self.terms, self.inflated, SCALAR)
        return Corridor.of(drift, self.terms.sure_view_rad)

    @cached_property
    def face_error_m(self) -> float:
        """Error of a face as the contract allows for it, heading included, in metres."""
        return face_error_m(self.terms, SCALAR)

    @cached_property
    def emergence_m(self) -> float:
        """How much more room is kept beside obstacles, which movers may hide behind."""
        return emergence_m(self.terms, self.inflated, SCALAR)

    @cached_property
    def mover_levels(self) -> tuple[Level, ...]:
        """What is promised against each declared class of movers."""
        return levels(self.terms, self.inflated, TICK_S)

    @cached_property
    def passing_levels(self) -> tuple[str, ...]:
        """Whether each declared class of movers is passed in flight, as an operator reads it."""
        return passing_levels(self.terms, self.inflated)

    @property
    def reserved_trim_mps2(self) -> float:
        """Acceleration that the limits leave for the wind (theory J)."""
        return reserved_trim_mps2(self.terms, SCALAR)

    @property
    def fastest_mps(self) -> float:
        """How fast the vehicle may be over ground: at cruise, and swerving (theory A, D)."""
        swerve, swerving_s = (
            self.inflated.manoeuvre_encounter,
            self.inflated.manoeuvre.avoidance_time_s,
        )
        left_mps2, right_mps2 = swerve.left_mps2, swerve.right_mps2
        aside_mps = max(
            overhang(one_mps2, other_mps2, swerving_s, swerve, SCALAR)[1]
            for one_mps2, other_mps2 in ((left_mps2, right_mps2), (right_mps2, left_mps2))
        )
        return math.hypot(swerve.speed_mps, aside_mps)

    def at_altitude(self, mission_altitude_m: float) -> Assessment:
        """Return the same contract for a mission at another height."""
        terms = replace(self.terms, mission_altitude_m=mission_altitude_m)
        return assess_terms(self.contract, terms)

    def region_around(self, obstacle: Box, position_error_m: float) -> RegionOfInfluence:
        """Region of Influence of a measured obstacle, inflated as a plan needs it (theory B).

        Args:
            obstacle: the measured box, leg frame.
            position_error_m: of each face; at least the contract's is used.
        """
        inflated = obstacle.inflated(self.inflation_m(position_error_m) + self.emergence_m)
        encounter = worst_encounter(self.terms, *inflated.size_m, SCALAR)
        stop = stop_region(self.terms, *inflated.size_m, SCALAR) if self.terms.stops else None
        return RegionOfInfluence.around(inflated, encounter, stop)

    def inflation_m(self, position_error_m: float = 0.0) -> float:
        """Return how far the faces of a measured box move out for a plan, r + E + e' (theory B).

        Args:
            position_error_m: of each face; at least the contract's is used.
        """
        return self.terms.body_m + max(position_error_m, self.face_error_m)


def assess(
    contract: Contract, input_set: InputSet = "inner", *, mission_altitude_m: float | None = None
) -> Assessment:
    """Check a contract's requirements against what it declares.

    Args:
        contract: the contract.
        input_set: ``"inner"`` (sound) or ``"paper"`` (Eq. 7 as printed).
        mission_altitude_m: height of the mission above the local origin; without it there is no
            clause ``ground_clearance``.
    """
    return assess_terms(contract, Terms.of(contract, input_set, mission_altitude_m))


def assess_terms(contract: Contract, terms: Terms[float]) -> Assessment:
    """Check a contract's requirements against other terms than it declares: what is seen in flight.

    Args:
        contract: the contract that the terms come from.
        terms: its numbers, some of them replaced.
    """
    inflated = derive(terms, SCALAR)
    x_mps2 = inflated.manoeuvre_encounter.brake_mps2
    y_mps2 = inflated.manoeuvre_encounter.left_mps2
    return Assessment(
        contract=contract,
        terms=terms,
        limits=AccelerationLimits(x_mps2, x_mps2, y_mps2, y_mps2),
        nominal=derive(terms.idealised(), SCALAR),
        inflated=inflated,
        clauses=clauses(terms, inflated, SCALAR),
    )
