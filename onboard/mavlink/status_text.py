"""Splits texts for the operator into the chunks of STATUSTEXT.

https://mavlink.io/en/messages/common.html#STATUSTEXT: chunks share an ``id`` and are numbered by
``chunk_seq``; the first NUL ends the text, so every chunk but the last is full, and a last chunk
that would be full is followed by an empty one.
"""

from __future__ import annotations

from typing import Final

CHUNK_BYTES: Final = 50
# Five messages: enough for a sentence with its numbers, and little enough for a telemetry radio.
TEXT_BYTES_MAX: Final = 5 * CHUNK_BYTES - 1
_ELLIPSIS: Final = b"..."
# Control characters mean nothing to an operator, and a NUL would end the text.
_CONTROL: Final = dict.fromkeys((*range(0x20), *range(0x7F, 0xA0)), " ")


def chunks(text: str) -> list[bytes]:
    """Return a text as UTF-8 in chunks of 50 bytes, the last one shorter unless it is the only one.

    Receivers decode each chunk by itself, so spaces move a character that would straddle two chunks
    to the second.  A text longer than `TEXT_BYTES_MAX` is cut and ends in dots.
    """
    data = _aligned(text.translate(_CONTROL))
    if len(data) > TEXT_BYTES_MAX:
        cut = data[: TEXT_BYTES_MAX - len(_ELLIPSIS)].decode(errors="ignore")
        data = cut.encode() + _ELLIPSIS
    if len(data) <= CHUNK_BYTES:
        return [data]
    return [data[start : start + CHUNK_BYTES] for start in range(0, len(data) + 1, CHUNK_BYTES)]


def _aligned(text: str) -> bytes:
    """Return the text's bytes, padded so that no character crosses a multiple of `CHUNK_BYTES`."""
    data = bytearray()
    # A lone surrogate cannot be encoded.
    for character in text.encode(errors="replace").decode():
        encoded = character.encode()
        left = -len(data) % CHUNK_BYTES
        if 0 < left < len(encoded):
            data += b" " * left
        data += encoded
    return bytes(data)
