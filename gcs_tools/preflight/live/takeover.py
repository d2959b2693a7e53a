"""How the pilot can take over from the daemon, told before the flight."""

from __future__ import annotations

from collections.abc import Mapping

from gcs_tools.preflight.finding import Finding, Verdict
from onboard.mavlink.profiles.profile import TakeOver


def takeover_finding(
    take_over: TakeOver, parameters: Mapping[str, float], *, heard: bool | None
) -> Finding:
    """Tell the pilot how to take over: only by what the vehicle would accept.

    Args:
        take_over: from the autopilot's profile.
        parameters: by name.
        heard: whether the vehicle hears a radio; None if it has not said so.
    """
    name, sticks = "take-over", take_over.sticks_ignored
    if sticks is not None and parameters.get(sticks[0]) == sticks[1]:
        text = f"sticks are ignored ({sticks[0]} = {sticks[1]:g}); {take_over.without_radio}"
        return Finding("vehicle", name, Verdict.HOLDS, text)
    if heard is None:
        text = "no SYS_STATUS, which tells whether the vehicle hears a radio"
        return Finding("vehicle", name, Verdict.UNKNOWN, text)
    if heard:
        text = f"the vehicle hears a radio; take over with {take_over.with_radio}"
    else:
        text = f"the vehicle hears no radio; {take_over.without_radio}"
    return Finding("vehicle", name, Verdict.HOLDS, text)
