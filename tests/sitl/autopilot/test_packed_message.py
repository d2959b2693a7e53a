"""A message that pymavlink's dialect lacks is packed like any other."""

import struct

from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.dialects.v20 import development

from sitl.autopilot.packed_message import PackedMessage


class Monitor(PackedMessage):
    layout = struct.Struct("<B")


def test_a_peer_that_knows_the_message_decodes_it() -> None:
    frame = Monitor(437, "AVAILABLE_MODES_MONITOR", 30, 7).pack(mavlink.MAVLink(None, 1, 1))
    (decoded,) = development.MAVLink(None).parse_buffer(frame)
    assert (decoded.get_type(), decoded.seq) == ("AVAILABLE_MODES_MONITOR", 7)


def test_a_wrong_check_byte_is_no_frame() -> None:
    frame = Monitor(437, "AVAILABLE_MODES_MONITOR", 31, 7).pack(mavlink.MAVLink(None, 1, 1))
    codec = development.MAVLink(None)
    codec.robust_parsing = True
    found = codec.parse_buffer(frame) or []
    assert [message.get_type() for message in found] == ["BAD_DATA"]
