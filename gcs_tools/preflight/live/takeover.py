"""How the pilot can take over from the daemon, told before the flight."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from gcs_tools.preflight.finding import Finding, Verdict

_NO_STICKS: Final = 4  # of PX4's COM_RC_IN_MODE
_BY_RADIO: Final[Mapping[str, str]] = {
    "px4": "its mode switch (POSCTL), or HOLD and LAND from the ground station",
    "ardupilot": "its mode switch (LOITER), or BRAKE and LAND from the ground station",
}
_WITHOUT_RADIO: Final[Mapping[str, str]] = {
    "px4": "PX4 refuses POSCTL then: take over from the ground station with HOLD or LAND",
    "ardupilot": "take over from the ground station with BRAKE or LAND",
}


def takeover_finding(
    flavour: str, parameters: Mapping[str, float], *, heard: bool | None
) -> Finding:
    """Say by what the pilot takes over: nothing that the vehicle would refuse.

    Args:
        flavour: ``px4`` or ``ardupilot``.
        parameters: by name.
        heard: whether the vehicle hears a radio; None if it has not said so.
    """
    name, deaf = "take-over", parameters.get("COM_RC_IN_MODE") == _NO_STICKS
    if deaf:
        text = f"sticks are ignored (COM_RC_IN_MODE = 4); {_WITHOUT_RADIO[flavour]}"
        return Finding("vehicle", name, Verdict.HOLDS, text)
    if heard is None:
        return Finding("vehicle", name, Verdict.UNKNOWN, "no SYS_STATUS: is a radio heard?")
    if heard:
        text = f"a radio is heard; take over with {_BY_RADIO[flavour]}"
    else:
        text = f"no radio is heard; {_WITHOUT_RADIO[flavour]}"
    return Finding("vehicle", name, Verdict.HOLDS, text)
