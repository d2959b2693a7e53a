"""Secret keys, as files that only their owner and group can read.

A key file is one line of 64 hexadecimal digits, which is 32 bytes: what MAVLink signing needs, and
what HMAC-SHA256 takes without loss.
"""

from __future__ import annotations

import stat
from pathlib import Path
from typing import Final

from onboard.files.yaml_file import FileError

KEY_BYTES: Final = 32
_HEX_DIGITS: Final = 2 * KEY_BYTES
# No key is longer than this, with whatever surrounds it.
_FILE_MAX_BYTES: Final = 4096


def load_key(path: Path) -> bytes:
    """Read a key of 32 bytes.

    Raises:
        FileError: the file cannot be read, other users may read or change it, or it is not a key.
            The message never contains what the file does.
    """
    try:
        with path.open("rb") as file:
            mode = stat.S_IMODE(path.stat().st_mode)
            content = file.read(_FILE_MAX_BYTES)
    except OSError as error:
        raise FileError(f"{path}: cannot be read: {error.strerror or error}") from error
    if mode & (stat.S_IRWXO | stat.S_IWGRP):
        raise FileError(
            f"{path}: mode {mode:04o} lets other users read or change the key "
            f"(expected 0600 or 0640): chmod 600 {path}"
        )
    try:
        digits = content.decode("ascii").strip()
        key = bytes.fromhex(digits)
    except ValueError:
        digits, key = "", b""
    if len(key) != KEY_BYTES or len(digits) != _HEX_DIGITS:
        raise FileError(
            f"{path}: not a key (expected one line of {_HEX_DIGITS} hexadecimal digits)"
        )
    return key
