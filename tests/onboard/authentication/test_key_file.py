"""Keys are read from files that others cannot read, and their content is never said."""

from __future__ import annotations

from pathlib import Path

import pytest

from onboard.authentication.key_file import load_key
from onboard.files.yaml_file import FileError

DIGITS = "0f" * 32


def key_file(directory: Path, content: str = DIGITS + "\n", mode: int = 0o600) -> Path:
    path = directory / "a.key"
    path.write_text(content)
    path.chmod(mode)
    return path


@pytest.mark.parametrize("mode", [0o400, 0o600, 0o640])
def test_a_key_is_32_bytes(tmp_path: Path, mode: int) -> None:
    assert load_key(key_file(tmp_path, mode=mode)) == bytes([0x0F] * 32)


@pytest.mark.parametrize("mode", [0o604, 0o644, 0o602, 0o620, 0o660])
def test_a_key_that_others_may_read_or_change_is_refused(tmp_path: Path, mode: int) -> None:
    path = key_file(tmp_path, mode=mode)
    with pytest.raises(FileError) as refusal:
        load_key(path)
    assert str(refusal.value).startswith(f"{path}: mode {mode:04o} lets other users")
    assert str(refusal.value).endswith(f"chmod 600 {path}")


@pytest.mark.parametrize("content", ["", "secret", DIGITS[:-1], DIGITS + "0f", "zz" * 32, "é" * 64])
def test_what_is_not_a_key_is_refused_without_saying_it(tmp_path: Path, content: str) -> None:
    with pytest.raises(FileError, match="expected one line of 64 hexadecimal digits") as refusal:
        load_key(key_file(tmp_path, content))
    assert not content or content not in str(refusal.value)


def test_a_missing_key_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"no\.key: cannot be read: No such file"):
        load_key(tmp_path / "no.key")
