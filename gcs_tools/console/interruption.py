"""Ctrl-C and its kin as a request that is noticed at the next wait, not an exception anywhere."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager

from gcs_tools.console.errors import Interrupted

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Interruption:
    """Whether somebody has asked to stop."""

    def __init__(self) -> None:
        self._signal_number: int | None = None

    @property
    def requested(self) -> bool:
        """Whether somebody has."""
        return self._signal_number is not None

    def check(self) -> None:
        """Go on if nobody has.

        Raises:
            Interrupted: somebody has.
        """
        if self._signal_number is not None:
            raise Interrupted(self._signal_number)

    def request(self, signal_number: int) -> None:
        """Ask to stop."""
        self._signal_number = signal_number


@contextmanager
def interruptible() -> Iterator[Interruption]:
    """Turn SIGINT, SIGTERM and SIGHUP into a request, and have the old answers back afterwards."""
    interruption = Interruption()
    before = {
        number: signal.signal(number, lambda received, _: interruption.request(received))
        for number in _SIGNALS
    }
    try:
        yield interruption
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
