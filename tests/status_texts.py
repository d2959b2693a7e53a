"""STATUSTEXT as a ground station reads it: chunks put together again."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any


def status_texts(messages: Iterable[Any]) -> list[str]:
    """Return the texts that are complete among messages, in the order in which they ended.

    Args:
        messages: as pymavlink decodes them.
    """
    parts: dict[tuple[int, int, int], dict[int, bytes]] = {}
    texts = []
    for message in messages:
        if message.get_type() != "STATUSTEXT":
            continue
        data = bytes(message._text_raw)
        if message.id == 0:
            texts.append(data.rstrip(b"\0").decode())
            continue
        text = parts.setdefault((*sender(message), message.id), {})
        text[message.chunk_seq] = data
        if b"\0" in data or len(data) < 50:
            assert sorted(text) == list(range(len(text))), "a chunk is missing"
            chunks = [text[number].split(b"\0")[0].decode() for number in sorted(text)]
            texts.append("".join(chunks))
            del parts[(*sender(message), message.id)]
    return texts


def sender(message: Any) -> tuple[int, int]:
    return message.get_srcSystem(), message.get_srcComponent()
