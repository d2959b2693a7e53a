"""Writes the state chart of guidance from its table: ``python -m tests.tools.state_chart``.

`docs/state_chart.md` is the output; `tests/tools/test_state_chart.py` fails if it is not.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final

from onboard.guidance.phases import STATES, TRANSITIONS, TRIGGERS, FlightState, Phase, Trigger

PAGE: Final = Path(__file__).parents[2] / "docs" / "state_chart.md"

Table = Mapping[tuple[FlightState, Trigger], FlightState]

_TEMPLATE: Final = """\
# State chart of guidance

Generated from the table in `onboard/guidance/phases.py` by `python -m tests.tools.state_chart`; do
not edit. A pair of state and trigger that is not in the table raises `IllegalTransitionError`: in a
test the test fails; in flight the service reports it as `self_check` and brakes to hover.

```mermaid
{diagram}
```

The diagram leaves out triggers that keep the state. Notes stand for triggers that lead to one state
from most others.

## States

The phase is what the service publishes on Zenoh, in the log and in the report.

{states}

## Triggers

{triggers}

## Transitions

{transitions}
"""


def page(table: Table = TRANSITIONS) -> str:
    """Return the page for a table."""
    return _TEMPLATE.format(
        diagram=diagram(table),
        states=_markdown(
            ("State", "Phase", "What the vehicle does"),
            ((f"`{state}`", f"`{facts.phase}`", facts.meaning) for state, facts in STATES.items()),
        ),
        triggers=_markdown(("Trigger", "Meaning"), TRIGGERS.items()),
        transitions=_markdown(
            ("State", "Trigger", "Next state", "Meaning"),
            (
                (f"`{source}`", trigger, f"`{target}`", TRIGGERS[trigger])
                for (source, trigger), target in table.items()
            ),
        ),
    )


def diagram(table: Table) -> str:
    """Return a table as a Mermaid state diagram."""
    lines = ["stateDiagram-v2", f"    [*] --> {FlightState.STANDBY}"]
    common = _common(table)
    edges: defaultdict[tuple[FlightState, FlightState], list[Trigger]] = defaultdict(list)
    for (source, trigger), target in table.items():
        if source is not target and trigger not in common:
            edges[source, target].append(trigger)
    lines += [
        f"    {source} --> {target}: {' / '.join(triggers)}"
        for (source, target), triggers in edges.items()
    ]
    for trigger, target in common.items():
        missing = [state for state in FlightState if (state, trigger) not in table]
        but = ", ".join(state for state in missing if state is not target)
        text = f"{trigger}: from every state" + (f" but {but}" if but else "")
        lines += [f"    note right of {target}", f"        {text}", "    end note"]
    for phase in Phase:
        states = ", ".join(state for state in FlightState if state.phase is phase)
        lines += [
            f"    classDef {phase}_phase {_COLOURS[phase]}",
            f"    class {states} {phase}_phase",
        ]
    return "\n".join(lines)


_COLOURS: Final = {
    Phase.STANDBY: "fill:#eeeeee,color:#000000",
    Phase.CRUISE: "fill:#d5e8d4,color:#000000",
    Phase.AVOID: "fill:#ffe6cc,color:#000000",
    Phase.THREAD: "fill:#e1d5e7,color:#000000",
    Phase.PAUSE: "fill:#fff2cc,color:#000000",
    Phase.YIELD: "fill:#d0e0e3,color:#000000",
    Phase.ARRIVED: "fill:#dae8fc,color:#000000",
    Phase.HOLD: "fill:#f8cecc,color:#000000",
}


def _common(table: Table) -> dict[Trigger, FlightState]:
    """Return the triggers that lead to one state from more than half of all states."""
    targets: defaultdict[Trigger, list[FlightState]] = defaultdict(list)
    for (_, trigger), target in table.items():
        targets[trigger].append(target)
    return {
        trigger: reached[0]
        for trigger, reached in targets.items()
        if len(set(reached)) == 1 and 2 * len(reached) > len(FlightState)
    }


def _markdown(header: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    """Return a Markdown table."""
    lines = [header, tuple("---" for _ in header), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def main() -> None:
    """Write the page."""
    PAGE.write_text(page(), encoding="utf-8")
    print(f"wrote {PAGE}")


if __name__ == "__main__":
    main()
