"""Prints the pre-flight check for the operator: the verdict, its reasons, then every margin."""

from __future__ import annotations

from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from gcs_tools.preflight.field_check import FieldRule
from gcs_tools.preflight.finding import Finding, Verdict
from gcs_tools.preflight.remedy import Remedy
from onboard.contract.assessment import Assessment, Clause

_OFFENDERS_SHOWN = 5
_REMEDIES_SHOWN = 3
# A bar is full where required equals declared; cells beyond that show what is lacking.
_BAR_FULL, _BAR_MAX = 16, 22

_TITLES = {
    Verdict.HOLDS: "[bold green]MAY FLY[/]",
    Verdict.BROKEN: "[bold red]DO NOT FLY[/]",
    Verdict.UNKNOWN: "[bold yellow]COULD NOT BE CHECKED[/]",
}
_MARKS = {
    Verdict.HOLDS: "[green]holds[/]",
    Verdict.BROKEN: "[red]BROKEN[/]",
    Verdict.UNKNOWN: "[yellow]UNKNOWN[/]",
}


def print_title(verdict: Verdict, title: str, reasons: tuple[str, ...], console: Console) -> None:
    """Print whether the flight may take place, and the reasons if not."""
    console.print(f"{_TITLES[verdict]}  {escape(title)}")
    for reason in reasons:
        console.print(f"  • {reason}", style="red", markup=False, soft_wrap=True)


def print_contract(assessment: Assessment, remedies: tuple[Remedy, ...], console: Console) -> None:
    """Print the binding clause, all margins as bars, and changes that satisfy broken clauses."""
    clause = assessment.binding
    say = "tightest" if assessment.compliant else "most violated"
    console.print(
        f"{say}: [bold]{clause.name}[/], margin {clause.margin:+.2f} {clause.unit} "
        f"({clause.reason})"
    )
    table = Table("clause", "", "share of declared", title="Contract", title_justify="left")
    for column in ("required", "declared", "margin"):
        table.add_column(column, justify="right")
    table.add_column("unit")
    for each in assessment.clauses:
        name = f"[bold]{each.name}[/] ←" if each is clause else each.name
        numbers = f"{each.required:.2f}", f"{each.declared:.2f}", f"{each.margin:+.2f}"
        mark = _MARKS[Verdict.of(holds=bool(each.holds))]
        table.add_row(name, mark, _bar(each), *numbers, each.unit)
    console.print(table)
    for each in assessment.clauses:
        if not each.holds:
            console.print(f"  to satisfy {each.name}: {advice(each.name, remedies)}", markup=False)


def advice(clause: str, remedies: tuple[Remedy, ...]) -> str:
    """Return the smallest changes that satisfy a clause, in words."""
    satisfying = [str(remedy) for remedy in remedies if remedy.clause == clause]
    return ", or ".join(satisfying[:_REMEDIES_SHOWN]) or "no single key satisfies it"


def _bar(clause: Clause[float]) -> Text:
    """Draw required as a share of declared, up to the mark at 100 % and beyond it."""
    share = clause.required / clause.declared
    cells = min(round(share * _BAR_FULL), _BAR_MAX)
    if not clause.holds:
        cells = max(cells, _BAR_FULL + 1)
    within = min(cells, _BAR_FULL)
    colour = "green" if clause.holds else "red"
    bar = Text("█" * within + "·" * (_BAR_FULL - within), colour)
    bar.append("|" + "█" * (cells - within), colour)
    return bar.append(f" {100.0 * share:.0f} %")


def print_field(
    rules: tuple[FieldRule, ...],
    fastest_mps: float | None,
    cruise_mps: float,
    console: Console,
) -> None:
    """Print every rule of the field, and the fastest cruise that complies."""
    table = Table("rule", "", title="Obstacle field", title_justify="left")
    for column in ("required", "declared", "unit", "offenders"):
        table.add_column(column, justify="right" if column.endswith("ed") else "left")
    for rule in rules:
        numbers = f"{rule.required:.3g}", f"{rule.declared:.3g}"
        offenders = escape(some(rule.offenders))
        mark = _MARKS[Verdict.of(holds=rule.holds)]
        table.add_row(rule.name, mark, *numbers, rule.unit, offenders)
    console.print(table)
    for rule in rules:
        if rule.note:
            console.print(f"{rule.name}: {rule.note}", markup=False, soft_wrap=True)
    if fastest_mps is None:
        console.print("no cruise speed makes this field compliant")
    else:
        console.print(
            f"fastest compliant cruise here: {fastest_mps:.2f} m/s (declared {cruise_mps:g} m/s)"
        )


def print_findings(findings: tuple[Finding, ...], console: Console) -> None:
    """Print the findings of the live check."""
    table = Table("of", "check", "", "found", title="Live", title_justify="left")
    for each in findings:
        table.add_row(each.subject, each.name, _MARKS[each.verdict], escape(each.text))
    console.print(table)


def some(offenders: tuple[str, ...]) -> str:
    """Return the first few offenders, as one text."""
    shown = "; ".join(offenders[:_OFFENDERS_SHOWN])
    return shown if len(offenders) <= _OFFENDERS_SHOWN else f"{shown}; …"
