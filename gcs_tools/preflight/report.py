"""Prints the pre-flight check for the operator: the verdict, its reasons, then every margin."""

from __future__ import annotations

from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from gcs_tools.contract.show import print_movers
from gcs_tools.preflight.finding import NOT_SEEN, VIRTUAL, Finding, Verdict
from gcs_tools.preflight.remedy import Remedy
from gcs_tools.preflight.rule import Rule
from gcs_tools.preflight.tier import Tier
from onboard.contract.assessment import Assessment, Clause

_OFFENDERS_SHOWN = 5
_REMEDIES_SHOWN = 3
# A bar is full where required equals declared; cells beyond that show what is lacking.
_BAR_FULL, _BAR_MAX = 16, 22

_COLOURS = {
    Tier.PROGRESS_GUARANTEED: "green",
    Tier.SAFE: "yellow",
    Tier.DO_NOT_FLY: "red",
    Tier.UNKNOWN: "yellow",
}
_MARKS = {
    Verdict.HOLDS: "[green]holds[/]",
    Verdict.BROKEN: "[red]BROKEN[/]",
    Verdict.UNKNOWN: "[yellow]UNKNOWN[/]",
}
# A clause about progress costs no safety where every flown way ends at rest in seen-free space.
_NOT_KEPT = "[yellow]not kept[/]"


def print_title(tier: Tier, title: str, reasons: tuple[str, ...], console: Console) -> None:
    """Print the verdict, and why it is not the best one."""
    console.print(f"[bold {_COLOURS[tier]}]{tier.value.upper()}[/]  {escape(title)}")
    for reason in reasons:
        console.print(f"  • {reason}", style=_COLOURS[tier], markup=False, soft_wrap=True)


def print_virtual(console: Console) -> None:
    """Print that what the vehicle avoids is not there."""
    console.print(f"[bold yellow]{VIRTUAL}[/]: {NOT_SEEN}", soft_wrap=True)


def print_acceptance(console: Console, *, accepted: bool) -> None:
    """Print what a flight without guaranteed arrival does, and whether that was accepted."""
    console.print(
        "the vehicle flies only where it has seen free space and can come to rest there; it may "
        "pause, look for another way, or give up",
        soft_wrap=True,
    )
    how = "--accept-no-progress accepts that once, requirements.progress: best_effort always"
    console.print("accepted" if accepted else f"not accepted: {how}", markup=False, soft_wrap=True)


def print_no_way_to_rest(console: Console) -> None:
    """Print what a contract without the clause stop lacks."""
    console.print(
        "requirements.stop is false: no way to rest is held in flight, and safety rests on every "
        "clause",
        soft_wrap=True,
    )


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
        table.add_row(name, _mark(each), _bar(each), *numbers, each.unit)
    console.print(table)
    print_movers(assessment, console)
    for each in assessment.clauses:
        if not each.holds:
            aim = "to satisfy" if each.concerns == "safety" else "to guarantee arrival, satisfy"
            console.print(f"  {aim} {each.name}: {advice(each.name, remedies)}", markup=False)


def _mark(checked: Clause[float] | Rule) -> str:
    if not checked.holds and checked.concerns == "progress":
        return _NOT_KEPT
    return _MARKS[Verdict.of(holds=bool(checked.holds))]


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
    rules: tuple[Rule, ...],
    fastest_mps: float | None,
    cruise_mps: float,
    console: Console,
) -> None:
    """Print every rule of the field, and the fastest cruise that complies."""
    print_rules("Obstacle field", rules, console)
    for rule in rules:
        if rule.note:
            console.print(f"{rule.name}: {rule.note}", markup=False, soft_wrap=True)
    if fastest_mps is None:
        console.print("no cruise speed makes this field compliant")
    else:
        console.print(
            f"fastest compliant cruise here: {fastest_mps:.2f} m/s (declared {cruise_mps:g} m/s)"
        )


def print_rehearsal(sentence: str, console: Console) -> None:
    """Print how the mission went on the map."""
    console.print(
        f"rehearsal, a prediction by the known map alone: {sentence}", markup=False, soft_wrap=True
    )


def print_rules(title: str, rules: tuple[Rule, ...], console: Console) -> None:
    """Print rules as a table; nothing without any."""
    if not rules:
        return
    table = Table("rule", "", title=title, title_justify="left")
    for column in ("required", "declared", "unit", "offenders"):
        table.add_column(column, justify="right" if column.endswith("ed") else "left")
    for rule in rules:
        numbers = f"{rule.required:.3g}", f"{rule.declared:.3g}"
        offenders = escape(some(rule.offenders))
        table.add_row(rule.name, _mark(rule), *numbers, rule.unit, offenders)
    console.print(table)


def print_findings(findings: tuple[Finding, ...], console: Console) -> None:
    """Print the findings of the live check."""
    table = Table("of", "check", "", "found", title="Live", title_justify="left")
    for each in findings:
        table.add_row(each.subject, each.name, _MARKS[each.verdict], escape(each.text))
    console.print(table)


def print_settings(findings: tuple[Finding, ...], console: Console) -> None:
    """Print the commands that cure the autopilot's parameters, as its shell and MAVProxy take them.

    Where one parameter cures several findings, its last value stands.
    """
    cured = [each for each in findings if not each.holds and each.settings]
    if not cured:
        return
    console.print("to cure the parameters, in the autopilot's shell or MAVProxy:")
    others = {each.settings[0][0]: each.settings[1:] for each in cured}
    for name, value in dict(each.settings[0] for each in cured).items():
        console.print(f"  param set {name} {value:.7g}", markup=False)
        if others[name]:
            instead = ", or ".join(f"{other} to {number:.7g}" for other, number in others[name])
            console.print(f"    (or instead: set {instead})", markup=False, soft_wrap=True)


def print_levels(assessment: Assessment, console: Console) -> None:
    """Print the level against each class of movers once more, in one line; nothing without any."""
    if assessment.mover_levels:
        none = " (none enforced)" if assessment.terms.movers_level == "none" else ""
        levels = "; ".join(level.brief for level in assessment.mover_levels)
        console.print(f"movers{none}: {levels}", markup=False, soft_wrap=True)


def print_verdict(tier: Tier, title: str, reasons: int, console: Console) -> None:
    """Print the verdict once more, below everything that scrolls past."""
    why = {0: "", 1: ": 1 reason, see above"}.get(reasons, f": {reasons} reasons, see above")
    console.print(f"[bold {_COLOURS[tier]}]{tier.value.upper()}[/]  {escape(title)}{why}")


def named(offenders: tuple[str, ...]) -> str:
    """Return the first few offenders in brackets; nothing if there are none."""
    return f" ({some(offenders)})" if offenders else ""


def some(offenders: tuple[str, ...]) -> str:
    """Return the first few offenders, as one text."""
    shown = "; ".join(offenders[:_OFFENDERS_SHOWN])
    return shown if len(offenders) <= _OFFENDERS_SHOWN else f"{shown}; …"
