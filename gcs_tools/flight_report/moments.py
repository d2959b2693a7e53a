"""What of a flight to look at first: where the report opens, and what it marks on the map."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

from gcs_tools.flight_report.flight import Document
from gcs_tools.flight_report.timeline import since
from onboard.events import EventName
from onboard.files.truth_record import TruthRecord
from onboard.recording.messages import EventRecord, StateRecord


@dataclass(frozen=True)
class _Moment:
    """Something that went wrong; it is later drawn where the vehicle was."""

    time_s: float
    kind: str
    text: str


def opening_s(marks: Sequence[Document], states: Sequence[StateRecord], start_s: float) -> float:
    """Return when a report opens, in seconds since departure.

    At the first contact in motion, else at the first violation or hold; of a flight without any, at
    the end of its mission, before the vehicle is taken over and landed.

    Args:
        marks: of the flight.
        states: that are shown.
        start_s: Unix time of the departure.
    """
    contacts = [mark for mark in marks if mark["kind"] == "contact"]
    failures = [mark for mark in marks if mark["kind"] != "touch"]
    if found := contacts or failures:
        return float(found[0]["time_s"])
    in_control = (state for state in reversed(states) if state.phase != "standby")
    return since(next(in_control, states[-1]), start_s)


def marks(
    events: Sequence[EventRecord],
    truths: Sequence[TruthRecord],
    states: Sequence[StateRecord],
    start_s: float,
) -> list[Document]:
    """Return contacts, touches at rest, violations and holds, in order, with place and reason."""
    begin_s, end_s = states[0].time_s, states[-1].time_s
    found = sorted([*_contacts(truths), *_failures(events)], key=lambda each: each.time_s)
    return [
        {
            "time_s": round(each.time_s - start_s, 3),
            "kind": each.kind,
            "text": each.text,
            "place_ned_m": _place(states, each.time_s),
        }
        for each in found
        if begin_s <= each.time_s <= end_s
    ]


def _contacts(truths: Sequence[TruthRecord]) -> Iterator[_Moment]:
    for before, after in pairwise(truths):
        if after.collisions > before.collisions:
            yield _Moment(after.time_unix_s, "contact", "contact in motion")
        if after.contacts_at_rest > before.contacts_at_rest:
            text = "a mover touches the vehicle at rest: no collision"
            yield _Moment(after.time_unix_s, "touch", text)


def _failures(events: Sequence[EventRecord]) -> Iterator[_Moment]:
    for event in events:
        if event.name == EventName.VIOLATION:
            yield _Moment(event.time_s, "violation", event.text)
        elif event.name == EventName.PHASE and event.data.get("to") == "hold":
            yield _Moment(event.time_s, "hold", event.text)


def _place(states: Sequence[StateRecord], time_s: float) -> list[float] | None:
    """Return where the vehicle was at a time; None where no position was known."""
    known = (state for state in states if state.time_s >= time_s and state.position_ned_m)
    state = next(known, None)
    if state is None or state.position_ned_m is None:
        return None
    return [round(value, 3) for value in state.position_ned_m[:2]]
