"""What outlives the process: written whole, and refused where it is damaged."""

from __future__ import annotations

from pathlib import Path

import pytest

from onboard.authentication.keys import LinkState
from onboard.authentication.state_file import load_state, save_state
from onboard.files.yaml_file import FileError


def test_what_was_saved_is_loaded_and_nothing_else_is_left(tmp_path: Path) -> None:
    path = tmp_path / "new" / "state.json"
    assert load_state(path, LinkState) == LinkState(timestamp=0)
    for timestamp in (7, 8):
        save_state(path, LinkState(timestamp=timestamp))
        assert load_state(path, LinkState).timestamp == timestamp
    assert [each.name for each in path.parent.iterdir()] == ["state.json"]


@pytest.mark.parametrize("content", ["", "{", '{"timestamp": -1}', '{"time": 1}'])
def test_a_damaged_file_is_refused_and_not_taken_for_a_first_start(
    tmp_path: Path, content: str
) -> None:
    path = tmp_path / "state.json"
    path.write_text(content)
    with pytest.raises(FileError, match=r"state\.json: damaged: .*remove the file"):
        load_state(path, LinkState)


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(FileError, match=r"state\.json: cannot be written: "):
        save_state(tmp_path / "file" / "state.json", LinkState())
    with pytest.raises(FileError, match="cannot be read"):
        load_state(tmp_path, LinkState)
