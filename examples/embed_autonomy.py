"""Run `Autonomy` in a program of your own: bytes and time in, bytes and events out.

`Autonomy` opens no socket, starts no thread and reads no clock.  Whatever calls it decides where
bytes come from and what time it is: here a simulated vehicle in virtual time, and a detector in the
same process instead of a sensor on Zenoh::

    python examples/embed_autonomy.py

On a vehicle, the loop reads the link and a monotonic clock instead, once every `TICK_S`.
"""

from __future__ import annotations

import json
from pathlib import Path

from onboard.autonomy import Autonomy
from onboard.contract.assessment import TICK_S
from onboard.files.contract_file import load_contract
from onboard.files.mission_file import Mission
from onboard.files.obstacle_field import ObstacleField
from onboard.files.yaml_file import load_yaml
from onboard.guidance.phases import Phase
from sitl.config import SitlConfig
from sitl.vehicle.scene import Scene
from sitl.virtual.scripted_operator import Operator, Step

CONFIG = Path(__file__).parents[1] / "config"
# Unix time at `now_s` zero; stamps of detections are read by it.
EPOCH_UNIX_S = 1_790_000_000.0
# The vehicle has one link to the autonomy and one to the operator.
AUTONOMY_LINK, OPERATOR_LINK = 0, 1
TICKS_PER_FRAME = 5
TIME_LIMIT_S = 120.0


def detection_frame(sequence: int, now_s: float) -> bytes:
    """Return what a detector has found: one box on the leg, in local NED."""
    box = {
        "id": "tree",
        "center_m": [22.0, 0.2],
        "size_m": [0.8, 0.8],
        "yaw_deg": 0.0,
        "uncertainty_m": 0.0,
    }
    frame = {
        "version": 1,
        "source": "my_detector",
        "sequence": sequence,
        "stamp_unix_s": EPOCH_UNIX_S + now_s,
        "frame": "local_ned",
        "range_m": 30.0,
        "field_of_view_deg": 120.0,
        "obstacles": [box],
    }
    return json.dumps(frame).encode()


def main() -> None:
    """Fly the paper's mission around one obstacle and print what happens."""
    mission = load_yaml(CONFIG / "paper_mission.yaml", Mission)
    autonomy = Autonomy(
        load_contract(CONFIG / "paper_contract.yaml"), mission, epoch_unix_s=EPOCH_UNIX_S
    )
    # The other end of the link: vehicle, autopilot and an operator who takes off and lands.
    sitl = SitlConfig.model_validate(
        {"realism": "ideal", "parameters": {"MIS_TAKEOFF_ALT": mission.altitude_m}}
    )
    vehicle = Scene(sitl, ObstacleField.of([]), EPOCH_UNIX_S).vehicle
    operator = Operator(sitl.system_id, mission.altitude_m)
    now_s, ticks = 0.0, 0
    while operator.step is not Step.DONE and now_s < TIME_LIMIT_S:
        ticks += 1
        now_s = ticks * TICK_S
        vehicle.advance(now_s)
        # Bytes in: they are latched, and decided on in the tick.
        autonomy.receive_mavlink(vehicle.bytes_to_send(AUTONOMY_LINK), now_s)
        if ticks % TICKS_PER_FRAME == 0:
            autonomy.receive_detection(detection_frame(ticks // TICKS_PER_FRAME, now_s), now_s)
        autonomy.tick(now_s)
        # Bytes out: setpoints, heartbeats, STATUSTEXT, requests for messages.
        vehicle.receive(autonomy.mavlink_to_send(), AUTONOMY_LINK)
        for event in autonomy.events():
            print(f"{event.time_s:6.2f} s  {event.text}")
        operator.receive(vehicle.bytes_to_send(OPERATOR_LINK))
        if autonomy.navigator.phase in {Phase.ARRIVED, Phase.HOLD}:
            operator.land()
        operator.advance(now_s)
        vehicle.receive(operator.bytes_to_send(), OPERATOR_LINK)


if __name__ == "__main__":
    main()
