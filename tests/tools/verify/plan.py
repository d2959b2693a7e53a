"""Which long shows are flown, in which order, and by which commands."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from tests.tools.verify.judging import (
    Judge,
    judge_ambush,
    judge_bench,
    judge_bench_small,
    judge_benchmark,
    judge_campaign,
    judge_mutants,
    judge_traceability,
)

ROOT: Final = Path(__file__).parents[3]
_SCENARIOS: Final = Path("config") / "scenarios"
# By the name of a campaign: flights, and those of the search.
_FULL: Final = {
    "adversary": (2000, 480),
    "nominal": (10_000, 0),
    "faults": (3000, 0),
    "movers": (1000, 0),
    "pedestrians": (200, 0),
    "ambush": (10, 0),
}
_SHORT: Final = {
    "adversary": (6, 8),
    "nominal": (8, 0),
    "faults": (8, 0),
    "movers": (4, 0),
    "pedestrians": (4, 0),
    "ambush": (2, 0),
}
# Of the scenario files, the short form flies every so many.
_SCENARIO_STEP: Final = 15
# Share and seed of the mutants of each part, as docs/mutation.md states them.
_MUTANTS: Final = {
    "region": (0.3, 1),
    "contract": (0.15, 1),
    "run-on": (0.3, 2),
    "seen-free": (0.085, 1),
    "certifier": (0.16, 1),
}
_MUTANTS_SHORT: Final = {"run-on": (0.03, 2)}
# One scene of each benchmark that has several is enough to show that it runs.
_SCENES_SHORT: Final = {
    "walls": "slalom",
    "forest": "500",
    "sando": "easy",
    "sando-dynamic": "easy",
    "dodgedrone": "easy_4",
}
# Something moves there, or has a height, which only the whole service flies.
_BY_SERVICE: Final = frozenset(("sando-dynamic", "dodgedrone"))
# The public benchmarks, and whether their scenes are files that are not part of the repository.
_BENCHMARKS: Final = {
    "walls": False,
    "forest": False,
    "longleaf": True,
    "competition": True,
    "sando": True,
    "sando-dynamic": True,
    "dodgedrone": True,
}


@dataclass(frozen=True)
class Step:
    """One show.

    Attributes:
        name: of it, and of its folder and log.
        command: words; the first is ``clearway`` or ``python``.
        judge: reads what it left and says what is wrong.
        skipped: why it is not run; empty if it is.
    """

    name: str
    command: tuple[str, ...]
    judge: Judge
    skipped: str = ""


@dataclass(frozen=True)
class Request:
    """What to run.

    Attributes:
        folder: of all results.
        short: the short form, which shows that the whole runs and little else.
        data: folder with the scenes of the public benchmarks; None without.
        jobs: processes of campaigns and benchmarks; None for all cores.
    """

    folder: Path
    short: bool = False
    data: Path | None = None
    jobs: int | None = None

    @property
    def _jobs(self) -> tuple[str, ...]:
        return () if self.jobs is None else ("--jobs", str(self.jobs))


def plan(request: Request) -> list[Step]:
    """Return the steps in their order: what flies, then what reads the flights."""
    return [
        *_campaigns(request),
        *_benchmarks(request),
        _bench(request),
        *_mutation(request),
        _traceability(request),
    ]


def _campaigns(request: Request) -> Iterator[Step]:
    for name, (flights, search) in (_SHORT if request.short else _FULL).items():
        searched = ("--search", str(search)) if search else ()
        size = ("--flights", str(flights), "--seed", "1", *searched)
        yield _campaign(request, name, (name,), size)
    files = sorted((ROOT / _SCENARIOS).glob("*.yaml"))[:: _SCENARIO_STEP if request.short else 1]
    names = tuple(str(_SCENARIOS / file.name) for file in files)
    yield _campaign(request, "scenarios", names, ("--flights", str(len(names))))


def _campaign(request: Request, name: str, sources: tuple[str, ...], size: tuple[str, ...]) -> Step:
    out = ("--out", str(request.folder / name))
    command = ("clearway", "campaign", *sources, *size, *request._jobs, *out)
    return Step(name, command, judge_ambush if name == "ambush" else judge_campaign)


def _benchmarks(request: Request) -> Iterator[Step]:
    for name, needs_data in _BENCHMARKS.items():
        out = ("-o", str(request.folder / f"benchmark-{name}" / "legs.parquet"))
        scene = (_SCENES_SHORT[name],) if request.short and name in _SCENES_SHORT else ()
        legs = ("--legs", "1") if request.short else ()
        data: tuple[str, ...] = ()
        skipped = ""
        if needs_data and request.data is None:
            skipped = f"the scenes of {name} are not part of the repository: give DATA=FOLDER"
        elif needs_data:
            data = ("--data", str(request.data))
        manner = ("--service",) if name in _BY_SERVICE else ()
        how = (*manner, *legs, *request._jobs)
        command = ("clearway", "benchmark", name, *scene, *data, *how, *out)
        yield Step(f"benchmark-{name}", command, judge_benchmark, skipped)


def _bench(request: Request) -> Step:
    out = ("--output", str(request.folder / "bench" / "bench.json"))
    small = ("--small", "--only", "contract") if request.short else ()
    judge = judge_bench_small if request.short else judge_bench
    return Step("bench", ("python", "-m", "tests.benchmarks", *small, *out), judge)


def _mutation(request: Request) -> Iterator[Step]:
    for part, (share, seed) in (_MUTANTS_SHORT if request.short else _MUTANTS).items():
        sample = (part, "--share", str(share), "--seed", str(seed), "--resume")
        command = ("python", "-m", "tests.tools.mutation", *sample)
        yield Step(f"mutation-{part}", command, judge_mutants)


def _traceability(request: Request) -> Step:
    campaigns = _SHORT if request.short else _FULL
    folders = [str(request.folder / name) for name in (*campaigns, "scenarios")]
    out = ("--output", str(request.folder / "traceability"))
    # So few flights break few assumptions: what is stated of other campaigns fills the rest.
    added = ("--add",) if request.short else ()
    command = ("python", "-m", "tests.tools.traceability", "--figures", *folders, *added, *out)
    return Step("traceability", command, judge_traceability)
