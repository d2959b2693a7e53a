"""The parameter protocol: PARAM_REQUEST_LIST, PARAM_REQUEST_READ, PARAM_SET and their answers."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.flavours.parameters import ParameterStore, SetResult
from sitl.autopilot.protocol.files.file_transfer import crc32

_ERRORS = {
    SetResult.UNKNOWN: mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST,
    SetResult.OUT_OF_RANGE: mavlink.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE,
    SetResult.READ_ONLY: mavlink.MAV_PARAM_ERROR_READ_ONLY,
}
TYPE_MISMATCH: Final = 7  # MAV_PARAM_ERROR, not yet in pymavlink's dialect
_ID_LENGTH = 16
_NO_INDEX = 0xFFFF
HASH_NAME: Final = "_HASH_CHECK"


class ParameterProtocol:
    """The vehicle's side of the protocol.

    Args:
        store: the values.
        bytewise: PX4's protocol: integers are copied into the float field bit by bit, the type of
            a new value must be the parameter's, and ``_HASH_CHECK`` is the hash of all values.
            Else ArduPilot's: integers travel as plain floats, types do not matter.
    """

    def __init__(self, store: ParameterStore, *, bytewise: bool) -> None:
        self._store = store
        self._bytewise = bytewise
        self._handlers: dict[str, Callable[[Any], list[Any]]] = {
            "PARAM_REQUEST_LIST": self._on_request_list,
            "PARAM_REQUEST_READ": self._on_request_read,
            "PARAM_SET": self._on_set,
        }

    @property
    def messages(self) -> tuple[str, ...]:
        """Names of the messages that :meth:`receive` understands."""
        return tuple(self._handlers)

    def receive(self, message: Any) -> list[Any]:
        """Return the answers to a message: PARAM_VALUE, or PARAM_ERROR as the only one."""
        return self._handlers[message.get_type()](message)

    def _on_request_list(self, _: Any) -> list[Any]:
        head = [self._hash()] if self._bytewise else []
        return head + [self._value(name) for name in self._store.names()]

    def _on_request_read(self, message: Any) -> list[Any]:
        names = self._store.names()
        index = message.param_index
        if self._bytewise and index < 0 and message.param_id == HASH_NAME:
            return [self._hash()]
        if index >= len(names) or (index < 0 and message.param_id not in self._store):
            return [_refusal(message, index, SetResult.UNKNOWN)]
        return [self._value(message.param_id if index < 0 else names[index])]

    def _on_set(self, message: Any) -> list[Any]:
        value = float(message.param_value)
        name = message.param_id
        writable = name in self._store and not self._store.spec(name).read_only
        if self._bytewise and writable and message.param_type != self._kind(name):
            return [_error(message, -1, TYPE_MISMATCH)]
        if self._bytewise and message.param_type == mavlink.MAV_PARAM_TYPE_INT32:
            value = float(struct.unpack("<i", struct.pack("<f", value))[0])
        result = self._store.set(message.param_id, value)
        if result is SetResult.DONE:
            return [self._value(message.param_id)]
        return [_refusal(message, -1, result)]

    def _kind(self, name: str) -> int:
        """Return MAV_PARAM_TYPE of a parameter."""
        whole = self._store.spec(name).is_integer
        return int(mavlink.MAV_PARAM_TYPE_INT32 if whole else mavlink.MAV_PARAM_TYPE_REAL32)

    def _hash(self) -> Any:
        """Return PX4's hash of all names and values, so that a client can keep those it knows."""
        content = b"".join(
            name.encode() + struct.pack("<i" if spec.is_integer else "<f", self._store[name])
            for name in self._store.names()
            for spec in (self._store.spec(name),)
        )
        return mavlink.MAVLink_param_value_message(
            HASH_NAME.encode(),
            struct.unpack("<f", struct.pack("<I", crc32(content)))[0],
            mavlink.MAV_PARAM_TYPE_UINT32,
            len(self._store),
            _NO_INDEX,
        )

    def _value(self, name: str) -> Any:
        value, kind = self._store[name], self._kind(name)
        if self._bytewise and kind == mavlink.MAV_PARAM_TYPE_INT32:
            value = struct.unpack("<f", struct.pack("<i", int(value)))[0]
        names = self._store.names()
        return mavlink.MAVLink_param_value_message(
            name.encode(), value, kind, len(names), names.index(name)
        )


def _refusal(message: Any, index: int, result: SetResult) -> Any:
    return _error(message, index, _ERRORS[result])


def _error(message: Any, index: int, error: int) -> Any:
    return mavlink.MAVLink_param_error_message(
        message.get_srcSystem(),
        message.get_srcComponent(),
        message.param_id.encode()[:_ID_LENGTH],
        index,
        error,
    )
