"""A contract's model of the run after a loss of the stream against the autopilot."""

from __future__ import annotations

from typing import Any

import pytest

from onboard.files.contract_file import Contract, load_contract
from onboard.mavlink.profiles.profile import AutopilotProfile
from onboard.mavlink.profiles.registry import OTHER, profile_named
from onboard.mavlink.profiles.setpoint_loss import loss_model_in_words, loss_model_refusal
from tests.onboard.conftest import CONTRACTS

PX4, ARDUPILOT = profile_named("px4"), profile_named("ardupilot")
COAST, FROZEN = "{model: coast}", "{model: frozen, gain_per_s: 0.95, velocity_gain_per_s: 1.8}"


def contract(*overrides: str) -> Contract:
    return load_contract(CONTRACTS / "precise_vehicle.yaml", overrides)


@pytest.mark.parametrize(
    ("loss", "measured", "profile", "refused"),
    [
        ("null", "null", PX4, True),
        (COAST, "null", PX4, True),
        (COAST, "4.7", PX4, True),
        ("null", "4.7", PX4, False),
        (FROZEN, "null", PX4, False),
        (FROZEN, "4.7", PX4, False),
        ("null", "null", ARDUPILOT, False),
        (FROZEN, "null", ARDUPILOT, False),
        ("null", "null", OTHER, False),
    ],
)
def test_a_px4_never_coasts(
    loss: str, measured: str, profile: AutopilotProfile, *, refused: bool
) -> None:
    stated = (f"vehicle.setpoint_loss={loss}", f"vehicle.setpoint_loss_run_on_m={measured}")
    refusal = loss_model_refusal(profile, contract(*stated))
    assert (refusal is not None) is refused
    if refusal is not None:
        assert "PX4 keeps flying to the last setpoint" in refusal
        assert "state vehicle.setpoint_loss with model frozen" in refusal
    bare = contract(*stated, "requirements.passive_safety=false")
    assert loss_model_refusal(profile, bare) is None


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        ((), "coasts for 0.5 s, then brakes"),
        ((f"vehicle.setpoint_loss={FROZEN}",), "frozen setpoint, gains 0.95/s and 1.8/s"),
        (
            ("vehicle.setpoint_loss_run_on_m=4.7",),
            "coasts for 0.5 s, then brakes; measured 4.7 m at 2.8 m/s where that is longer",
        ),
    ],
)
def test_the_model_is_named_to_the_operator(overrides: Any, words: str) -> None:
    assert loss_model_in_words(contract(*overrides)) == words
