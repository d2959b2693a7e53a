"""``clearway contract show``: the clauses of a contract, their margins and derived quantities."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from rich.console import Console
from rich.table import Table

from gcs_tools.console.output import Format, write_document
from gcs_tools.contract.document import contract_document, derived_document
from onboard.contract.assessment import Assessment, Clause, assess
from onboard.files.contract_file import InputSet, load_contract

_QUANTITIES = {
    "collision_set_depth_m": "collision set depth D (m)",
    "csb_shape": "collision set boundary",
    "lane_overhang_m.left": "lane overhang, left (m)",
    "lane_overhang_m.right": "lane overhang, right (m)",
    "pob_depth_m": "front face to post-obstacle border (m)",
    "roi_length_m": "region of influence, length (m)",
    "roi_width_m": "region of influence, width (m)",
    "required_detection_range_m": "detection range required (m)",
    "required_separation_m": "separation required, any direction (m)",
    "required_separation_box_m.0": "separation required, along the leg (m)",
    "required_separation_box_m.1": "or across it (m)",
    "stopping_distance_m": "stopping distance (m)",
}


def show_contract(
    path: Path,
    *,
    overrides: tuple[str, ...],
    input_set: InputSet,
    form: Format,
    output: Path | None,
) -> None:
    """Write what a contract requires, whether it complies or not.

    Raises:
        FileError: the contract or an override cannot be used.
        CommandError: the output cannot be written.
    """
    assessment = assess(load_contract(path, overrides), input_set)
    write_document(
        contract_document(assessment),
        partial(print_contract, assessment, str(path)),
        form=form,
        path=output,
    )


def print_contract(assessment: Assessment, title: str, console: Console) -> None:
    """Print verdict, clauses with margins, and derived quantities."""
    print_verdict(assessment, title, console)
    console.print(clause_table(assessment.clauses, binding=assessment.binding.name))
    console.print(_quantity_table(assessment))
    print_movers(assessment, console)
    limits = assessment.limits
    console.print(
        f"accelerations ({assessment.terms.input_set} set): brake {limits.brake_mps2:.3f}, "
        f"forward {limits.forward_mps2:.3f}, left {limits.left_mps2:.3f}, "
        f"right {limits.right_mps2:.3f} m/s²"
    )
    console.print(f"contract {assessment.contract.sha256}", style="dim")


def print_movers(assessment: Assessment, console: Console) -> None:
    """Print what is promised against each declared class of movers; nothing if none is."""
    if not assessment.mover_levels:
        return
    required = assessment.terms.movers_level
    title = f"movers (required: {required}, speeds as declared):"
    if required == "none":
        title = (
            "movers: nothing is enforced against them, since requirements.movers = none; "
            "requiring passive would make them, at the speeds declared:"
        )
    console.print(title)
    for level in assessment.mover_levels:
        console.print(f"  {level}", style="" if level.level else "red")
    if required == "none" or not assessment.passing_levels:
        return  # none is waited for either
    console.print("movers in the way (passive safety does not include passing them):")
    for sentence in assessment.passing_levels:
        console.print(f"  {sentence}")


def print_verdict(assessment: Assessment, title: str, console: Console) -> None:
    """Print whether the contract complies, and the clause that decides."""
    clause = assessment.binding
    if assessment.compliant:
        verdict, say = "[bold green]COMPLIANT[/]", "tightest"
    else:
        verdict, say = "[bold red]NOT COMPLIANT[/]", "most violated"
    console.print(
        f"{verdict}  {title}\n{say}: {clause.name}, margin {clause.margin:+.2f} {clause.unit} "
        f"({clause.reason})"
    )


def clause_table(clauses: tuple[Clause[float], ...], *, binding: str) -> Table:
    """Return clauses as a table, the binding one marked."""
    table = Table("clause", "", title="Clauses", title_justify="left")
    for column in ("required", "declared", "margin", "unit"):
        table.add_column(column, justify="left" if column == "unit" else "right")
    for clause in clauses:
        mark = "[green]holds[/]" if clause.holds else "[red]BROKEN[/]"
        name = f"[bold]{clause.name}[/] ←" if clause.name == binding else clause.name
        numbers = (f"{clause.required:.3f}", f"{clause.declared:.3f}", f"{clause.margin:+.3f}")
        table.add_row(name, mark, *numbers, clause.unit)
    return table


def _quantity_table(assessment: Assessment) -> Table:
    table = Table("for the largest obstacle", title="Derived", title_justify="left")
    table.add_column("nominal (point mass)", justify="right")
    table.add_column("inflated (all errors)", justify="right")
    readings = [derived_document(each) for each in (assessment.nominal, assessment.inflated)]
    for key, label in _QUANTITIES.items():
        table.add_row(label, *(_number(reading, key) for reading in readings))
    return table


def _number(reading: dict[str, object], key: str) -> str:
    outer, _, inner = key.partition(".")
    value = reading[outer]
    if isinstance(value, dict):
        value = value[inner]
    elif isinstance(value, list):
        value = value[int(inner)]
    return f"{value:.3f}" if isinstance(value, float) else str(value)
