"""A solver that proves statements about real numbers, or finds counterexamples."""

from __future__ import annotations

from typing import Any

import z3

from onboard.contract.arithmetic import Arithmetic

# Ample: each takes a fraction of a second.  A solver that gives up fails the test.
TIMEOUT_MS = 60_000


def solution(*constraints: Any) -> z3.ModelRef | None:
    """Return values that satisfy all constraints, or None if there provably are none."""
    solver = z3.SolverFor("QF_NRA")
    solver.set("timeout", TIMEOUT_MS)
    solver.add(*constraints)
    verdict = solver.check()
    assert verdict != z3.unknown, solver.reason_unknown()
    return solver.model() if verdict == z3.sat else None


def assert_theorem(claim: Any, *assumptions: Any) -> None:
    """The claim follows from the assumptions, and these do not contradict each other."""
    assert solution(*assumptions) is not None, "nothing satisfies the assumptions"
    counterexample = solution(*assumptions, z3.Not(claim))
    assert counterexample is None, counterexample


def assert_refuted(claim: Any, *assumptions: Any) -> None:
    """There are values that satisfy the assumptions but not the claim."""
    assert solution(*assumptions, z3.Not(claim)) is not None


class Symbols:
    """Arithmetic on z3's reals; of a square root it is known what it squares to."""

    def __init__(self) -> None:
        self.known: list[Any] = []
        self.arithmetic: Arithmetic[Any] = Arithmetic(
            sqrt=self._sqrt,
            exp=self._unknown,
            sin=self._unknown,
            tan=self._unknown,
            atan2=self._unknown,
            minimum=lambda first, second: z3.If(first <= second, first, second),
            maximum=lambda first, second: z3.If(first >= second, first, second),
            where=z3.If,
            anywhere=self._unknown,
        )

    def _sqrt(self, square: Any) -> Any:
        root = z3.FreshReal("root")
        self.known += [root >= 0, root * root == square]
        return root

    def _unknown(self, *_: Any) -> Any:
        raise AssertionError("no statement about this function")
