"""The known profiles, by MAV_AUTOPILOT.

To fly another autopilot, describe it once, and register it before the first heartbeat is read::

    from onboard.__main__ import main  # or gcs_tools.__main__, for the operator's commands
    from onboard.mavlink.profiles.registry import register

    register(AutopilotProfile(autopilot=mavlink.MAV_AUTOPILOT_SLUGS, key="slugs", ...))
    main()

Daemon, pre-flight check and operator then use it for every vehicle whose heartbeat states that
value.  `dataclasses.replace` derives a profile from a known one, such as a PX4 with other modes;
``register(profile, replace_known=True)`` uses it in place of that one.
"""

from __future__ import annotations

from types import MappingProxyType
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from onboard.mavlink.profiles.ardupilot import ARDUPILOT
from onboard.mavlink.profiles.profile import (
    CONSTANT_POSITION,
    ESTIMATOR_STATUS,
    AutopilotProfile,
    EstimatorFacts,
    Modes,
    TakeOff,
    TakeOver,
)
from onboard.mavlink.profiles.px4 import GAIN_MAX_PER_S, PX4

# Any other autopilot.  No mode of it is known to obey setpoints, so that the service never flies
# it; what the message definitions say of every autopilot is still monitored.
OTHER: Final = AutopilotProfile(
    autopilot=mavlink.MAV_AUTOPILOT_GENERIC,
    key="other",
    name="unknown autopilot",
    modes=Modes(lambda custom_mode: f"MODE {custom_mode}"),
    estimator=EstimatorFacts(
        message=ESTIMATOR_STATUS,
        made_up_flags=CONSTANT_POSITION,
        doubt_flags=MappingProxyType({}),
        ratio_max=1.0,
        position_health=0,
        texts=("gps lost", "dead reckoning"),
    ),
    take_off=TakeOff(),
    take_over=TakeOver("its mode switch", "take over from the ground station"),
    # The greatest of those known: an echo that one of them could send raises no alarm.
    target_gain_max_per_s=GAIN_MAX_PER_S,
)

_profiles: Final = {profile.autopilot: profile for profile in (PX4, ARDUPILOT)}


def register(profile: AutopilotProfile, *, replace_known: bool = False) -> None:
    """Make a profile known.

    Args:
        profile: of the autopilot.
        replace_known: use it instead of the profile that is known for the same MAV_AUTOPILOT.

    Raises:
        ValueError: MAV_AUTOPILOT_INVALID, a MAV_AUTOPILOT that has a profile, or another profile's
            key.
    """
    number, key = profile.autopilot, profile.key
    if number == mavlink.MAV_AUTOPILOT_INVALID:
        raise ValueError(f"MAV_AUTOPILOT {number}: no autopilot states it, expected another value")
    known = _profiles.get(number)
    if known is not None and not replace_known:
        raise ValueError(
            f"MAV_AUTOPILOT {number}: already has the profile {known.key!r}, "
            "expected replace_known=True to replace it"
        )
    if any(each.key == key for each in (*_profiles.values(), OTHER) if each is not known):
        raise ValueError(f"profile key {key!r}: belongs to another profile, expected a new one")
    _profiles[number] = profile


def profile_of(autopilot: int) -> AutopilotProfile:
    """Return the profile of a MAV_AUTOPILOT; `OTHER` if there is none."""
    return _profiles.get(autopilot, OTHER)


def profile_named(key: str) -> AutopilotProfile:
    """Return the profile with a key.

    Raises:
        KeyError: no profile has it.
    """
    return {each.key: each for each in _profiles.values()}[key]


def known_profiles() -> tuple[AutopilotProfile, ...]:
    """Return every profile, without `OTHER`."""
    return tuple(_profiles.values())
