"""Profiles by MAV_AUTOPILOT, and profiles that others add."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from onboard.mavlink.endpoint import MavlinkEndpoint
from onboard.mavlink.profiles import registry
from onboard.mavlink.profiles.ardupilot import ARDUPILOT
from onboard.mavlink.profiles.profile import ESTIMATOR_STATUS, AutopilotProfile, Mode, Modes
from onboard.mavlink.profiles.px4 import PX4
from onboard.mavlink.profiles.registry import (
    OTHER,
    known_profiles,
    profile_named,
    profile_of,
    register,
)

OWN = replace(
    OTHER,
    autopilot=mavlink.MAV_AUTOPILOT_SLUGS,
    key="slugs",
    name="SLUGS",
    modes=Modes(
        lambda custom_mode: {1: "MANUAL", 2: "FOLLOW"}.get(custom_mode, "OTHER"),
        external_control=Mode("FOLLOW", 2),
    ),
)


@pytest.fixture(autouse=True)
def _registry(monkeypatch: pytest.MonkeyPatch) -> None:
    """Forget what a test registers."""
    monkeypatch.setattr(registry, "_profiles", dict(registry._profiles))


def test_the_two_built_in_profiles_are_found() -> None:
    assert profile_of(mavlink.MAV_AUTOPILOT_PX4) is profile_named("px4") is PX4
    assert profile_of(mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA) is profile_named("ardupilot")
    assert known_profiles() == (PX4, ARDUPILOT)


@pytest.mark.parametrize("autopilot", [0, 8, 13, 18, 255])
def test_any_other_autopilot_gets_the_conservative_profile(autopilot: int) -> None:
    assert profile_of(autopilot) is OTHER


@pytest.mark.parametrize("custom_mode", [0, 4, 6 << 16, 2**32 - 1])
def test_no_mode_of_an_unknown_autopilot_obeys_setpoints(custom_mode: int) -> None:
    """Not even those of PX4 or ArduPilot: the numbers may mean anything."""
    assert not OTHER.modes.is_external_control(custom_mode)
    assert OTHER.modes.name_of(custom_mode) == f"MODE {custom_mode}"
    assert (OTHER.modes.external_control, OTHER.modes.hold) == (None, None)


def test_the_unknown_autopilot_is_monitored_by_what_all_have_in_common() -> None:
    assert (OTHER.parameters, OTHER.firmware) == (None, None)
    assert (mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS, 5.0) in OTHER.requested_hz
    gains_per_s = [each.target_gain_max_per_s for each in known_profiles()]
    assert OTHER.target_gain_max_per_s == max(gains_per_s)


def heartbeats(autopilot: int, custom_modes: tuple[int, ...]) -> Iterator[bytes]:
    sender = mavlink.MAVLink(None, 1, 1)
    for custom_mode in custom_modes:
        message = sender.heartbeat_encode(2, autopilot, 128, custom_mode, 4)
        yield message.pack(sender)


def test_a_registered_profile_decides_on_the_mode_in_flight() -> None:
    endpoint = MavlinkEndpoint(system_id=1)
    manual, follow = heartbeats(OWN.autopilot, (1, 2))
    endpoint.receive(follow, 0.0)
    assert (endpoint.status.mode, endpoint.status.external_control) == ("MODE 2", False)
    register(OWN)
    for data, mode, external_control in ((manual, "MANUAL", False), (follow, "FOLLOW", True)):
        endpoint.receive(data, 1.0)
        assert endpoint.profile is OWN
        assert endpoint.status.mode == mode
        assert endpoint.status.external_control is external_control
    assert profile_named("slugs") is OWN
    assert known_profiles() == (PX4, ARDUPILOT, OWN)


def test_a_known_profile_is_replaced_only_on_request() -> None:
    own = replace(PX4, name="PX4 with another gain", target_gain_max_per_s=3.0)
    with pytest.raises(ValueError, match=r"MAV_AUTOPILOT 12: already has the profile 'px4'"):
        register(own)
    assert profile_of(own.autopilot) is PX4
    register(own, replace_known=True)
    assert profile_of(own.autopilot) is profile_named("px4") is own


@pytest.mark.parametrize("key", ["px4", "ardupilot", "other"])
def test_a_key_belongs_to_one_profile(key: str) -> None:
    with pytest.raises(ValueError, match=f"profile key '{key}': belongs to another profile"):
        register(replace(OWN, key=key))
    assert profile_of(OWN.autopilot) is OTHER


def test_the_value_of_companions_cannot_be_registered() -> None:
    """A heartbeat with MAV_AUTOPILOT_INVALID is not an autopilot's."""
    with pytest.raises(ValueError, match="MAV_AUTOPILOT 8: no autopilot states it"):
        register(replace(OWN, autopilot=mavlink.MAV_AUTOPILOT_INVALID))


@pytest.mark.parametrize("key", ["", "PX4", "other"])
def test_an_unknown_key_raises(key: str) -> None:
    with pytest.raises(KeyError):
        profile_named(key)


@pytest.mark.parametrize("profile", [PX4, ARDUPILOT, OTHER], ids=lambda each: each.key)
def test_each_profile_is_consistent(profile: AutopilotProfile) -> None:
    ids = [message_id for message_id, _ in profile.requested_hz]
    assert len(ids) == len(set(ids)) == 7
    assert all(rate_hz > 0.0 for _, rate_hz in profile.requested_hz)
    assert set(ids) <= mavlink.mavlink_map.keys()
    message = profile.estimator.message
    fields = mavlink.mavlink_map[message.message_id].fieldnames
    names = (message.velocity, message.position, message.height, message.heading)
    assert {*names, message.accuracy or names[0], "flags"} <= set(fields)
    assert mavlink.mavlink_map[message.message_id].msgname == message.name
    assert (message.accuracy is None) is (message is not ESTIMATOR_STATUS)
    estimator = profile.estimator
    assert all(text == text.lower() for text in (*estimator.texts, *estimator.cleared))
    flags = [*estimator.made_up_flags, *estimator.doubt_flags]
    assert all(flag.bit_count() == 1 for flag in flags)
    assert len(flags) == len(set(flags))
    assert 0.0 < estimator.ratio_max <= 1.0
