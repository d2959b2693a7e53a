"""Failsafe conditions, each reported once: fence, battery, ground station, sticks, position."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.modes import Mode
from sitl.autopilot.settings import FlightSettings, Reaction

MODE_OF_REACTION = {
    Reaction.HOLD: Mode.HOLD,
    Reaction.RETURN: Mode.RTL,
    Reaction.LAND: Mode.LAND,
    Reaction.MANUAL: Mode.POSCTL,
}


@dataclass(frozen=True)
class FailsafeInputs:
    """Inputs of the failsafes.

    Attributes:
        battery_remaining: share of the charge.
        ground_silence_s: since the ground station's last heartbeat; ``inf`` before the first.
        sticks_silence_s: since the last manual control.
        sticks_needed: whether the mode is flown by stick.
        position_valid: whether the estimate of the position is valid.
        fence_breached: whether the vehicle is outside of the geofence.
    """

    battery_remaining: float
    ground_silence_s: float
    sticks_silence_s: float
    sticks_needed: bool
    position_valid: bool
    fence_breached: bool = False


@dataclass(frozen=True)
class Trigger:
    """One failsafe that begins now; an empty text stands for the autopilot's own."""

    reaction: Reaction
    severity: int = mavlink.MAV_SEVERITY_CRITICAL
    text: str = ""


class Failsafes:
    """Detect conditions as they begin; each may begin again after it ended, but the battery's."""

    def __init__(self) -> None:
        self._battery_level = 0
        self._ground_lost = False
        self._sticks_lost = False
        self._position_lost = False
        self._fence_breached = False

    def check(self, inputs: FailsafeInputs, settings: FlightSettings) -> Iterator[Trigger]:
        """Yield what has begun since the last call, the gravest last."""
        if inputs.fence_breached and not self._fence_breached:
            reaction = settings.fence_reaction or Reaction.NONE
            yield Trigger(reaction, mavlink.MAV_SEVERITY_WARNING, "Geofence breached")
        self._fence_breached = inputs.fence_breached
        ground_lost = settings.ground_timeout_s < inputs.ground_silence_s < float("inf")
        if ground_lost and not self._ground_lost and settings.ground_loss is not Reaction.NONE:
            yield Trigger(settings.ground_loss, mavlink.MAV_SEVERITY_WARNING, "Ground station lost")
        self._ground_lost = ground_lost
        sticks_lost = inputs.sticks_needed and (
            settings.manual_timeout_s < inputs.sticks_silence_s < float("inf")
        )
        if sticks_lost and not self._sticks_lost:
            yield Trigger(
                settings.manual_loss, mavlink.MAV_SEVERITY_CRITICAL, "Manual control lost"
            )
        self._sticks_lost = sticks_lost
        yield from self._battery(inputs.battery_remaining, settings)
        if not inputs.position_valid and not self._position_lost:
            yield Trigger(Reaction.LAND)
        self._position_lost = not inputs.position_valid

    def _battery(self, remaining: float, settings: FlightSettings) -> Iterator[Trigger]:
        levels = (
            (settings.battery_low, settings.low_reaction, "Low battery level"),
            (settings.battery_critical, settings.critical_reaction, "Critical battery level"),
            (settings.battery_emergency, settings.emergency_reaction, "Dangerous battery level"),
        )
        reached = sum(remaining < threshold for threshold, _, _ in levels)
        for _, reaction, text in levels[self._battery_level : reached]:
            severity = (
                mavlink.MAV_SEVERITY_WARNING
                if reaction is Reaction.NONE
                else mavlink.MAV_SEVERITY_CRITICAL
            )
            yield Trigger(reaction, severity, text)
        self._battery_level = max(self._battery_level, reached)
