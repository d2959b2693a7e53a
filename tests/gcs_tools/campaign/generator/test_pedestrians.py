"""Flights among people: every scene is drawn, with a ring or with the view ahead alone."""

from __future__ import annotations

import math
import random
from collections import Counter

import numpy as np
import pytest

from gcs_tools.campaign.generator import pedestrians
from gcs_tools.campaign.generator.case import FlightCase
from gcs_tools.campaign.generator.pedestrians import SCENES, pedestrian_case
from onboard.files.contract_file import Contract
from sitl.environment.movers.config import Pursuit, Waypoints
from sitl.environment.movers.occlusion import are_hidden

FLIGHTS = 24


@pytest.fixture(scope="module")
def cases() -> list[FlightCase]:
    return [pedestrian_case(random.Random(f"people {number}")) for number in range(FLIGHTS)]


def test_every_scene_is_drawn_and_promises_no_contact_in_motion(cases: list[FlightCase]) -> None:
    assert set(Counter(case.variant for case in cases)) == set(SCENES)
    assert all(case.covered for case in cases)


def test_the_view_is_of_120_degrees_with_a_ring_and_walls_are_not_seen_through(
    cases: list[FlightCase],
) -> None:
    for case in cases:
        front, ring = case.scenario.plant.sensors
        assert (front.field_of_view_deg, ring.field_of_view_deg) == (120.0, 360.0)
        assert front.range_m == case.scenario.contract.sensor.detection_range_m
        assert ring.range_m == case.scenario.contract.sensor.all_round_range_m
        assert front.movers_hidden
        assert ring.movers_hidden


def test_people_keep_to_what_is_declared_and_begin_apart_from_the_vehicle(
    cases: list[FlightCase],
) -> None:
    for case in cases:
        (person,) = case.scenario.contract.environment.movers
        assert person.hidden is (case.variant == "door")
        assert case.scenario.plant.movers
        for mover in case.scenario.plant.movers:
            assert 0.0 < mover.speed_mps <= person.speed_max_mps
            assert mover.size_m <= person.size_max_m
            assert isinstance(mover.path, Waypoints | Pursuit)
            start = (
                mover.path.places_ned_m[0]
                if isinstance(mover.path, Waypoints)
                else mover.path.start_ned_m
            )
            assert math.hypot(*start) > 5.0


def test_who_steps_out_is_hidden_until_the_vehicle_is_near(cases: list[FlightCase]) -> None:
    for case in cases:
        if case.variant != "door":
            continue
        field, (person,) = case.scenario.obstacles, case.scenario.plant.movers
        kiosk = np.concatenate((field.center_ned_m, field.half_size_m, field.yaw_rad[:, None]), 1)
        assert isinstance(person.path, Waypoints)
        stands, *others = person.path.places_ned_m
        assert person.path.begins_within_m is not None
        for north_m in np.arange(0.0, stands[0] - person.path.begins_within_m, 0.5).tolist():
            place = np.array((stands,))
            assert are_hidden(place, (north_m, 0.0), kiosk).all(), north_m
        # It crosses the way.
        assert others[0][1] * stands[1] < 0.0


def test_without_a_ring_no_person_comes_from_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    def drawn(draw: random.Random, level: pedestrians.Level, *, hidden: bool) -> Contract:
        asked.append(level)
        ringed = make(draw, "passive", hidden=hidden)
        sensor = ringed.sensor.model_copy(update={"all_round_range_m": 0.0})
        requirements = ringed.requirements.model_copy(update={"movers": "none"})
        return ringed.model_copy(update={"sensor": sensor, "requirements": requirements})

    make = pedestrians._contract
    monkeypatch.setattr(pedestrians, "_contract", drawn)
    cases = [pedestrian_case(random.Random(k), "passive_in_view") for k in range(12)]
    assert set(asked) == {"passive_in_view"}
    assert {case.variant for case in cases} == {"crossing", "oncoming", "door"}
    assert all(len(case.scenario.plant.sensors) == 1 for case in cases)
