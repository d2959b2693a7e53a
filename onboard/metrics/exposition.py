"""Figures as Prometheus metrics; names and units as Prometheus wants them.

Source: https://prometheus.io/docs/practices/naming/.  This module needs prometheus-client (extra
``metrics``).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from importlib.metadata import version

from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    HistogramMetricFamily,
    InfoMetricFamily,
    Metric,
    StateSetMetricFamily,
)
from prometheus_client.registry import Collector

from onboard.guidance.phases import Phase
from onboard.metrics.figures import Figures
from onboard.metrics.tick_times import TickTimes
from onboard.recording.messages import Margins, StateRecord


class FiguresCollector(Collector):
    """Turns figures into metrics whenever Prometheus asks.

    Args:
        figures: of the service.
        contract_sha256: of the contract as declared.
    """

    def __init__(self, figures: Figures, contract_sha256: str) -> None:
        self._figures, self._contract_sha256 = figures, contract_sha256

    def collect(self) -> Iterator[Metric]:
        """Yield every metric."""
        labels = {"version": version("clearway"), "contract_sha256": self._contract_sha256}
        yield InfoMetricFamily("clearway_build", "Version, and contract as declared", labels)
        yield from _of_ticks(self._figures.ticks)
        yield from _of_counts(self._figures)
        if (state := self._figures.state) is not None:
            yield from _of_state(state)
            yield from _of_drops(state)
        if (margins := self._figures.margins) is not None:
            yield from _of_margins(margins)


def _of_ticks(ticks: TickTimes) -> Iterator[Metric]:
    buckets = [
        ("+Inf" if bound_s == float("inf") else str(bound_s), float(count))
        for bound_s, count in ticks.cumulative()
    ]
    yield HistogramMetricFamily(
        "clearway_tick_duration_seconds",
        "Time from the beginning of a tick to its end",
        buckets=buckets,
        sum_value=ticks.duration_sum_s,
    )
    longest = GaugeMetricFamily("clearway_tick_duration_max_seconds", "The longest tick so far")
    longest.add_metric([], ticks.duration_max_s)
    yield longest
    late = CounterMetricFamily(
        "clearway_late_ticks",
        "Ticks that began late: own doing, or starved of a processor",
        labels=["cause"],
    )
    latest = GaugeMetricFamily(
        "clearway_tick_late_max_seconds", "The latest beginning of a late tick", labels=["cause"]
    )
    for cause, count in ticks.late.items():
        late.add_metric([cause.value], count)
        latest.add_metric([cause.value], ticks.late_max_s[cause])
    yield late
    yield latest


def _of_counts(figures: Figures) -> Iterator[Metric]:
    events = CounterMetricFamily(
        "clearway_events", "What happened, by name and severity", labels=["name", "severity"]
    )
    for labels, count in sorted(dict(figures.events).items()):
        events.add_metric(labels, count)
    yield events
    plans = CounterMetricFamily("clearway_plans", "Plans that were flown")
    plans.add_metric([], figures.plans)
    yield plans
    took = CounterMetricFamily("clearway_planning_seconds", "Time that those plans took")
    took.add_metric([], figures.plan_time_sum_s)
    yield took
    if figures.battery_fraction is not None:
        charge = GaugeMetricFamily(
            "clearway_battery_fraction", "Charge of the emptiest battery, from 0 to 1"
        )
        charge.add_metric([], figures.battery_fraction)
        yield charge


def _of_state(state: StateRecord) -> Iterator[Metric]:
    phases = {phase.value: phase.value == state.phase for phase in Phase}
    yield StateSetMetricFamily("clearway_phase", "Phase of the flight", phases)
    for name, text, value in (
        ("armed", "Whether the autopilot is armed", state.armed),
        ("airborne", "Whether it says that it flies", state.airborne),
        ("cleared", "Whether a flight authorization is valid, or none required", state.cleared),
        ("log_ended", "Whether the service flies on without a log", state.log_ended),
        ("telemetry_age_seconds", "Age of the newest pose", state.telemetry_age_s),
        ("detection_age_seconds", "Age of the oldest sensor's frame", state.detection_age_s),
        ("tracking_error_meters", "Horizontal, from the reference", state.tracking_error_m),
        ("tracking_error_vertical_meters", "From the reference", state.tracking_error_z_m),
        ("obstacles_known", "Size of the map", state.obstacles_known),
        ("free_cells", "Cells around the vehicle that have been seen free", state.free_cells),
        ("rest_certified", "Whether a certified way to rest is held", state.rest_certified),
        ("pauses", "Pauses on this leg", state.pauses),
    ):
        if value is not None:  # what is not known is absent, not zero
            gauge = GaugeMetricFamily(f"clearway_{name}", text)
            gauge.add_metric([], float(value))
            yield gauge
    ages = GaugeMetricFamily(
        "clearway_sensor_age_seconds", "Since a sensor's newest stamp", labels=["sensor"]
    )
    for name, sensor in state.sensors.items():
        if sensor.age_s is not None:
            ages.add_metric([name], sensor.age_s)
    yield ages


def _of_drops(state: StateRecord) -> Iterator[Metric]:
    dropped = CounterMetricFamily(
        "clearway_dropped_inputs", "Input that was not used, by reason", labels=["reason"]
    )
    for reason, count in dataclasses.asdict(state.dropped).items():
        dropped.add_metric([reason], count)
    yield dropped
    refused = CounterMetricFamily(
        "clearway_sensor_messages_refused",
        "Messages of a sensor that were dropped, by reason",
        labels=["sensor", "reason"],
    )
    for name, sensor in state.sensors.items():
        for reason, count in sensor.refused.items():
            refused.add_metric([name, reason], count)
    yield refused


def _of_margins(margins: Margins) -> Iterator[Metric]:
    margin = GaugeMetricFamily(
        "clearway_contract_margin",
        "Declared less required of each clause, in the clause's unit",
        labels=["clause", "unit"],
    )
    holds = GaugeMetricFamily(
        "clearway_contract_clause_holds", "Whether a clause holds", labels=["clause"]
    )
    for clause in margins.clauses:
        margin.add_metric([clause.name, clause.unit], clause.margin)
        holds.add_metric([clause.name], float(clause.holds))
    yield margin
    yield holds
