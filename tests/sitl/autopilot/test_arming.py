"""What speaks against arming, and when a standing vehicle disarms by itself."""

import math
from dataclasses import replace
from typing import Any

import pytest

from sitl.autopilot.arming import Arming, PrearmInputs, prearm_failures
from sitl.autopilot.flavours.parameters import ParameterStore
from sitl.autopilot.flavours.px4 import Px4
from sitl.autopilot.settings import FlightSettings

READY = PrearmInputs(
    estimator_ready=True,
    sensor_failed=False,
    tilt_rad=0.0,
    battery_remaining=1.0,
    battery_critical=0.07,
)


def settings(**changes: Any) -> FlightSettings:
    """Return PX4's settings with the given delays."""
    flavour = Px4()
    defaults = flavour.settings(ParameterStore(flavour.parameter_specs(1), {}))
    delays: dict[str, Any] = {"disarm_landed_s": 2.0, "disarm_grounded_s": 10.0, **changes}
    return replace(defaults, **delays)


def test_a_ready_vehicle_may_arm() -> None:
    assert prearm_failures(READY) == []


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"estimator_ready": False}, "estimator not ready"),
        ({"sensor_failed": True}, "sensor failure"),
        ({"tilt_rad": math.radians(31.0)}, "vehicle not level"),
        ({"battery_remaining": 0.06}, "battery too low"),
    ],
)
def test_each_check_has_its_reason(change: dict[str, Any], reason: str) -> None:
    assert prearm_failures(replace(READY, **change)) == [reason]


@pytest.mark.parametrize("change", [{"tilt_rad": math.radians(29.0)}, {"battery_remaining": 0.07}])
def test_the_limits_themselves_are_allowed(change: dict[str, Any]) -> None:
    assert prearm_failures(replace(READY, **change)) == []


def test_all_reasons_are_stated() -> None:
    worst = PrearmInputs(
        estimator_ready=False,
        sensor_failed=True,
        tilt_rad=3.0,
        battery_remaining=0.0,
        battery_critical=0.1,
    )
    assert len(prearm_failures(worst)) == 4


@pytest.mark.parametrize("on_ground", [True, False])
def test_a_vehicle_that_starts_in_the_air_is_armed(on_ground: bool) -> None:
    assert Arming(on_ground=on_ground).armed is not on_ground


def test_an_armed_vehicle_that_does_not_take_off_disarms_after_its_delay() -> None:
    arming = Arming(on_ground=True)
    arming.arm(5.0)
    assert arming.armed
    assert arming.reason_to_disarm(14.9, 0.0, settings()) is None
    assert arming.reason_to_disarm(15.0, 0.0, settings()) == "no take-off"


def test_a_landed_vehicle_disarms_after_its_delay_from_the_landing() -> None:
    arming = Arming(on_ground=True)
    arming.arm(5.0)
    arming.note_take_off()
    assert arming.reason_to_disarm(51.9, 50.0, settings()) is None
    assert arming.reason_to_disarm(52.0, 50.0, settings()) == "landed"


def test_a_vehicle_that_starts_in_the_air_has_flown() -> None:
    arming = Arming(on_ground=False)
    assert arming.reason_to_disarm(12.0, 10.0, settings()) == "landed"


def test_the_next_arming_begins_a_new_flight() -> None:
    arming = Arming(on_ground=True)
    arming.arm(0.0)
    arming.note_take_off()
    arming.disarm()
    assert not arming.armed
    arming.arm(100.0)
    assert arming.reason_to_disarm(105.0, 50.0, settings()) is None
    assert arming.reason_to_disarm(110.0, 50.0, settings()) == "no take-off"


@pytest.mark.parametrize("delay", ["disarm_landed_s", "disarm_grounded_s"])
def test_a_negative_delay_means_never(delay: str) -> None:
    arming = Arming(on_ground=True)
    arming.arm(0.0)
    if delay == "disarm_landed_s":
        arming.note_take_off()
    assert arming.reason_to_disarm(1e6, 0.0, settings(**{delay: -1.0})) is None
