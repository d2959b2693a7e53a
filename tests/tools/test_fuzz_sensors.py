"""Damaged sensor messages are decoded or refused; 10,000 of each kind."""

from tests.tools.fuzz_sensors import fuzz, targets


def test_no_damaged_message_raises_anything_but_a_refusal() -> None:
    found = fuzz(10_000, seed=1)
    for name, _, _ in targets():
        assert found[f"{name} refused"] > 1000
        assert found[f"{name} decoded"] > 100  # the damage is not so coarse that all is refused
