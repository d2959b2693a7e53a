"""``clearway fleet fly``: flies a fleet by the whole service in virtual time, once or often."""

from __future__ import annotations

import functools
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from gcs_tools.console.errors import CommandError
from gcs_tools.console.output import write_text
from gcs_tools.console.progress import progress_bar
from gcs_tools.console.worker_pool import run_locally
from gcs_tools.fleet.flight import FLIGHT_LOG, TRUTH_LOG, FlightTerms, Outcome, fly_fleet
from gcs_tools.fleet.joining import joining
from gcs_tools.fleet.vehicles import Join, require_preflight
from gcs_tools.logs.flight_log import read_log
from gcs_tools.logs.result import result_of
from gcs_tools.preflight.offline.fleet_files import Member, read_fleet
from sitl.autopilot.flavours.parameters import ParameterError
from sitl.vehicle.vehicle import warm_up

SUMMARY: Final = "fleet.json"
_FAILURES_SHOWN: Final = 10


@dataclass(frozen=True)
class FlyRequest:
    """Arguments of the command.

    Attributes:
        fleet: the fleet's file.
        episodes: how many flights; more than one leave no logs.
        seed: of the first.
        terms: what happens in each.
        processes: that fly them.
        out: directory for what is written; None for one in ``flights``.
    """

    fleet: Path
    episodes: int
    seed: int
    terms: FlightTerms
    processes: int
    out: Path | None

    @property
    def directory(self) -> Path:
        """Where the results go."""
        last = "" if self.episodes == 1 else f"-{self.seed + self.episodes - 1}"
        return self.out or Path("flights") / f"{self.fleet.stem}-{self.seed}{last}"


def fly_fleet_file(request: FlyRequest) -> bool:
    """Fly all flights, write and print the result, tell whether no two vehicles met in motion.

    Raises:
        FileError: a file cannot be used.
        CommandError: a pre-flight check refuses, the output cannot be written, a process died.
    """
    _joined.cache_clear()
    members, _ = _joined(request.fleet)
    require_preflight(members)
    directory, console = request.directory, Console(highlight=False)
    try:
        directory.mkdir(parents=True, exist_ok=True)
        outcomes = _logged(request, directory) if request.episodes == 1 else _many(request)
    except (OSError, ParameterError) as error:
        raise CommandError(f"{directory}: {error}") from error
    document = {
        "fleet": str(request.fleet),
        "terms": asdict(request.terms),
        "flights": {str(seed): _document(outcomes[seed]) for seed in sorted(outcomes)},
    }
    write_text(json.dumps(document, indent=2, allow_nan=False) + "\n", directory / SUMMARY)
    _print(request, outcomes, console)
    if request.episodes == 1:
        _print_vehicles(outcomes[request.seed], console)
        console.print(f"logs of each vehicle: {directory}", soft_wrap=True, markup=False)
    return not any(outcome.collisions for outcome in outcomes.values())


# ------------------------------------------------------------------ the flights


def _logged(request: FlyRequest, directory: Path) -> dict[int, Outcome]:
    """Fly one flight, and leave logs and result of each vehicle."""
    members, _ = _joined(request.fleet)
    with progress_bar("flying in virtual time", request.terms.time_limit_s) as bar:
        outcome = _flown(request, request.seed, directory, bar.show)
    for member in members:
        logs = directory / member.name
        flight, truth = read_log(logs / FLIGHT_LOG), read_log(logs / TRUTH_LOG)
        result = result_of(
            flight,
            truth,
            seed=request.seed,
            aborted=outcome.vehicles[member.name].aborted,
            progress=member.assessment.contract.requirements.progress,
        )
        result.write(logs / "result.json")
    return {request.seed: outcome}


def _many(request: FlyRequest) -> dict[int, Outcome]:
    jobs = ((request, request.seed + number) for number in range(request.episodes))
    outcomes: dict[int, Outcome] = {}
    with progress_bar("flying in virtual time", request.episodes) as bar:
        for seed, outcome in run_locally(fly_episode, jobs, request.processes):
            outcomes[seed] = outcome
            bar.show(len(outcomes), f"flight {len(outcomes)} of {request.episodes}")
    return outcomes


def fly_episode(request: FlyRequest, seed: int) -> tuple[int, Outcome]:
    """Fly one flight of several, without logs; return its seed, too."""
    return seed, _flown(request, seed)


