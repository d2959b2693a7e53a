"""Messages encoded by another implementation (rosbags 0.11, types of Humble and Jazzy)."""

import json
from pathlib import Path

_ENCODED = json.loads(Path(__file__).with_name("encoded_by_rosbags.json").read_text())
ORDERS = ("le", "be")


def encoded(type_name: str, order: str) -> list[bytes]:
    """Return the same message in every definition of its type."""
    package, _, name = type_name.partition("/")
    return [bytes.fromhex(each) for each in _ENCODED[f"{package}/msg/{name}|{order}"]]
