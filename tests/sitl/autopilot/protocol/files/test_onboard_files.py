"""The files on board: metadata that describe every parameter, and all values packed."""

from __future__ import annotations

import json
import lzma
import struct
from typing import Any

import pytest

from sitl.autopilot.flavours.ardupilot import Copter
from sitl.autopilot.flavours.parameters import ParameterStore
from sitl.autopilot.flavours.px4 import Px4
from sitl.autopilot.protocol.files.file_transfer import crc32
from sitl.autopilot.protocol.files.onboard_files import (
    GENERAL_METADATA,
    metadata_files,
    packed_parameter_file,
)


def document(content: bytes) -> Any:
    return json.loads(lzma.decompress(content))


def test_the_general_file_leads_to_the_description_of_every_parameter() -> None:
    store = ParameterStore(Px4().parameter_specs(1), {})
    files = metadata_files(store)
    (entry,) = document(files[GENERAL_METADATA]())["metadataTypes"]
    content = files[entry["uri"].removeprefix("mftp:///")]()
    assert entry["fileCrc"] == crc32(content)
    described = {each["name"]: each for each in document(content)["parameters"]}
    assert tuple(described) == store.names()
    limit = described["COM_OF_LOSS_T"]
    assert (limit["type"], limit["min"], limit["max"], limit["default"]) == ("Float", 0, 60, 1)
    assert described["COM_OBL_RC_ACT"]["type"] == "Int32"


def unpacked(content: bytes) -> dict[str, float]:
    """Read ArduPilot's packed format, as its definition says."""
    magic, sent, total = struct.unpack_from("<HHH", content)
    assert (magic, sent) == (0x671B, total)
    values: dict[str, float] = {}
    at, name = 6, b""
    while at < len(content):
        kind, lengths = content[at], content[at + 1]
        length = (lengths >> 4) + 1
        at += 2
        name = name[: lengths & 0x0F] + content[at : at + length]
        at += length
        (values[name.decode()],) = struct.unpack_from({3: "<i", 4: "<f"}[kind], content, at)
        at += 4
    assert len(values) == total
    return values


def test_all_values_are_packed_as_they_are_when_the_file_is_opened() -> None:
    store = ParameterStore(Copter().parameter_specs(1), {})
    files = packed_parameter_file(store)
    store.set("GUID_TIMEOUT", 1.5)
    values = unpacked(files["@PARAM/param.pck"]())
    assert values == pytest.approx({name: store[name] for name in store.names()})
    assert values["GUID_TIMEOUT"] == 1.5
