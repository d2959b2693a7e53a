"""``clearway fleet simulate``: flies a fleet's missions by the protocol, in many bad episodes.

A shortcut in place of the whole service, which does not fly by it yet: the protocol is
`onboard.fleet`, but the vehicles are point masses on the lines of their missions, without
obstacles, sensors or planner (`gcs_tools.fleet.flyer`).
"""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape

from gcs_tools.console.output import Format, write_document
from gcs_tools.console.progress import progress_bar
from gcs_tools.fleet.episode import Episode, EpisodeTerms, Outcome
from gcs_tools.fleet.flyer import Flyer, FlyerTerms
from gcs_tools.preflight.offline.fleet_files import Member, read_fleet
from onboard.fleet.area import Place
from onboard.fleet.fleet_file import Fleet
from onboard.fleet.messages import Message
from onboard.fleet.reservation import OwnVehicle
from onboard.fleet.wire import FleetWire


@dataclass(frozen=True)
class SimulateRequest:
    """Arguments of the command.

    Attributes:
        fleet: the fleet's file.
        episodes: how many.
        seed: of the first.
        terms: what happens in each.
        ahead_m: how much of its way a vehicle asks for at a time.
    """

    fleet: Path
    episodes: int
    seed: int
    terms: EpisodeTerms
    ahead_m: float


@dataclass(frozen=True)
class Simulated:
    """How all episodes went.

    Attributes:
        vehicles: of the fleet.
        outcomes: by seed.
    """

    vehicles: int
    outcomes: dict[int, Outcome]

    @property
    def collided(self) -> tuple[int, ...]:
        """Seeds of the episodes in which two vehicles touched while one moved."""
        return tuple(seed for seed, each in self.outcomes.items() if each.contacts)

    def document(self) -> dict[str, Any]:
        """Return the result as JSON values."""
        outcomes = tuple(self.outcomes.values())
        return {
            "episodes": len(outcomes),
            "collided_seeds": list(self.collided),
            "vehicles_flown": self.vehicles * len(outcomes),
            "vehicles_arrived": sum(each.arrived for each in outcomes),
            "all_arrived": sum(each.arrived == self.vehicles for each in outcomes),
            "times_blocked": sum(each.blocked for each in outcomes),
            "restarts": sum(each.restarts for each in outcomes),
            "flown_s": sum(each.ended_s for each in outcomes),
            "protocol": dict(sum((each.counts for each in outcomes), Counter[str]())),
        }


def simulate_fleet(request: SimulateRequest, *, form: Format, output: Path | None) -> bool:
    """Fly all episodes, write the result, tell whether no two vehicles touched.

    Raises:
        FileError: a file cannot be used.
        CommandError: the output cannot be written.
    """
    fleet, members = read_fleet(request.fleet)
    ways = ways_of(members)
    outcomes: dict[int, Outcome] = {}
    with progress_bar("simulating", request.episodes) as bar:
        for number in range(request.episodes):
            seed = request.seed + number
            outcomes[seed] = _episode(fleet, members, ways, request, seed).run()
            bar.show(number + 1, f"episode {number + 1} of {request.episodes}")
    simulated = Simulated(len(members), outcomes)
    document = {
        "fleet": str(request.fleet),
        "terms": asdict(request.terms),
        **simulated.document(),
    }
    write_document(document, partial(_print, simulated, request), form=form, path=output)
    return not simulated.collided


def ways_of(members: Sequence[Member]) -> dict[str, list[Place]]:
    """Return the polyline of each mission, by name, in the local frame of the first vehicle."""
    common, ways = members[0].frame, {}
    for member in members:
        mission, frame = member.mission, member.frame
        places = [mission.start_ned_m, *(leg.end_ned_m for leg in mission.legs)]
        if frame != common:
            places = [
                common.north_east_m(*frame.latitude_longitude_deg(*place)) for place in places
            ]
        ways[member.name] = places
    return ways


def _episode(
    fleet: Fleet,
    members: Sequence[Member],
    ways: dict[str, list[Place]],
    request: SimulateRequest,
    seed: int,
) -> Episode:
    draw, flyers = random.Random(seed), {}
    for member in members:
        terms = member.assessment.terms
        own = OwnVehicle(member.name, "", terms.body_m + member.error_m, fleet.speed_max_mps)
        flyer = FlyerTerms(
            own,
            radius_m=terms.radius_m,
            cruise_mps=terms.cruise_speed_mps,
            accel_mps2=member.assessment.limits.brake_mps2,
            settle_s=terms.rest_settle_s or terms.attitude_lag_s,
            ahead_m=request.ahead_m,
        )
        flyers[member.name] = Flyer(flyer, ways, ways[member.name], draw)
    contracts = {each.name: each.assessment.contract.sha256 for each in members}
    wire = FleetWire(members[0].frame, contracts)

    def carried(message: Message) -> Message:
        return wire.decoded(message.head.sender, *wire.encoded(message))

    return Episode(flyers, request.terms, draw, carried)


def _print(simulated: Simulated, request: SimulateRequest, console: Console) -> None:
    document, network = simulated.document(), request.terms.network
    collided = simulated.collided
    verdict = "[bold green]NO CONTACT[/]"
    if collided:
        seeds = ", ".join(map(str, collided[:10]))
        verdict = f"[bold red]CONTACT[/] in {len(collided)} of {request.episodes} episodes"
        verdict += f" (seeds {seeds})"
    console.print(
        f"{verdict}  {escape(str(request.fleet))}: {document['episodes']} episodes of "
        f"{simulated.vehicles} point masses",
        soft_wrap=True,
    )
    console.print(
        f"network: {network.loss:.0%} of the messages lost, a quarter late by up to "
        f"{network.delay_max_s:g} s, in two parts {network.partition_share:.0%} of the time; "
        f"{document['restarts']} daemons restarted in flight",
        soft_wrap=True,
    )
    console.print(
        f"{document['vehicles_arrived']} of {document['vehicles_flown']} vehicles arrived within "
        f"{request.terms.duration_s:g} s (all of them in {document['all_arrived']} episodes); "
        f"BLOCKED at rest {document['times_blocked']} times",
        soft_wrap=True,
    )