@functools.cache
def _joined(path: Path) -> tuple[tuple[Member, ...], Join]:
    """Read the files of a fleet, once per process: they may change while it flies."""
    _, members = read_fleet(path)
    return members, joining(path, members)


def _flown(
    request: FlyRequest,
    seed: int,
    directory: Path | None = None,
    show: Callable[[float], None] = lambda _: None,
) -> Outcome:
    warm_up()  # once per process, so that no flight includes loading compiled code
    members, join = _joined(request.fleet)
    flight = None
    for flight in fly_fleet(members, request.terms, seed, join, directory):
        show(flight.now_s)
    assert flight is not None  # noqa: S101  the time limit is above 0
    return flight.outcome()


# ------------------------------------------------------------------ what is said


def _document(outcome: Outcome) -> dict[str, Any]:
    return {
        "ended_s": outcome.ended_s,
        "vehicles": {name: asdict(flown) for name, flown in outcome.vehicles.items()},
        "contacts": [
            {**contact._asdict(), "moving": contact.moving} for contact in outcome.contacts
        ],
    }


def _print(request: FlyRequest, outcomes: Mapping[int, Outcome], console: Console) -> None:
    collided = sorted(seed for seed, each in outcomes.items() if each.collisions)
    verdict = "[bold green]NO CONTACT IN MOTION[/]"
    if collided:
        seeds = ", ".join(map(str, collided[:_FAILURES_SHOWN]))
        verdict = f"[bold red]CONTACT IN MOTION[/] in {len(collided)} of {len(outcomes)} flights"
        verdict += f" (seeds {seeds})"
    console.print(f"{verdict}  {escape(str(request.fleet))}", soft_wrap=True)
    for line in _sums(request, outcomes):
        console.print(line, soft_wrap=True, markup=False)


def _sums(request: FlyRequest, outcomes: Mapping[int, Outcome]) -> Iterator[str]:
    network, flown = (
        request.terms.network,
        [each for outcome in outcomes.values() for each in outcome.vehicles.values()],
    )
    yield (
        f"network: {network.loss:.0%} of the messages lost, a quarter late by up to "
        f"{network.delay_max_s:g} s, in two parts {network.partition_share:.0%} of the time; "
        f"{sum(each.restarts for each in flown)} daemons restarted in flight"
    )
    all_arrived = sum(
        all(each.arrived for each in outcome.vehicles.values()) for outcome in outcomes.values()
    )
    at_rest = sum(len(outcome.contacts) - len(outcome.collisions) for outcome in outcomes.values())
    yield (
        f"{sum(each.arrived for each in flown)} of {len(flown)} vehicles arrived within "
        f"{request.terms.time_limit_s:g} s (all of them in {all_arrived} of {len(outcomes)} "
        f"flights); BLOCKED at rest {sum(each.blocked for each in flown)} times"
    )
    nearest_m, seed = min(
        (min(each.apart_min_m for each in outcome.vehicles.values()), seed)
        for seed, outcome in outcomes.items()
    )
    yield (
        f"least distance between two bodies: {nearest_m:.2f} m (seed {seed}); "
        f"contacts at rest: {at_rest}"
    )


def _print_vehicles(outcome: Outcome, console: Console) -> None:
    table = Table("vehicle", "", box=None, padding=(0, 2, 0, 0))
    for column in ("BLOCKED", "restarts", "nearest peer (m)"):
        table.add_column(column, justify="right")
    for name, flown in outcome.vehicles.items():
        how = "landed" if flown.aborted is None else f"waiting ({flown.ended})"
        ended = f"{how} {flown.short_m:.0f} m before its end"
        if flown.arrived_s is not None:
            ended = f"arrived after {flown.arrived_s:.0f} s"
        numbers = (str(flown.blocked), str(flown.restarts), f"{flown.apart_min_m:.2f}")
        table.add_row(escape(name), escape(ended), *numbers)
    console.print(table)
    for contact in outcome.contacts:
        how = "in motion" if contact.moving else "at rest"
        pair, (one_mps, other_mps) = " and ".join(contact.pair), contact.speeds_mps
        console.print(
            f"contact {how}: {pair} after {contact.time_s:.2f} s, at {one_mps:.2f} and "
            f"{other_mps:.2f} m/s",
            style="red" if contact.moving else "",
            markup=False,
            soft_wrap=True,
        )
