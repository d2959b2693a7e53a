"""Turns Ctrl-C and stop signals into a request that a command checks at its next wait."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager

from gcs_tools.console.errors import Interrupted

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Interruption:
    """A request to stop, from a signal."""

    def __init__(self) -> None:
        self._signal_number: int | None = None

    @property
    def requested(self) -> bool:
        """Whether a stop was requested."""
        return self._signal_number is not None

    def check(self) -> None:
        """Return unless a stop was requested.

        Raises:
            Interrupted: a stop was requested.
        """
        if self._signal_number is not None:
            raise Interrupted(self._signal_number)

    def request(self, signal_number: int) -> None:
        """Request a stop."""
        self._signal_number = signal_number


@contextmanager
def interruptible() -> Iterator[Interruption]:
    """Turn SIGINT, SIGTERM and SIGHUP into a request; restore the old handlers afterwards."""
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
