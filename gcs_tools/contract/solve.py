"""``clearway contract solve``: which values of one key comply, all else as stated.

The complying values need not be one half-line.  The search samples the admissible range on a
logarithmic grid, looks for islands and gaps at extrema between samples, and bisects every change of
verdict, always with the function that the pre-flight check uses.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
from rich.console import Console

from gcs_tools.console.output import Format, write_document
from gcs_tools.console.progress import tracked
from gcs_tools.contract.keys import ContractKey, contract_key
from onboard.contract.assessment import Clause, assess
from onboard.files.contract_file import Contract, InputSet, load_contract
from onboard.files.yaml_file import FileError

Answer = Literal["largest", "smallest", "between", "several", "always", "never"]

# Keys without an upper bound are tried up to this value, in their own unit.
LARGEST_TRIED = 1e6
_SMALLEST_TRIED = 1e-6
_SAMPLES_PER_DECADE = 80

# Relative width to which limits are bisected; the reported value is on the complying side.
_RELATIVE_WIDTH = 1e-13
_SEARCH_STEPS = 80


@dataclass(frozen=True)
class Trial:
    """The verdict on one value.

    Attributes:
        value: in the key's unit.
        score: least margin of all clauses as a share of declared; above 0 complies, minus infinity
            is not admissible.
        clause: the clause with that margin; None if the value is not admissible.
        reason: the purpose of that clause, or the rule that the value breaks.
    """

    value: float
    score: float
    clause: str | None
    reason: str

    @property
    def complies(self) -> bool:
        """Whether every clause holds."""
        return self.score > 0.0


@dataclass(frozen=True)
class Limit:
    """An end of an interval of complying values.

    Attributes:
        value: the last value that complies.
        beyond: the verdict just beyond it.
    """

    value: float
    beyond: Trial


@dataclass(frozen=True)
class Interval:
    """Complying values; None for an end that only the admissible or tried range sets."""

    lower: Limit | None
    upper: Limit | None


@dataclass(frozen=True)
class Solution:
    """Which values of a key comply.

    Attributes:
        key: whose values were searched.
        declared: value that the contract states.
        intervals: of complying values, ascending.
        closest: the value closest to complying, if none complies.
        notes: restrictions of the answer.
    """

    key: ContractKey
    declared: float | None
    intervals: tuple[Interval, ...]
    closest: Trial | None
    notes: tuple[str, ...]

    @property
    def answer(self) -> Answer:
        """Return the kind of solution, in a word."""
        match self.intervals:
            case []:
                return "never"
            case [Interval(lower=None, upper=None)]:
                return "always"
            case [Interval(lower=None)]:
                return "largest"
            case [Interval(upper=None)]:
                return "smallest"
            case [_]:
                return "between"
            case _:
                return "several"

    @property
    def limit(self) -> Limit | None:
        """The one limit, where there is exactly one."""
        limits = [end for each in self.intervals for end in (each.lower, each.upper) if end]
        return limits[0] if len(limits) == 1 else None


def solve(contract: Contract, path: str, input_set: InputSet = "inner") -> Solution:
    """Find the values of one key with which a contract complies, all else as stated.

    Raises:
        CommandError: the key is unknown or not numeric.
    """
    key = contract_key(path)
    declared = key.value_in(contract)
    tried = partial(_try, contract, key, input_set)
    samples = _samples(key, declared)
    each = tracked(samples, len(samples), f"trying values of {key.path}")
    trials = _refined([tried(value) for value in each], tried)
    intervals = tuple(_intervals(trials, tried))
    closest = None if intervals else max(trials, key=lambda trial: trial.score)
    return Solution(key, declared, intervals, closest, tuple(_notes(contract, key)))


def _try(contract: Contract, key: ContractKey, input_set: InputSet, value: float) -> Trial:
    try:
        assessment = assess(key.changed(contract, value), input_set)
    except FileError as error:
        rule = str(error).rpartition(": ")[2]  # after file, key and value
        return Trial(value, -math.inf, None, rule)
    clause: Clause[float] = assessment.binding
    # `binding` ranks clauses by this quotient, so its sign is the verdict.
    return Trial(value, clause.margin / clause.declared, clause.name, clause.reason)


def _samples(key: ContractKey, declared: float | None) -> list[float]:
    """Return values across the admissible range, denser towards its bounds."""
    decades = math.log10(LARGEST_TRIED / _SMALLEST_TRIED)
    steps = np.logspace(
        math.log10(_SMALLEST_TRIED),
        math.log10(LARGEST_TRIED),
        round(decades * _SAMPLES_PER_DECADE) + 1,
    )
    values = {float(key.lower + step) for step in steps if key.lower + step < key.upper}
    if math.isfinite(key.upper):
        values |= {float(key.upper - step) for step in steps if key.upper - step > key.lower}
    values |= {key.lower} if key.lower_admitted else set()
    values |= {key.upper} if key.upper_admitted else set()
    values |= {declared} if declared is not None else set()
    return sorted(values)


def _refined(trials: list[Trial], tried: Callable[[float], Trial]) -> list[Trial]:
    """Add complying islands and non-complying gaps that lie between samples."""
    found: list[Trial] = []
    for left, middle, right in zip(trials, trials[1:], trials[2:], strict=False):
        if left.complies == middle.complies == right.complies:
            sign = -1.0 if middle.complies else 1.0
            if sign * left.score < sign * middle.score >= sign * right.score:
                extreme = _extreme(left.value, right.value, tried, sign)
                if extreme.complies != middle.complies:
                    found.append(extreme)
    return sorted(trials + found, key=lambda trial: trial.value)


def _extreme(low: float, high: float, tried: Callable[[float], Trial], sign: float) -> Trial:
    """Find the highest (sign 1) or lowest (sign -1) score between two values by ternary search."""
    for _ in range(_SEARCH_STEPS):
        third = (high - low) / 3.0
        nearer, farther = tried(low + third), tried(high - third)
        if sign * nearer.score < sign * farther.score:
            low = nearer.value
        else:
            high = farther.value
    return tried((low + high) / 2.0)


def _intervals(trials: list[Trial], tried: Callable[[float], Trial]) -> Iterator[Interval]:
    """Yield the intervals of complying values."""
    lower: Limit | None = None
    for before, after in pairwise(trials):
        if not before.complies and after.complies:
            lower = _bisected(after, before, tried)
        elif before.complies and not after.complies:
            yield Interval(lower, _bisected(before, after, tried))
            lower = None
    if trials[-1].complies:
        yield Interval(lower, None)


def _bisected(inside: Trial, outside: Trial, tried: Callable[[float], Trial]) -> Limit:
    while abs(outside.value - inside.value) > _RELATIVE_WIDTH * abs(inside.value):
        middle = tried((inside.value + outside.value) / 2.0)
        if middle.value in {inside.value, outside.value}:
            break
        if middle.complies:
            inside = middle
        else:
            outside = middle
    return Limit(inside.value, outside)


def _notes(contract: Contract, key: ContractKey) -> Iterator[str]:
    counted_on = contract.requirements.passive_safety
    measured = counted_on and contract.vehicle.setpoint_loss_run_on_m is not None
    if measured and key.term in {"cruise_speed_mps", "velocity_error_x_mps"}:
        yield (
            "vehicle.setpoint_loss_run_on_m was measured at "
            f"{contract.vehicle.setpoint_loss_run_on_speed_mps:g} m/s: it is scaled below that "
            "speed and unknown above it, where no value is admissible"
        )


def solve_contract(
    path: Path,
    *,
    key: str,
    overrides: tuple[str, ...],
    input_set: InputSet,
    form: Format,
    output: Path | None,
) -> None:
    """Write which values of one key comply.

    Raises:
        FileError: the contract or an override cannot be used.
        CommandError: the key is unknown or not numeric, or the output cannot be written.
    """
    contract = load_contract(path, overrides)
    solution = solve(contract, key, input_set)
    document = {"contract_sha256": contract.sha256, "input_set": input_set}
    write_document(
        document | solution_document(solution),
        partial(print_solution, solution),
        form=form,
        path=output,
    )


def solution_document(solution: Solution) -> dict[str, Any]:
    """Return the solution, values in the key's unit; the keys are a published interface."""
    limit = solution.limit
    return {
        "key": solution.key.path,
        "unit": solution.key.unit,
        "declared": solution.declared,
        "answer": solution.answer,
        "value": limit.value if limit else None,
        "binding": limit.beyond.clause if limit else None,
        "intervals": [
            {"lower": _limit_document(each.lower), "upper": _limit_document(each.upper)}
            for each in solution.intervals
        ],
        "closest": None if solution.closest is None else vars(solution.closest),
        "notes": list(solution.notes),
    }


