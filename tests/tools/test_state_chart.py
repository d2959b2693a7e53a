"""The page of the state chart is what the table gives."""

import re
from pathlib import Path

import pytest

from onboard.guidance.phases import TRANSITIONS, FlightState, Trigger
from tests.tools import state_chart
from tests.tools.state_chart import PAGE, diagram, main, page

EDGE = re.compile(r"^    (\w+) --> (\w+): (.+)$", re.MULTILINE)
ROW = re.compile(r"^\| `(\w+)` \| ([\w -]+) \| `(\w+)` \| .+ \|$", re.MULTILINE)


def test_the_page_is_what_the_table_gives() -> None:
    written = PAGE.read_text(encoding="utf-8")
    assert written == page(), "run python -m tests.tools.state_chart"


def test_the_page_has_every_transition() -> None:
    rows = {(FlightState(s), Trigger(t)): FlightState(n) for s, t, n in ROW.findall(page())}
    assert rows == dict(TRANSITIONS)


def test_the_diagram_draws_what_changes_the_state_and_notes_the_rest() -> None:
    text = diagram(TRANSITIONS)
    drawn = {
        (FlightState(source), Trigger(trigger)): FlightState(target)
        for source, target, triggers in EDGE.findall(text)
        for trigger in triggers.split(" / ")
    }
    left_out = dict(TRANSITIONS.items() - drawn.items())
    assert drawn.items() <= TRANSITIONS.items()
    assert {trigger for (state, trigger), target in left_out.items() if state is not target} == {
        Trigger.CONTROL_TAKEN,
        Trigger.ASSUMPTION_FAILED,
    }
    assert "control taken: from every state\n" in text
    assert "assumption failed: from every state but standby, arrived\n" in text


@pytest.mark.parametrize("state", FlightState)
def test_every_state_is_coloured_by_its_phase(state: FlightState) -> None:
    assert re.search(rf"^    class .*\b{state}\b.* {state.phase}_phase$", diagram({}), re.MULTILINE)


def test_a_changed_table_gives_another_page() -> None:
    changed = {**TRANSITIONS, (FlightState.ARRIVED, Trigger.NO_WAY): FlightState.HOLDING}
    assert page(changed) != page()
    assert "    arrived --> holding: no way\n" in diagram(changed)


def test_the_tool_writes_the_page(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    written = tmp_path / "state_chart.md"
    monkeypatch.setattr(state_chart, "PAGE", written)
    main()
    assert written.read_text(encoding="utf-8") == page()
