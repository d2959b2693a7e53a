"""What moved in a flight, as the page draws it: boxes, what they could reach, and the truth."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise

from gcs_tools.flight_report.flight import Document
from gcs_tools.flight_report.timeline import since
from onboard.files.truth_record import TrueMoversRecord
from onboard.recording.messages import StateRecord
from onboard.recording.mover_record import KnownMover, MoversRecord, extent

# A page cannot hold all records of a long flight: every n-th is kept.
MOMENTS_MAX = 600
FREE_SETS_MAX = 150
SUMMARY_MAX = 60
_DIGITS = 3
# Twice as long as records are apart.
_RENEWED_S = 0.6
# A record holds until the next, but no longer than this.
_HOLDS_S = 2.0


def movers_during(
    records: Sequence[MoversRecord], states: Sequence[StateRecord]
) -> list[MoversRecord]:
    """Return the records between the first and the last state."""
    begin_s, end_s = states[0].time_s, states[-1].time_s
    return [record for record in records if begin_s <= record.time_s <= end_s]


def mover_moments(records: Sequence[MoversRecord], start_s: float) -> list[Document]:
    """Return what was known of movers, moment by moment.

    Boxes are least and greatest north, least and greatest east.  The mover-free set is large: only
    some moments have it, under ``free``; it is null in the others.  Where another record follows
    soon, boxes were renewed before they had grown: ``renewed``.

    Args:
        records: of a flight, in the order of time.
        start_s: Unix time of the departure.
    """
    stride = max(1, math.ceil(len(records) / MOMENTS_MAX))
    kept = records[::stride]
    followers = [*records[1::stride], *[None] * (len(kept) - len(records[1::stride]))]
    step = max(1, math.ceil(len(kept) / FREE_SETS_MAX))
    return [
        {
            "time_s": since(record, start_s),
            "until_s": None if record.until_s is None else _rounded(record.until_s - start_s),
            "stamp_error_s": record.stamp_error_s,
            "renewed": follower is not None and follower.time_s - record.time_s < _RENEWED_S,
            "yielding": record.yielding,
            "missing": record.missing,
            "movers": [_mover(mover, start_s) for mover in record.movers if mover.box_ned_m],
            "free": None if number % step else _free(record),
        }
        for number, (record, follower) in enumerate(zip(kept, followers, strict=True))
    ]


def _mover(mover: KnownMover, start_s: float) -> Document:
    return {
        "id": mover.id,
        "kind": mover.kind,
        "seen_s": _rounded(mover.seen_s - start_s),
        "speed_max_mps": mover.speed_max_mps,
        "box_m": _extent(mover.box_ned_m),
        "reach_m": _extent(mover.reach_ned_m or mover.box_ned_m),
        "yields_for": mover.yields_for,
    }


def _extent(outline_m: list[tuple[float, float]]) -> list[float]:
    return [_rounded(value) for value in extent(outline_m)]


def _free(record: MoversRecord) -> Document:
    return {
        "corner_ned_m": [_rounded(value) for value in record.corner_ned_m],
        "cell_m": record.cell_m,
        "row": record.row,
        "column_from": record.column_from,
        "column_to": record.column_to,
    }


def mover_summary(records: Sequence[MoversRecord], start_s: float) -> list[Document]:
    """Return each mover with its class, when it was known, and for how long it was yielded for.

    Of very many those that were yielded for longest.
    """
    found: dict[str, Document] = {}
    for record, after in pairwise((*records, None)):
        assert record is not None  # noqa: S101  the last one is never the first of a pair
        lasted_s = 0.0 if after is None else min(after.time_s - record.time_s, _HOLDS_S)
        for mover in record.movers:
            one = found.setdefault(
                mover.id,
                {
                    "id": mover.id,
                    "kind": mover.kind,
                    "first_s": since(record, start_s),
                    "yielded_s": 0.0,
                },
            )
            one |= {"last_s": since(record, start_s), "speed_max_mps": mover.speed_max_mps}
            one["yielded_s"] = _rounded(one["yielded_s"] + lasted_s * mover.yields_for)
    # Of a sensor that tells ranges only every return is one: those matter that were yielded for.
    first = sorted(found.values(), key=lambda one: (-one["yielded_s"], one["first_s"]))
    return sorted(first[:SUMMARY_MAX], key=lambda one: one["first_s"])


def true_movers(
    records: Iterable[TrueMoversRecord], states: Sequence[StateRecord], start_s: float
) -> list[Document]:
    """Return where each simulated mover really was: its size, and times and places.

    Args:
        records: of the simulation.
        states: of the flight.
        start_s: Unix time of the departure.
    """
    begin_s, end_s = states[0].time_s, states[-1].time_s
    within = [record for record in records if begin_s <= record.time_unix_s <= end_s]
    found: dict[str, Document] = {}
    for record in within[:: max(1, math.ceil(len(within) / (2 * MOMENTS_MAX)))]:
        for mover in record.movers:
            one = found.setdefault(
                mover.id,
                {
                    "id": mover.id,
                    "kind": mover.kind,
                    "half_m": mover.half_m,
                    "time_s": [],
                    "places_ned_m": [],
                },
            )
            one["time_s"].append(_rounded(record.time_unix_s - start_s))
            one["places_ned_m"].append([_rounded(value) for value in mover.position_ned_m])
    return list(found.values())


def _rounded(value: float) -> float:
    return round(value, _DIGITS)
