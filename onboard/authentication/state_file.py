"""Small files that outlive the process: what was accepted and what was signed last."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel

from onboard.files.json_payload import MalformedPayloadError, parse
from onboard.files.yaml_file import FileError

M = TypeVar("M", bound=BaseModel)


def load_state(path: Path, model: type[M]) -> M:
    """Read a state file; one that does not exist yet is the model's default.

    Raises:
        FileError: it cannot be read, or was written by something else.
    """
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        return model()
    except OSError as error:
        raise FileError(f"{path}: cannot be read: {error.strerror or error}") from error
    try:
        return parse(content, model)
    except MalformedPayloadError as error:
        text = f"{path}: damaged: {error}; remove the file once you know why"
        raise FileError(text) from error


def save_state(path: Path, state: BaseModel) -> None:
    """Replace a state file: a process that dies leaves the old one or the new one.

    Raises:
        FileError: it cannot be written.
    """
    written = path.with_name(f".{path.name}.new")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with written.open("wb") as file:
            file.write(state.model_dump_json().encode())
            file.flush()
            os.fsync(file.fileno())
        written.replace(path)
    except OSError as error:
        raise FileError(f"{path}: cannot be written: {error.strerror or error}") from error
