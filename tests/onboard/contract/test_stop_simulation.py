"""Stopping and sidestepping, tried by a simulator that knows none of the formulas.

Fields at the limit of the clause, faces wrong by the error, the vehicle off by its tracking error
towards the nearest obstacle, and the stream lost at every step.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Literal

import numpy as np
import pytest

from onboard.contract.assessment import Assessment, assess
from onboard.contract.run_on import contract_run_on
from onboard.geometry.box import Box
from onboard.geometry.frames import FloatArray
from tests.onboard.contract.stop_and_sidestep import (
    Coasts,
    FliesOn,
    Vehicle,
    clearance_m,
    flown,
    off_by,
    runs_on,
)
from tests.onboard.contract.test_assessment import contract

GAINS: dict[str, Any] = {"model": "frozen", "gain_per_s": 0.95, "velocity_gain_per_s": 1.8}
# With such a lag the loop does not overshoot.
LAG_S = 0.2
# What a step of 0.01 s makes of a front that is exact.
INTEGRATION_M = 2e-3
# Slower or faster, nimbler or less, one sensor worse than the other.
VARIETIES: list[dict[str, Any]] = [
    {"cruise_speed_mps": 1.0},
    {"cruise_speed_mps": 2.8, "tracking_error_m": 0.8, "position_error_m": 0.1},
    {"cruise_speed_mps": 5.0, "reaction_time_s": 0.4},
    {"cruise_speed_mps": 2.8, "roll_max_deg": 6.0, "pitch_max_deg": 20.0},
]


Loss = Literal["flies on", "coasts", "holds still"]


def assessed(loss: Loss, **changes: Any) -> Assessment:
    plain = {"velocity_error_mps": [0.0, 0.0], "obstacle_size_max_m": 2.0}
    return assess(
        contract(
            **(plain | changes),
            attitude_lag_s=LAG_S,
            setpoint_loss=GAINS if loss == "flies on" else None,
            passive_safety=loss != "holds still",
        )
    )


def vehicle_of(assessment: Assessment) -> Vehicle:
    terms, limits = assessment.terms, assessment.limits
    loss: FliesOn | Coasts | None = None
    kappa_s = c_s2 = 0.0
    if terms.passive_safety:
        kappa_s, c_s2 = contract_run_on(terms).gains[-1]
        loss = Coasts(terms.setpoint_loss_timeout_s, LAG_S, min(vars(limits).values()))
    if terms.setpoint_gain_per_s is not None:
        loss = FliesOn(GAINS["gain_per_s"], GAINS["velocity_gain_per_s"], LAG_S)
    return Vehicle(
        speed_mps=terms.cruise_speed_mps,
        brake_mps2=limits.brake_mps2,
        forward_mps2=limits.forward_mps2 / 2.0,
        lateral_mps2=limits.left_mps2,
        dead_s=terms.attitude_lag_s,
        reaction_s=terms.reaction_time_s,
        kappa_s=kappa_s,
        c_s2=c_s2,
        loss=loss,
    )


def field(assessment: Assessment, random: np.random.Generator) -> list[Box]:
    """Obstacles one after another: as near along the leg, or aside, as the clause allows."""
    along_m, across_m = assessment.inflated.required_separation_box_m
    largest_m = assessment.terms.obstacle_size_max_m
    centre_m = np.array((along_m, 0.0))
    boxes = []
    for _ in range(6):
        size_m = random.choice((largest_m, 0.3 * largest_m), 2)
        low_m, high_m = centre_m - size_m / 2.0, centre_m + size_m / 2.0
        boxes.append(Box(low_m[0], high_m[0], low_m[1], high_m[1]))
        beside = 1.000001 * across_m * random.choice((-1.0, 1.0))
        boxes.append(boxes[-1].shifted_by(float(random.uniform(0.0, 2.0)), float(beside)))
        step_m = 1.000001 * along_m + 2.0
        centre_m += (step_m, random.uniform(-1.0, 1.0))
    return boxes


def worst_m(assessment: Assessment, states: FloatArray, boxes: list[Box]) -> float:
    """Least clearance of the body, wherever within its error, flown or running on."""
    places_m = runs_on(vehicle_of(assessment), states[::3])
    everywhere = clearance_m(states[:, :2], boxes, assessment.terms.body_m)
    return min(everywhere, clearance_m(places_m, boxes, assessment.terms.body_m))


@pytest.mark.parametrize("loss", ["flies on", "coasts", "holds still"])
@pytest.mark.parametrize("changes", VARIETIES)
def test_every_obstacle_is_passed_and_none_touched(changes: dict[str, Any], loss: Loss) -> None:
    assessment = assessed(loss, **changes)
    error_m = assessment.face_error_m
    for seed in range(4):
        random = np.random.default_rng(seed)
        boxes = field(assessment, random)
        reported = [off_by(box, error_m, random) for box in boxes]
        regions = [assessment.region_around(box, error_m) for box in reported]
        for number, region in enumerate(regions):
            for other in regions[number + 1 :]:
                assert not region.conflicts_with(other)
        states = flown(vehicle_of(assessment), regions, boxes[-1].x_max_m + 5.0)
        assert states is not None
        assert worst_m(assessment, states, boxes) >= -INTEGRATION_M


def head_on(assessment: Assessment) -> tuple[list[Box], list[Box]]:
    """One obstacle, its front face reported as far away as the error allows; and as it is."""
    error_m = assessment.face_error_m
    box = Box(30.0, 32.0, -1.0, 1.0)
    return [box], [replace(box, x_min_m=box.x_min_m + error_m)]


@pytest.mark.parametrize("changes", [VARIETIES[0], VARIETIES[1], VARIETIES[3]])
def test_the_front_is_as_long_as_it_has_to_be(changes: dict[str, Any]) -> None:
    """Reacting 0.35 m later, of which 0.15 m are room for planning, leads into the obstacle.

    Where V <= κb: faster, the run of a setpoint that brakes is shorter than what is counted.
    """
    assessment = assessed("flies on", **changes)
    boxes, reported = head_on(assessment)
    regions = [assessment.region_around(box, assessment.face_error_m) for box in reported]
    for shorter_m, safe in ((0.0, True), (0.35, False)):
        states = flown(vehicle_of(assessment), regions, 34.0, shorter_m=shorter_m)
        assert states is not None
        assert (worst_m(assessment, states, boxes) >= -INTEGRATION_M) is safe


def test_a_body_that_is_off_by_more_than_its_error_touches() -> None:
    """The checker sees a contact: 0.5 m more than declared."""
    assessment = assessed("flies on", cruise_speed_mps=2.8)
    boxes, reported = head_on(assessment)
    regions = [assessment.region_around(box, assessment.face_error_m) for box in reported]
    states = flown(vehicle_of(assessment), regions, 34.0)
    assert states is not None
    places_m = runs_on(vehicle_of(assessment), states)
    assert clearance_m(places_m, boxes, assessment.terms.body_m + 0.5) < 0.0
