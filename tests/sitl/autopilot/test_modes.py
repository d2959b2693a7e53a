"""Modes and landed states."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.failsafes import MODE_OF_REACTION
from sitl.autopilot.modes import LandedState, Mode
from sitl.autopilot.settings import Reaction

STICKS = {Mode.MANUAL, Mode.ALTCTL, Mode.POSCTL, Mode.ACRO, Mode.STABILIZED}


@pytest.mark.parametrize("mode", list(Mode))
def test_a_mode_either_needs_sticks_or_flies_by_itself(mode: Mode) -> None:
    assert mode.needs_sticks is (mode in STICKS)


def test_landed_states_have_mavlinks_numbers() -> None:
    for state in LandedState:
        assert state == getattr(mavlink, f"MAV_LANDED_STATE_{state.name}")


def test_every_reaction_that_flies_on_has_a_mode() -> None:
    assert set(Reaction) - set(MODE_OF_REACTION) == {Reaction.NONE, Reaction.DISARM}
    assert MODE_OF_REACTION[Reaction.MANUAL].needs_sticks


def test_names_are_distinct() -> None:
    assert len({mode.value for mode in Mode}) == len(Mode)
