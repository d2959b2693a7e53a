"""docs/responses.md says of every assumption what ends the response to it, as the code has it."""

import re
from pathlib import Path

from onboard.monitoring.adaptation import PROGRESS_ASSUMPTIONS, WORSENINGS
from onboard.monitoring.assumptions import Assumption
from onboard.monitoring.resumption import RESUMABLE

PAGE = Path(__file__).parents[3] / "docs" / "responses.md"
ROW = re.compile(r"^\| `(\w+)` \| ([^|]+) \| ([^|]+) \| ([^|]+) \|$", re.MULTILINE)


def test_the_page_states_every_assumption_as_the_code_has_it() -> None:
    rows = {name: (one, other) for name, _, one, other in ROW.findall(PAGE.read_text("utf-8"))}
    adapted = {assumption for assumption, _ in WORSENINGS}
    expected = {}
    for assumption in Assumption:
        ended_by = "`clearway resume`" if assumption in RESUMABLE else "the pilot"
        guaranteed = f"adapts, else {ended_by}" if assumption in adapted else ended_by
        best_effort = "by itself" if assumption in PROGRESS_ASSUMPTIONS else ended_by
        expected[assumption.value] = (guaranteed, best_effort)
    # Only what looks around gives up looking, and only there one late tick is not the last.
    for only_there in (Assumption.NO_PASSAGE, Assumption.LATE_TICKS):
        expected[only_there.value] = ("does not occur", expected[only_there.value][1])
    assert rows == expected
