"""docs/responses.md says of every assumption what ends the response to it, as the code has it."""

import re
from pathlib import Path

from onboard.guidance.adaptation_ladder import DELAYS, NOTICES
from onboard.monitoring.adaptation import PROGRESS_ASSUMPTIONS, WORSENINGS
from onboard.monitoring.assumptions import Assumption

PAGE = Path(__file__).parents[3] / "docs" / "responses.md"
ROW = re.compile(r"^\| `(\w+)` \| ([^|]+) \| ([^|]+) \| ([^|]+) \| ([^|]+) \|$", re.MULTILINE)
ADAPTED = {assumption for assumption, _ in WORSENINGS}
# Found by guidance itself, which leaves the leg to THREAD then.
THREADED = {Assumption.PLAN_EXISTS, Assumption.LEG_END_CLEAR, Assumption.TARGET_REACHED}
# Only reported: the step is planned from where the vehicle is.
REPORTED = {Assumption.LATE_FIRST_SIGHT}


def on_a_held_way(assumption: Assumption) -> str:
    """Return the response where passing is guaranteed and a way to rest is held."""
    if assumption in THREADED:
        return "threads"
    if assumption not in PROGRESS_ASSUMPTIONS:
        return "the pilot"
    if assumption in NOTICES | REPORTED:
        return "by itself"
    last = "by itself" if assumption in DELAYS else "threads"
    return f"adapts, else {last}" if assumption in ADAPTED else last


def test_the_page_states_every_assumption_as_the_code_has_it() -> None:
    rows = {name: tuple(cells) for name, _, *cells in ROW.findall(PAGE.read_text("utf-8"))}
    expected = {}
    for assumption in Assumption:
        best_effort = "by itself" if assumption in PROGRESS_ASSUMPTIONS else "the pilot"
        pure = "adapts, else the pilot" if assumption in ADAPTED else "the pilot"
        expected[assumption.value] = (on_a_held_way(assumption), best_effort, pure)
    # Only what looks around gives up looking.
    expected["no_passage"] = ("the pilot", "the pilot", "does not occur")
    assert rows == expected
