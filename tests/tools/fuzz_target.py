"""The fuzz target: simulated vehicles in the air, and bytes on their links.

A vehicle that signs its messages hangs in the air and gets bytes, raw and wrapped into frames with
right checksums, on two links.  None of it is genuine, so nothing may raise, and the vehicle may not
move, change its mode or one of its parameters.  Every input is also given to a vehicle without
signing, whose handlers it reaches: there nothing may raise, and the state stays finite.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.config import StartConfig, VehicleConfig
from sitl.vehicle.vehicle import SimulatedVehicle

WORDS = "open sesame"
FLAVOURS = ("px4", "ardupilot")
HOVER_NED_M = (0.0, 0.0, -4.0)
_ADVANCE = 20  # inputs between two ticks of 10 ms
_RENEW = 2000  # inputs after which an unsigned vehicle is replaced
_STILL_M = 1e-3


def framed(data: bytes) -> Iterator[bytes]:
    """Yield frames with right checksums: two bytes choose each message, the rest is its content."""
    ids = sorted(mavlink.mavlink_map)
    while len(data) >= 4:
        kind = mavlink.mavlink_map[ids[int.from_bytes(data[:2], "little") % len(ids)]]
        size = min(kind.unpacker.size, len(data) - 4)
        body = data[4 : 4 + size].ljust(kind.unpacker.size, b"\0")
        header = bytes([len(body), 0, 0, data[2], 1 + data[3] % 2, 196])
        checked = header + kind.id.to_bytes(3, "little") + body
        checksum = mavlink.x25crc(checked + bytes([kind.crc_extra])).crc
        yield b"\xfd" + checked + int(checksum).to_bytes(2, "little")
        data = data[4 + size :]


class Target:
    """Two hovering vehicles of each flavour: one that signs, and one that does not."""

    def __init__(self) -> None:
        self.inputs = 0
        self._pairs = [
            _Pair(_vehicle(flavour, WORDS), _vehicle(flavour, None)) for flavour in FLAVOURS
        ]

    def feed(self, data: bytes) -> None:
        """Give an input to the vehicles of each flavour in turn.

        Raises:
            AssertionError: bytes without a key have moved or changed a vehicle.
        """
        self.inputs += 1
        pair = self._pairs[self.inputs % len(FLAVOURS)]
        if self.inputs // len(FLAVOURS) % _RENEW == 0:
            pair.renew(FLAVOURS[self.inputs % len(FLAVOURS)])
        pair.feed(data)
        if self.inputs // len(FLAVOURS) % _ADVANCE == 0:
            pair.advance()

    @property
    def handled(self) -> tuple[str, ...]:
        """Names of the messages that reach a handler."""
        return self._pairs[0].unsigned.autopilot.handled

    def disturb(self) -> None:
        """Disarm the vehicle that signs, which no input may do."""
        self._pairs[0].signed.autopilot.commander.disarm(force=True)


class _Pair:
    """A vehicle that signs, as it was at the start, and one that does not."""

    def __init__(self, signed: SimulatedVehicle, unsigned: SimulatedVehicle) -> None:
        self.signed = signed
        self.unsigned = unsigned
        self._before = _state(signed)

    def renew(self, flavour: str) -> None:
        """Replace the vehicle that obeys unsigned messages, wherever it has flown."""
        self.unsigned = _vehicle(flavour, None)

    def feed(self, data: bytes) -> None:
        """Give both the bytes as they are, and frames made of them."""
        for vehicle in (self.signed, self.unsigned):
            vehicle.receive(data, 0)
            for frame in framed(data):
                vehicle.receive(frame, 1)
            for link in (0, 1):
                vehicle.bytes_to_send(link)

    def advance(self) -> None:
        """Advance both vehicles and check their state."""
        for vehicle in (self.signed, self.unsigned):
            vehicle.advance(vehicle.truth.time_s + 0.01)
        if _state(self.signed) != self._before:
            raise AssertionError("an unsigned message changed the vehicle that signs")
        if math.dist(self.signed.truth.position_ned_m, HOVER_NED_M) > _STILL_M:
            raise AssertionError("an unsigned message moved the vehicle that signs")
        if not all(map(math.isfinite, self.unsigned.truth.position_ned_m)):
            raise AssertionError("the state of the vehicle is not finite")


def _vehicle(flavour: str, words: str | None) -> SimulatedVehicle:
    config = VehicleConfig.model_validate(
        # An estimate that wanders would move the vehicle too.
        {
            "flavour": flavour,
            "start": StartConfig(position_ned_m=HOVER_NED_M),
            "realism": "ideal",
        }
    )
    return SimulatedVehicle(config.model_copy(update={"signing_passphrase": words}))


def _state(vehicle: SimulatedVehicle) -> tuple[object, ...]:
    autopilot = vehicle.autopilot
    values = tuple(autopilot.parameters[name] for name in autopilot.parameters.names())
    commander = autopilot.commander
    return commander.armed, commander.mode, commander.mission.items, values


def seeds() -> Iterator[bytes]:
    """Yield one well-formed input for every message that the autopilot handles."""
    ids = sorted(mavlink.mavlink_map)
    for name in _vehicle("px4", None).autopilot.handled:
        number = ids.index(getattr(mavlink, f"MAVLINK_MSG_ID_{name}"))
        size = mavlink.mavlink_map[ids[number]].unpacker.size
        yield number.to_bytes(2, "little") + bytes([0, 0]) + bytes([1] * size)
