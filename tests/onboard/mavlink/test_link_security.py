"""What the endpoint reads with a key and without, and what it says of the rest."""

from __future__ import annotations

from onboard.mavlink.endpoint import MavlinkEndpoint
from onboard.mavlink.signing import LinkSigning, Objection
from tests.onboard.mavlink.test_endpoint import LOITER, Autopilot
from tests.onboard.mavlink.test_signing import KEY, NOW, OTHER_KEY, frame


def endpoint(key: bytes | None = KEY) -> MavlinkEndpoint:
    return MavlinkEndpoint(1, None if key is None else LinkSigning(key, 0, NOW))


def test_a_signed_vehicle_is_read_and_told_in_signed_messages() -> None:
    link = endpoint()
    link.receive(frame(NOW), 1.0)
    assert link.status.heard_s == 1.0
    assert link.security.doubt(1.0) is None
    link.keep_alive(1.0, active=False)
    other = Autopilot(component=2)
    other.mav.signing.secret_key = KEY
    other.mav.signing.timestamp = NOW
    heard = list(other.heard(link.bytes_to_send()))
    assert heard
    assert all(message.get_signed() for message in heard)


def test_unsigned_forged_and_replayed_messages_are_counted_said_and_dropped() -> None:
    link = endpoint()
    for data in (frame(), frame(), frame(NOW, OTHER_KEY)):
        link.receive(data, 1.0)
    assert link.status.heard_s < 0.0
    assert link.security.refused == {Objection.UNSIGNED: 2, Objection.FORGED: 1}
    assert [event.text for event in link.security.take_news()] == [
        "MAVLink messages of 1/1 are refused: not signed",
        "MAVLink messages of 1/1 are refused: signed with another key, or altered",
    ]
    assert link.security.take_news() == []
    assert link.security.doubt(1.0) == (
        "every message of the vehicle is refused: signed with another key, or altered "
        "(mavlink.signing)"
    )
    link.receive(frame(NOW), 1.5)
    link.receive(frame(NOW), 1.6)
    assert link.security.refused[Objection.REPLAYED] == 1
    assert link.security.doubt(1.6) is None  # single forgeries beside a genuine vehicle


def test_radio_status_needs_no_signature() -> None:
    link, radio = endpoint(), Autopilot(51, 68)
    radio.mav.radio_status_send(1, 1, 1, 1, 1, 1, 1)
    link.receive(radio.said(), 1.0)
    assert not link.security.refused


def test_a_vehicle_that_signs_is_noticed_where_no_key_is_configured() -> None:
    link = endpoint(None)
    link.receive(Autopilot().heartbeat(LOITER, armed=False), 1.0)
    assert link.security.doubt(1.0) is None
    link.receive(frame(NOW), 2.0)
    assert link.status.heard_s == 2.0
    text = link.security.doubt(2.0)
    assert text is not None
    assert text.startswith("the vehicle signs its messages and mavlink.signing names no key")
    assert [event.text for event in link.security.take_news()] == [text]
    assert link.security.doubt(9.0) is None
