"""The files that the autopilot serves by MAVLink FTP.

PX4 describes its parameters in ``etc/extras`` (MAVLink's page "Component Metadata Protocol", with
its JSON schemas); ArduPilot serves their values packed, as ``@PARAM/param.pck``.
"""

from __future__ import annotations

import functools
import json
import lzma
import struct
from collections.abc import Callable, Iterable, Mapping
from itertools import takewhile
from typing import Any, Final

from sitl.autopilot.flavours.parameters import ParameterSpec, ParameterStore
from sitl.autopilot.protocol.files.file_transfer import crc32

GENERAL_METADATA: Final = "etc/extras/component_general.json.xz"
_PARAMETER_METADATA = "etc/extras/parameters.json.xz"
_TYPE_PARAMETER = 1  # COMP_METADATA_TYPE
_PACKED_PARAMETERS = "@PARAM/param.pck"
_PACK_MAGIC, _PACK_INT32, _PACK_FLOAT = 0x671B, 3, 4
_PACK_NAME_MAX = 15

Files = Mapping[str, Callable[[], bytes]]


def metadata_files(parameters: ParameterStore) -> Files:
    """Return the files that describe PX4 by their names, defaults and ranges, compressed."""

    @functools.cache
    def described() -> bytes:
        specs = map(parameters.spec, parameters.names())
        return _compressed({"version": 1, "parameters": list(map(_description, specs))})

    @functools.cache
    def general() -> bytes:
        parameter_file = {
            "type": _TYPE_PARAMETER,
            "uri": f"mftp:///{_PARAMETER_METADATA}",
            "fileCrc": crc32(described()),
        }
        return _compressed(
            {
                "version": 1,
                "vendorName": "Clearway",
                "modelName": "PX4, simulated",
                "metadataTypes": [parameter_file],
            }
        )

    return {GENERAL_METADATA: general, _PARAMETER_METADATA: described}


def packed_parameter_file(parameters: ParameterStore) -> Files:
    """Return the file of all values, in ArduPilot's packed format."""

    def content() -> bytes:
        names = parameters.names()
        head = struct.pack("<HHH", _PACK_MAGIC, len(names), len(names))
        return head + b"".join(_packed_values(parameters, names))

    return {_PACKED_PARAMETERS: content}


def _packed_values(parameters: ParameterStore, names: Iterable[str]) -> Iterable[bytes]:
    """Yield each value after what its name does not share with the name before."""
    before = ""
    for name in names:
        alike = takewhile(lambda pair: pair[0] == pair[1], zip(before, name, strict=False))
        shared = min(len(list(alike)), _PACK_NAME_MAX, len(name) - 1)
        rest = name[shared:].encode()
        whole = parameters.spec(name).is_integer
        kind = _PACK_INT32 if whole else _PACK_FLOAT
        value = parameters[name]
        number = struct.pack("<i", int(value)) if whole else struct.pack("<f", value)
        yield bytes((kind, shared | len(rest) - 1 << 4)) + rest + number
        before = name


def _description(spec: ParameterSpec) -> dict[str, Any]:
    return {
        "name": spec.name,
        "type": "Int32" if spec.is_integer else "Float",
        "shortDesc": spec.meaning,
        "default": spec.default,
        "min": spec.minimum,
        "max": spec.maximum,
    }


def _compressed(document: Mapping[str, Any]) -> bytes:
    return lzma.compress(json.dumps(document, separators=(",", ":")).encode(), preset=0)
