"""An identification flight of the bundled simulator in virtual time, without sockets."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from gcs_tools.identify.flight.free_air import FreeAir
from gcs_tools.identify.flight.pilot import IdentificationPilot, Notice, Stage
from gcs_tools.identify.flight.programme import programme
from gcs_tools.identify.flight.records import event_record, state_record
from onboard.contract.assessment import TICK_S, assess
from onboard.files.contract_file import Contract
from onboard.files.obstacle_field import ObstacleField
from onboard.geometry.fence import Fence
from onboard.mavlink.endpoint import MavlinkEndpoint
from onboard.recording.messages import Record
from sitl.config import SitlConfig
from sitl.plant.truth import VehicleTruth
from sitl.vehicle.scene import Scene
from sitl.vehicle.vehicle import TICK_RATE_HZ, warm_up
from sitl.virtual.scripted_operator import Operator, Step

EPOCH_UNIX_S = 1_790_000_000.0
ONBOARD_LINK, OPERATOR_LINK = 0, 1
TELEMETRY_DELAY_S = 0.01


@dataclass
class VirtualFlight:
    """A simulated vehicle, its operator, and the pilot under test; `advance` is one tick."""

    contract: Contract
    sitl: SitlConfig
    air: FreeAir
    run_on: bool = False
    fence: Fence | None = None
    altitude_m: float = 5.0
    now_s: float = 0.0
    records: list[Record] = field(default_factory=list)
    notices: list[Notice] = field(default_factory=list)
    truths: list[tuple[VehicleTruth, Stage]] = field(default_factory=list)

    def __post_init__(self) -> None:
        warm_up()
        nothing = ObstacleField.of([])
        self.scene = Scene(self.sitl, nothing, EPOCH_UNIX_S, round(TICK_S * TICK_RATE_HZ))
        self.link = MavlinkEndpoint(self.sitl.system_id)
        flown = programme(assess(self.contract), self.air, None, run_on=self.run_on)
        self.pilot = IdentificationPilot(self.link, flown, self.fence)
        self.operator = Operator(self.sitl.system_id, self.altitude_m)
        self._steps = 0

    def advance(self) -> None:
        self._steps += 1
        self.now_s = self._steps * TICK_S
        self.scene.advance(self.now_s)
        vehicle = self.scene.vehicle
        telemetry = vehicle.bytes_to_send(ONBOARD_LINK)
        self.link.receive(telemetry, self.now_s - TICK_S + TELEMETRY_DELAY_S)
        self.pilot.tick(self.now_s)
        vehicle.receive(self.link.bytes_to_send(), ONBOARD_LINK)
        notices = self.pilot.take_notices()
        self.notices += notices
        self.records.append(state_record(self.pilot, self.link, self.now_s, EPOCH_UNIX_S))
        self.records += [event_record(each, EPOCH_UNIX_S) for each in notices]
        self.truths.append((vehicle.truth, self.pilot.stage))
        if self._steps % 5 == 0:
            self.operator.receive(vehicle.bytes_to_send(OPERATOR_LINK))
            self.operator.advance(self.now_s)
            vehicle.receive(self.operator.bytes_to_send(), OPERATOR_LINK)

    def fly(self, until: Callable[[], bool], limit_s: float = 300.0) -> None:
        while not until():
            assert self.now_s < limit_s, (self.pilot.stage, self.operator.step, self.notices)
            self.advance()

    def fly_all(self) -> None:
        """Fly the programme, land, and end."""
        self.fly(lambda: self.pilot.ended != "")
        self.operator.land()
        self.fly(lambda: self.operator.step is Step.DONE)
        self.fly(lambda: self.pilot.over)
