"""Movers beside declared heights: what is flown over, and what counts at any height."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from onboard.contract.heights import LEVEL_M
from onboard.files.contract_file import Contract
from onboard.files.yaml_file import validate
from onboard.monitoring.assumptions import Assumption
from tests.onboard.monitoring.fake_flight import FakeFlight
from tests.onboard.monitoring.movers.test_mover_space import Scene, names, person

# The leg is at 4 m; body, control, drift until passing, and the error of a measured top.
BODY_M, CONTROL_M, DRIFT_M, ERROR_Z_M = 0.2, 0.4, 0.3, 0.2
BAND_FROM_M = 4.0 - BODY_M - CONTROL_M - DRIFT_M - LEVEL_M - ERROR_Z_M


def over(contract: Contract, *kinds: str, top_max_m: float = 1.6) -> Scene:
    """Return a vehicle that flies over classes that stay low."""
    low = [
        {"class": kind, "speed_max_mps": 1.5, "size_max_m": 1.0, "top_max_m": top_max_m}
        for kind in kinds or ("person",)
    ]
    data = contract.model_dump(mode="json")
    data["vehicle"] |= {
        "rest_settle_s": 0.4, "setpoint_loss_run_time_s": 3.0, "radius_z_m": BODY_M,
        "tracking_error_z_m": CONTROL_M, "height_drift_m": DRIFT_M, "height_drift_flight_m": 0.7,
    }  # fmt: skip
    data["requirements"] |= {"stop": True, "movers": "passive"}
    data["sensor"] |= {
        "position_error_z_m": ERROR_Z_M, "vertical_field_of_view_deg": [45.0, 45.0]
    }  # fmt: skip
    data["environment"] |= {"movers": low}
    flight = FakeFlight.under(validate(data, Contract, source="test"))
    return Scene(replace(flight))


def tracks(scene: Scene) -> list[str]:
    return [track.id for track in scene.movers.tracks]


def below(top_m: float | None, **keys: Any) -> dict[str, Any]:
    """Return a person 8 m ahead whose top is measured at a height."""
    return person(8.0, down_m=[None if top_m is None else -top_m, 0.0], **keys)


@pytest.mark.parametrize(
    ("seen", "in_the_way"),
    [
        (below(1.5), False),
        (below(1.5, motion="unknown"), False),
        (below(BAND_FROM_M - 0.02), False),
        # Control, drift and error all count, and so does what straddles the edge of the band.
        (below(BAND_FROM_M + 0.02), True),
        (below(4.0), True),
        (below(None), True),
        (person(8.0), True),
        (below(1.5, partial=True, box_whole=False), True),
        (below(1.5, down_uncertainty_m=1.6), True),
    ],
    ids=["low", "may move", "just below", "just in", "level", "cut", "unsaid", "part", "vague"],
)
def test_only_what_is_measured_below_the_band_is_in_no_way(
    contract: Contract, seen: dict[str, Any], *, in_the_way: bool
) -> None:
    scene = over(contract, top_max_m=2.5)
    scene.look(seen)
    assert tracks(scene) == (["ring/1"] if in_the_way else [])
    assert list(scene.flight.obstacles) == []  # no part of the map in either case


def test_what_is_of_no_declared_class_may_rise(contract: Contract) -> None:
    scene = over(contract)
    assert scene.look(below(1.5, **{"class": "bird"})) == []
    assert tracks(scene) == ["ring/1"]
    declared = over(contract, "person", "unknown")
    declared.look(below(1.5, **{"class": "bird"}))
    assert tracks(declared) == []


def test_a_top_beyond_the_vertical_view_is_unknown(contract: Contract) -> None:
    """At 1.2 m the view of 45 degrees ends 1.2 m below the body, above a top at 1.5 m."""
    scene = over(contract)
    scene.look(person(1.2, down_m=[-3.3, 0.0]))
    assert tracks(scene) == ["ring/1"]
    narrow = over(contract)
    narrow.look(below(1.5), vertical_field_of_view_deg=[45.0, 0.0])
    assert tracks(narrow) == []  # a top is cut by the upper edge only


@pytest.mark.parametrize("down_m", [[-9.0, -7.0], [None, -7.0]])
def test_one_that_is_taller_than_its_class_breaks_what_is_declared(
    contract: Contract, down_m: list[float | None]
) -> None:
    """Measured above the flight it may come down, whatever else was declared of it."""
    scene = over(contract)
    assert Assumption.MOVER_CLASS in names(scene.look(person(8.0, down_m=down_m)))
    assert tracks(scene) == ["ring/1"]


def test_errors_of_a_top_do_not_break_what_is_declared(contract: Contract) -> None:
    scene = over(contract)
    # 1.6 m of the class, 0.2 m of the sensor, 0.7 m of drift since the start.
    assert scene.look(below(1.6 + 0.2 + 0.65)) == []
    assert names(scene.look(below(1.6 + 0.2 + 0.75))) == [Assumption.MOVER_CLASS]


def test_no_set_of_places_without_movers_is_kept(contract: Contract) -> None:
    scene = over(contract)
    assert scene.movers.free is None
    assert scene.movers.refusal is None
    assert scene.movers.check_ring(1e6) is None
    scene.look(below(4.0))
    movers = scene.movers.movers
    assert movers is not None
    assert len(movers.tracks) == 1
