"""Publish obstacle detections over Zenoh: all that a sensor's driver has to do.

Needs only `eclipse-zenoh`.  Start the daemon, then::

    clearway-onboard --config config/onboard.yaml
    python examples/detection_publisher.py

Replace `detected_boxes` by your own detector.  The rules of the frame's fields are in
docs/vehicles.md, "Publish detections"; config/schemas has the JSON Schema.
"""

from __future__ import annotations

import argparse
import itertools
import json
import time
from collections.abc import Iterator
from typing import Any

import zenoh

RATE_HZ = 20.0
SOURCE = "front"
RANGE_M = 15.0
FIELD_OF_VIEW_DEG = 90.0


def detected_boxes() -> list[dict[str, Any]]:
    """Return the obstacles in view: upright boxes in local NED, all of them in every frame."""
    return [
        {
            "id": "7",  # the same for as long as the obstacle is seen
            "center_m": [14.2, 0.6],  # north, east; the size is along and across yaw_deg
            "size_m": [1.0, 1.2],
            "yaw_deg": 0.0,
            "uncertainty_m": 0.05,  # how far off each face may be
        }
    ]


def frames() -> Iterator[bytes]:
    """Yield one frame after another, without end; an empty list of boxes is a frame too."""
    for sequence in itertools.count():
        frame = {
            "version": 1,
            "source": SOURCE,
            "sequence": sequence,
            "stamp_unix_s": time.time(),  # when it was measured, not when it is sent
            "frame": "local_ned",  # or "body_frd": metres ahead and to the right
            "range_m": RANGE_M,
            "field_of_view_deg": FIELD_OF_VIEW_DEG,
            "obstacles": detected_boxes(),
        }
        yield json.dumps(frame).encode()


def main() -> None:
    """Publish until interrupted, or until ``--frames`` are sent."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("--connect", default="tcp/127.0.0.1:7448", help="the daemon's zenoh.listen")
    parser.add_argument("--vehicle", default="vehicle", help="name in the daemon's configuration")
    parser.add_argument("--frames", type=int, help="how many to send; default: until interrupted")
    options = parser.parse_args()
    config = zenoh.Config()
    config.insert_json5("connect/endpoints", json.dumps([options.connect]))
    with zenoh.open(config) as session:
        publisher = session.declare_publisher(f"clearway/{options.vehicle}/obstacles")
        for frame in itertools.islice(frames(), options.frames):
            publisher.put(frame)
            time.sleep(1.0 / RATE_HZ)


if __name__ == "__main__":
    main()
