"""``clearway fleet check``: are the corridors of all vehicles disjoint?"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any, Final

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from gcs_tools.console.errors import CommandError
from gcs_tools.console.output import Format, write_document
from gcs_tools.cures.checks import RULE_CURES
from gcs_tools.preflight.offline.corridors import Corridors, check_corridors
from gcs_tools.preflight.offline.fleet_files import read_fleet
from onboard.mission_items.fence_items import FenceError

_CLAUSE: Final = "corridors"


def check_fleet(path: Path, *, form: Format, output: Path | None) -> bool:
    """Check a fleet, write the result, tell whether no two vehicles may ever meet.

    Raises:
        FileError: a file cannot be used.
        CommandError: the edges of a geofence cross, or the output cannot be written.
    """
    _, members = read_fleet(path)
    try:
        corridors = check_corridors(members)
    except FenceError as error:
        raise CommandError(f"{path}: {error}") from error
    table = partial(_print, corridors, str(path))
    write_document(_document(corridors), table, form=form, path=output)
    return corridors.hold


def _document(corridors: Corridors) -> dict[str, Any]:
    return {
        "clause": _CLAUSE,
        "holds": corridors.hold,
        "sentences": list(corridors.sentences),
        "pairs": [
            {
                "vehicles": [pair.first, pair.second],
                "required_m": pair.required_m,
                "apart_m": pair.apart_m,
                "disjoint": pair.disjoint,
            }
            for pair in corridors.pairs
        ],
    }


def _print(corridors: Corridors, title: str, console: Console) -> None:
    verdict = "[bold green]CORRIDORS ARE DISJOINT[/]"
    if not corridors.hold:
        verdict = "[bold red]VEHICLES MAY MEET[/]"
    console.print(f"{verdict}  {escape(title)}")
    for sentence in corridors.sentences:
        console.print(f"  • {sentence}", style="red", markup=False, soft_wrap=True)
    if corridors.sentences:
        cure = RULE_CURES[_CLAUSE].cure
        console.print(f"to cure it: {cure}", markup=False, soft_wrap=True)
    if not corridors.pairs:
        return
    table = Table("vehicles", "", title=_CLAUSE, title_justify="left")
    for column in ("required", "apart"):
        table.add_column(f"{column} (m)", justify="right")
    for pair in corridors.pairs:
        mark = "[green]holds[/]" if pair.disjoint else "[red]BROKEN[/]"
        names = escape(f"{pair.first}, {pair.second}")
        table.add_row(names, mark, f"{pair.required_m:.2f}", f"{pair.apart_m:.2f}")
    console.print(table)
