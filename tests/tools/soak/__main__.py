"""``python -m tests.tools.soak --minutes 60 -o DIR``: memory and ticks of an hour's flight.

A simulated ArduPilot and the daemon fly to and fro among obstacles, as processes in real time.
Every second the memory and processor time of both is read from ``/proc``; the daemon counts its own
ticks and logs each late one.  Exit code 0: memory is flat, and no tick was late by the daemon's own
doing.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import sys
import time
import urllib.request
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import yaml
import zenoh
from prometheus_client.parser import text_string_to_metric_families

from gcs_tools.console.interruption import Interruption, interruptible
from gcs_tools.console.processes import Children, free_ports
from gcs_tools.fly.command import best_effort
from gcs_tools.fly.live_configuration import VEHICLE_NAME, Endpoints, write_configuration
from gcs_tools.fly.live_flight import READY_TIMEOUT_S, START_TIMEOUT_S, Operator, Status
from gcs_tools.resume.command import ask
from gcs_tools.scenario import Scenario, load_scenario
from gcs_tools.vehicle.connection import connected_vehicle
from gcs_tools.vehicle.operator import Vehicle
from onboard.files.mission_file import Leg, Mission
from onboard.files.zenoh_endpoints import ZenohEndpoints
from onboard.guidance.phases import Phase, Trigger
from onboard.zenoh_session import open_session
from tests.tools.soak.figures import Sample, Soak, failures, late_ticks, table

ROOT = Path(__file__).parents[3]
SCENARIO: Final = ROOT / "config/default.yaml"
_SAMPLE_S: Final = 1.0
# The operator resumes a hold once the daemon may agree (`onboard.monitoring.resumption`).
_RESUME_EVERY_S: Final = 5.0
# No leg is flown faster; there are enough of them to last.
_LEG_MIN_S: Final = 30.0
_TICKS_PER_S: Final = os.sysconf("SC_CLK_TCK")


def to_and_fro(mission: Mission, minutes: float) -> Mission:
    """Return a mission that flies the first leg there and back for as long as the soak lasts."""
    there, back = mission.legs[0].end_ned_m, mission.start_ned_m
    width_m = mission.legs[0].target_half_width_m
    count = 2 * (int(minutes * 60.0 / _LEG_MIN_S) // 2 + 1)
    ends = [there if number % 2 == 0 else back for number in range(count)]
    legs = tuple(Leg(end_ned_m=end, target_half_width_m=width_m) for end in ends)
    return mission.model_copy(update={"legs": legs})


def soak_scenario(minutes: float) -> Scenario:
    """Return the scenario, with a battery that lasts.

    It flies with best effort, so that the operator can resume every hold wherever it has ended.
    """
    scenario = load_scenario(SCENARIO)
    battery = scenario.plant.battery.model_copy(update={"capacity_ah": 5.0 + minutes})
    plant = scenario.plant.model_copy(update={"battery": battery})
    contract, mission = best_effort(scenario.contract), to_and_fro(scenario.mission, minutes)
    return replace(scenario, contract=contract, mission=mission, plant=plant)


def configure(scenario: Scenario, endpoints: Endpoints, metrics_port: int, out: Path) -> None:
    """Write the configuration of both processes: that of `clearway fly`, as a vehicle has it.

    The daemon serves metrics, and its logs rotate within a quota.
    """
    write_configuration(scenario, endpoints, seed=0, out=out, fly_outside_contract=False)
    path = out / "onboard.yaml"
    settings: dict[str, Any] = yaml.safe_load(path.read_text(encoding="utf-8"))
    settings |= {
        "metrics": {"listen": f"127.0.0.1:{metrics_port}"},
        "log_file": None,
        "log_directory": "flights",
        "log_quota_mb": 200,
        "log_format": "json",
        # What a busy computer delays is what is measured here.
        "require_preflight": False,
    }
    path.write_text(yaml.safe_dump(settings), encoding="utf-8")
    path = out / "sitl.yaml"
    settings = yaml.safe_load(path.read_text(encoding="utf-8"))
    path.write_text(yaml.safe_dump(settings | {"truth_log": None}), encoding="utf-8")


def process_of(children: Children, name: str) -> int:
    """Return the id of a child process."""
    return next(each.process.pid for each in children._children if each.name == name)


def sample(time_s: float, daemon: int, simulator: int) -> Sample:
    """Read memory and processor time of both processes, and what the hypervisor took."""
    fields = Path(f"/proc/{daemon}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    stolen = Path("/proc/stat").read_text(encoding="ascii").splitlines()[0].split()[8]
    return Sample(
        time_s,
        *_memory_bytes(daemon),
        _memory_bytes(simulator)[0],
        (int(fields[11]) + int(fields[12])) / _TICKS_PER_S,
        int(stolen) / _TICKS_PER_S,
    )


def _memory_bytes(process: int) -> tuple[float, float]:
    """Return the resident memory, and the part that no file backs (proc_pid_status(5))."""
    status = Path(f"/proc/{process}/status").read_text(encoding="ascii")
    sizes = dict(line.split(":", 1) for line in status.splitlines())
    resident, anonymous = (int(sizes[key].split()[0]) for key in ("VmRSS", "RssAnon"))
    return resident * 1024.0, anonymous * 1024.0


def scraped(port: int) -> dict[str, float]:
    """Return the daemon's metrics, each by its name and labels."""
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=10.0) as answer:
        text = answer.read().decode()
    return {
        each.name + "".join(f"{{{key}={value}}}" for key, value in sorted(each.labels.items())): (
            each.value
        )
        for family in text_string_to_metric_families(text)
        for each in family.samples
    }


