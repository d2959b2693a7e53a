"""docs/responses.md says of every assumption what ends the response to it, as the code has it."""

import re
from pathlib import Path

from onboard.guidance.adaptation_ladder import DELAYS, NOTICES
from onboard.monitoring.adaptation import PROGRESS_ASSUMPTIONS, WORSENINGS
from onboard.monitoring.assumptions import Assumption
from onboard.monitoring.resumption import RESUMABLE

PAGE = Path(__file__).parents[3] / "docs" / "responses.md"
ROW = re.compile(r"^\| `(\w+)` \| ([^|]+) \| ([^|]+) \| ([^|]+) \| ([^|]+) \|$", re.MULTILINE)
ADAPTED = {assumption for assumption, _ in WORSENINGS}
# Found by guidance itself, which leaves the leg to THREAD then.
THREADED = {Assumption.PLAN_EXISTS, Assumption.LEG_END_CLEAR, Assumption.TARGET_REACHED}
OF_MOVERS = {
    Assumption.MOVER_FIRST_SIGHT,
    Assumption.MOVER_CLASS,
    Assumption.STATIC_CLAIM,
    Assumption.REST_SPEED,
    Assumption.YIELD_TIME,
    Assumption.MOVER_VIEW,
}
# Only reported: the step is planned from where the vehicle is.
REPORTED = {Assumption.LATE_FIRST_SIGHT}


def ended_by_whom(assumption: Assumption) -> str:
    return "`clearway resume`" if assumption in RESUMABLE else "the pilot"


def on_a_held_way(assumption: Assumption) -> str:
    """Return the response where passing is guaranteed and a way to rest is held."""
    if assumption in THREADED:
        return "threads"
    if assumption not in PROGRESS_ASSUMPTIONS:
        return ended_by_whom(assumption)
    if assumption in NOTICES | REPORTED:
        return "by itself"
    last = "by itself" if assumption in DELAYS else "threads"
    return f"adapts, else {last}" if assumption in ADAPTED else last


def test_the_page_states_every_assumption_as_the_code_has_it() -> None:
    rows = {name: tuple(cells) for name, _, *cells in ROW.findall(PAGE.read_text("utf-8"))}
    expected = {}
    for assumption in Assumption:
        ended_by = ended_by_whom(assumption)
        best_effort = "by itself" if assumption in PROGRESS_ASSUMPTIONS else ended_by
        pure = f"adapts, else {ended_by}" if assumption in ADAPTED else ended_by
        expected[assumption.value] = (on_a_held_way(assumption), best_effort, pure)
    # Only what looks around gives up looking, and only there one late tick is not the last; what
    # is safe against movers holds a way to rest.
    for only_there in (Assumption.NO_PASSAGE, Assumption.LATE_TICKS, *OF_MOVERS):
        expected[only_there.value] = (*expected[only_there.value][:2], "does not occur")
    assert rows == expected
