"""PROTOCOL_VERSION and COMPONENT_METADATA, byte by byte: pymavlink's dialects lack both."""

import struct

from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.generator.mavcrc import x25crc

from sitl.autopilot.packed_message import PackedMessage
from sitl.autopilot.protocol.identity_messages import ComponentMetadata, ProtocolVersion


def crc_extra(name: str, *fields: tuple[str, str, int]) -> int:
    """Return the check byte of a definition, as MAVLink's serialization page says."""
    crc = x25crc()
    crc.accumulate_str(f"{name} ")
    for kind, field, length in fields:
        crc.accumulate_str(f"{kind} {field} ")
        if length:
            crc.accumulate([length])
    return int((crc.crc & 0xFF) ^ (crc.crc >> 8))


def payload(message: PackedMessage) -> bytes:
    """Return the payload, with the zeros at its end that MAVLink 2 cuts off."""
    frame: bytes = message.pack(mavlink.MAVLink(None, 1, 1))
    return frame[10 : 10 + frame[1]].ljust(message.layout.size, b"\0")


def test_mavlink_1_and_2_are_understood() -> None:
    message = ProtocolVersion()
    assert struct.unpack_from("<HHH", payload(message)) == (200, 100, 200)
    numbers = [("uint16_t", f"{each}version", 0) for each in ("", "min_", "max_")]
    hashes = [("uint8_t", f"{each}_version_hash", 8) for each in ("spec", "library")]
    assert message.crc_extra == crc_extra("PROTOCOL_VERSION", *numbers, *hashes)


def test_the_metadata_are_a_file_on_board() -> None:
    message = ComponentMetadata(1234, 0xDEADBEEF, "etc/general.json.xz")
    boot_ms, checksum = struct.unpack_from("<II", payload(message))
    assert (boot_ms, checksum) == (1234, 0xDEADBEEF)
    assert payload(message)[8:].rstrip(b"\0") == b"mftp:///etc/general.json.xz"
    assert message.crc_extra == crc_extra(
        "COMPONENT_METADATA",
        ("uint32_t", "time_boot_ms", 0),
        ("uint32_t", "file_crc", 0),
        ("char", "uri", 100),
    )
