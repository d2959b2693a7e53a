"""``clearway campaign``: many seeded flights in virtual time, checked by oracles and counted.

Its source (a generator or a scenario file), the campaign's seed and its own number determine a
flight; the number of flights, the process and the order do not matter.  An interrupted campaign
therefore continues where it stopped, and each finding replays alone.
"""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from gcs_tools.campaign.adversary.draw import SOURCE
from gcs_tools.campaign.adversary.genes import genes_of
from gcs_tools.campaign.adversary_summary import print_adversary
from gcs_tools.campaign.flight import FlightRow, replay_command
from gcs_tools.campaign.forest import ForestSource
from gcs_tools.campaign.generator.case import FlightCase
from gcs_tools.campaign.generator.generators import GENERATORS
from gcs_tools.campaign.report import write_report
from gcs_tools.campaign.search import search_jobs, search_locally
from gcs_tools.campaign.shrink import shrink
from gcs_tools.campaign.sources import AdversarySource, FileSource, GeneratedSource, Source
from gcs_tools.campaign.statistics import CONFIDENCE, ClassSummary, summarize, total
from gcs_tools.campaign.table import read_table, write_table
from gcs_tools.campaign.workers import FlightJob, fly_locally, fly_on_cluster
from gcs_tools.console.errors import CommandError
from gcs_tools.console.output import write_text
from gcs_tools.scenario import Scenario, load_scenario, obstacle_list
from onboard.files.obstacle_field import load_field
from onboard.files.yaml_file import dump_document

# A campaign that is killed loses at most this many flights.
_ROWS_BETWEEN_WRITES: Final = 200
# Width of tables where the output is not a terminal.
_FILE_WIDTH: Final = 130
# Shrinking one flight takes at most this many.
_FLIGHTS_PER_SHRINKING: Final = 60
# Failures printed on the terminal; the table has them all.
_FAILURES_SHOWN: Final = 20


@dataclass(frozen=True)
class CampaignRequest:
    """Arguments of the command.

    Attributes:
        scenarios: names of generators, or scenario files.
        flights: in all, divided evenly among the scenarios.
        seed: of the campaign.
        only: fly only this number of every scenario.
        processes: None for all cores; ignored on a cluster.
        dask: address of a Dask scheduler.
        out: directory for the results.
        shrink: reduce this many of the failing flights to minimal scenarios.
        search: so many more flights search near the worst ones of an adversary.
        genes: of an adversary's flight that a search has found.
    """

    scenarios: tuple[str, ...]
    flights: int
    seed: int
    only: int | None = None
    processes: int | None = None
    dask: str | None = None
    out: Path | None = None
    shrink: int = 3
    search: int = 0
    genes: str = ""


def run_campaign(request: CampaignRequest) -> bool:
    """Fly a campaign; return whether no oracle has a finding in any flight.

    Writes ``flights.parquet``, ``summary.html`` and a scenario file of every failed flight to the
    output directory.  Skips flights that the table there already has.

    Raises:
        FileError: a scenario cannot be used.
        CommandError: the output cannot be written, a worker died, or no scheduler answers.
    """
    sources = [_source(name, request.genes) for name in request.scenarios]
    if (request.search or request.genes) and not _attacks(sources):
        raise CommandError(f"--search and --genes: only the scenario {SOURCE} has them")
    directory = _prepared(request)
    jobs = _jobs(sources, request)
    table = directory / "flights.parquet"
    rows = _flown_before(table, jobs)
    known = {(row.source, row.number) for row in rows}
    missing = [job for job in jobs if (job.source.name, job.number) not in known]
    console = Console(width=None if sys.stdout.isatty() else _FILE_WIDTH, highlight=False)
    if rows:
        console.print(f"{len(rows)} flights are already in {table}", soft_wrap=True)
    try:
        for row in _with_progress(_flown(missing, request), len(missing), console):
            rows.append(row)
            if len(rows) % _ROWS_BETWEEN_WRITES == 0:
                write_table(rows, table)
                if not console.is_terminal:
                    bad = sum(not each.good for each in rows)
                    console.print(f"{len(rows)} of {len(jobs)} flights, {bad} failed")
    finally:
        write_table(rows, table)
    rows += _searched(rows, request, console)
    write_table(rows, table)
    write_report(rows, directory / "summary.html")
    failed = [row for row in rows if not row.good]
    _keep_scenarios(failed, sources, directory / "failed")
    _print_summary(rows, console)
    print_adversary(rows, console)
    _print_failures(failed, console)
    _shrink_failures(failed[: request.shrink], sources, directory / "failed", console)
    console.print(f"table, report, scenarios of failed flights: {directory}", soft_wrap=True)
    return not failed


