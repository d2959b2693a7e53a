"""YAML file -> validated, frozen model; every error names file, key, value and unit.

The one reader of Clearway's own files.  It contains no flight code, so the simulated vehicle
may share it with the daemon that it tests.
"""

from __future__ import annotations

import re
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, Final, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import PydanticCustomError

from onboard.files import strict_yaml

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from pydantic_core import ErrorDetails

ModelT = TypeVar("ModelT", bound=BaseModel)

# A suffix that is the end of another comes after it: `_m` after `_ned_m`.
_UNITS = {
    "_per_s": "1/s",
    "_mps3": "m/s³",
    "_mps2": "m/s²",
    "_mps": "m/s",
    "_deg": "°",
    "_rad": "rad",
    "_ned_m": "m",
    "_m": "m",
    "_s": "s",
    "_hz": "Hz",
    "_kg": "kg",
    "to_weight": "times the weight",
}


# Of a longer list of words only the nearest are shown.
_OPTIONS_SHOWN: Final = 6

# A field of a hundred thousand obstacles takes a tenth of this.
FILE_BYTES_MAX: Final = 100_000_000


class FileError(ValueError):
    """A file that cannot be used; the message is one line fit for an operator."""


class FileModel(BaseModel):
    """Base of every model read from a file: frozen, no unknown keys, no NaN, no silent casts."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)


def refuse_renamed_keys(data: Any, renamed: Mapping[str, str]) -> Any:
    """Return the input of a model unchanged; for validators that run before the model's own.

    Args:
        data: keys and values as read.
        renamed: old names of keys, and the new ones.

    Raises:
        PydanticCustomError: an old name is used; `validate` names file, old and new key.
    """
    if isinstance(data, dict):
        for old, new in renamed.items():
            if old in data:
                names = {"old": old, "new": new}
                raise PydanticCustomError("renamed_key", "{old} is now called {new}", names)
    return data


def unit_of(key: str) -> str:
    """Return the unit that a key's suffix declares: "m/s" for cruise_speed_mps; '' for none."""
    return next((unit for suffix, unit in _UNITS.items() if key.endswith(suffix)), "")


def load_yaml(path: Path, model: type[ModelT]) -> ModelT:
    """Read ``path`` as YAML and validate it as ``model``.

    Raises:
        FileError: the file is missing, unreadable, not YAML, or breaks a rule of the model.
    """
    return validate(read_mapping(path), model, source=str(path))


def read_mapping(path: Path) -> dict[str, Any]:
    """Read ``path`` as one YAML mapping, refusing duplicate keys.

    Raises:
        FileError: the file is missing, unreadable, not YAML or not a mapping.
    """
    data = read_document(path)
    if data is None:
        raise FileError(f"{path}: expected keys and values, found nothing")
    if not isinstance(data, dict):
        raise FileError(f"{path}: expected keys and values, found {_describe(data)}")
    return data


def read_document(path: Path) -> Any:
    """Read ``path`` as one YAML document of any shape (`onboard.files.strict_yaml`).

    Raises:
        FileError: the file is missing, unreadable or not YAML.
    """
    return parse_document(read_text(path), source=str(path))


def read_text(path: Path) -> str:
    """Read a text file: UTF-8, with or without a byte order mark.

    Raises:
        FileError: the file is missing, unreadable, larger than `FILE_BYTES_MAX` or not UTF-8.
    """
    try:
        with path.open("rb") as file:
            data = file.read(FILE_BYTES_MAX + 1)
    except OSError as error:
        raise FileError(f"{path}: cannot be read: {error.strerror or error}") from error
    except ValueError as error:  # a zero byte in its name
        raise FileError(f"{path!s:.60}: cannot be read: {error}") from error
    if len(data) > FILE_BYTES_MAX:
        raise FileError(f"{path}: is larger than {FILE_BYTES_MAX // 1_000_000} MB")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileError(f"{path}: is not UTF-8 text (byte {error.start})") from error


def parse_document(text: str, *, source: str) -> Any:
    """Read a text as one YAML document; ``source`` names it in errors.

    Raises:
        FileError: the text is not YAML, or has a value that could be misread.
    """
    try:
        return strict_yaml.load(text)
    except strict_yaml.UnclearValueError as error:
        raise FileError(f"{source}: {error}") from error
    except yaml.YAMLError as error:
        raise FileError(f"{source}: is not valid YAML: {' '.join(str(error).split())}") from error


def parse_value(text: str, *, source: str) -> Any:
    """Read one value as given on a command line; ``source`` names it in errors.

    Raises:
        FileError: the text is not a value, or could be misread.
    """
    try:
        return strict_yaml.load(text)
    except strict_yaml.UnclearValueError as error:
        raise FileError(f"{source}: {error.reason}") from error
    except yaml.YAMLError as error:
        raise FileError(f"{source}: {text!r} is not a value") from error


def dump_document(document: Any) -> str:
    """Return a document as YAML that `parse_document` reads as the same values."""
    return strict_yaml.dump(document)


def validate(data: Any, model: type[ModelT], *, source: str) -> ModelT:
    """Validate already parsed data; ``source`` names it in errors.

    Raises:
        FileError: the data break a rule of the model.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        problems = "; ".join(map(_explain, _causes(error.errors(include_url=False))))
        raise FileError(f"{source}: {problems}") from error


def _causes(errors: list[ErrorDetails]) -> list[ErrorDetails]:
    """Return errors but for those of lists that lack only what is wrong itself."""
    wrong = {each["loc"][:length] for each in errors for length in range(len(each["loc"]))}
    return [each for each in errors if each["type"] != "too_short" or each["loc"] not in wrong]


def _explain(error: ErrorDetails) -> str:
    key = ".".join(str(part) for part in error["loc"]) or "(the whole file)"
    unit = unit_of(_innermost_key(error))
    where = f"{key} [{unit}]" if unit else key
    match error["type"]:
        case "missing":
            return f"{where} is missing"
        case "extra_forbidden":
            return f"{where} is not a known key (value {_describe(error['input'])})"
        case "renamed_key":
            names = error["ctx"]
            section = "".join(f"{part}." for part in error["loc"])
            return f"{section}{names['old']} is now called {section}{names['new']}"
        case "literal_error" if len(options := _options(error)) > _OPTIONS_SHOWN:
            near = get_close_matches(str(error["input"]), options, _OPTIONS_SHOWN, cutoff=0.0)
            expected = f"expected one of {len(options)}, nearest: {', '.join(map(repr, near))}"
            return f"{where} = {_describe(error['input'])}: {expected}"
        case _:
            reason = error["msg"].removeprefix("Value error, ")
            return f"{where} = {_describe(error['input'])}: {reason[:1].lower()}{reason[1:]}"


def _options(error: ErrorDetails) -> list[str]:
    """Return the words that a key may have."""
    return re.findall(r"'([^']*)'", str(error.get("ctx", {}).get("expected", "")))


def _innermost_key(error: ErrorDetails) -> str:
    """Return the last key that is a name: in ``size_m.1`` the unit belongs to ``size_m``."""
    return next((part for part in reversed(error["loc"]) if isinstance(part, str)), "")


def _describe(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
