"""One leg of a benchmark: how it is flown, what became of it, whether that passes."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gcs_tools.benchmark.planner_flight import DURATION_MAX_S, PAUSES_MAX, Flight, Outcome
from gcs_tools.benchmark.scenes import Scene
from gcs_tools.benchmark.service_flight import (
    Served,
    contract_of,
    fly_by_service,
    service_margin_m,
    service_reach_m,
)
from gcs_tools.benchmark.vehicles import Vehicle, vehicles

PLANNER, SERVICE = "planner", "service"
_ENDS: Final = {
    "stuck": f"no passage certified in {PAUSES_MAX} pauses",
    "timeout": f"still under way after {DURATION_MAX_S:g} s",
}


@dataclass(frozen=True)
class Rule:
    """When a leg passes: flown to its end, nothing touched, and far enough away.

    Attributes:
        text: in words.
        distance_min_m: of the vehicle's centre from every obstacle; None where that does not count.
        duration_max_s: from taking control to the end; infinite where that does not count.
        beside_max_m, behind_max_m: how far its centre may be from the line of the leg, and behind
            its start.
    """

    text: str
    distance_min_m: float | None = None
    duration_max_s: float = math.inf
    beside_max_m: float = math.inf
    behind_max_m: float = math.inf


@dataclass(frozen=True)
class Manner:
    """How legs are flown.

    Attributes:
        vehicle: default, ardupilot or px4.
        service: through the whole service in virtual time, not by the planner alone.
        seed: of errors; each leg has its own by its number.
        wish_m: distance to obstacles that is preferred.
        tracking_error_m: of the planner's vehicle, in place of its own.
        first_look: the planner's vehicle turns on the spot first.
        unseen_is_free: the ablation: the planner takes what was not seen as free.
    """

    vehicle: str
    service: bool = False
    seed: int = 1
    wish_m: float = 0.0
    tracking_error_m: float | None = None
    first_look: bool = False
    unseen_is_free: bool = False

    def planner_vehicle(self) -> Vehicle:
        """Return the vehicle of the planner alone."""
        vehicle = vehicles()[self.vehicle]
        if self.tracking_error_m is None:
            return vehicle
        return replace(vehicle, tracking_error_m=self.tracking_error_m)

    def seed_of(self, number: int) -> int:
        """Return the seed of one leg."""
        return int(np.random.SeedSequence((self.seed, number)).generate_state(1)[0])


@dataclass(frozen=True)
class LegRow:
    """One row of the table.

    Attributes:
        benchmark, field, leg, number: which leg of what.
        form: ``planner`` or ``service``.
        vehicle, seed: as in `Manner`.
        passable: whether a way is open on the true map, with all faces moved out by what the
            vehicle keeps from a reported face.
        arrived: whether it came to the end of the leg.
        collisions: how often contact began; the planner's flight ends with the first.
        end: in one word: arrived, stuck, timeout, collision; of the service, its outcome.
        length_m, duration_s: of the leg; of the flight, from taking control.
        speed_mps: length over duration, of legs that were flown to their end, else None.
        first_look_s: of the duration, until it set off.
        pauses: how often it stopped to look for another way.
        clearance_min_m: least distance of the hull to an obstacle, by the worst tracking error
            (planner) or as it truly flew (service); None without obstacles.
        distance_min_m: the same of the vehicle's centre.
        certified_min_m: least distance of an accepted plan, its way to rest included, beyond body
            and tracking error; None of the service.
        false_cells: points of obstacles in cells that were called free; None of the service.
        losses, losses_unsafe: instants at which the stream's end was tried, and those at which the
            run that follows touches an obstacle.
        peer_distance_m: the least distance that the benchmark's peer kept there.
        waited_s: at rest, or coming to rest, for what moves (YIELD).
        contacts_at_rest: how often something touched the vehicle at rest, which is no collision.
        beside_max_m, behind_max_m: how far from the line of the leg the vehicle's centre was, and
            how far behind its start; None of the planner.
        passed: by the benchmark's rule.
        why_not: the reason, if it did not pass.
    """

    benchmark: str
    field: str
    leg: str
    number: int
    form: str
    vehicle: str
    seed: int
    passable: bool
    arrived: bool
    collisions: int
    end: str
    length_m: float
    duration_s: float
    speed_mps: float | None
    first_look_s: float
    pauses: int
    clearance_min_m: float | None
    distance_min_m: float | None
    certified_min_m: float | None
    false_cells: int | None
    losses: int
    losses_unsafe: int
    peer_distance_m: float | None
    waited_s: float = 0.0
    contacts_at_rest: int = 0
    beside_max_m: float | None = None
    behind_max_m: float | None = None
    passed: bool = False
    why_not: str = ""


def fly_leg(benchmark: str, rule: Rule, scene: Scene, number: int, manner: Manner) -> LegRow:
    """Fly one leg and judge it; runs in a worker process."""
    row = (_by_service if manner.service else _by_planner)(benchmark, scene, number, manner)
    why_not = "; ".join(_reasons(row, rule))
    return replace(row, passed=not why_not, why_not=why_not)


def _by_planner(benchmark: str, scene: Scene, number: int, manner: Manner) -> LegRow:
    vehicle = manner.planner_vehicle()
    flight = Flight(
        scene,
        vehicle,
        manner.seed_of(number),
        unseen_is_free=manner.unseen_is_free,
        first_look=manner.first_look,
        wish_m=manner.wish_m,
    )
    outcome: Outcome = flight.fly()
    arrived = outcome.end == "arrived"
    clearance_m = _finite(outcome.clearance_min_m)
    return LegRow(
        benchmark=benchmark,
        field=scene.field,
        leg=scene.name,
        number=number,
        form=PLANNER,
        vehicle=manner.vehicle,
        seed=manner.seed,
        passable=scene.passable(vehicle.body_radius_m + vehicle.face_error_m),
        arrived=arrived,
        collisions=int(outcome.end == "collision"),
        end=outcome.end,
        length_m=scene.length_m,
        duration_s=outcome.duration_s,
        speed_mps=outcome.speed_mps(scene.length_m) if arrived else None,
        first_look_s=outcome.first_look_s,
        pauses=outcome.pauses,
        clearance_min_m=clearance_m,
        distance_min_m=None if clearance_m is None else clearance_m + vehicle.radius_m,
        certified_min_m=_finite(outcome.certified_min_m),
        false_cells=outcome.false_cells,
        losses=outcome.losses,
        losses_unsafe=outcome.losses_unsafe,
        peer_distance_m=scene.peer_distance_m,
    )


def _by_service(benchmark: str, scene: Scene, number: int, manner: Manner) -> LegRow:
    contract = contract_of(scene, manner.vehicle, manner.wish_m)
    served: Served = fly_by_service(
        scene,
        number,
        vehicle=manner.vehicle,
        seed=manner.seed_of(number),
        wish_m=manner.wish_m,
    )
    result, radius_m = served.result, contract.vehicle.radius_m
    arrived = result.outcome == "arrived"
    clearance_m = result.clearance_min_m
    return LegRow(
        benchmark=benchmark,
        field=scene.field,
        leg=scene.name,
        number=number,
        form=SERVICE,
        vehicle=manner.vehicle,
        seed=manner.seed,
        passable=scene.passable(
            service_margin_m(scene, manner.vehicle), service_reach_m(scene, manner.vehicle)
        ),
        arrived=arrived,
        collisions=result.collisions,
        end=result.outcome if arrived else _why_it_ended(served),
        length_m=scene.length_m,
        duration_s=result.duration_s,
        speed_mps=scene.length_m / max(result.duration_s, 1.0) if arrived else None,
        first_look_s=served.first_look_s,
        # The look before it sets off is one, too.
        pauses=max(result.pauses - 1, 0),
        clearance_min_m=clearance_m,
        distance_min_m=None if clearance_m is None else clearance_m + radius_m,
        certified_min_m=None,
        false_cells=None,
        losses=0,
        losses_unsafe=0,
        peer_distance_m=scene.peer_distance_m,
        waited_s=served.waited_s,
        contacts_at_rest=result.contacts_at_rest,
        beside_max_m=served.beside_max_m,
        behind_max_m=served.behind_max_m,
    )


def _why_it_ended(served: Served) -> str:
    """Return outcome and reason, and what it waited for."""
    result = served.result
    waited = f", {served.wait_reason}" if served.wait_reason else ""
    return f"{result.outcome}: {result.reason}{waited}"


def _reasons(row: LegRow, rule: Rule) -> list[str]:
    """Return why a leg does not pass; nothing if it does."""
    if row.collisions:
        return ["touched an obstacle"]
    reasons = []
    if not row.arrived:
        closed = "" if row.passable else ", and no way is open on the map"
        reasons.append(_ENDS.get(row.end, row.end) + closed)
    near_m, least_m = row.distance_min_m, rule.distance_min_m
    if near_m is not None and least_m is not None and near_m < least_m:
        reasons.append(f"{near_m:.2f} m from an obstacle, less than {least_m:g} m")
    return reasons + _strayed(row, rule)


def _strayed(row: LegRow, rule: Rule) -> list[str]:
    """Return by how much time or place a leg is beyond its rule; nothing if it is not."""
    bounds = (
        (row.duration_s, rule.duration_max_s, "s of flight"),
        (row.beside_max_m, rule.beside_max_m, "m beside the line"),
        (row.behind_max_m, rule.behind_max_m, "m behind the start"),
    )
    return [
        f"{value:.1f} {what}, more than {limit:g}"
        for value, limit, what in bounds
        if value is not None and value > limit
    ]


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
