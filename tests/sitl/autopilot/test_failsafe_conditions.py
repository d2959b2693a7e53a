"""Failsafe conditions one by one: when each begins, how often it is reported, what follows."""

import math
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.failsafes import FailsafeInputs, Failsafes
from sitl.autopilot.flavours.parameters import ParameterStore
from sitl.autopilot.flavours.px4 import Px4
from sitl.autopilot.settings import FlightSettings, Reaction

FINE = FailsafeInputs(
    battery_remaining=1.0,
    ground_silence_s=0.1,
    sticks_silence_s=math.inf,
    sticks_needed=False,
    position_valid=True,
)
_FLAVOUR = Px4()
SETTINGS: FlightSettings = replace(
    _FLAVOUR.settings(ParameterStore(_FLAVOUR.parameter_specs(1), {})),
    ground_timeout_s=10.0,
    ground_loss=Reaction.RETURN,
    manual_timeout_s=0.5,
    manual_loss=Reaction.HOLD,
    battery_low=0.3,
    battery_critical=0.2,
    battery_emergency=0.1,
    low_reaction=Reaction.NONE,
    critical_reaction=Reaction.RETURN,
    emergency_reaction=Reaction.LAND,
)
GROUND_LOST = replace(FINE, ground_silence_s=11.0)
STICKS_LOST = replace(FINE, sticks_needed=True, sticks_silence_s=1.0)
POSITION_LOST = replace(FINE, position_valid=False)


def reactions(failsafes: Failsafes, inputs: FailsafeInputs) -> list[Reaction]:
    return [trigger.reaction for trigger in failsafes.check(inputs, SETTINGS)]


def test_nothing_triggers_while_all_is_well() -> None:
    assert reactions(Failsafes(), FINE) == []


@pytest.mark.parametrize(
    ("inputs", "reaction"),
    [
        (GROUND_LOST, Reaction.RETURN),
        (STICKS_LOST, Reaction.HOLD),
        (POSITION_LOST, Reaction.LAND),
    ],
)
def test_a_condition_triggers_once_while_it_lasts_and_again_after_it_ended(
    inputs: FailsafeInputs, reaction: Reaction
) -> None:
    failsafes = Failsafes()
    reported = [reactions(failsafes, each) for each in (inputs, inputs, FINE, inputs)]
    assert reported == [[reaction], [], [], [reaction]]


@pytest.mark.parametrize(
    "inputs",
    [
        replace(FINE, ground_silence_s=10.0),
        replace(FINE, ground_silence_s=math.inf),
        replace(FINE, sticks_silence_s=1.0),
        replace(FINE, sticks_needed=True, sticks_silence_s=0.5),
        replace(FINE, sticks_needed=True, sticks_silence_s=math.inf),
        replace(FINE, battery_remaining=0.3),
    ],
)
def test_limits_and_peers_that_never_were_there_trigger_nothing(inputs: FailsafeInputs) -> None:
    assert reactions(Failsafes(), inputs) == []


def test_a_ground_loss_without_a_reaction_is_not_even_reported() -> None:
    silent = replace(SETTINGS, ground_loss=Reaction.NONE)
    assert list(Failsafes().check(GROUND_LOST, silent)) == []


def test_the_battery_triggers_level_by_level_and_never_again() -> None:
    failsafes = Failsafes()
    reported = [
        reactions(failsafes, replace(FINE, battery_remaining=remaining))
        for remaining in (0.35, 0.25, 0.25, 0.15, 0.05, 0.9, 0.05)
    ]
    assert reported == [[], [Reaction.NONE], [], [Reaction.RETURN], [Reaction.LAND], [], []]


def test_a_battery_that_drops_through_all_levels_reports_each() -> None:
    triggers = list(Failsafes().check(replace(FINE, battery_remaining=0.0), SETTINGS))
    assert [(trigger.text, trigger.severity) for trigger in triggers] == [
        ("Low battery level", mavlink.MAV_SEVERITY_WARNING),
        ("Critical battery level", mavlink.MAV_SEVERITY_CRITICAL),
        ("Dangerous battery level", mavlink.MAV_SEVERITY_CRITICAL),
    ]


def test_of_several_conditions_the_gravest_comes_last() -> None:
    worst = FailsafeInputs(
        battery_remaining=0.0,
        ground_silence_s=20.0,
        sticks_silence_s=5.0,
        sticks_needed=True,
        position_valid=False,
    )
    assert reactions(Failsafes(), worst) == [
        Reaction.RETURN,
        Reaction.HOLD,
        Reaction.NONE,
        Reaction.RETURN,
        Reaction.LAND,
        Reaction.LAND,
    ]


def test_a_lost_position_leaves_the_text_to_the_autopilot() -> None:
    (trigger,) = Failsafes().check(POSITION_LOST, SETTINGS)
    assert trigger.text == ""
