"""``clearway fleet simulate``: four missions that cross, and what the command says of them."""

from __future__ import annotations

import json
import math
from functools import partial

import pytest

from gcs_tools.fleet.flyer import Flyer
from gcs_tools.fleet.simulate import ways_of
from gcs_tools.preflight.offline.fleet_files import read_fleet
from onboard.fleet.reservation import Reservation
from onboard.geometry.frames import FloatArray
from tests.gcs_tools.running import CONFIG, Clearway

CROSSING = CONFIG / "fleet" / "crossing.yaml"


def test_four_vehicles_cross_over_a_bad_network(clearway: Clearway) -> None:
    ran = clearway("fleet", "simulate", CROSSING, "--episodes", "4", "--format", "json")
    assert ran.code == 0, ran
    document = json.loads(ran.out)
    assert document["collided_seeds"] == []
    assert (document["vehicles_flown"], document["vehicles_arrived"]) == (16, 16)
    assert document["restarts"] > 0
    assert document["terms"]["network"]["loss"] == 0.3


def test_the_same_seeds_fly_the_same(clearway: Clearway) -> None:
    arguments = (
        "fleet",
        "simulate",
        CROSSING,
        "--episodes",
        "2",
        "--seed",
        "7",
        "--format",
        "json",
    )
    assert clearway(*arguments).out == clearway(*arguments).out


class AsksNone(Reservation):
    """Leaves out who has to be asked."""

    def _need(self, _boxes_m: FloatArray, _until_s: float) -> frozenset[str]:
        return frozenset()


def test_contacts_are_reported_with_their_seeds(
    clearway: Clearway, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gcs_tools.fleet.simulate.Flyer", partial(Flyer, make=AsksNone))
    ran = clearway("fleet", "simulate", CROSSING, "--episodes", "3")
    assert ran.code == 1, ran
    assert ran.out.startswith("CONTACT in 2 of 3 episodes (seeds 1, 3)")


def test_the_ways_are_those_of_the_missions() -> None:
    ways = ways_of(read_fleet(CROSSING)[1])
    """In the frame of the first, whose sphere is larger than that of the PX4."""
    assert ways["northbound"] == [(0.0, 0.0), (90.0, 0.0)]
    start_m, end_m = ways["southbound"]
    assert start_m == pytest.approx((90.0, -14.0), abs=0.12)
    assert end_m == pytest.approx((0.0, -14.0), abs=0.12)
    assert all(math.dist(*way) == pytest.approx(90.0, rel=0.0012) for way in ways.values())


@pytest.mark.parametrize(
    ("option", "words"),
    [
        (("--loss", "1.0"), "not a share"),
        (("--episodes", "0"), "1 or more"),
        (("--delay", "-1"), "above 0"),
    ],
)
def test_a_wrong_number_is_one_line(
    clearway: Clearway, option: tuple[str, str], words: str
) -> None:
    ran = clearway("fleet", "simulate", CROSSING, *option)
    assert (ran.code, ran.err.count("\n")) == (2, 1), ran
    assert words in ran.err
