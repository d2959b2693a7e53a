"""Damaged sensor messages are decoded or refused; 2,000 of each kind."""

import warnings

from tests.onboard.perception.test_sensor_channels import KINDS
from tests.tools.fuzz_sensors import fuzz, inputs_of_sensors, targets


def test_no_damaged_message_raises_anything_but_a_refusal() -> None:
    found = fuzz(2_000, seed=1)
    for name, _, _ in targets():
        assert found[f"{name} refused"] > 200
        assert found[f"{name} decoded"] > 100  # the damage is not so coarse that all is refused


def test_no_damaged_message_gets_past_the_input_of_a_sensor() -> None:
    """Neither as an exception nor as a warning, which numbers that are none would give."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = fuzz(1500, seed=1, chosen=inputs_of_sensors())
    for kind in KINDS:
        assert found[f"input {kind} refused"] > 100
        assert found[f"input {kind} decoded"] > 0
