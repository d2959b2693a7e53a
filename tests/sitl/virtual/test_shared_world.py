"""Several vehicles in one world: who is seen where, behind whom, and which contacts count."""

from __future__ import annotations

import json
import math
from itertools import combinations
from pathlib import Path
from typing import Any, Literal

import pytest

from gcs_tools.scenario import Expectation, Plant, Scenario
from onboard.files.contract_file import load_contract
from onboard.files.mission_file import Mission
from onboard.files.obstacle_field import ObstacleField
from onboard.geometry.local_frame import GeographicPoint, LocalFrame
from sitl.autopilot.flavours.tuned import TUNED
from sitl.virtual.shared_world import Contact, Resident, SharedWorld
from sitl.virtual.simulation import SimulatedFlight, Simulation

CONTRACT = load_contract(Path(__file__).parents[3] / "config" / "default_contract.yaml")
CENTRE = GeographicPoint(47.397742, 8.545594)
NOTHING = ObstacleField.of(())
# On the spheres of the autopilots, a metre differs by 0.11 %.
SCALE = 0.0012

Place = tuple[float, float]


def resident(
    place_m: Place,
    *,
    to_m: float = 20.0,
    autopilot: Literal["px4", "ardupilot"] = "ardupilot",
    aside_m: Place = (0.0, 0.0),
    message_version: int = 2,
    yaw_deg: float = 0.0,
) -> Resident:
    """Return a vehicle that hovers at a place of the site, where its own frame begins."""
    site = LocalFrame(CENTRE, "px4")
    told_m = (place_m[0] - aside_m[0], place_m[1] - aside_m[1])
    origin = GeographicPoint(*site.latitude_longitude_deg(*told_m))
    mission = Mission.model_validate(
        {
            "altitude_m": 5.0,
            "start_clear_m": 4.0,
            "legs": [{"end_ned_m": (to_m, 0.0), "target_half_width_m": 4.0}],
        }
    )
    plant = Plant.model_validate(
        {
            "flavour": autopilot,
            "realism": "ideal",
            "parameters": dict(TUNED[autopilot]),
            "start": {"position_ned_m": (0.0, 0.0, -5.0), "yaw_deg": yaw_deg},
            "sensors": [{"message_version": message_version, "movers_hidden": True}],
        }
    )
    scenario = Scenario(
        "it", CONTRACT, mission, NOTHING, plant, (), False, False, Expectation(), ()
    )
    sitl = scenario.sitl_config(seed=1)
    simulation = Simulation(SimulatedFlight(CONTRACT, mission, sitl, NOTHING))
    return Resident(simulation, LocalFrame(origin, autopilot), aside_m)


def seen_by(one: Resident, now_s: float) -> dict[Place, Any]:
    """Return the boxes of the frame that its sensor measures now."""
    scene = one.simulation.scene
    (detector,) = scene.detectors
    truth = scene.vehicle.truth
    detector.sense(now_s, truth)  # what was seen before leaves it
    (payload,) = detector.sense(now_s + 0.04, truth)
    return {tuple(each["center_m"]): each for each in json.loads(payload)["obstacles"]}


def test_each_is_seen_where_it_really_is_in_the_frame_of_who_looks() -> None:
    one = resident((0.0, 0.0), aside_m=(1.5, -0.5))
    other = resident((8.0, 3.0), autopilot="px4", aside_m=(-1.0, 0.7))
    world = SharedWorld({"one": one, "other": other})
    world.place()
    ((centre_m, box),) = seen_by(one, 0.06).items()
    assert centre_m == pytest.approx((8.0, 3.0), abs=8.0 * SCALE)
    assert box["motion"] == "moving"
    assert box["size_m"] == pytest.approx([0.6, 0.6])
    (body,) = other.simulation.scene.movers.all
    assert body.position_ned_m == pytest.approx((-8.0, -3.0), abs=8.0 * SCALE)


def test_who_is_behind_another_is_not_seen() -> None:
    places = {"one": (0.0, 0.0), "near": (4.0, 0.0), "far": (8.0, 0.0), "beside": (8.0, 3.0)}
    vehicles = {name: resident(place_m) for name, place_m in places.items()}
    SharedWorld(vehicles).place()
    seen_m = [math.dist(place, (0.0, 0.0)) for place in seen_by(vehicles["one"], 0.06)]
    assert sorted(seen_m) == pytest.approx([4.0, math.hypot(8.0, 3.0)], abs=0.05)


def flown(world: SharedWorld, vehicles: dict[str, Resident], until_s: float) -> None:
    """Fly in lock step."""
    steps = round(until_s / 0.02)
    for _ in range(steps):
        world.place()
        for each in vehicles.values():
            each.simulation.advance()
        world.observe()


def test_blind_vehicles_that_fly_at_each_other_collide() -> None:
    """No message, no sensor: the oracle has to say so, and each one's own record, too."""
    vehicles = {
        "north": resident((0.0, 0.0), message_version=1),
        "south": resident((12.0, 0.1), to_m=-20.0, message_version=1, yaw_deg=180.0),
    }
    world = SharedWorld(vehicles)
    flown(world, vehicles, 10.0)
    (contact,) = world.contacts
    assert contact.pair == ("north", "south")
    assert contact.moving
    assert min(contact.speeds_mps) > 1.0
    assert world.apart_min_m[contact.pair] < -0.3
    assert [v.simulation.scene.movers.contacts_moving for v in vehicles.values()] == [1, 1]


def test_bodies_that_pass_do_not_touch() -> None:
    vehicles = {
        "north": resident((0.0, 0.0), message_version=1),
        "south": resident((12.0, 2.0), to_m=-20.0, message_version=1, yaw_deg=180.0),
    }
    world = SharedWorld(vehicles)
    flown(world, vehicles, 10.0)
    assert world.contacts == []
    # 2 m from centre to centre, two bodies of 0.3 m, and what the flights are off.
    assert world.apart_m("north") == pytest.approx(1.4, abs=0.3)


@pytest.mark.parametrize(
    ("speeds_mps", "moving"), [((0.0, 0.0), False), ((0.19, 0.1), False), ((0.0, 0.3), True)]
)
def test_a_contact_moves_if_one_of_both_does(
    speeds_mps: tuple[float, float], *, moving: bool
) -> None:
    assert Contact(("a", "b"), 1.0, speeds_mps).moving == moving


def test_every_pair_is_watched() -> None:
    names = "abc"
    world = SharedWorld({name: resident((6.0 * n, 0.0)) for n, name in enumerate(names)})
    world.observe()
    expected = {("a", "b"): 5.4, ("b", "c"): 5.4, ("a", "c"): 11.4}
    assert set(world.apart_min_m) == set(combinations(names, 2))
    assert world.apart_min_m == pytest.approx(expected, rel=2.0 * SCALE)
