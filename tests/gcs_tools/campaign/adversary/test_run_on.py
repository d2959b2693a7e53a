"""Runs after the stream ends, integrated, against what the contract's own hull says."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from gcs_tools.campaign.adversary.contract import adversary_contract, timing_of
from gcs_tools.campaign.adversary.genes import Genes
from gcs_tools.campaign.adversary.run_on import runs_m
from onboard.contract.assessment import assess
from onboard.contract.run_on import contract_run_on
from onboard.files.contract_file import Contract, VehicleTerms

LOSSES: tuple[dict[str, Any], ...] = (
    {"model": "frozen", "gain_per_s": 1.3, "velocity_gain_per_s": 4.5},
    {"model": "frozen", "gain_per_s": 0.95, "velocity_gain_per_s": 1.8},
    {"model": "coast"},
)


def with_loss(loss: dict[str, Any]) -> Contract:
    genes = Genes("run", {"passive": 1.0, "kind": 0.0})
    drawn = adversary_contract(genes, timing_of(genes), "lane")
    assert drawn is not None
    terms = drawn.model_dump()
    terms["vehicle"]["setpoint_loss"] = loss
    return Contract.model_validate(terms)


def vehicle(loss: dict[str, Any]) -> VehicleTerms:
    return with_loss(loss).vehicle


@pytest.mark.parametrize("loss", LOSSES)
def test_a_run_begins_at_the_setpoint_and_comes_to_rest(loss: dict[str, Any]) -> None:
    states = np.array([[[1.0, 2.0], [2.0, -1.0], [0.5, 0.5]]])
    (run,) = runs_m(vehicle(loss), states)
    assert run[0] == pytest.approx([1.0, 2.0])
    assert np.abs(run[-1] - run[-2]).max() < 0.2
    assert np.linalg.norm(run[-1] - run[0]) > 0.5


def test_a_frozen_setpoint_is_overshot_and_come_back_to() -> None:
    (run,) = runs_m(vehicle(LOSSES[1]), np.array([[[0.0, 0.0], [2.0, 0.0], [0.0, 0.0]]]))
    assert run[-1, 0] == pytest.approx(2.0 / 0.95, abs=0.01)  # p + v / Kp
    assert run[:, 0].max() >= run[-1, 0]


@pytest.mark.parametrize("loss", LOSSES)
def test_the_contract_encloses_every_run(loss: dict[str, Any]) -> None:
    contract = with_loss(loss)
    run_on = contract_run_on(assess(contract).terms)
    random = np.random.default_rng(1)
    states = random.uniform(-1.0, 1.0, (300, 3, 2)) * np.array([0.0, 1.4, 1.0])[:, None]
    for state, run in zip(states, runs_m(contract.vehicle, states), strict=True):
        p, v, a = state
        points = np.array([p, *(p + kappa * v + c * a for kappa, c in run_on.gains)])
        low, high = points.min(axis=0) - 1e-3, points.max(axis=0) + 1e-3
        assert ((run >= low) & (run <= high)).all()
