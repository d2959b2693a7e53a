"""docs/responses.md says of every assumption what ends the response to it, as the code has it."""

import re
from pathlib import Path

from onboard.monitoring.adaptation import PROGRESS_ASSUMPTIONS, WORSENINGS
from onboard.monitoring.assumptions import Assumption

PAGE = Path(__file__).parents[3] / "docs" / "responses.md"
ROW = re.compile(r"^\| `(\w+)` \| ([^|]+) \| ([^|]+) \| ([^|]+) \|$", re.MULTILINE)


def test_the_page_states_every_assumption_as_the_code_has_it() -> None:
    rows = {name: (one, other) for name, _, one, other in ROW.findall(PAGE.read_text("utf-8"))}
    adapted = {assumption for assumption, _ in WORSENINGS}
    expected = {}
    for assumption in Assumption:
        guaranteed = "adapts, else the pilot" if assumption in adapted else "the pilot"
        best_effort = "by itself" if assumption in PROGRESS_ASSUMPTIONS else "the pilot"
        expected[assumption.value] = (guaranteed, best_effort)
    # Only what looks around gives up looking.
    expected["no_passage"] = ("does not occur", "the pilot")
    assert rows == expected
