"""The benchmarks: their scenes, their rule, and what peers report of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

from gcs_tools.benchmark.formats import read_box_scenes, read_forest, read_pillars, read_ways
from gcs_tools.benchmark.legs import Rule
from gcs_tools.benchmark.moving_scenes import moving_legs, sphere_legs
from gcs_tools.benchmark.scenes import (
    PILLARS_HALF_WIDTH_M,
    WALLS,
    Scene,
    Selection,
    blocked_legs,
    data_of,
    drawn_walls,
    expect_no_data,
    expect_no_scenes,
    file_of,
    forest_legs,
    found_in,
    pillar_legs,
    random_forest,
)
from gcs_tools.benchmark.world_file import read_world
from gcs_tools.console.errors import CommandError

_SANDO_LEG_M: Final = 105.0
_DIFFICULTIES: Final = ("easy", "medium", "hard")
_DENSITIES: Final = ("500", "1000", "1500")
_DENSITY_MAX_PER_HA: Final = 10_000.0
_LONGLEAF_LEG_M, _FOREST_LEG_M = 60.0, 50.0
_ARRIVES: Final = Rule("the leg is flown to its end and nothing is touched")


class Peer(NamedTuple):
    """What another system did.

    Attributes:
        name: of the system.
        reported: the figure, in words.
        source: who reports it.
    """

    name: str
    reported: str
    source: str


@dataclass(frozen=True)
class Benchmark:
    """One benchmark.

    Attributes:
        name: on the command line.
        title: for people.
        scenes: yields the legs of a selection.
        rule: when a leg passes.
        legs: of each scene, unless the command says otherwise.
        wish_m: distance to obstacles that is preferred, unless the command says otherwise.
        origin: whose scenes these are, with the licence, and how they are flown here.
        differences: what is not as in the peers' tests.
        peers: what others report.
        service_only: whether only the whole service flies them: something moves, or obstacles have
            heights.
        moves: whether something does.
    """

    name: str
    title: str
    scenes: Callable[[Selection], Iterator[Scene]]
    rule: Rule
    legs: int
    origin: str
    differences: str
    peers: tuple[Peer, ...]
    wish_m: float = 0.0
    service_only: bool = False
    moves: bool = False


def benchmark_named(name: str) -> Benchmark:
    """Return a benchmark.

    Raises:
        CommandError: there is none of that name.
    """
    if name not in BENCHMARKS:
        raise CommandError(f"{name}: unknown benchmark; expected one of {', '.join(BENCHMARKS)}")
    return BENCHMARKS[name]


# ------------------------------------------------------------------ the scenes of each


def _sando(selection: Selection) -> Iterator[Scene]:
    for path in _sando_files(selection):
        pillars = (read_world if path.suffix == ".world" else read_pillars)(path)
        yield from pillar_legs(
            path.stem, pillars, _SANDO_LEG_M, selection.legs, PILLARS_HALF_WIDTH_M
        )


def _sando_files(selection: Selection) -> list[Path]:
    data = data_of(selection, "sando")
    moving = next((each for each in (*selection.scenes, data.name) if "dynamic" in each), None)
    if moving is not None:
        raise CommandError(f"sando {moving}: its boxes move: fly the benchmark sando-dynamic")
    wrong = next((each for each in selection.scenes if each not in _DIFFICULTIES), None)
    if wrong is not None:
        raise CommandError(
            f"sando: unknown scene {wrong!r}; expected one of {', '.join(_DIFFICULTIES)}"
        )
    if not data.is_dir():
        return [data]
    wanted = selection.scenes or _DIFFICULTIES
    found = [
        found_in(data, f"static_{each}.csv", "sando")
        or found_in(data, f"{each}_forest.world", "worlds")
        for each in wanted
    ]
    missing = [f"static_{each}.csv" for each, path in zip(wanted, found, strict=True) if not path]
    if missing and (selection.scenes or len(missing) == len(wanted)):
        raise CommandError(f"{data}: has no {' or '.join(missing)} of SANDO")
    return [path for path in found if path is not None]


def _sando_dynamic(selection: Selection) -> Iterator[Scene]:
    data, known = data_of(selection, "sando-dynamic"), _DIFFICULTIES[:2]
    wrong = next((each for each in selection.scenes if each not in known), None)
    if wrong is not None:
        raise CommandError(
            f"sando-dynamic: unknown scene {wrong!r}; expected one of {', '.join(known)}"
        )
    for each in selection.scenes or known:
        path = file_of(data, f"dynamic_{each}.json", "sando")
        yield from moving_legs(path, selection.legs)
        if path == data:  # the file itself is named
            return


def _dodgedrone(selection: Selection) -> Iterator[Scene]:
    for path in _sphere_files(selection):
        yield from sphere_legs(path, selection.legs)


def _sphere_files(selection: Selection) -> list[Path]:
    data = data_of(selection, "dodgedrone")
    if not data.is_dir():
        return [data]
    places = (data / "benchmarks" / "dodgedrone", data / "dodgedrone", data)
    known = {path.stem: path for place in places for path in sorted(place.glob("*_*.csv"))}
    named = {each: [stem for stem in known if stem.startswith(each)] for each in _DIFFICULTIES}
    wanted = selection.scenes or _DIFFICULTIES
    found = [known[stem] for name in wanted for stem in named.get(name, [name]) if stem in known]
    if not found or not all(named.get(name, name in known) for name in selection.scenes):
        raise CommandError(
            f"{data}: has no such scenes of DodgeDrone: expected files easy_0.csv, ..., and as "
            f"scenes easy, medium, hard or the name of a file; got {' '.join(wanted)}"
        )
    return found


def _competition(selection: Selection) -> Iterator[Scene]:
    expect_no_scenes("competition", selection)
    data = data_of(selection, "competition")
    path = file_of(data, "two_box_scenes.csv", "uav_testing_competition")
    scenes = list(read_box_scenes(path))
    ways = read_ways(path.with_name("missions.json"))
    return blocked_legs(path.stem, scenes, ways, selection.legs)


def _longleaf(selection: Selection) -> Iterator[Scene]:
    expect_no_scenes("longleaf", selection)
    path = file_of(data_of(selection, "longleaf"), "longleaf_pines.csv", "longleaf")
    forest = read_forest(path)
    return forest_legs(path.stem, forest, _LONGLEAF_LEG_M, selection.legs, selection.seed)


def _forest(selection: Selection) -> Iterator[Scene]:
    expect_no_data("forest", selection)
    for text in selection.scenes or _DENSITIES:
        density = _density(text)
        forest = random_forest(density, selection.seed)
        name = f"{density:g} stems/ha"
        yield from forest_legs(name, forest, _FOREST_LEG_M, selection.legs, selection.seed)


def _walls(selection: Selection) -> Iterator[Scene]:
    expect_no_data("walls", selection)
    if not selection.scenes:
        raise CommandError(f"walls: name the scenes to fly: {WALLS}")
    for scene in map(drawn_walls, selection.scenes):
        for _ in range(selection.legs):  # the errors of the faces differ
            yield scene


def _density(text: str) -> float:
    try:
        density = float(text)
    except ValueError:
        density = math.nan
    if not 0.0 < density <= _DENSITY_MAX_PER_HA:
        raise CommandError(
            f"forest: {text!r} is not a density [stems/ha] above 0 and up to "
            f"{_DENSITY_MAX_PER_HA:g}"
        )
    return density


# ------------------------------------------------------------------ what each is

BENCHMARKS: Final = {
    each.name: each
    for each in (
        Benchmark(
            name="sando",
            title="SANDO, static forests",
            scenes=_sando,
            rule=_ARRIVES,
            legs=10,
            origin=(
                "Upright cylinders of 1.0 to 1.5 m radius, 41 (easy) and 81 (medium), from "
                "[mit-acl/sando](https://github.com/mit-acl/sando), `worlds/*.world`, BSD-3; one "
                "leg of 105 m, flown several times with other errors of the faces"
            ),
            differences=(
                "The peers fly a box of 0.2 m at up to 5 m/s, and over and under; here the radius "
                "is 0.3 m, the tracking error 0.35 m, the speed 2.8 m/s, the height constant."
            ),
            peers=(
                Peer("SANDO", "100 % without collision", "its repository and paper, 2026"),
                Peer("MIGHTY", "100 % without collision", "SANDO's paper, 2026"),
            ),
        ),
        Benchmark(
            name="sando-dynamic",
            title="SANDO, moving boxes",
            scenes=_sando_dynamic,
            rule=Rule(
                "the leg is flown to its end, and nothing touches the vehicle while it moves"
            ),
            legs=5,
            service_only=True,
            moves=True,
            origin=(
                "50 (easy) and 100 (medium) boxes in a strip of 105 m by 12 m, as "
                "[mit-acl/sando](https://github.com/mit-acl/sando), `scripts/run_sim.py`, BSD-3, "
                "draws them with seeds 0 to 4; 65 % are cubes of 0.8 m that go along trefoil knots "
                "at up to 0.95 m/s, the rest beams of 4 m that stand still. What moves is declared "
                "with the speed that the file gives it, rounded up to 0.05 m/s"
            ),
            differences=(
                "The peers fly over and under boxes that rise and sink by up to 2 m, at up to "
                "5 m/s. Here every box and beam is a pillar over all heights, since beside heights "
                "a contract covers movers below the flight only; a leg may leave the strip, as far "
                "as 18 m from its line, as it may in the static forests, and the legs flown so far "
                "do: they pass beside most boxes, not between them; the speed "
                "is 2 m/s, and of a mover nothing is known but its class. Where one may come "
                "before the vehicle rests, it waits (YIELD)."
            ),
            peers=(
                Peer(
                    "SANDO",
                    "highest success of those that it compares, no violation",
                    "its repository and paper, 2026",
                ),
            ),
        ),
        Benchmark(
            name="dodgedrone",
            title="DodgeDrone, spheres at all heights",
            scenes=_dodgedrone,
            rule=Rule(
                "it comes to 17 m ahead within 60 s, nothing is touched, and it is never farther "
                "than 15 m beside the line nor 5 m behind the start",
                duration_max_s=60.0,
                beside_max_m=15.0,
                behind_max_m=5.0,
            ),
            legs=3,
            service_only=True,
            origin=(
                "Up to 30 (easy), 60 (medium) and 90 (hard) spheres of up to 3.9 m diameter in "
                "15 m by 20 m by 10 m, in the format of the ICRA 2022 DodgeDrone competition "
                "([uzh-rpg/agile_flight](https://github.com/uzh-rpg/agile_flight), MIT), as "
                "DESS flies them ([thethaibinh/agile_flight]"
                "(https://github.com/thethaibinh/agile_flight)), each scene flown three times with "
                "other errors of faces and heights; the rule is DESS's. The competition's own, for "
                "its longer fields with spheres that move: from x = 0 past x = 60 m within 30 s, "
                "with x from -5 to 65 m, y from -10 to 10 m and z from 0 to 10 m"
            ),
            differences=(
                "The peer climbs to 5 m and flies in three dimensions, over and under spheres, at "
                "up to 5 m/s; passing x = 17 m anywhere is enough. Here each sphere is the box "
                "around it, the flight stays at 2.5 m, the middle of what the generator of the "
                "scenes keeps clear at the start, whatever the scene, and ends at (17, 0); spheres "
                "out of the band of heights that it may fill are not in its way. Passable is of "
                "that height. The sensor sees 120° wide, and 60° up and down; the word that the "
                "start is clear is the operator's. What does not pass arrives later than the rule "
                "allows: it stops and looks around wherever what it would fly through has not been "
                "seen free."
            ),
            peers=(Peer("DESS", "99.1 % easy, 89.7 % medium, 84.9 % hard", "Nguyen et al., 2023"),),
        ),
        Benchmark(
            name="competition",
            title="UAV Testing Competition, two boxes",
            scenes=_competition,
            rule=Rule(
                "the leg is flown to its end with the vehicle's centre at 1.5 m or more from "
                "every box (less than 0.25 m counts as a crash)",
                1.5,
            ),
            legs=100_000,
            wish_m=1.5,
            origin=(
                "Scenes that tools generated to make PX4-Avoidance fail, from the "
                "[UAV Testing Competition](https://github.com/skhatiri/UAV-Testing-Competition), "
                "MIT; every leg of its missions that a scene blocks and whose ends are 3 m clear"
            ),
            differences=(
                "The peers fly whole missions in Gazebo with cameras; here each leg is flown for "
                "itself, with a wish for 1.5 m of clearance. A peer's distance is of the scene's "
                "own mission."
            ),
            peers=(
                Peer(
                    "PX4-Avoidance",
                    "fails in 2 to 20 of 20 tests, by tool and case",
                    "reports of the competition",
                ),
                Peer("EGO-Planner", "crashes in 25 % of random scenes", "forks of the competition"),
            ),
        ),
        Benchmark(
            name="longleaf",
            title="Longleaf pines, a real forest",
            scenes=_longleaf,
            rule=_ARRIVES,
            legs=40,
            origin=(
                "584 stems of an inventory of longleaf pines, 146 a hectare but clumped; legs of "
                "60 m anywhere, in any direction, with clear ends and a corridor of ±9 m"
            ),
            differences="The peer flew in another pine forest, with a real vehicle and cameras.",
            peers=(
                Peer(
                    "Jarin-Lipschitz et al.",
                    "flies in a real pine forest at 2.5 m/s",
                    "their paper, 2022",
                ),
            ),
        ),
        Benchmark(
            name="forest",
            title="Uniform forests",
            scenes=_forest,
            rule=_ARRIVES,
            legs=12,
            origin=(
                "Stems of 0.1 to 0.4 m diameter, placed uniformly in a square of 120 m, by the "
                "seed; legs of 50 m anywhere, in any direction, with clear ends and a corridor of "
                "±9 m"
            ),
            differences=(
                "No peer reports these forests; the figures are of other fields, for scale."
            ),
            peers=(
                Peer(
                    "FASTER",
                    "7.8 m/s on hardware, with a safe way held",
                    "Tordesillas et al., 2022",
                ),
            ),
        ),
        Benchmark(
            name="walls",
            title="Doors, slaloms, an S, a trap",
            scenes=_walls,
            rule=_ARRIVES,
            legs=5,
            origin="Walls drawn for Clearway: what is passed, and how narrow it may be",
            differences="These scenes are ours; no peer has flown them.",
            peers=(),
        ),
    )
}
