"""The parameter protocol: PARAM_REQUEST_LIST, PARAM_REQUEST_READ, PARAM_SET and their answers."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.flavours.parameters import ParameterStore, SetResult

_ERRORS = {
    SetResult.UNKNOWN: mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST,
    SetResult.OUT_OF_RANGE: mavlink.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE,
    SetResult.READ_ONLY: mavlink.MAV_PARAM_ERROR_READ_ONLY,
}
_ID_LENGTH = 16


class ParameterProtocol:
    """The vehicle's side of the protocol.

    Args:
        store: the values.
        bytewise: integers are copied into the float field bit by bit (PX4); else they travel as
            plain floats (ArduPilot).
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
        return [self._value(name) for name in self._store.names()]

    def _on_request_read(self, message: Any) -> list[Any]:
        names = self._store.names()
        index = message.param_index
        if index >= len(names) or (index < 0 and message.param_id not in self._store):
            return [_refusal(message, index, SetResult.UNKNOWN)]
        return [self._value(message.param_id if index < 0 else names[index])]

    def _on_set(self, message: Any) -> list[Any]:
        value = float(message.param_value)
        if self._bytewise and message.param_type == mavlink.MAV_PARAM_TYPE_INT32:
            value = float(struct.unpack("<i", struct.pack("<f", value))[0])
        result = self._store.set(message.param_id, value)
        if result is SetResult.DONE:
            return [self._value(message.param_id)]
        return [_refusal(message, -1, result)]

    def _value(self, name: str) -> Any:
        value = self._store[name]
        kind = mavlink.MAV_PARAM_TYPE_REAL32
        if self._store.spec(name).is_integer:
            kind = mavlink.MAV_PARAM_TYPE_INT32
            if self._bytewise:
                value = struct.unpack("<f", struct.pack("<i", int(value)))[0]
        names = self._store.names()
        return mavlink.MAVLink_param_value_message(
            name.encode(), value, kind, len(names), names.index(name)
        )


def _refusal(message: Any, index: int, result: SetResult) -> Any:
    return mavlink.MAVLink_param_error_message(
        message.get_srcSystem(),
        message.get_srcComponent(),
        message.param_id.encode()[:_ID_LENGTH],
        index,
        _ERRORS[result],
    )
