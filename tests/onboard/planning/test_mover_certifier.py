"""The certifier against movers, compared with dense sampling of body, run-on and growing boxes."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from random import Random

import numpy as np
import pytest

from gcs_tools.benchmark.run_on_models import coasting_run_on
from onboard.contract.agility import AccelerationLimits
from onboard.contract.run_on import NO_RUN_ON
from onboard.geometry.box import Box
from onboard.geometry.frames import FloatArray, LegFrame
from onboard.motion.trajectory import State, Trajectory
from onboard.planning.closed_form import brake_to_hover, stop_at
from onboard.planning.mover_certifier import Movers, Settling, mover_failures
from onboard.planning.problem import Envelope
from onboard.planning.rest_certifier import RestLimits

ENVELOPE = Envelope(AccelerationLimits(2.6, 2.6, 2.6, 2.6), 16.0, (13.0, 13.0, 6.0), 4.0)
LEG = LegFrame((5.0, -3.0, -2.0), math.radians(37.0))
LIMITS = RestLimits(0.65, 30.0, (30.0,) * 4, math.inf, 60.0, NO_RUN_ON)
SETTLING = Settling(0.3)


@dataclass(frozen=True)
class Track:
    """A mover, seen at a time."""

    id: str
    box: Box
    seen_s: float
    speed_mps: float

    def predicted(self, time_s: float, stamp_error_s: float = 0.0) -> Box:
        return self.box.inflated(self.speed_mps * (time_s - self.seen_s + stamp_error_s))


class Places:
    """What a certificate asks."""

    def free_until_s(self, places: FloatArray) -> FloatArray:
        raise AssertionError(f"no certificate asks this of {places}")


class Everywhere(Places):
    """Places without movers but those that are tracked."""

    def first_reached(self, low: FloatArray, high: FloatArray, until_s: FloatArray) -> int | None:  # noqa: ARG002  all alike
        return None


@dataclass(frozen=True)
class Until(Places):
    """A half plane (north of a line) that holds none before a time."""

    north_m: float
    time_s: float

    def first_reached(self, low: FloatArray, high: FloatArray, until_s: FloatArray) -> int | None:  # noqa: ARG002  no bound
        bad = np.flatnonzero((low[:, 0] < self.north_m) | (until_s > self.time_s))
        return int(bad[0]) if bad.size else None


@dataclass(frozen=True)
class Behind(Places):
    """A place that holds no mover before a time, and is asked about only while it is left."""

    place_ned_m: tuple[float, float, float]
    time_s: float

    def first_reached(self, low: FloatArray, high: FloatArray, until_s: FloatArray) -> int | None:
        middle = (low + high) / 2.0 - self.place_ned_m[:2]
        there = np.hypot(*middle.T) < 1e-6  # pieces that rest there
        bad = np.flatnonzero(there & (until_s > self.time_s))
        return int(bad[0]) if bad.size else None


def stop(speed_mps: float = 2.8, envelope: Envelope = ENVELOPE) -> Trajectory:
    state = State((0.0, 0.0, 0.0), (speed_mps, 0.0, 0.0))
    return brake_to_hover(state, 10.0, envelope)


def failures(
    way: Trajectory, *tracks: Track, limits: RestLimits = LIMITS, settling: Settling = SETTLING
) -> tuple[str, ...]:
    return mover_failures(way, limits, settling, LEG, Movers(Everywhere(), tracks, 0.01))


def ahead(distance_m: float, speed_mps: float = 1.5, half_m: float = 0.1) -> Track:
    """Return a mover whose box is around a point ahead on the leg, seen as the stop begins."""
    north_m, east_m, _ = LEG.position_ned((distance_m, 0.0, 0.0))
    box = Box(north_m - half_m, north_m + half_m, east_m - half_m, east_m + half_m)
    return Track("front/1", box, 10.0, speed_mps)


def rest_s(way: Trajectory) -> float:
    """Return when a way that ends in a piece at rest has come to rest."""
    return way.end_s - float(way.durations_s[-1])


def touched(way: Trajectory, track: Track, radius_m: float, settle_s: float) -> bool:
    """Tell by sampling whether the box of the body meets the mover's while the vehicle moves."""
    for time_s in np.arange(way.start_s, rest_s(way) + settle_s, 0.002):
        state = way.sample(min(float(time_s), way.end_s))
        north_m, east_m, _ = LEG.position_ned(state.position_leg_m)
        body = Box(north_m - radius_m, north_m + radius_m, east_m - radius_m, east_m + radius_m)
        if body.intersects(track.predicted(float(time_s), 0.01)):
            return True
    return False


def test_a_vehicle_at_rest_may_be_touched() -> None:
    resting = Trajectory(
        10.0, np.array((1.0,)), np.zeros((1, 3)), *(np.zeros((1, 3)) for _ in range(3))
    )
    assert failures(resting, ahead(0.0)) == ()


def test_a_mover_that_may_come_before_the_rest_speaks_against_it() -> None:
    way = stop()
    assert failures(way, ahead(30.0)) == ()
    (why,) = failures(way, ahead(3.0))
    assert why == "mover front/1 may be on the way"


