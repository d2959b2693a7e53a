"""The daemon as a process, at 50 Hz against the bundled SITL: processor, memory, start, latency.

Each flight is flown once in real time, as by ``clearway fly``, with a meter in the daemon
(`tests.benchmarks.daemon_meter`).
"""

from __future__ import annotations

import functools
import json
import math
import os
import tempfile
import time
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from gcs_tools.console.processes import Children
from gcs_tools.fly.live_flight import fly_live
from gcs_tools.scenario import load_scenario
from onboard.guidance.phases import Phase
from tests.benchmarks.daemon_meter import ALONG_LEG, OUTPUT, STARTED
from tests.benchmarks.measurement import Measurement
from tests.gcs_tools.running import CONFIG

LIVE = True  # each flight takes about a minute, so that none is flown just to show that it works
ROOT = Path(__file__).parents[2]
ALONG_LEG_FLIGHT, DENSE_FLIGHT = "paper.yaml", "scenarios/uniform_forest.yaml"
ALONG_LEG_PERCENT_MAX, DENSE_PERCENT_MAX = 15.0, 25.0
MEMORY_MAX_MB, START_MAX_S = 200.0, 4.0
LATENCY_MAX_MS, DENSE_LATENCY_MAX_MS = 20.0, 450.0


class MeteredChildren(Children):
    """Starts the daemon with its meter."""

    def start(self, name: str, module: str, *arguments: str, log_path: Path) -> None:
        """Start a child program as `Children` does."""
        if module == "onboard":
            module = "tests.benchmarks.daemon_meter"
            os.environ[STARTED] = str(time.monotonic())
        super().start(name, module, *arguments, log_path=log_path)


@functools.cache
def flown(name: str) -> dict[str, Any]:
    """Fly a scenario in real time; return what the daemon's meter has noted.

    Raises:
        RuntimeError: the mission was not completed.
    """
    scenario = load_scenario(CONFIG / name)
    with tempfile.TemporaryDirectory() as directory:
        output = Path(directory) / "meter.json"
        environment = {OUTPUT: str(output), "PYTHONPATH": str(ROOT)}
        with (
            patch.dict(os.environ, environment),
            patch("gcs_tools.fly.live_flight.Children", MeteredChildren),
        ):
            aborted = fly_live(
                scenario,
                seed=1,
                out=Path(directory),
                fly_outside_contract=scenario.fly_outside_contract,
                report=lambda *_: None,
            )
        if aborted is not None:
            raise RuntimeError(f"{name}: {aborted}")
        figures: dict[str, Any] = json.loads(output.read_text(encoding="utf-8"))
    return figures


def _share_percent(name: str, *phases: Phase) -> float:
    """Return the processor time in some phases, as a share of one core."""
    figures = flown(name)
    wall_s, processor_s = (
        math.fsum(figures[key].get(phase, 0.0) for phase in phases)
        for key in ("wall_s", "processor_s")
    )
    return 100.0 * processor_s / wall_s


def _latency_ms(name: str, *phases: Phase) -> float:
    """Return the 99th percentile of a detection's way to its setpoint."""
    latencies_s = [one for phase in phases for one in flown(name)["latencies_s"].get(phase, [])]
    return 1e3 * float(np.percentile(latencies_s, 99))


def bench_daemon_processor() -> Measurement:
    """Share of one core in cruise and avoidance (the paper's flight)."""
    share = _share_percent(ALONG_LEG_FLIGHT, *ALONG_LEG)
    return Measurement(share, "% of a core", limit=ALONG_LEG_PERCENT_MAX)


def bench_daemon_processor_dense() -> Measurement:
    """Share of one core in dense flight (the uniform forest)."""
    share = _share_percent(DENSE_FLIGHT, Phase.THREAD)
    return Measurement(share, "% of a core", limit=DENSE_PERCENT_MAX)


def bench_daemon_memory() -> Measurement:
    """The most memory that the daemon had in either flight."""
    peak_mb = max(flown(name)["peak_mb"] for name in (ALONG_LEG_FLIGHT, DENSE_FLIGHT))
    return Measurement(peak_mb, "MB", limit=MEMORY_MAX_MB)


def bench_daemon_start() -> Measurement:
    """From the start of the process until the daemon serves; the slower of the two flights."""
    start_s = max(flown(name)["start_s"] for name in (ALONG_LEG_FLIGHT, DENSE_FLIGHT))
    return Measurement(start_s, "s", limit=START_MAX_S)


def bench_detection_to_setpoint() -> Measurement:
    """99th percentile in cruise and avoidance, waiting for the tick included."""
    latency_ms = _latency_ms(ALONG_LEG_FLIGHT, *ALONG_LEG)
    return Measurement(latency_ms, "ms", limit=LATENCY_MAX_MS)


def bench_detection_to_setpoint_dense() -> Measurement:
    """99th percentile in dense flight, until a plan that was begun with the frame is flown."""
    return Measurement(_latency_ms(DENSE_FLIGHT, Phase.THREAD), "ms", limit=DENSE_LATENCY_MAX_MS)