@dataclass
class Watch:
    """Records a flight that is under way.

    Attributes:
        soak: takes the record.
        status: of the daemon.
        session: on its bus.
        children: both processes.
        interruption: set by an operator who gives up.
        minutes: how long.
    """

    soak: Soak
    status: Status
    session: zenoh.Session
    children: Children
    interruption: Interruption
    minutes: float

    async def run(self, vehicle: Vehicle) -> None:
        """Sample until the time is over or the mission flown; resume holds, hand over again."""
        daemon = process_of(self.children, "clearway-onboard")
        simulator = process_of(self.children, "clearway-sitl")
        resume_due_s = 0.0
        due_s = begin_s = time.monotonic()
        while (now_s := time.monotonic()) - begin_s < self.minutes * 60.0:
            self.children.check()
            self.interruption.check()
            self.soak.samples.append(sample(now_s - begin_s, daemon, simulator))
            phase = self.status.phase
            self.soak.phases[phase] += 1
            if phase == Phase.ARRIVED:
                return
            if phase == Phase.HOLD and now_s > resume_due_s:
                resume_due_s = now_s + _RESUME_EVERY_S
                await asyncio.to_thread(ask, self.session, VEHICLE_NAME)
            elif phase == Phase.STANDBY and vehicle.state.in_air and now_s > resume_due_s:
                resume_due_s = now_s + _RESUME_EVERY_S
                await vehicle.hand_over()
            due_s += _SAMPLE_S
            await asyncio.sleep(max(0.0, due_s - time.monotonic()))

    def hear_truth(self, received: zenoh.Sample) -> None:
        """Note collisions and clearance, of which the simulator keeps count."""
        truth = json.loads(received.payload.to_bytes())
        self.soak.collisions = truth["collisions"]
        self.soak.clearance_min_m = truth["clearance_min_m"]

    def hear_event(self, received: zenoh.Sample) -> None:
        """Count legs, and note why the vehicle holds."""
        event = json.loads(received.payload.to_bytes())
        data = event.get("data", {})
        self.soak.legs += data.get("trigger") == Trigger.LEG_FLOWN
        if event["name"] == "phase" and data.get("to") == Phase.HOLD:
            self.soak.holds.append(event["text"])


async def fly(
    scenario: Scenario,
    endpoints: Endpoints,
    children: Children,
    minutes: float,
    metrics_port: int,
    interruption: Interruption,
) -> Soak:
    """Fly; return the record, the vehicle back on the ground."""
    bus = ZenohEndpoints(connect=(endpoints.daemon_zenoh, endpoints.sitl_zenoh), listen=())
    soak = Soak(time.time())
    async with connected_vehicle(
        endpoints.operator_url, interruption, START_TIMEOUT_S, children.check
    ) as vehicle:
        with open_session(bus) as session:
            status = Status()
            watch = Watch(soak, status, session, children, interruption, minutes)
            prefix = f"clearway/{VEHICLE_NAME}"
            session.declare_subscriber(f"{prefix}/status", status.receive)
            operator = Operator(vehicle, status, children, scenario.mission, lambda *_: None)
            await operator.wait_ready()
            session.declare_subscriber(f"{prefix}/truth", watch.hear_truth)
            session.declare_subscriber(f"{prefix}/events", watch.hear_event)
            await vehicle.arm()
            await vehicle.take_off(scenario.mission.altitude_m)
            await vehicle.until(
                lambda: status.airborne, READY_TIMEOUT_S, lambda: "airborne to the daemon"
            )
            await vehicle.hand_over()
            soak.began_unix_s = time.time()
            await watch.run(vehicle)
            soak.metrics = await asyncio.to_thread(scraped, metrics_port)
            await vehicle.land()
    return soak


def main() -> int:
    """Fly, print the figures, and tell by the exit code whether the soak has passed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("-o", "--output", type=Path, default=Path("build/soak"))
    options = parser.parse_args()
    out: Path = options.output
    out.mkdir(parents=True, exist_ok=True)
    scenario = soak_scenario(options.minutes)
    endpoints, metrics_port = Endpoints(*free_ports(4)), free_ports(1)[0]
    configure(scenario, endpoints, metrics_port, out)
    with interruptible() as interruption, Children() as children:
        for name, module in (("clearway-sitl", "sitl"), ("clearway-onboard", "onboard")):
            config = out / f"{module}.yaml"
            log_path = out / f"{module}.log"
            children.start(name, module, "--config", str(config), log_path=log_path)
        soak = asyncio.run(
            fly(scenario, endpoints, children, options.minutes, metrics_port, interruption)
        )
    with (out / "onboard.log").open(encoding="utf-8") as lines:
        soak.late = list(late_ticks(lines))
    return report(soak, out)


def report(soak: Soak, out: Path) -> int:
    """Print the figures and keep the samples; return the exit code."""
    rows = [list(each) for each in soak.samples]
    document = {"samples": rows, "late": soak.late, "holds": soak.holds, "metrics": soak.metrics}
    (out / "soak.json").write_text(json.dumps(document), encoding="utf-8")
    for name, text in table(soak):
        print(f"{name:<20} {text}")
    failed = list(failures(soak))
    for text in failed:
        print(f"FAILED: {text}")
    print("failed" if failed else "passed: memory is flat, and no tick was late of itself")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
