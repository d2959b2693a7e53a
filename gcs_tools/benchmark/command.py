"""``clearway benchmark``: fly public scenes, judge each leg by their rule, report beside peers."""

from __future__ import annotations

import bisect
import os
import shlex
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rich.console import Console

from gcs_tools.benchmark.legs import LegRow, Manner, Rule, fly_leg
from gcs_tools.benchmark.page import write_section
from gcs_tools.benchmark.scenes import Scene, Selection
from gcs_tools.benchmark.service_flight import SERVICE_VEHICLES
from gcs_tools.benchmark.suites import Benchmark, benchmark_named
from gcs_tools.benchmark.summary import Run, print_tables
from gcs_tools.benchmark.vehicles import vehicles
from gcs_tools.console.errors import CommandError
from gcs_tools.console.parquet_file import schema_of, write_rows
from gcs_tools.console.progress import tracked
from gcs_tools.console.worker_pool import run_locally

# Width of tables where the output is not a terminal.
_FILE_WIDTH: Final = 150
# A benchmark that is killed loses at most this many legs.
_ROWS_BETWEEN_WRITES: Final = 5

_Job = tuple[str, Rule, Scene, int, Manner]


@dataclass(frozen=True)
class BenchmarkRequest:
    """Arguments of the command.

    Attributes:
        name: of the benchmark.
        scenes: which of its scenes; none means all.
        data: file or folder of its scenes.
        legs: of each scene; None for the benchmark's own number.
        every: fly each Nth leg only.
        seed: of what is drawn, and of errors.
        processes: None for all cores.
        vehicle: None for default, or with the service ardupilot.
        service: through the whole service instead of by the planner alone.
        wish_m: distance to obstacles to prefer; None for the benchmark's own.
        tracking_error_m, first_look, unseen_is_free: of the planner alone, as in `Manner`.
        output: Parquet file to write.
        page: Markdown page of which to write this benchmark's section.
    """

    name: str
    scenes: tuple[str, ...] = ()
    data: Path | None = None
    legs: int | None = None
    every: int = 1
    seed: int = 1
    processes: int | None = None
    vehicle: str | None = None
    service: bool = False
    wish_m: float | None = None
    tracking_error_m: float | None = None
    first_look: bool = False
    unseen_is_free: bool = False
    output: Path | None = None
    page: Path | None = None


def run_benchmark(request: BenchmarkRequest) -> bool:
    """Fly a benchmark; return whether nothing was touched that may not be.

    The ablation is flown to show that something is.

    Raises:
        FileError: a data file cannot be used.
        CommandError: the request makes no sense, or the output cannot be written.
    """
    benchmark = benchmark_named(request.name)
    manner = _manner(benchmark, request)
    _check_outputs(request)
    jobs = list(_jobs(benchmark, manner, request))
    rows: list[LegRow] = []
    try:
        for row in tracked(_flown(jobs, request), len(jobs), request.name):
            bisect.insort(rows, row, key=lambda each: each.number)
            if request.output is not None and len(rows) % _ROWS_BETWEEN_WRITES == 0:
                write_rows(rows, schema_of(LegRow), request.output)
    finally:
        if rows:  # an interrupted benchmark reports what was flown
            _report(Run(benchmark, manner, command_line(request), rows, len(jobs)), request)
    return request.unseen_is_free or not any(row.collisions for row in rows)


def _flown(jobs: Sequence[_Job], request: BenchmarkRequest) -> Iterator[LegRow]:
    return run_locally(fly_leg, jobs, request.processes or os.cpu_count() or 1)


def _report(run: Run, request: BenchmarkRequest) -> None:
    console = Console(width=None if sys.stdout.isatty() else _FILE_WIDTH, highlight=False)
    print_tables(run, console)
    if request.output is not None:
        write_rows(run.rows, schema_of(LegRow), request.output)
    if request.page is not None:
        write_section(request.page, run)


def command_line(request: BenchmarkRequest) -> str:
    """Return the command that flies the same legs; the data's place is not part of it."""
    words = ["clearway", "benchmark", request.name, *request.scenes]
    options = {
        "--data": None if request.data is None else "DATA",
        "--legs": request.legs,
        "--every": None if request.every == 1 else request.every,
        "--seed": None if request.seed == 1 else request.seed,
        "--vehicle": request.vehicle,
        "--clearance-wish": request.wish_m,
        "--tracking-error": request.tracking_error_m,
    }
    for option, value in options.items():
        words += [] if value is None else [option, f"{value}"]
    flags = {
        "--service": request.service,
        "--first-look": request.first_look,
        "--ablation unseen-is-free": request.unseen_is_free,
    }
    return " ".join((shlex.join(words), *(flag for flag, is_set in flags.items() if is_set)))


def _manner(benchmark: Benchmark, request: BenchmarkRequest) -> Manner:
    vehicle = request.vehicle or ("ardupilot" if request.service else "default")
    known = SERVICE_VEHICLES if request.service else vehicles()
    if vehicle not in known:
        raise CommandError(
            f"--vehicle {vehicle}: expected {' or '.join(sorted(known))}"
            f"{' with --service' if request.service else ''}"
        )
    if benchmark.service_only and not request.service:
        raise CommandError(f"{benchmark.name}: only the whole service flies it: add --service")
    if request.service and (
        request.tracking_error_m is not None or request.first_look or request.unseen_is_free
    ):
        raise CommandError(
            "--tracking-error, --first-look and --ablation are of the planner alone, "
            "not of --service"
        )
    return Manner(
        vehicle=vehicle,
        service=request.service,
        seed=request.seed,
        wish_m=benchmark.wish_m if request.wish_m is None else request.wish_m,
        tracking_error_m=request.tracking_error_m,
        first_look=request.first_look,
        unseen_is_free=request.unseen_is_free,
    )


def _check_outputs(request: BenchmarkRequest) -> None:
    """Refuse before the flights what could not be written after them."""
    for option, path, suffix in (
        ("-o", request.output, ".parquet"),
        ("--page", request.page, ".md"),
    ):
        if path is None:
            continue
        if path.suffix != suffix:
            raise CommandError(f"{option} {path}: expected a name that ends in {suffix}")
        if path.is_dir() or not path.parent.is_dir():
            raise CommandError(f"{option} {path}: cannot be written: {path.parent} is no folder")


def _jobs(benchmark: Benchmark, manner: Manner, request: BenchmarkRequest) -> Iterator[_Job]:
    legs = benchmark.legs if request.legs is None else request.legs
    selection = Selection(request.scenes, request.data, legs, request.seed)
    numbered = enumerate(benchmark.scenes(selection))
    chosen = [(scene, number) for number, scene in numbered if number % request.every == 0]
    if not chosen:
        raise CommandError(f"{benchmark.name}: the data have no leg to fly")
    for scene, number in chosen:
        yield benchmark.name, benchmark.rule, scene, number, manner
