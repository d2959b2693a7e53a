"""``clearway preflight``: contract, field and vehicle -> may this be flown?"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from gcs_tools.contract_document import contract_document
from gcs_tools.contract_show import clause_table, print_verdict
from gcs_tools.field_check import FieldRule, check_field
from gcs_tools.output import Format, write_document
from onboard.agility import InputSet
from onboard.config import Contract, Mission, load_contract
from onboard.contract import Assessment, assess
from onboard.yaml_file import load_yaml
from sitl.field import ObstacleField, load_field

_OFFENDERS_SHOWN = 5


@dataclass(frozen=True)
class Preflight:
    """What was checked before a flight, and how it came out.

    Attributes:
        assessment: the contract's clauses.
        field_rules: the obstacle field's, where one was given.
        vehicle: one line about the vehicle, where one was asked for.
    """

    assessment: Assessment
    field_rules: tuple[FieldRule, ...] = ()
    vehicle: str | None = None

    @property
    def compliant(self) -> bool:
        """Whether the flight is covered by the contract."""
        return self.assessment.compliant and all(rule.holds for rule in self.field_rules)

    @property
    def refusals(self) -> tuple[str, ...]:
        """Why it is not; empty if it is."""
        clauses = tuple(
            f"{c.name}: requires {c.required:.2f} {c.unit}, declared {c.declared:.2f} {c.unit}"
            for c in self.assessment.clauses
            if not c.holds
        )
        return clauses + tuple(
            f"{rule.name}: {rule.reason} ({_some(rule.offenders)})"
            for rule in self.field_rules
            if not rule.holds
        )

    def document(self) -> dict[str, Any]:
        """Return the result as JSON values."""
        return {
            "compliant": self.compliant,
            "refusals": list(self.refusals),
            "contract": contract_document(self.assessment),
            "field": [_rule_document(rule) for rule in self.field_rules],
            "vehicle": self.vehicle,
        }


def check(
    contract: Contract,
    obstacles: ObstacleField | None,
    mission: Mission | None,
    input_set: InputSet = "inner",
) -> Preflight:
    """Check what can be checked on paper."""
    assessment = assess(contract, input_set)
    rules = () if obstacles is None else check_field(assessment, obstacles, mission)
    return Preflight(assessment, rules)


def run_preflight(
    contract_path: Path,
    *,
    overrides: tuple[str, ...],
    field_path: Path | None,
    mission_path: Path | None,
    vehicle_url: str | None,
    input_set: InputSet,
    form: Format,
    output: Path | None,
) -> bool:
    """Check, write the result, and return whether the flight is covered.

    Raises:
        FileError: a file is not usable.
        CommandError: there is no vehicle, or the output cannot be written.
    """
    contract = load_contract(contract_path, overrides)
    obstacles = None if field_path is None else load_field(field_path)
    mission = None if mission_path is None else load_yaml(mission_path, Mission)
    result = check(contract, obstacles, mission, input_set)
    if vehicle_url is not None:
        result = Preflight(result.assessment, result.field_rules, _look_at_vehicle(vehicle_url))
    table = partial(print_preflight, result, str(contract_path))
    write_document(result.document(), table, form=form, path=output)
    return result.compliant


def _look_at_vehicle(url: str) -> str:
    # MAVSDK is a large native library: load it for those who have a vehicle.
    from gcs_tools.vehicle import describe_vehicle  # noqa: PLC0415

    return asyncio.run(describe_vehicle(url))


def print_preflight(result: Preflight, title: str, console: Console) -> None:
    """Draw the operator's view: verdict, then every rule."""
    mark = "[bold green]MAY FLY[/]" if result.compliant else "[bold red]DO NOT FLY[/]"
    console.print(mark)
    for refusal in result.refusals:
        console.print(f"  • {refusal}", style="red", markup=False, soft_wrap=True)
    assessment = result.assessment
    print_verdict(assessment, title, console)
    console.print(clause_table(assessment.clauses, binding=assessment.binding.name))
    if result.field_rules:
        console.print(_rule_table(result.field_rules))
    if result.vehicle is not None:
        console.print(result.vehicle)


def _rule_table(rules: tuple[FieldRule, ...]) -> Table:
    table = Table("rule", "", title="Obstacle field", title_justify="left")
    for column in ("required", "declared", "unit", "offenders"):
        table.add_column(column, justify="right" if column.endswith("ed") else "left")
    for rule in rules:
        mark = "[green]holds[/]" if rule.holds else "[red]BROKEN[/]"
        numbers = f"{rule.required:.3g}", f"{rule.declared:.3g}"
        table.add_row(rule.name, mark, *numbers, rule.unit, escape(_some(rule.offenders)))
    return table


def _rule_document(rule: FieldRule) -> dict[str, Any]:
    return {
        "name": rule.name,
        "required": rule.required,
        "declared": _finite(rule.declared),
        "margin": _finite(rule.margin),
        "unit": rule.unit,
        "holds": rule.holds,
        "reason": rule.reason,
        "offenders": list(rule.offenders),
    }


def _finite(value: float) -> float | None:
    """JSON knows no infinity: a single obstacle has no nearest neighbour."""
    return value if abs(value) < float("inf") else None


def _some(offenders: tuple[str, ...]) -> str:
    shown = "; ".join(offenders[:_OFFENDERS_SHOWN])
    return shown if len(offenders) <= _OFFENDERS_SHOWN else f"{shown}; …"