# ------------------------------------------------------------------ the flights


def _attacks(sources: Sequence[Source]) -> bool:
    return any(isinstance(source, AdversarySource) for source in sources)


def _source(name: str, genes: str = "") -> Source:
    if name == SOURCE:
        return AdversarySource(tuple(genes_of(genes).items()))
    if name in GENERATORS:
        return GeneratedSource(name)
    if Path(name).suffix.lower() == ".csv":
        load_field(Path(name))
        return ForestSource(name)
    if not Path(name).suffix:
        raise CommandError(
            f"{name}: unknown scenario; expected a scenario file, a stem map (CSV) or one of "
            f"{', '.join((*GENERATORS, SOURCE))}"
        )
    return FileSource(name, load_scenario(Path(name)))


def _prepared(request: CampaignRequest) -> Path:
    names = "-".join(Path(name).stem for name in request.scenarios[:3])
    which = request.seed if request.only is None else f"{request.seed}-{request.only}"
    directory = request.out or Path("campaigns") / f"{names}-{which}"
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CommandError(f"{directory}: cannot be written: {error.strerror or error}") from error
    return directory


def _jobs(sources: Sequence[Source], request: CampaignRequest) -> list[FlightJob]:
    if request.only is not None:
        return [FlightJob(source, request.seed, request.only) for source in sources]
    return [
        FlightJob(sources[index % len(sources)], request.seed, index // len(sources))
        for index in range(request.flights)
    ]


def _flown_before(table: Path, jobs: Sequence[FlightJob]) -> list[FlightRow]:
    """Return the requested rows that an earlier run of this campaign left."""
    if not table.exists():
        return []
    requested = {(job.source.name, job.campaign_seed, job.number) for job in jobs}
    before = read_table(table)
    rows = [row for row in before if (row.source, row.campaign_seed, row.number) in requested]
    if len(rows) < len(before):
        raise CommandError(f"{table}: has flights of another campaign: use another --out")
    return [row for row in rows if not row.genes]  # searches are repeated


def _flown(jobs: Iterable[FlightJob], request: CampaignRequest) -> Iterator[FlightRow]:
    if request.dask is not None:
        return fly_on_cluster(jobs, request.dask)
    return fly_locally(jobs, request.processes or os.cpu_count() or 1)


def _searched(
    rows: Sequence[FlightRow], request: CampaignRequest, console: Console
) -> list[FlightRow]:
    jobs = search_jobs(rows, request.search)
    found: list[FlightRow] = []
    if jobs:
        console.print(f"searching near the {len(jobs)} flights with the least margins")
    for part in search_locally(jobs, request.processes or os.cpu_count() or 1):
        found += part
    return found


def _with_progress(rows: Iterator[FlightRow], count: int, console: Console) -> Iterator[FlightRow]:
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
        bar = progress.add_task("flying", total=count)
        failed = 0
        for row in rows:
            failed += not row.good
            description = f"flying, [red]{failed} failed[/]" if failed else "flying"
            progress.update(bar, advance=1, description=description)
            yield row


# ------------------------------------------------------------------ the results


def _keep_scenarios(failed: Iterable[FlightRow], sources: Sequence[Source], place: Path) -> None:
    named = {source.name: source for source in sources}
    for number, row in enumerate(failed):
        case = _case(named[row.source], row)
        suffix = f"-search-{number}" if row.genes else ""
        path = place / f"{Path(row.source).stem}-{row.campaign_seed}-{row.number}{suffix}.yaml"
        heading = f"# {replay_command(row)}\n" + "".join(
            f"# {line}\n" for line in row.findings.splitlines()
        )
        document = scenario_document(case.scenario)
        text = dump_document(document)
        place.mkdir(exist_ok=True)
        write_text(heading + text, path)


def _shrink_failures(
    failed: Sequence[FlightRow], sources: Sequence[Source], place: Path, console: Console
) -> None:
    named = {source.name: source for source in sources}
    for row in failed:
        case = _case(named[row.source], row)
        oracles = frozenset(line.split(":", 1)[0] for line in row.findings.splitlines())
        document = scenario_document(case.scenario)
        shrunk = shrink(document, oracles, case.seed, _FLIGHTS_PER_SHRINKING)
        if shrunk is None:
            continue
        path = place / f"minimal-{Path(row.source).stem}-{row.campaign_seed}-{row.number}.yaml"
        replay = f"clearway campaign {shlex.quote(str(path))} --seed {case.seed} --only 0"
        text = dump_document(shrunk.document)
        found = "".join(f"# {line}\n" for line in shrunk.findings.splitlines())
        write_text(f"# {replay}\n{found}{text}", path)
        console.print(f"shrunk in {shrunk.flights} flights: {replay}", markup=False, soft_wrap=True)


def _case(source: Source, row: FlightRow) -> FlightCase:
    """Return the case of a row, where a search has moved it, too."""
    moved = AdversarySource(tuple(genes_of(row.genes).items())) if row.genes else source
    return moved.case(row.campaign_seed, row.number)


def scenario_document(scenario: Scenario) -> dict[str, Any]:
    """Return a scenario as the content of one YAML file, which names no other files."""
    return {
        "contract": scenario.contract.model_dump(mode="json"),
        "field": [each.model_dump(mode="json") for each in obstacle_list(scenario.obstacles)],
        "mission": scenario.mission.model_dump(mode="json"),
        "sitl": scenario.plant.model_dump(mode="json", exclude_defaults=True),
        "faults": [fault.model_dump(mode="json", exclude_none=True) for fault in scenario.faults],
        "field_known": scenario.field_known,
        "fly_outside_contract": scenario.fly_outside_contract,
        "expect": scenario.expect.model_dump(mode="json", exclude_none=True),
    }


def _print_summary(rows: Sequence[FlightRow], console: Console) -> None:
    table = Table(title=f"Bounds at {CONFIDENCE:.0%} (Clopper-Pearson)", title_justify="left")
    table.add_column("scenario")
    table.add_column("fault or breach")
    for column in ("flights", "refused", "arrived", "held", "fallback", "collided", "failed"):
        table.add_column(column, justify="right")
    table.add_column("collision rate", justify="right")
    table.add_column("clearance", justify="right")
    for each in (*summarize(rows), total(rows)):
        table.add_row(*_cells(each), style="bold red" if each.failed else "")
    console.print(table)


def _cells(each: ClassSummary) -> tuple[str, ...]:
    lower, upper = each.collision_rate
    rate = f"{lower:.2%} to {upper:.2%}" if each.collided else f"≤ {upper:.2%}"
    clearance = "" if each.clearance_min_m is None else f"{each.clearance_min_m:.2f} m"
    variant = each.variant if each.covered else f"{each.variant} (nothing promised)"
    counts = (
        each.flights,
        each.refused,
        each.arrived,
        each.held,
        each.fell_back,
        each.collided,
        each.failed,
    )
    flew = each.flights > each.refused
    return each.source, variant, *map(str, counts), rate if flew else "", clearance


def _print_failures(failed: Sequence[FlightRow], console: Console) -> None:
    for row in failed[:_FAILURES_SHOWN]:
        console.print(f"[red]failed[/] {escape(row.findings)}", soft_wrap=True)
        console.print(f"  {replay_command(row)}", markup=False, soft_wrap=True)
    if len(failed) > _FAILURES_SHOWN:
        console.print(f"… and {len(failed) - _FAILURES_SHOWN} more, in the table")
