"""One flight of a fleet: every vehicle with the whole service, in one world, over a bad network."""

from __future__ import annotations

import math
import random
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from gcs_tools.fleet.network import Network, NetworkTerms
from gcs_tools.fleet.vehicles import Join, beside, boot_of, flight_of, restarts
from gcs_tools.preflight.offline.fleet_files import Member
from onboard.autonomy import Autonomy
from onboard.events import EventName
from onboard.guidance.phases import Phase
from onboard.recording.flight_log import FlightLog
from onboard.recording.messages import EventRecord
from sitl.environment.truth_log import TruthLog
from sitl.virtual.shared_world import Contact, Resident, SharedWorld
from sitl.virtual.simulation import (
    EPOCH_UNIX_S,
    ServiceJournal,
    Simulation,
    log_metadata,
    without_cycle_collection,
)

FLIGHT_LOG: Final = "flight.mcap"
TRUTH_LOG: Final = "truth.mcap"
# Of the vehicle's own seeds.
_SEED_MAX: Final = 1 << 31


@dataclass(frozen=True)
class FlightTerms:
    """What happens in a flight.

    Attributes:
        network: how bad it is.
        restart_period_s: mean time between deaths of one daemon; infinite for none.
        time_limit_s: the flight ends then, landed or not.
    """

    network: NetworkTerms = field(default_factory=NetworkTerms)
    restart_period_s: float = 120.0
    time_limit_s: float = 300.0


@dataclass(frozen=True)
class Flown:
    """How a vehicle's flight ended.

    Attributes:
        arrived: whether it came to the end of its mission.
        arrived_s: when; None if it did not.
        ended: the phase of its service at the end.
        short_m: how far it was from the end of its mission then.
        blocked: how often it was blocked, at rest.
        restarts: of its daemon.
        apart_min_m: the least distance from its body to another's.
        aborted: why the operator gave it up; None if it landed.
    """

    arrived: bool
    arrived_s: float | None
    ended: str
    short_m: float
    blocked: int
    restarts: int
    apart_min_m: float
    aborted: str | None


@dataclass(frozen=True)
class Outcome:
    """How a flight of a fleet went.

    Attributes:
        vehicles: by name.
        contacts: of two bodies, in the order in which they began.
        ended_s: when all had landed, or two had met in motion, or the time limit.
    """

    vehicles: Mapping[str, Flown]
    contacts: tuple[Contact, ...]
    ended_s: float

    @property
    def collisions(self) -> tuple[Contact, ...]:
        """The contacts in motion."""
        return tuple(each for each in self.contacts if each.moving)


class FleetFlight:
    """One flight, advanced step by step.

    Args:
        members: the vehicles.
        terms: what happens.
        seed: of everything random.
        join: makes a daemon a member of the fleet.

    Attributes:
        now_s: virtual time.
        simulations: by name.
        world: that all share.
    """

    def __init__(
        self, members: Sequence[Member], terms: FlightTerms, seed: int, join: Join
    ) -> None:
        self._terms, self._join, self.now_s = terms, join, 0.0
        draw = self._draw = random.Random(f"fleet {seed}")
        self._network = Network[tuple[str, bytes]](
            terms.network, [each.name for each in members], draw
        )
        self.simulations: dict[str, Simulation] = {}
        self._starts: dict[str, int] = {}
        residents = {}
        for number, member in enumerate(members):
            aside_m = beside(draw, member.error_m)
            simulation = self._simulation(member, number)
            self.simulations[member.name] = simulation
            residents[member.name] = Resident(simulation, member.frame, aside_m)
        self.world = SharedWorld(residents)
        self._watched = {name: _Watched() for name in self.simulations}

    def _simulation(self, member: Member, number: int) -> Simulation:
        terms, draw = self._terms, self._draw
        faults = restarts(draw, terms.restart_period_s, terms.time_limit_s)
        flight = flight_of(
            member,
            number,
            seed=draw.randrange(_SEED_MAX),
            faults=faults,
            time_limit_s=terms.time_limit_s,
        )
        self._starts[member.name] = 0

        def equip(service: Autonomy) -> None:
            self._starts[member.name] += 1
            if member.geofence is not None:
                service.keep_in(member.geofence)
            self._join(service, member, boot_of(draw))

        return Simulation(flight, equip)

    @property
    def over(self) -> bool:
        """Whether all have landed, two have met in motion, or the time is up."""
        landed = all(simulation.over for simulation in self.simulations.values())
        collided = any(contact.moving for contact in self.world.contacts)
        return landed or collided or self.now_s >= self._terms.time_limit_s

    def advance(self) -> None:
        """Advance all by one tick of their services, 20 ms."""
        for name, (key, payload) in self._network.arrived(self.now_s):
            receiver = self.simulations[name]
            if receiver.service_runs:
                receiver.autonomy.receive_fleet(key, payload, self.now_s)
        self.world.place()
        for name, simulation in self.simulations.items():
            simulation.advance()
            self.now_s = simulation.now_s
            if simulation.service_runs:
                for message in simulation.autonomy.fleet_to_send():
                    self._network.send(name, message, self.now_s)
        self.world.observe()

    def watch(self, name: str, events: Iterable[str]) -> None:
        """Take note of the events of one vehicle's service in this step."""
        self._watched[name].watch(self.simulations[name], events)

    def outcome(self) -> Outcome:
        """Return how it went."""
        return Outcome(
            {name: self._flown(name) for name in self.simulations},
            tuple(self.world.contacts),
            self.now_s,
        )

    def _flown(self, name: str) -> Flown:
        simulation, watched = self.simulations[name], self._watched[name]
        return Flown(
            arrived=watched.arrived_s is not None,
            arrived_s=watched.arrived_s,
            ended=simulation.autonomy.navigator.phase.value,
            short_m=math.dist(
                simulation.scene.vehicle.truth.position_ned_m[:2],
                simulation.flight.mission.legs[-1].end_ned_m,
            ),
            blocked=watched.blocked,
            restarts=self._starts[name] - 1,
            apart_min_m=self.world.apart_m(name),
            aborted=simulation.aborted,
        )


