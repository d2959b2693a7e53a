"""What an adversary has left of each promise of a contract: below zero, the promise is broken.

Each margin is a distance to the nearest true obstacle, in metres, less what the promise takes.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np

from gcs_tools.campaign.adversary.run_on import runs_m
from gcs_tools.campaign.oracles.evidence import Evidence
from gcs_tools.campaign.oracles.rest import distances_m
from onboard.geometry.frames import FloatArray
from onboard.guidance.phases import FLYING_PHASES

# Points of runs compared with all obstacles at once.
_AT_ONCE: Final = 20_000


class Margin(NamedTuple):
    """The least margin of one promise in a flight.

    Attributes:
        promise: ``clearance``: the vehicle touches nothing; ``rest``: every way to rest that was
            held is free for vehicle and tracking error; ``plan``: so is every avoidance that was
            flown, or, where a way to rest is held, all of the reference that was flown: what a
            plan intends beyond the space seen is flown only as far as it certifies; ``run_on``:
            so is the run after the daemon dies, in every tick.
        metres: what is left.
    """

    promise: str
    metres: float


def least_margin(evidence: Evidence) -> Margin | None:
    """Return the least margin of a flight; None where nothing was flown or nothing stands."""
    return min(margins(evidence), key=lambda margin: margin.metres, default=None)


def margins(evidence: Evidence) -> Iterator[Margin]:
    """Yield the least margin of every promise that the flight's contract makes."""
    scenario = evidence.case.scenario
    vehicle, requirements = scenario.contract.vehicle, scenario.contract.requirements
    if evidence.result.clearance_min_m is None or not len(scenario.obstacles):
        return
    yield Margin("clearance", evidence.result.clearance_min_m)
    body_m = vehicle.radius_m + vehicle.tracking_error_m
    if requirements.stop and evidence.ways:
        points_m = np.concatenate([way.points_ned_m for way in evidence.ways])
        yield Margin("rest", _nearest_m(points_m, evidence) - body_m)
    states = _setpoints(evidence)
    path_m = states[:, 0] if requirements.stop else _planned_m(evidence)
    if len(path_m):
        yield Margin("plan", _nearest_m(path_m, evidence) - body_m)
    if requirements.passive_safety and len(states):
        points_m = runs_m(vehicle, states).reshape(-1, 2)
        yield Margin("run_on", _nearest_m(points_m, evidence) - body_m)


def _planned_m(evidence: Evidence) -> FloatArray:
    """Return the points, (n, 2), of every avoidance that was flown."""
    plans = [plan for plan in evidence.flight.plans if plan.kind != "brake"]
    return np.array([point[:2] for plan in plans for point in plan.path_ned_m]).reshape(-1, 2)


def _nearest_m(points_ned_m: FloatArray, evidence: Evidence) -> float:
    obstacles = evidence.case.scenario.obstacles
    parts = range(0, len(points_ned_m), _AT_ONCE)
    return min(
        float(distances_m(points_ned_m[begin : begin + _AT_ONCE], obstacles).min())
        for begin in parts
    )


def _setpoints(evidence: Evidence) -> FloatArray:
    """Return position, velocity and acceleration of every setpoint that was flown, (n, 3, 2)."""
    found = [
        (
            state.reference_position_ned_m[:2],
            state.reference_velocity_ned_mps[:2],
            state.reference_acceleration_ned_mps2[:2],
        )
        for state in evidence.states
        if state.phase in FLYING_PHASES
        and state.reference_position_ned_m is not None
        and state.reference_velocity_ned_mps is not None
        and state.reference_acceleration_ned_mps2 is not None
    ]
    return np.array(found).reshape(-1, 3, 2)
