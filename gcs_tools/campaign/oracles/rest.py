"""The oracle about the invariant: at every time a way to rest is held, certified, and truly free.

The first half reads what the service says of itself in every tick.  The second does not believe it:
it grows every way that was held by the vehicle and its tracking error, and looks for true obstacles
there, also where the vehicle never came.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np

from gcs_tools.campaign.generator.faults import MISLEADING
from gcs_tools.campaign.oracles.evidence import ROUND_OFF, Evidence
from gcs_tools.preflight.offline.heights import obstacles_in_way
from onboard.files.obstacle_field import ObstacleField
from onboard.geometry.frames import FloatArray
from onboard.guidance.phases import FLYING_PHASES, FlightState
from onboard.recording.messages import StateRecord

# A reference slower than this rests.
_AT_REST_MPS: Final = 0.01
# In these the vehicle has left the place where it took control, or may at any time.
_ON_ITS_WAY: Final = frozenset(
    {
        FlightState.CRUISING,
        FlightState.RECENTRING,
        FlightState.STOPPING,
        FlightState.AVOIDING,
        FlightState.AVOIDING_THEN_STOPPING,
        FlightState.THREADING,
    }
)


def rest_held(evidence: Evidence) -> Iterator[str]:
    """Where the contract requires to be able to stop, a certified way to rest is always held."""
    if not evidence.case.scenario.contract.requirements.stop:
        return
    unseen = True
    for state in evidence.states:
        unseen = _may_be_unseen(state, before=unseen)
        if state.phase in FLYING_PHASES and not _holds_way(state, evidence, unseen=unseen):
            certified = "not held" if state.rest_certified is None else "not certified"
            yield f"the way to rest is {certified} in {state.phase} ({state.state})"
    yield from _ways_into_obstacles(evidence)


def _may_be_unseen(state: StateRecord, *, before: bool) -> bool:
    """Tell whether the place where the vehicle rests need not have been seen free yet.

    That is so from when it takes control until it first flies along a leg, and again from when the
    set is emptied; the start of every later leg has been seen on the way there.
    """
    if state.phase not in FLYING_PHASES or state.free_cells == 0:
        return True
    return before and state.state not in _ON_ITS_WAY


def _holds_way(state: StateRecord, evidence: Evidence, *, unseen: bool) -> bool:
    """Tell whether a tick is as the invariant says.

    A vehicle that rests where it has taken control holds nothing before it has looked round; it may
    climb to its leg there, since obstacles stand at every height.  What empties the set, a doubt of
    the position for instance, leaves it the way that was certified.
    """
    if state.rest_certified is None:
        velocity_mps = state.reference_velocity_ned_mps
        at_rest = velocity_mps is not None and math.hypot(*velocity_mps[:2]) <= _AT_REST_MPS
        return unseen and at_rest
    voided = state.free_cells == 0 and not evidence.undisturbed
    return state.rest_certified or voided


def _ways_into_obstacles(evidence: Evidence) -> Iterator[str]:
    scenario = evidence.case.scenario
    misled = any(fault.kind in MISLEADING for fault in scenario.faults)
    obstacles = obstacles_in_way(scenario.obstacles, scenario.contract, scenario.mission)
    if misled or not evidence.case.covered or not len(obstacles):
        return
    vehicle = scenario.contract.vehicle
    body_m = vehicle.radius_m + vehicle.tracking_error_m
    for way in evidence.ways:
        room_m = float(distances_m(way.points_ned_m, obstacles).min())
        if room_m < body_m - ROUND_OFF:
            yield (
                f"the way to rest held at {way.time_s:.2f} s passes a true obstacle at "
                f"{room_m:.3f} m, where vehicle and tracking error take {body_m:.3f} m"
            )


def distances_m(points_ned_m: FloatArray, obstacles: ObstacleField) -> FloatArray:
    """Return the distance of points (n, 2) from each obstacle, (n, m); 0 inside."""
    offset_m = points_ned_m[:, None, :] - obstacles.center_ned_m[None, :, :]
    cosine, sine = np.cos(obstacles.yaw_rad), np.sin(obstacles.yaw_rad)
    along_m = np.abs(cosine * offset_m[..., 0] + sine * offset_m[..., 1])
    across_m = np.abs(cosine * offset_m[..., 1] - sine * offset_m[..., 0])
    outside_m = np.stack((along_m, across_m), axis=-1) - obstacles.half_size_m
    distances: FloatArray = np.hypot(*np.moveaxis(np.maximum(outside_m, 0.0), -1, 0))
    return distances
