"""Who comes near a cruise was in view first: the clause `passive_in_view` against pursuers.

Each adversary ends where it would touch the vehicle before it rests, braking from now on, and comes
from there backwards by a way of its own.  The clause says that it came into range within the view,
and stayed there for the reaction time; in a narrower view some do not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from onboard.contract import movers
from onboard.contract.arithmetic import SCALAR
from onboard.contract.assessment import derive
from onboard.contract.movers import NO_VIEW_RAD, NOSE_TOLERANCE_RAD, Stop, in_view_rad, stop_of
from onboard.contract.terms import Terms
from onboard.geometry.frames import FloatArray
from tests.onboard.contract.test_movers import contract

ADVERSARIES = 3000
STEP_S = 0.02


@dataclass(frozen=True)
class Cruise:
    """A vehicle in a steady cruise, and the view that its clause requires.

    Attributes:
        terms: of its contract.
        stop: how it comes to rest.
        drift_mps: w.
        view_rad: as required.
    """

    terms: Terms[float]
    stop: Stop[float]
    drift_mps: float
    view_rad: float


def cruising(mover_mps: float, speed_mps: float, range_m: float, brake_deg: float) -> Cruise:
    """Return a cruise without passive safety: then the clause has nothing to spare."""
    base = Terms.of(contract(requirements__passive_safety=False))
    tilt_rad = math.radians(brake_deg)
    terms = replace(
        base,
        cruise_speed_mps=speed_mps,
        detection_range_m=range_m,
        roll_max_rad=tilt_rad,
        pitch_max_rad=tilt_rad,
    )
    derived = derive(terms, SCALAR)
    stop = stop_of(terms, derived, SCALAR)
    view_rad = in_view_rad(terms, derived, stop, mover_mps, SCALAR)
    return Cruise(terms, stop, derived.manoeuvre_encounter.lateral_speed_mps, view_rad)


def unit(angle_rad: FloatArray) -> FloatArray:
    return np.stack((np.cos(angle_rad), np.sin(angle_rad)), axis=1)


def touching(cruise: Cruise, mover_mps: float, draw: np.random.Generator) -> FloatArray:
    """Return where movers are, from the vehicle, who may touch it if it begins to brake now."""
    stop, count = cruise.stop, ADVERSARIES
    dead_s = cruise.terms.reaction_time_s + stop.lag_s
    least_mps = cruise.terms.cruise_speed_mps - cruise.terms.velocity_error_x_mps
    speed_mps = draw.choice((least_mps, stop.speed_mps), count)
    at_s = draw.uniform(0.0, 1.0, count) * (dead_s + speed_mps / stop.brake_mps2)
    braking_s = np.maximum(at_s - dead_s, 0.0)
    made_m = speed_mps * at_s - stop.brake_mps2 * braking_s**2 / 2.0
    at_s += np.where(draw.random(count) < 0.5, stop.rest_settle_s, 0.0)
    aside_m = draw.choice((-1.0, 1.0), count) * cruise.drift_mps * at_s
    from_rad = draw.uniform(-math.pi, math.pi, count)
    reach_m = mover_mps * at_s + stop.fixed_m
    return np.stack((made_m, aside_m), axis=1) + reach_m[:, None] * unit(from_rad)


def unseen(cruise: Cruise, mover_mps: float, share: float, seed: int) -> int:
    """Return how many who may touch were out of view in the reaction time from range on."""
    draw = np.random.default_rng(seed)
    place_m = touching(cruise, mover_mps, draw)
    least_mps = cruise.terms.cruise_speed_mps - cruise.terms.velocity_error_x_mps
    velocity_mps = np.stack(
        (
            draw.choice((least_mps, cruise.stop.speed_mps), ADVERSARIES),
            draw.choice((-1.0, 1.0), ADVERSARIES) * cruise.drift_mps,
        ),
        axis=1,
    )
    # Straight on, or as slowly as possible across the line of alpha; some wander.
    alpha_rad = math.asin((mover_mps + cruise.drift_mps) / least_mps)
    across_rad = draw.choice((-1.0, 1.0), ADVERSARIES) * (math.pi / 2.0 + alpha_rad)
    any_rad = draw.uniform(-math.pi, math.pi, ADVERSARIES)
    heads_rad = np.where(draw.random(ADVERSARIES) < 0.5, across_rad, any_rad)
    axis_rad = draw.choice((-1.0, 1.0), ADVERSARIES) * NOSE_TOLERANCE_RAD
    half_rad = share * (cruise.view_rad / 2.0 - cruise.terms.heading_error_rad)
    range_m, needed = cruise.terms.detection_range_m, cruise.terms.reaction_time_s
    steps = math.ceil((range_m + 12.0) / (least_mps - mover_mps) / STEP_S)
    distances_m, outside = [], []
    for step in range(steps):
        if step % 25 == 0:
            wander_rad = np.where(any_rad > 2.0, draw.normal(0.0, 1.0, ADVERSARIES), 0.0)
        place_m = place_m + (velocity_mps - mover_mps * unit(heads_rad + wander_rad)) * STEP_S
        distances_m.append(np.hypot(*place_m.T))
        off_rad = np.arctan2(place_m[:, 1], place_m[:, 0]) - axis_rad
        outside.append(np.abs((off_rad + math.pi) % (2.0 * math.pi) - math.pi) > half_rad + 1e-9)
    assert (np.array(distances_m)[-1] > range_m).all()
    # Backwards: the first step beyond the range, and the reaction time before it.
    entered = np.argmax(np.array(distances_m) > range_m, axis=0)
    late = math.ceil(needed / STEP_S)
    rows = np.arange(steps)[:, None]
    within = (rows < entered) & (rows >= entered - late)
    return int((np.array(outside) & within).any(axis=0).sum())


@given(
    mover_mps=st.floats(0.2, 1.5),
    speed=st.floats(2.2, 5.0),
    range_m=st.floats(10.0, 30.0),
    brake_deg=st.floats(10.0, 30.0),
    seed=st.integers(0, 2**16),
)
@settings(max_examples=4, deadline=None)
def test_every_pursuer_who_may_touch_came_into_range_in_view(
    mover_mps: float, speed: float, range_m: float, brake_deg: float, seed: int
) -> None:
    cruise = cruising(mover_mps, speed * (mover_mps + 0.4), range_m, brake_deg)
    if cruise.view_rad < NO_VIEW_RAD:
        assert unseen(cruise, mover_mps, 1.0, seed) == 0


def test_in_a_narrower_view_some_come_unseen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(movers, "RASTER_M", 0.0)
    for mover_mps, speed_mps in ((0.5, 2.8), (1.0, 4.0)):
        cruise = cruising(mover_mps, speed_mps, 15.0, 15.0)
        assert cruise.view_rad < math.radians(150.0)
        assert unseen(cruise, mover_mps, 1.0, 3) == 0
        assert unseen(cruise, mover_mps, 0.75, 3) > 0
        assert unseen(cruise, mover_mps, 0.5, 3) > 100


def test_the_table_of_the_theory(monkeypatch: pytest.MonkeyPatch) -> None:
    """T1c, half views from 20 m on at 15 degrees: without drift and tolerances."""
    monkeypatch.setattr(movers, "RASTER_M", 0.0)
    for mover_mps, speed_mps, range_m, half_deg in (
        (0.5, 2.0, 20.0, 20.0), (0.5, 2.8, 20.0, 15.0), (0.5, 4.0, 20.0, 12.0),
        (0.5, 8.0, 20.0, 10.0), (1.5, 4.0, 20.0, 30.0), (1.5, 6.0, 20.0, 24.0),
        (1.5, 8.0, 22.7, 21.0),
    ):  # fmt: skip
        cruise = cruising(mover_mps, speed_mps, range_m, 15.0)
        base = replace(cruise.terms, rest_settle_s=0.0, velocity_error_y_mps=0.0)
        table = Stop(1.30, speed_mps + 0.1, 2.628, 0.2, 0.0, 0.0)
        view_rad = in_view_rad(base, derive(base, SCALAR), table, mover_mps, SCALAR)
        assert math.degrees(view_rad / 2.0 - NOSE_TOLERANCE_RAD) == pytest.approx(half_deg, abs=1.0)
