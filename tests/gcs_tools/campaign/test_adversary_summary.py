"""What the terminal says of an adversary's campaign."""

from __future__ import annotations

import io
from dataclasses import replace

from rich.console import Console

from gcs_tools.campaign.adversary_summary import adversary_lines, print_adversary
from tests.gcs_tools.campaign.rows import row

ROWS = [
    row(
        source="adversary", number=3, least_margin_m=0.02, least_margin_of="rest",
        shares='{"tracking": 0.9}',
    ),
    row(
        source="adversary", number=4, least_margin_m=-0.01, least_margin_of="run_on",
        shares='{"tracking": 1.0, "faces": 0.98}', genes="late=0.5000",
    ),
    row(source="adversary", number=5, least_margin_m=0.5, least_margin_of="rest", shares="{}"),
]  # fmt: skip


def test_each_promise_has_its_least_margin_and_replay() -> None:
    least, rest, bound = adversary_lines(ROWS)
    assert least == (
        "least margin of run_on: -0.0100 m: "
        "clearway campaign adversary --seed 1 --only 4 --genes late=0.5000"
    )
    assert rest.startswith("least margin of rest: +0.0200 m: ")
    # A flight of the search is not a draw.
    assert bound == (
        "negative margins: 0 of 2 draws, at most 77.639% at 95%; 1 of 1 flights of the search"
    )
    broken = replace(ROWS[1], genes="")
    assert adversary_lines([ROWS[0], broken])[-1].startswith(
        "negative margins: 1 of 2 draws, 1.258% to 98.742% at 95%; 0 of 0"
    )


def test_shares_are_a_table_and_other_campaigns_have_none() -> None:
    output = io.StringIO()
    console = Console(file=output, width=100)
    print_adversary([row()], console)
    assert output.getvalue() == ""
    print_adversary(ROWS, console)
    assert "95.00%" in output.getvalue()
    assert "90.00%" in output.getvalue()
