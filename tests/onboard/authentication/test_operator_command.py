"""A command counts once, from the operator, for this vehicle, in its kind, and in time."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.authentication.operator_command import (
    SKEW_MAX_S,
    CommandGate,
    CommandJournal,
    CommandKind,
    CommandRefusedError,
    sealed,
)
from onboard.files.yaml_file import FileError

KEY, OTHER_KEY = bytes(range(32)), bytes(32)
NOW_UNIX_S = 1_790_000_000.0
PAYLOAD = '{"passed": true, "where": "Zürich"}'.encode()
CLEARANCE = CommandKind.CLEARANCE


def envelope(key: bytes = KEY, now_unix_s: float = NOW_UNIX_S, **changes: Any) -> bytes:
    settings: dict[str, Any] = {"vehicle": "v1", "kind": CLEARANCE} | changes
    return sealed(PAYLOAD, key=key, now_unix_s=now_unix_s, **settings)


def gate(journal: CommandJournal | None = None) -> CommandGate:
    return CommandGate(KEY, "v1", journal or CommandJournal())


def refusal(opened: CommandGate, data: bytes, now_unix_s: float = NOW_UNIX_S) -> str:
    with pytest.raises(CommandRefusedError) as refused:
        opened.open(CLEARANCE, data, now_unix_s)
    return str(refused.value)


def test_the_operators_command_arrives_as_it_was_sent() -> None:
    assert gate().open(CLEARANCE, envelope(), NOW_UNIX_S + 1.0) == PAYLOAD


@pytest.mark.parametrize(
    "data",
    [PAYLOAD, b"", b"\xff", b"[]", envelope().replace(b"payload", b"payloat"), b'{"version": 2}'],
)
def test_what_is_not_in_an_envelope_is_not_signed(data: bytes) -> None:
    assert refusal(gate(), data) == "not signed with the operator's key"


def test_another_key_vehicle_or_kind_is_a_forgery() -> None:
    forged = "signed with another key, or altered"
    for data in (
        envelope(OTHER_KEY), envelope(vehicle="v2"), envelope(kind=CommandKind.MISSION)
    ):  # fmt: skip
        assert refusal(gate(), data) == forged


@pytest.mark.parametrize(
    "change",
    [
        {"payload": PAYLOAD.decode().replace("true", "1")},
        {"stamp_unix_ms": round(NOW_UNIX_S * 1e3) + 1},
        {"nonce": "0" * 32},
        {"hmac_sha256": "0" * 64},
    ],
)
def test_whatever_is_altered_is_noticed(change: dict[str, Any]) -> None:
    data = json.dumps(json.loads(envelope()) | change).encode()
    assert refusal(gate(), data) == "signed with another key, or altered"


@given(st.binary(max_size=300))
def test_no_bytes_raise_anything_else(data: bytes) -> None:
    assert refusal(gate(), data) == "not signed with the operator's key"


def test_a_command_is_accepted_once_also_after_a_restart() -> None:
    kept: list[CommandJournal] = []
    first, data = CommandGate(KEY, "v1", CommandJournal(), kept.append), envelope()
    first.open(CLEARANCE, data, NOW_UNIX_S)
    assert refusal(first, data) == "received before: a replay"
    restarted = gate(CommandJournal.model_validate_json(kept[-1].model_dump_json()))
    assert refusal(restarted, data) == "received before: a replay"
    assert restarted.open(CLEARANCE, envelope(), NOW_UNIX_S) == PAYLOAD


@pytest.mark.parametrize(("ahead_s", "where"), [(31.0, "ahead of"), (-31.0, "behind")])
def test_the_clocks_have_to_agree(ahead_s: float, where: str) -> None:
    said = refusal(gate(), envelope(now_unix_s=NOW_UNIX_S + ahead_s))
    assert said.startswith(f"its stamp is 31.0 s {where} this computer's clock (limit 30 s)")
    for within_s in (-SKEW_MAX_S, SKEW_MAX_S):
        gate().open(CLEARANCE, envelope(now_unix_s=NOW_UNIX_S + within_s), NOW_UNIX_S)


def test_a_clock_that_is_set_back_brings_no_old_command_back() -> None:
    opened, old = gate(), envelope()
    opened.open(CLEARANCE, old, NOW_UNIX_S)
    later_s = NOW_UNIX_S + 3600.0
    opened.open(CLEARANCE, envelope(now_unix_s=later_s), later_s)
    assert "older than what was accepted" in refusal(opened, old)


def test_a_command_that_cannot_be_remembered_is_refused() -> None:
    def full(_: CommandJournal) -> None:
        raise FileError("j.json: cannot be written: No space left on device")

    opened, data = CommandGate(KEY, "v1", CommandJournal(), full), envelope()
    assert refusal(opened, data) == (
        "it cannot be remembered: j.json: cannot be written: No space left on device"
    )


def test_what_is_remembered_stays_small() -> None:
    kept: list[CommandJournal] = []
    opened = CommandGate(KEY, "v1", CommandJournal(), kept.append)
    for second in range(300):
        opened.open(CLEARANCE, envelope(now_unix_s=NOW_UNIX_S + second), NOW_UNIX_S + second)
    assert len(kept[-1].accepted) == 2 * SKEW_MAX_S + 1