def _limit_document(limit: Limit | None) -> dict[str, Any] | None:
    if limit is None:
        return None
    return {"value": limit.value, "binding": limit.beyond.clause, "reason": limit.beyond.reason}


def print_solution(solution: Solution, console: Console) -> None:
    """Print which values comply, and the clause that the others violate."""
    key, unit = solution.key, solution.key.unit
    declared = "nothing" if solution.declared is None else f"{solution.declared:g} {unit}"
    console.print(f"[bold]{key.path}[/] (the contract states {declared})")
    if solution.closest is not None:
        closest = solution.closest
        console.print(
            f"[red]no value complies[/]; closest is {closest.value:.6g} {unit}, where "
            f"{closest.clause} lacks {-100.0 * closest.score:.3g} % ({closest.reason})"
        )
    for interval in solution.intervals:
        console.print(f"[green]complies[/] {_described(interval, unit)}")
        for end, word in ((interval.lower, "below"), (interval.upper, "above")):
            if end is not None:
                console.print(
                    f"  {word}: {end.beyond.clause or 'not admissible'} ({end.beyond.reason})"
                )
    for note in solution.notes:
        console.print(f"note: {note}")


def _described(interval: Interval, unit: str) -> str:
    if interval.lower is None and interval.upper is None:
        return f"with every admissible value (tried up to {LARGEST_TRIED:g} {unit})"
    ends = ((interval.lower, "from"), (interval.upper, "up to"))
    return " ".join(f"{word} {end.value:.10g} {unit}" for end, word in ends if end is not None)