@pytest.mark.parametrize("seed", range(30))
def test_it_agrees_with_sampling_but_for_the_length_of_a_piece(seed: int) -> None:
    """Never more lenient; stricter by no more than what a mover makes in a piece."""
    random = Random(seed)
    way = stop(random.uniform(0.5, 4.0))
    bearing_rad, away_m = random.uniform(-math.pi, math.pi), random.uniform(0.5, 8.0)
    at = (away_m * math.cos(bearing_rad), away_m * math.sin(bearing_rad), 0.0)
    north_m, east_m, _ = LEG.position_ned(at)
    track = Track(
        "1", Box(north_m, north_m + 0.3, east_m, east_m + 0.3), 9.8, random.uniform(0.1, 4.0)
    )
    certified = not failures(way, track)
    if certified:
        assert not touched(way, track, LIMITS.body_radius_m, SETTLING.rest_settle_s)
    else:
        # What a mover makes in a piece, the way in it, and the box around it.
        strict_m = 0.1 * track.speed_mps + 0.1 * 4.0 + 0.05
        assert touched(way, track, LIMITS.body_radius_m + strict_m, SETTLING.rest_settle_s)


def test_the_rest_lasts_until_the_vehicle_has_settled() -> None:
    way = stop()
    end_m = way.final.position_leg_m[0]
    # It reaches the place of rest after the reference is at rest, before the vehicle is.
    needed_m = end_m + 0.65 * (abs(math.cos(LEG.heading_rad)) + abs(math.sin(LEG.heading_rad)))
    near = ahead(needed_m + 1.0 * (rest_s(way) - 9.7) * 1.3 + 0.3, 1.0)
    assert failures(way, near) == ()
    assert failures(way, near, settling=Settling(3.0)) != ()


def test_the_run_on_needs_its_place_and_its_time() -> None:
    way = stop()
    run_on = coasting_run_on(
        0.5, lag_s=0.2, brake_mps2=2.63, speed_max_mps=2.8, acceleration_max_mps2=2.63
    )
    running = replace(LIMITS, run_on=run_on)
    settling = Settling(0.3, loss_s=0.7, brake_mps2=2.63)
    between = next(
        distance_m
        for distance_m in np.arange(2.0, 20.0, 0.25)
        if failures(way, ahead(float(distance_m))) == ()
    )
    slow = next(
        distance_m
        for distance_m in np.arange(2.0, 20.0, 0.25)
        if failures(way, ahead(float(distance_m), 0.1)) == ()
    )
    assert failures(way, ahead(slow, 0.1), limits=running) != ()
    assert failures(way, ahead(between), settling=settling) != ()
    assert failures(way, ahead(between + 6.0), limits=running, settling=settling) == ()


def test_a_measured_run_time_counts_for_every_setpoint() -> None:
    measured = Settling(0.3, loss_s=0.7, brake_mps2=2.63, measured_s=4.0)
    speeds = np.array((0.1, 3.0))
    assert measured.after_s(speeds, speeds).tolist() == [4.3, 4.3]
    assert Settling(0.3).after_s(speeds, speeds).tolist() == [0.0, 0.0]
    model = Settling(0.3, loss_s=0.7, brake_mps2=2.0)
    assert model.after_s(np.array((1.0,)), np.array((1.0,))).tolist() == [
        pytest.approx(0.7 + 1.7 / 2.0 + 0.3)
    ]


def test_places_are_asked_for_in_local_ned_until_the_end_of_each_piece() -> None:
    way = stop()
    for north_m, ends in ((-100.0, True), (5.0, False)):
        late, early = Until(north_m, rest_s(way) + 0.31), Until(north_m, rest_s(way) + 0.29)
        assert (mover_failures(way, LIMITS, SETTLING, LEG, Movers(late, (), 0.0)) == ()) == ends
        (why,) = mover_failures(way, LIMITS, SETTLING, LEG, Movers(early, (), 0.0))
        assert why.startswith("a mover may be on the way from ")


def test_a_pause_on_the_way_counts_until_the_vehicle_has_settled() -> None:
    """A reference that rests on its way leaves the vehicle moving for t_set, as at its end."""
    first = stop(1.0)
    first = first.until(rest_s(first))
    (x_m, _, _), rests_s = first.final.position_leg_m, first.end_s
    still = Trajectory(
        rests_s, np.array((1.0,)), np.array(((x_m, 0.0, 0.0),)), *[np.zeros((1, 3))] * 3
    )
    there = State((x_m, 0.0, 0.0), (0.0, 0.0, 0.0))
    again = stop_at(there, still.end_s, ENVELOPE, x_m + 9.0, speed_mps=2.0, z_m=0.0)
    assert again is not None
    way = first.followed_by(still).followed_by(again)
    # No mover is on the second part; where the first ends one may be from a time on.
    for later_s, stays in ((0.45, False), (0.65, True)):
        places = Behind(LEG.position_ned((x_m, 0.0, 0.0)), rests_s + later_s)
        found = mover_failures(way, LIMITS, Settling(0.5), LEG, Movers(places, (), 0.0))
        assert (found == ()) == stays
