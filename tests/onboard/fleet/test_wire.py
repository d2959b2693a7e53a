"""Bytes of the fleet's messages: what they say, and what is dropped."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from onboard.files.json_payload import MalformedPayloadError
from onboard.fleet.area import along
from onboard.fleet.link import FleetLink
from onboard.fleet.messages import (
    Ack,
    Commit,
    Head,
    Heartbeat,
    Message,
    MessageKind,
    Propose,
    Tube,
)
from onboard.fleet.wire import FleetWire
from onboard.geometry.local_frame import Autopilot, GeographicPoint, LocalFrame
from tests.onboard.fleet.pair import BOOTS, vehicle

SHA = {"a": "1" * 64, "b": "2" * 64}
ZURICH = LocalFrame(GeographicPoint(47.397742, 8.545594))
TUBE = Tube(3, along((0.0, -40.0), (30.0, 60.0), 1.5, 12))
HEAD = Head("b", BOOTS["b"], 7)
HEARTBEAT = Heartbeat(HEAD, TUBE, None, (10.0, -6.0), 0.25, 1.5, {"a": (BOOTS["a"], 5)})
MESSAGES: list[Message] = [
    Propose(HEAD, TUBE, 12.5),
    Ack(HEAD, "a", BOOTS["a"], 4),
    Commit(HEAD, 4, committed=False),
    HEARTBEAT,
    Heartbeat(HEAD, TUBE, Tube(5, TUBE.boxes_m), (0.0, 0.0), 0.0, 1.5),
]


def wire(frame: LocalFrame = ZURICH, key: bytes | None = None) -> FleetWire:
    return FleetWire(frame, SHA, key)


def changed(message: Message, **changes: Any) -> bytes:
    document = json.loads(wire().encoded(message)[1])
    return json.dumps(document | changes).encode()


@pytest.mark.parametrize("key", [None, b"k" * 32])
@pytest.mark.parametrize("message", MESSAGES, ids=lambda each: type(each).__name__)
def test_what_is_written_is_read(message: Message, key: bytes | None) -> None:
    kind, payload = wire(key=key).encoded(message)
    read = wire(key=key).decoded("b", kind, payload)
    assert type(read) is type(message)
    assert read.head == message.head
    for name, value in vars(message).items():
        if isinstance(value, Tube):
            assert getattr(read, name).number == value.number
        elif name == "position_m":
            assert read.position_m == pytest.approx(value, abs=1e-6)  # type: ignore[union-attr]
        else:
            assert getattr(read, name) == value


@example(65.0, 0.0, 0.0, 1500.0, "px4", "ardupilot")
@example(65.0, 0.0, 0.0, 1500.0, "ardupilot", "px4")
@given(
    st.floats(-65.0, 65.0),
    st.floats(-3e3, 3e3),
    st.floats(-3e3, 3e3),
    st.floats(0.3, 6.0) | st.floats(100.0, 1500.0),
    st.sampled_from(["px4", "ardupilot"]),
    st.sampled_from(["px4", "ardupilot"]),
)
def test_another_frame_reads_at_least_the_place_that_is_meant(
    latitude: float, north_m: float, east_m: float, half_m: float, one: Autopilot, other: Autopilot
) -> None:
    """Its origin is elsewhere, and it takes the Earth for another sphere."""
    own = LocalFrame(GeographicPoint(latitude, 20.0), one)
    theirs = LocalFrame(GeographicPoint(latitude + 0.01, 19.98), other)
    box = np.array([[north_m - half_m, north_m + half_m, east_m - half_m, east_m + half_m]])
    kind, payload = wire(own).encoded(Propose(HEAD, Tube(3, box), 0.0))
    read = wire(theirs).decoded("b", kind, payload)
    assert isinstance(read, Propose)
    ((low_n, high_n, low_e, high_e),) = read.tube.boxes_m.tolist()
    # Its edges bend, so that its corners are not all.
    shares = np.linspace(0.0, 1.0, 9)
    norths_m, easts_m = (low + shares * (high - low) for low, high in box.reshape(2, 2))
    for place_m in ((n_m, e_m) for n_m in norths_m for e_m in easts_m):
        n_m, e_m = theirs.north_east_m(*own.latitude_longitude_deg(*place_m))
        assert low_n <= n_m <= high_n
        assert low_e <= e_m <= high_e
    assert high_n - low_n < 2.0 * half_m * 1.01 + 0.5 + half_m**2 / 1e6


# ------------------------------------------------------------------------ what is dropped


@pytest.mark.parametrize(
    ("payload", "words"),
    [
        (b"", "Invalid JSON"),
        (b"\xff\xfe", "Invalid JSON"),
        (b"[]", "payload"),
        (changed(HEARTBEAT, version=2), "version"),
        (changed(HEARTBEAT, boot="B" * 16), "boot"),
        (changed(HEARTBEAT, number=-1), "number"),
        (changed(HEARTBEAT, reach_m=0.0), "reach_m"),
        (changed(HEARTBEAT, reach_m=float("nan")), "reach_m"),
        (changed(HEARTBEAT, position_age_s=-1.0), "position_age_s"),
        (changed(HEARTBEAT, position_deg=[91.0, 0.0]), "position_deg"),
        (changed(HEARTBEAT, position_deg=[-47.0, 8.0]), "km from the origin"),
        (changed(HEARTBEAT, active={"number": 1, "boxes_deg": []}), "active.boxes_deg"),
        (
            changed(HEARTBEAT, active={"number": 1, "boxes_deg": [[47.4, 47.39, 8.5, 8.6]]}),
            "from exceeds to",
        ),
        (changed(HEARTBEAT, contract_sha256="3" * 64), "flies by 333333333333, the roster has"),
        (changed(HEARTBEAT, hmac="0"), "hmac"),
        (changed(HEARTBEAT, number=3), "number = 3: expected above that of tube 3"),
        (changed(MESSAGES[4], number=5), "number = 5: expected above that of tube 5"),
        (b" " * 200_001, "200001 bytes"),
    ],
)
def test_what_is_malformed_is_counted_reported_and_dropped(payload: bytes, words: str) -> None:
    reports: list[str] = []
    core = vehicle("a", (0.0, 0.0))
    link = FleetLink(core, wire(), reports.append)
    link.receive("clearway/fleet/b/heartbeat", payload, 1.0)
    assert core.counts["malformed"] == 1
    (line,) = reports
    assert line.startswith("clearway/fleet/b/heartbeat: dropped: ")
    assert words in line


@pytest.mark.parametrize("key", ["b/steer", "b", "", "b/heartbeat/x", "x/heartbeat", "a/ack"])
def test_other_keys_are_counted(key: str) -> None:
    core = vehicle("a", (0.0, 0.0))
    FleetLink(core, wire()).receive(f"clearway/fleet/{key}", b"{}", 1.0)
    assert core.counts.total() == 1


@pytest.mark.parametrize(("kind", "number"), [(MESSAGES[0], 3), (MESSAGES[2], 4)])
def test_a_message_is_of_tubes_before_it(kind: Message, number: int) -> None:
    """Else no heartbeat would ever release them."""
    name, _ = wire().encoded(kind)
    with pytest.raises(MalformedPayloadError, match=f"number = {number}: expected above"):
        wire().decoded("b", name, changed(kind, number=number))


def test_what_cannot_be_written_is_counted_reported_and_lost() -> None:
    """Here its tube begins beside the antimeridian and ends beyond it."""
    reports: list[str] = []
    core = vehicle("a", (0.0, 0.0))
    fiji = wire(LocalFrame(GeographicPoint(-17.0, 179.99999)))
    core.tick(0.0)
    assert list(FleetLink(core, fiji, reports.append).payloads_to_send()) == []
    assert core.counts["unwritable"] == 1
    assert reports == ["Heartbeat 1: not sent: a tube across the antimeridian cannot be written"]


@settings(max_examples=25)
@given(st.binary(max_size=300) | st.from_regex(r'\{"[a-z]+": [0-9]*\}').map(str.encode))
def test_nothing_raises(payload: bytes) -> None:
    core = vehicle("a", (0.0, 0.0))
    for key in (None, b"k" * 32):
        for kind in MessageKind:
            FleetLink(core, wire(key=key)).receive(f"clearway/fleet/b/{kind}", payload, 1.0)
    assert core.counts["malformed"] == 8


# ------------------------------------------------------------------------ with a key


def test_with_a_key_only_its_holders_are_heard() -> None:
    sealed, other = wire(key=b"k" * 32), wire(key=b"o" * 32)
    kind, payload = sealed.encoded(HEARTBEAT)
    assert sealed.decoded("b", kind, payload)
    for reader in (other, wire()):
        with pytest.raises(MalformedPayloadError):
            reader.decoded("b", kind, payload)
    with pytest.raises(MalformedPayloadError):
        sealed.decoded("b", *wire().encoded(HEARTBEAT))
    altered = payload.replace(b"0.25", b"0.00")
    assert altered != payload
    with pytest.raises(MalformedPayloadError, match="another key, or altered"):
        sealed.decoded("b", kind, altered)
    with pytest.raises(MalformedPayloadError, match="another key, or altered"):
        sealed.decoded("a", kind, payload)


def test_two_vehicles_talk_in_bytes() -> None:
    """Under the keys of the fleet, until one has the other's leave."""
    first, second = vehicle("a", (0.0, 0.0)), vehicle("b", (20.0, 0.0))
    key = b"k" * 32
    links = FleetLink(first, wire(key=key)), FleetLink(second, wire(key=key))
    onward = along((0.0, 0.0), (8.0, 0.0), 1.5, 4)
    for number in range(8):
        now_s = 0.5 * number
        if number == 4:
            assert first.propose(onward, 20.0, now_s)
            assert first.outstanding is not None
        for core, link, other in ((first, *links), (second, *links[::-1])):
            core.tick(now_s)
            for name, payload in link.payloads_to_send():
                other.receive(name, payload, now_s)
    assert (first.counts["committed"], first.counts["malformed"]) == (1, 0)
    assert second.free_of_records(onward) == 0
