"""What a vehicle has leave for: all of a way and of its run-on in the tube, at rest in time."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from gcs_tools.benchmark.run_on_models import coasting_run_on
from onboard.contract.agility import AccelerationLimits
from onboard.contract.run_on import NO_RUN_ON
from onboard.fleet.area import along
from onboard.geometry.frames import FloatArray, LegFrame
from onboard.guidance.movers.leave import leave_failures
from onboard.motion.trajectory import State, Trajectory
from onboard.planning.closed_form import stop_at
from onboard.planning.mover_certifier import Settling, moving_until_s
from onboard.planning.problem import Envelope
from onboard.planning.rest_certifier import RestLimits
from onboard.planning.tube_certifier import lies_in_tube, occupied_ned_m

ENVELOPE = Envelope(AccelerationLimits(2.6, 2.6, 2.6, 2.6), 16.0, (13.0, 13.0, 6.0), 4.0)
BODY_M = 0.65
LEG = LegFrame((5.0, -3.0, -2.0), math.radians(37.0))
LIMITS = RestLimits(BODY_M, 30.0, (30.0,) * 4, math.inf, 60.0, NO_RUN_ON)
RUN_ON = coasting_run_on(
    0.5, lag_s=0.3, brake_mps2=2.6, speed_max_mps=3.0, acceleration_max_mps2=2.6
)
RUNNING_ON = replace(LIMITS, run_on=RUN_ON)
SETTLING = Settling(0.3)
BEGIN_S, LENGTH_M = 100.0, 12.0
REST = State((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def ahead(length_m: float = LENGTH_M) -> Trajectory:
    """Return a way along the leg, from rest to rest."""
    way = stop_at(REST, BEGIN_S, ENVELOPE, length_m, speed_mps=3.0, z_m=0.0)
    assert way is not None
    return way


def tube(length_m: float, half_m: float) -> FloatArray:
    """Return boxes along the leg, as leave is asked for them."""
    ends = [LEG.position_ned((x_m, 0.0, 0.0))[:2] for x_m in (0.0, length_m)]
    return along(ends[0], ends[1], half_m, 6)


@dataclass
class Granted:
    """Leave, as a member of a fleet states it."""

    tube_m: FloatArray
    expires_s: float = math.inf
    stranger: str | None = None
    asked: list[float] = field(default_factory=list)

    def who_may_come(self, area_m: FloatArray, until_s: float) -> str | None:
        assert area_m.shape[1] == 4
        self.asked.append(until_s)
        return self.stranger

    def waits_for(self) -> str:
        return "waiting for leave of them"


def test_a_way_in_the_tube_has_leave() -> None:
    assert leave_failures(ahead(), LIMITS, SETTLING, LEG, Granted(tube(LENGTH_M, 1.5))) == ()


@pytest.mark.parametrize(
    "tube_m",
    [tube(LENGTH_M - 2.0, 1.5), tube(LENGTH_M, BODY_M - 0.01), np.zeros((0, 4))],
    ids=["too short", "narrower than the body", "none"],
)
def test_a_way_that_leads_out_of_the_tube_has_none(tube_m: FloatArray) -> None:
    found = leave_failures(ahead(), LIMITS, SETTLING, LEG, Granted(tube_m))
    assert found == ("waiting for leave of them",)


def test_the_run_on_has_to_be_in_the_tube() -> None:
    """If the stream ends on the way, the vehicle comes to rest in what it has leave for."""
    tube_m = tube(LENGTH_M, BODY_M + 0.05)
    assert lies_in_tube(ahead(), LIMITS, LEG, tube_m)
    assert not lies_in_tube(ahead(), RUNNING_ON, LEG, tube_m)
    assert lies_in_tube(ahead(), RUNNING_ON, LEG, tube(LENGTH_M + 4.0, 3.0))


def test_it_rests_settled_before_the_leave_ends() -> None:
    way = ahead()
    rests_s = moving_until_s(way, SETTLING)
    assert rests_s is not None
    times_s = np.arange(way.start_s, way.end_s, 0.01)
    moving_s = max(t for t in times_s if math.hypot(*way.sample(float(t)).velocity_leg_mps) > 0.01)
    assert 0.0 <= rests_s - moving_s - SETTLING.rest_settle_s < 0.12
    in_time, late = Granted(tube(LENGTH_M, 1.5), rests_s + 1e-3), Granted(tube(12.0, 1.5), rests_s)
    assert leave_failures(way, LIMITS, SETTLING, LEG, in_time) == ()
    assert leave_failures(way, LIMITS, SETTLING, LEG, late) == ("waiting for leave of them",)
    assert in_time.asked == [rests_s]


def test_who_has_left_its_tube_may_come() -> None:
    granted = Granted(tube(LENGTH_M, 1.5), stranger="south")
    found = leave_failures(ahead(), LIMITS, SETTLING, LEG, granted)
    assert found == ("south has left its tube and may come",)


def test_who_only_rests_needs_no_leave() -> None:
    at_rest = Trajectory(
        BEGIN_S, np.ones(1), np.zeros((1, 3)), *(np.zeros((1, 3)) for _ in range(3))
    )
    assert leave_failures(at_rest, LIMITS, SETTLING, LEG, Granted(np.zeros((0, 4)), 0.0)) == ()


@pytest.mark.parametrize("limits", [LIMITS, RUNNING_ON])
def test_what_is_occupied_holds_the_body_wherever_it_is(limits: RestLimits) -> None:
    way = ahead()
    boxes_m = occupied_ned_m(way, BODY_M, limits.run_on, LEG)
    for time_s in np.linspace(way.start_s, way.end_s, 60):
        state = way.sample(float(time_s))
        for kappa_s, c_s2 in ((0.0, 0.0), *limits.run_on.gains):
            place_leg_m = [p + kappa_s * v + c_s2 * a for p, v, a in zip(*state, strict=True)]
            north_m, east_m, _ = LEG.position_ned((place_leg_m[0], place_leg_m[1], 0.0))
            corner_m = np.array(
                (north_m - BODY_M, north_m + BODY_M, east_m - BODY_M, east_m + BODY_M)
            )
            inside = (boxes_m[:, 0::2] <= corner_m[0::2]) & (corner_m[1::2] <= boxes_m[:, 1::2])
            assert inside.all(axis=1).any()
