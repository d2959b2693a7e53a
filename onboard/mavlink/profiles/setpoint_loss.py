"""How an autopilot runs on after a loss of the setpoint stream, against what a contract says."""

from __future__ import annotations

from onboard.files.contract_file import Contract
from onboard.mavlink.profiles.profile import AutopilotProfile


def loss_model_in_words(contract: Contract) -> str:
    """Return the model of the run that a contract counts on."""
    vehicle = contract.vehicle
    loss = vehicle.setpoint_loss
    if loss is not None and loss.model == "frozen":
        model = f"frozen setpoint, gains {loss.gain_per_s:g}/s and {loss.velocity_gain_per_s:g}/s"
    else:
        model = f"coasts for {vehicle.setpoint_loss_timeout_s:g} s, then brakes"
    if vehicle.setpoint_loss_run_on_m is None:
        return model
    at_mps = vehicle.setpoint_loss_run_on_speed_mps
    at = "" if at_mps is None else f" at {at_mps:g} m/s"
    return f"{model}; measured {vehicle.setpoint_loss_run_on_m:g} m{at} where that is longer"


def loss_model_refusal(profile: AutopilotProfile, contract: Contract) -> str | None:
    """Return why a contract's model of the run does not fit an autopilot; None if it may.

    An autopilot that keeps flying to the last setpoint runs on farther than one that coasts and
    brakes.  A measured run covers it, unless the contract states the other model.
    """
    vehicle = contract.vehicle
    loss = vehicle.setpoint_loss
    if not contract.requirements.passive_safety or profile.after_setpoint_loss != "frozen":
        return None
    stated = loss is not None
    if loss is not None and loss.model == "frozen":
        return None
    if vehicle.setpoint_loss_run_on_m is not None and not stated:
        return None
    return (
        f"passive safety counts on a vehicle that {loss_model_in_words(contract)}, but "
        f"{profile.name} keeps flying to the last setpoint: state vehicle.setpoint_loss with model "
        "frozen, or a measured setpoint_loss_run_on_m"
    )
