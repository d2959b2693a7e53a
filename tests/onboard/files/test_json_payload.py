"""Payloads become models, or one line that names the first offending key."""

from __future__ import annotations

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel, ConfigDict

from onboard.files.json_payload import MalformedPayloadError, parse


class Inner(BaseModel):
    """A part of a payload."""

    model_config = ConfigDict(extra="forbid")
    size_m: tuple[float, float]


class Payload(BaseModel):
    """A whole payload."""

    model_config = ConfigDict(extra="forbid")
    seq: int
    boxes: list[Inner] = []


def problem_of(payload: bytes) -> str:
    with pytest.raises(MalformedPayloadError) as caught:
        parse(payload, Payload)
    message = str(caught.value)
    assert "\n" not in message
    return message


def test_a_payload_becomes_its_model() -> None:
    payload = b'{"seq": 7, "boxes": [{"size_m": [1, 2.5]}]}'
    assert parse(payload, Payload) == Payload(seq=7, boxes=[Inner(size_m=(1.0, 2.5))])


@pytest.mark.parametrize(
    ("payload", "problem"),
    [
        (b"", "payload: Invalid JSON"),
        (b"{", "payload: Invalid JSON"),
        (b"\xff\xfe", "payload: Invalid JSON"),
        (b"[]", "payload: Input should be an object"),
        (b"null", "payload: Input should be an object"),
        (b"{}", "seq: Field required"),
        (b'{"seq": 1.5}', "seq: Input should be a valid integer"),
        (b'{"seq": 1, "more": 2}', "more: Extra inputs are not permitted"),
        (b'{"seq": 1, "boxes": [{"size_m": [1]}]}', "boxes.0.size_m.1: Field required"),
        (
            b'{"seq": 1, "boxes": [{"size_m": [1, 2]}, {"size_m": [1, "a"]}]}',
            "boxes.1.size_m.1: Input should be a valid number",
        ),
    ],
)
def test_the_first_offending_key_is_named(payload: bytes, problem: str) -> None:
    assert problem_of(payload).startswith(problem)


def test_only_the_first_of_several_is_named() -> None:
    message = problem_of(b'{"seq": "a", "boxes": 3}')
    assert message.startswith("seq: ")
    assert "boxes" not in message


def test_the_value_itself_is_not_repeated() -> None:
    secret = "x" * 10_000
    assert secret not in problem_of(b'{"seq": "' + secret.encode() + b'"}')


@given(st.binary(max_size=40))
def test_arbitrary_bytes_raise_nothing_else(payload: bytes) -> None:
    with contextlib.suppress(MalformedPayloadError):
        assert isinstance(parse(payload, Payload), Payload)
