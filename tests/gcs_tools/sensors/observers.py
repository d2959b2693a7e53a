"""Scripted surroundings of a daemon's file."""

from __future__ import annotations

from typing import Any

import numpy as np

from gcs_tools.sensors.observation import SensorObserver
from onboard.files.daemon_config import DaemonConfig
from tests.onboard.perception.ros2.encoding import attachment, scan_all_round
from tests.onboard.perception.sources.scenes import EPOCH_UNIX_S
from tests.onboard.perception.test_sensor_channels import KEY, KINDS, KNOWN

STATED: dict[str, Any] = {"name": "lidar", "range_m": 10.0, "uncertainty_m": 0.1}


def config(*kinds: str, **keys: Any) -> DaemonConfig:
    """Return a daemon's file with one sensor of each kind, named after it."""
    sources = [STATED | {"name": kind, "kind": kind} | KINDS.get(kind, {}) | keys for kind in kinds]
    document = {"contract": "contract.yaml", "mission": "mission.yaml", "sources": sources}
    return DaemonConfig.model_validate(document)


def observer(of: DaemonConfig) -> SensorObserver:
    return SensorObserver(of, EPOCH_UNIX_S)


def scan(at_s: float, range_m: float = 5.0, **changes: Any) -> bytes:
    ranges_m = np.full(360, range_m)
    return scan_all_round(ranges_m, stamp_unix_s=EPOCH_UNIX_S + at_s, **changes)


def send(seen: SensorObserver, *payloads: bytes, key: str = KNOWN, by: bytes = bytes(16)) -> None:
    """Deliver scans at 10 Hz, 20 ms after their stamps."""
    for number, payload in enumerate(payloads):
        now_s = number / 10.0 + 0.02
        seen.receive_sample("laserscan", payload, now_s, key=key, attachment=attachment(by))
        seen.tick(now_s)


__all__ = ["KEY", "KNOWN", "STATED", "config", "observer", "scan", "send"]
