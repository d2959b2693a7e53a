"""Events: every name is emitted somewhere and documented, and its data have the stated keys."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest
from pydantic import TypeAdapter, ValidationError

from onboard.events import Event, EventData, EventName, Severity
from onboard.recording.journal import event_record
from onboard.recording.messages import as_json

ROOT = Path(__file__).parents[2]
SOURCES = [path for path in sorted((ROOT / "onboard").rglob("*.py")) if path.name != "events.py"]


def names_passed_to_events(path: Path) -> set[str]:
    """The members of `EventName` that a file passes to `Event(...)`."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            if node.func.id != "Event":
                continue
            name = node.args[1] if len(node.args) > 1 else None
            assert isinstance(name, ast.Attribute), f"{path}:{node.lineno}: not a member"
            found.add(name.attr)
    return found


def test_every_name_is_emitted_and_no_other() -> None:
    emitted = set().union(*(names_passed_to_events(path) for path in SOURCES))
    assert emitted == set(EventName.__members__)


def test_every_name_is_documented_and_no_other() -> None:
    page = (ROOT / "docs" / "recording.md").read_text(encoding="utf-8")
    table = page.partition("## Events")[2].partition("\n## ")[0]
    documented = re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE)
    assert sorted(documented) == sorted(EventName)


def test_every_key_of_the_data_is_documented_and_no_other() -> None:
    page = (ROOT / "docs" / "recording.md").read_text(encoding="utf-8")
    table = page.partition("## Events")[2].partition("\n## ")[0]
    cells = [line.split("|")[3] for line in table.splitlines() if line.startswith("| `")]
    documented = {key for cell in cells for key in re.findall(r"`(\w+)`", cell)}
    assert documented == set(EventData.__annotations__)


def test_a_name_is_its_text_on_the_wire() -> None:
    event = Event(1.0, EventName.VIOLATION, Severity.ERROR, "late", {"measured": 0.4})
    record = event_record(event, 1.7e9)
    assert (record.name, record.severity, record.time_s) == ("violation", "error", 1.7e9)
    assert b'"name":"violation","severity":"error","text":"late"' in as_json(record)
    assert EventName("violation") is EventName.VIOLATION


@pytest.mark.parametrize("severity", Severity)
def test_severities_are_those_of_mavlink(severity: Severity) -> None:
    from pymavlink.dialects.v20 import common as mavlink  # noqa: PLC0415

    assert getattr(mavlink, f"MAV_SEVERITY_{severity.name}") == severity


@pytest.mark.parametrize(
    "data",
    [
        {"measured": "much"},
        {"limit": None},
        {"shift_ned_m": [1.0, 2.0]},
        {"reasons": [{"kind": "wind"}]},
        {"followed": 1},
    ],
)
def test_data_of_another_shape_are_malformed(data: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(EventData).validate_python(data, strict=True)
