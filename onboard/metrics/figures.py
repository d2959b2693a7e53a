"""The newest figures of the service: the tick writes them, another thread may read them."""

from __future__ import annotations

from collections import Counter

from onboard.metrics.tick_times import TickTimes
from onboard.recording.messages import EventRecord, Margins, PlanRecord, Record, StateRecord


class Figures:
    """What has been counted, and the newest records.

    The tick alone writes.  Another thread may read: a record is replaced and never changed, and a
    count is at most one tick old.

    Attributes:
        ticks: their times.
        events: how often each happened, by name and severity.
        state, margins: the newest; None before the first.
        battery_fraction: charge of the emptiest battery, from 0 to 1; None while unknown.
        plans, plan_time_sum_s: how many were made, and how long they took together.
    """

    def __init__(self, ticks: TickTimes) -> None:
        self.ticks = ticks
        self.events: Counter[tuple[str, str]] = Counter()
        self.state: StateRecord | None = None
        self.margins: Margins | None = None
        self.battery_fraction: float | None = None
        self.plans, self.plan_time_sum_s = 0, 0.0

    def take(self, records: list[Record], battery_fraction: float | None) -> None:
        """Take the records of a tick."""
        self.battery_fraction = battery_fraction
        for record in records:
            if isinstance(record, StateRecord):
                self.state = record
            elif isinstance(record, EventRecord):
                self.events[record.name, record.severity] += 1
            elif isinstance(record, Margins):
                self.margins = record
            elif isinstance(record, PlanRecord):
                self.plans += 1
                self.plan_time_sum_s += (record.plan_time_ms or 0.0) / 1e3
