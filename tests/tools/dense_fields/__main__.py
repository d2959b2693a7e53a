"""Fly the planner for dense fields through true fields, at the level of references.

``python -m tests.tools.dense_fields FIELD.csv|DENSITY|SCENE… --legs N --seed S``: a file of stems,
of pillars or of two-box scenes, a density [stems/ha], or slalom, slalom-tight, s:GAP, door:WIDTH,
trap.  ``--service`` flies them through the whole service in virtual time instead.  Exits with 1 if
something was hit that may not be hit.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from tests.tools.dense_fields.flight import Flight, Outcome
from tests.tools.dense_fields.scenes import Scene, scenes_of
from tests.tools.dense_fields.service import Served, fly_by_service, margin_m, sum_of
from tests.tools.dense_fields.vehicles import vehicles


class Flown(NamedTuple):
    """One leg, and what became of it.

    Attributes:
        scene: the leg.
        passable: whether a way is open on the map that the margin grows.
        roomy: whether one is open where the wish for clearance grows it, too.
        outcome: of the flight.
    """

    scene: Scene
    passable: bool
    roomy: bool
    outcome: Outcome

    @property
    def arrived(self) -> bool:
        """Whether it came to the end of the leg."""
        return self.outcome.end == "arrived"


def main() -> int:
    """Fly the chosen fields; return 1 after a collision, unless the ablation provokes it."""
    options = _parser().parse_args()
    if options.service:
        return _fly_by_service(options)
    vehicle = vehicles()[options.vehicle]
    if options.tracking_error is not None:
        vehicle = replace(vehicle, tracking_error_m=options.tracking_error)
    margin_m, wish_m = vehicle.body_radius_m + vehicle.face_error_m, options.clearance_wish
    hit = 0
    for source in options.fields:
        flown: list[Flown] = []
        for number, scene in enumerate(scenes_of(source, options.legs, options.seed)):
            if number % options.every:
                continue
            flight = Flight(
                scene,
                vehicle,
                number,
                unseen_is_free=options.ablation == "unseen-is-free",
                first_look=options.first_look,
                wish_m=wish_m,
            )
            open_ways = scene.passable(margin_m), scene.passable(margin_m + wish_m)
            flown.append(Flown(scene, *open_ways, flight.fly()))
            print(f"{source} {scene.name}: {_row(flown[-1])}", flush=True)
        print(f"{source}: {_sum(flown, wish_m)}", flush=True)
        hit += sum(one.outcome.end == "collision" for one in flown)
    return int(hit > 0 and options.ablation is None)


def _fly_by_service(options: argparse.Namespace) -> int:
    wish_m, hit = options.clearance_wish, 0
    for source in options.fields:
        flown: list[tuple[bool, Served]] = []
        for number, scene in enumerate(scenes_of(source, options.legs, options.seed)):
            if number % options.every:
                continue
            served = fly_by_service(scene, number, wish_m=wish_m)
            flown.append((scene.passable(margin_m()), served))
            word = "passable" if flown[-1][0] else "closed"
            print(f"{source} {scene.name}: {word}, {served.row()}", flush=True)
        print(f"{source}: {sum_of(flown)}", flush=True)
        hit += sum(served.result.collisions for _, served in flown)
    return int(hit > 0)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("fields", nargs="+", metavar="FIELD", help="file, density or scene")
    parser.add_argument("--legs", type=int, default=10)
    parser.add_argument("--every", type=int, default=1, metavar="N", help="fly each Nth leg only")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--vehicle", choices=sorted(vehicles()), default="default")
    parser.add_argument("--tracking-error", type=float, help="E [m], instead of the vehicle's")
    parser.add_argument("--clearance-wish", type=float, default=0.0, help="[m], to be preferred")
    parser.add_argument("--service", action="store_true", help="through the whole service")
    parser.add_argument("--first-look", action="store_true", help="turn on the spot first")
    parser.add_argument("--ablation", choices=("unseen-is-free",))
    return parser


def _row(flown: Flown) -> str:
    scene, outcome = flown.scene, flown.outcome
    return (
        f"{'passable' if flown.passable else 'closed'}, {outcome.end}, "
        f"{outcome.speed_mps(scene.length_m):.2f} m/s "
        f"({outcome.speed_mps(scene.length_m, with_first_look=False):.2f} without the first look), "
        f"{outcome.pauses} pauses, clearance {outcome.clearance_min_m:+.2f} m, "
        f"certified {outcome.certified_min_m:+.3f} m, {outcome.false_cells} false cells, "
        f"{outcome.losses_unsafe}/{outcome.losses} losses unsafe, {_times(outcome.plan_s)}"
    )


def _sum(flown: list[Flown], wish_m: float) -> str:
    outcomes = [one.outcome for one in flown]
    passable = [one for one in flown if one.passable]
    arrived = [one for one in flown if one.arrived]
    first = [one.outcome.speed_mps(one.scene.length_m) for one in arrived]
    bare = [o.speed_mps(scene.length_m, with_first_look=False) for scene, *_, o in arrived]
    slices_ms = 1e3 * np.array([one for o in outcomes for one in o.slice_s])
    guides_ms = 1e3 * np.array([one for o in outcomes for one in o.guide_s])
    return (
        f"{len(flown)} legs, {len(passable)} passable, "
        f"{sum(one.arrived for one in passable)} of these arrived, "
        f"{sum(o.end == 'collision' for o in outcomes)} collisions, {_wished(flown, wish_m)}"
        f"mean {np.mean(first) if first else 0.0:.2f} m/s "
        f"({np.mean(bare) if bare else 0.0:.2f} without the first look), "
        f"{sum(o.pauses for o in outcomes) / len(flown):.1f} pauses a leg, "
        f"clearance {min(o.clearance_min_m for o in outcomes):+.2f} m, "
        f"certified {min(o.certified_min_m for o in outcomes):+.3f} m, "
        f"{sum(o.false_cells for o in outcomes)} false cells, "
        f"{sum(o.losses_unsafe for o in outcomes)}/{sum(o.losses for o in outcomes)} losses "
        f"unsafe, {_times([one for o in outcomes for one in o.plan_s])}, "
        f"slice p99 {np.percentile(slices_ms, 99):.1f} max {slices_ms.max():.1f} ms, "
        f"guide slice p99 {np.percentile(guides_ms, 99):.1f} ms"
    )


def _wished(flown: list[Flown], wish_m: float) -> str:
    if wish_m == 0.0:
        return ""
    roomy = [one for one in flown if one.roomy]
    kept = sum(one.arrived and one.outcome.clearance_min_m >= wish_m for one in roomy)
    return f"{len(roomy)} passable with {wish_m:g} m, {kept} of these arrived with it, "


def _times(seconds: list[float]) -> str:
    p50, p99 = np.percentile(seconds, (50, 99)) * 1e3
    return f"plan p50 {p50:.1f} p99 {p99:.1f} max {max(seconds) * 1e3:.1f} ms"


if __name__ == "__main__":
    sys.exit(main())
