"""Keys as the daemon's file names them; time stamps that outlive it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from onboard.authentication.keys import DaemonKeys, LinkState, first_timestamp
from onboard.files.daemon_config import DaemonConfig
from onboard.files.yaml_file import FileError, validate
from onboard.mavlink.signing import timestamp_at
from tests.onboard.mavlink.test_signing import frame

NOW_UNIX_S = 1_790_000_000.0
NOW = timestamp_at(NOW_UNIX_S)
BOTH: dict[str, Any] = {
    "mavlink": {"signing": {"key_file": "a.key", "link_id": 4}},
    "operator_key_file": "a.key",
}


def config(**changes: Any) -> DaemonConfig:
    document = {"contract": "c.yaml", "mission": "m.yaml", "vehicle": "v1"} | changes
    return validate(document, DaemonConfig, source="onboard.yaml")


def loaded(directory: Path, now_unix_s: float = NOW_UNIX_S, **changes: Any) -> DaemonKeys:
    key = directory / "a.key"
    key.touch(0o600)
    key.write_text("00" * 32)
    return DaemonKeys.load(config(**changes), directory, directory / "state", now_unix_s)


def test_without_keys_nothing_is_signed_nor_written(tmp_path: Path) -> None:
    keys = loaded(tmp_path)
    assert keys == DaemonKeys()
    assert keys.is_genuine(frame())
    keys.save()
    assert not (tmp_path / "state").exists()


def test_keys_are_relative_to_the_file_and_state_is_not(tmp_path: Path) -> None:
    keys = loaded(tmp_path, **BOTH)
    assert keys.signing is not None
    assert keys.commands is not None
    assert not keys.is_genuine(frame())
    assert keys.is_genuine(frame(1, bytes(32)))
    assert {each.name for each in (tmp_path / "state").iterdir()} == {
        "v1-mavlink-signing.json", "v1-operator-commands.json"
    }  # fmt: skip


@pytest.mark.parametrize("clock_s", [NOW_UNIX_S + 60.0, NOW_UNIX_S, 0.0])
def test_no_time_stamp_is_used_twice_over_a_restart(tmp_path: Path, clock_s: float) -> None:
    before = loaded(tmp_path, **BOTH)
    assert before.signing is not None
    before.save()
    # The daemon dies just before it would save again.
    before.signing.follow_clock(NOW_UNIX_S + 9.9)
    last = before.signing.sign(frame())
    after = loaded(tmp_path, clock_s, **BOTH)
    assert after.signing is not None
    first = after.signing.sign(frame())
    assert first[-12:-6][::-1] > last[-12:-6][::-1]


def test_a_right_clock_is_followed_and_quick_restarts_do_not_run_ahead_of_it() -> None:
    assert first_timestamp(LinkState(timestamp=NOW - 1), NOW_UNIX_S) == NOW


def test_a_state_that_cannot_be_written_is_refused_at_the_start(tmp_path: Path) -> None:
    (tmp_path / "state").touch()
    with pytest.raises(FileError, match="state/v1-mavlink-signing"):
        loaded(tmp_path, **BOTH)
