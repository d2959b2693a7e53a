"""Detection frames and schedules for the tests of faults."""

import json

from sitl.environment.sensor_message import ZenohMessage
from sitl.virtual.faults.detections import DetectionFaults
from sitl.virtual.faults.schedule import FaultSchedule
from sitl.virtual.faults.schema import Fault, FaultKind

HERE_NED_M = (10.0, 0.0, -4.0)


def frame(center_m: tuple[float, float] = (18.0, 1.0), coordinates: str = "local_ned") -> bytes:
    """Return a frame with one box, 1 m by 2 m."""
    obstacle = {"id": "1", "center_m": list(center_m), "size_m": [1.0, 2.0], "yaw_deg": 0.0}
    return json.dumps(
        {
            "version": 1,
            "stamp_unix_s": 100.0,
            "frame": coordinates,
            "range_m": 12.0,
            "field_of_view_deg": 120.0,
            "obstacles": [obstacle | {"uncertainty_m": 0.05}],
        }
    ).encode()


def two_boxes() -> bytes:
    """Return a frame with a second box 8 m east of the first."""
    seen = json.loads(frame())
    other = {**seen["obstacles"][0], "id": "2", "center_m": [18.0, 9.0]}
    return json.dumps({**seen, "obstacles": [seen["obstacles"][0], other]}).encode()


def present(kind: FaultKind, amount: float | None = None) -> FaultSchedule:
    """Return a schedule in which one fault is present from the start."""
    schedule = FaultSchedule((Fault(kind=kind, amount=amount),), seed=1)
    schedule.advance(0.0, "cruise")
    return schedule


def arriving(faults: DetectionFaults, payloads: list[bytes]) -> list[bytes]:
    """Return what arrives of detections as JSON."""
    sent = [ZenohMessage("front", payload) for payload in payloads]
    return [message.payload for message in faults.arriving(sent, HERE_NED_M)]
