"""Metrics as Prometheus reads them."""

import urllib.request

import pytest
from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.parser import text_string_to_metric_families

from onboard.files.daemon_config import MetricsOutput
from onboard.metrics.exposition import FiguresCollector
from onboard.metrics.figures import Figures
from onboard.metrics.server import MetricsError, serve
from onboard.metrics.tick_times import TickTimes
from onboard.recording.messages import (
    ClauseMargin,
    DropCounters,
    EventRecord,
    Margins,
    PlanRecord,
    SensorRecord,
    StateRecord,
)
from tests.onboard.test_daemon import free_port

SHA256 = "4afe1f944e2a"


def filled() -> Figures:
    figures = Figures(TickTimes())
    figures.ticks.begin(0.0, 0.0, 0.0)
    figures.ticks.begin(0.2, 0.0, 0.2)
    figures.ticks.end(0.004)
    sensor = SensorRecord(age_s=0.05, refused={"stale": 3})
    state = StateRecord(
        time_s=1.0, phase="cruise", armed=True, airborne=None, telemetry_age_s=0.02,
        sensors={"front": sensor}, dropped=DropCounters(frames_malformed=7),
    )  # fmt: skip
    clause = ClauseMargin(
        name="range", required=9.0, declared=12.0, margin=3.0, unit="m", holds=True
    )
    event = EventRecord(time_s=1.0, name="phase", severity="info", text="")
    plan = PlanRecord(time_s=1.0, plan_time_ms=30.0)
    figures.take([state, Margins(time_s=1.0, clauses=[clause]), event, plan, event], 0.75)
    return figures


def samples(text: str) -> dict[tuple[str, frozenset[tuple[str, str]]], float]:
    return {
        (sample.name, frozenset(sample.labels.items())): sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
    }


def read(figures: Figures) -> dict[tuple[str, frozenset[tuple[str, str]]], float]:
    registry = CollectorRegistry()
    registry.register(FiguresCollector(figures, SHA256))
    return samples(generate_latest(registry).decode())


def test_every_figure_is_read_with_its_labels() -> None:
    found = read(filled())
    for name, labels, value in (
        ("clearway_events_total", {"name": "phase", "severity": "info"}, 2.0),
        ("clearway_plans_total", {}, 1.0),
        ("clearway_planning_seconds_total", {}, 0.03),
        ("clearway_late_ticks_total", {"cause": "starved"}, 1.0),
        ("clearway_late_ticks_total", {"cause": "own"}, 0.0),
        ("clearway_tick_duration_seconds_count", {}, 1.0),
        ("clearway_tick_duration_seconds_bucket", {"le": "0.003"}, 0.0),
        ("clearway_tick_duration_seconds_bucket", {"le": "0.005"}, 1.0),
        ("clearway_tick_duration_seconds_bucket", {"le": "+Inf"}, 1.0),
        ("clearway_phase", {"clearway_phase": "cruise"}, 1.0),
        ("clearway_phase", {"clearway_phase": "hold"}, 0.0),
        ("clearway_armed", {}, 1.0),
        ("clearway_telemetry_age_seconds", {}, 0.02),
        ("clearway_sensor_age_seconds", {"sensor": "front"}, 0.05),
        ("clearway_sensor_messages_refused_total", {"sensor": "front", "reason": "stale"}, 3.0),
        ("clearway_dropped_inputs_total", {"reason": "frames_malformed"}, 7.0),
        ("clearway_battery_fraction", {}, 0.75),
        ("clearway_contract_margin", {"clause": "range", "unit": "m"}, 3.0),
        ("clearway_contract_clause_holds", {"clause": "range"}, 1.0),
    ):
        assert found[name, frozenset(labels.items())] == value, name
    assert any(
        name == "clearway_build_info" and ("contract_sha256", SHA256) in labels
        for name, labels in found
    )


def test_what_is_not_known_is_absent() -> None:
    names = {name for name, _ in read(filled())}
    assert "clearway_airborne" not in names
    assert "clearway_detection_age_seconds" not in names
    empty = {name for name, _ in read(Figures(TickTimes()))}
    assert "clearway_battery_fraction" not in empty
    assert "clearway_phase" not in empty
    assert "clearway_events_total" not in empty


def test_they_are_served_with_the_memory_of_the_process_until_closed() -> None:
    config = MetricsOutput(listen=f"127.0.0.1:{free_port()}")
    close = serve(config, filled(), SHA256)
    url = f"http://{config.listen}/metrics"
    with urllib.request.urlopen(url, timeout=10.0) as answer:
        found = samples(answer.read().decode())
    assert found["process_resident_memory_bytes", frozenset()] > 1e6
    assert found["clearway_plans_total", frozenset()] == 1.0
    with pytest.raises(MetricsError, match=r"metrics\.listen = 127\.0\.0\.1:\d+: Address already"):
        serve(config, filled(), SHA256)
    close()
    with pytest.raises(OSError, match="refused"):
        urllib.request.urlopen(url, timeout=10.0)
