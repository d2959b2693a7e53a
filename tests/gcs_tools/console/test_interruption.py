"""Ctrl-C, SIGTERM and SIGHUP are requests, noticed where somebody looks."""

from __future__ import annotations

import signal

import pytest

from gcs_tools.console.errors import Interrupted
from gcs_tools.console.interruption import interruptible


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_is_noticed_at_the_next_check(number: signal.Signals) -> None:
    before = signal.getsignal(number)
    with interruptible() as interruption:
        interruption.check()
        signal.raise_signal(number)
        with pytest.raises(Interrupted) as noticed:
            interruption.check()
    assert noticed.value.exit_code == 128 + number
    assert signal.getsignal(number) is before