class _Watched:
    """What is counted of one vehicle while it flies."""

    def __init__(self) -> None:
        self.arrived_s: float | None = None
        self.blocked = 0

    def watch(self, simulation: Simulation, events: Iterable[str]) -> None:
        phase = simulation.autonomy.navigator.phase
        if self.arrived_s is None and phase is Phase.ARRIVED:
            self.arrived_s = simulation.now_s
        self.blocked += sum(name == EventName.BLOCKED for name in events)


def fly_fleet(
    members: Sequence[Member],
    terms: FlightTerms,
    seed: int,
    join: Join,
    directory: Path | None = None,
) -> Iterator[FleetFlight]:
    """Fly one flight to its end; yield it after each step.

    Args:
        members: the vehicles.
        terms: what happens.
        seed: of everything random.
        join: makes a daemon a member of the fleet.
        directory: gets a directory for each vehicle's logs; None writes none.

    Raises:
        OSError: a log cannot be written.
    """
    flight = FleetFlight(members, terms, seed, join)
    with ExitStack() as stack:
        stack.enter_context(without_cycle_collection())
        takers = {
            name: _Logs(directory / name, simulation, stack) if directory else _Events(simulation)
            for name, simulation in flight.simulations.items()
        }
        while not flight.over:
            flight.advance()
            for name, taker in takers.items():
                flight.watch(name, taker.take())
            yield flight


class _Events:
    """Takes the events of one vehicle, and keeps no log."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation

    def take(self) -> list[str]:
        """Return the names of the events since the last step."""
        return [event.name for event in self._simulation.autonomy.events()]


class _Logs:
    """Writes both logs of one vehicle, until it has landed.

    Args:
        directory: for the logs.
        simulation: of the vehicle.
        stack: closes the logs.

    Raises:
        OSError: a log cannot be written.
    """

    def __init__(self, directory: Path, simulation: Simulation, stack: ExitStack) -> None:
        directory.mkdir(parents=True, exist_ok=True)
        self._simulation, self._journal = simulation, ServiceJournal(simulation)
        metadata, field_ = log_metadata(simulation.flight), simulation.scene.world.field
        self._flight = stack.enter_context(FlightLog(directory / FLIGHT_LOG, metadata))
        truth = TruthLog(directory / TRUTH_LOG, EPOCH_UNIX_S, field_)
        self._truth = stack.enter_context(truth)

    def take(self) -> list[str]:
        """Write what the last step has left; return the names of its events."""
        records = self._journal.collect()
        if not self._simulation.over:
            scene = self._simulation.scene
            self._flight.write(records)
            self._truth.write(scene.vehicle.truth, scene.world, scene.movers)
        return [each.name for each in records if isinstance(each, EventRecord)]
