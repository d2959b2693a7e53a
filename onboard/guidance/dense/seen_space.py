"""What guidance needs of the space that was seen free: the seam to perception."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

from onboard.geometry.free_grid import FreeGrid

if TYPE_CHECKING:
    from onboard.files.mission_file import Mission
    from onboard.geometry.frames import LegFrame


class SeenSpace(Protocol):
    """The seen-free set in the frame of the leg.

    Attributes:
        relied_on: whether what is flown is certified in it, so that a contradiction counts.
    """

    relied_on: bool

    @property
    def frames_needed(self) -> int:
        """K, frames that have to show a cell free."""
        ...

    @property
    def frames_counted(self) -> int:
        """How many frames of one sensor have counted: complete, placed, not of a fast turn."""
        ...

    def grid(self) -> FreeGrid:
        """Return the set as it is now."""
        ...

    def confirm_start(self, x_m: float, y_m: float) -> bool:
        """Take the place where the vehicle rests as free, if it has looked all round from there.

        Returns:
            Whether it is: frames have shown every bearing, and no known obstacle is there.
        """
        ...

    def confirm_by_word(self, north_m: float, east_m: float, radius_m: float) -> None:
        """Take a disc for free that the operator has confirmed, unless an obstacle is known there.

        Args:
            north_m: of its centre, local NED.
            east_m: likewise.
            radius_m: its radius.
        """
        ...

    def begin_leg(self, leg: LegFrame) -> None:
        """State the set in the frame of another leg."""
        ...

    def limit(self, half_width_m: float) -> None:
        """Call nothing free that is farther than this from the line of a leg."""
        ...


def take_operators_word(seen: SeenSpace, mission: Mission) -> None:
    """Take the place around a mission's start for free, as far as the operator says that it is."""
    if mission.start_clear_m is not None:
        seen.confirm_by_word(*mission.start_ned_m, mission.start_clear_m)


class NothingSeen:
    """The set before any sensor feeds it: nothing is free, and nothing certifies."""

    frames_needed = 1
    frames_counted = 0
    relied_on = False

    def grid(self) -> FreeGrid:
        """Return a grid without cells."""
        return FreeGrid((0.0, 0.0), 1.0, np.zeros((1, 1), np.int32))

    def confirm_start(self, x_m: float, y_m: float) -> bool:  # noqa: ARG002  none is
        """Confirm no place."""
        return False

    def confirm_by_word(self, north_m: float, east_m: float, radius_m: float) -> None:
        """Do nothing."""

    def begin_leg(self, leg: LegFrame) -> None:
        """Do nothing."""

    def limit(self, half_width_m: float) -> None:
        """Do nothing."""
