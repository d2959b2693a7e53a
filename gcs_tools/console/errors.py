"""What ends a command early."""

from __future__ import annotations


class CommandError(Exception):
    """A command that cannot do its work; the message is one line fit for an operator."""

    exit_code = 2


class Interrupted(CommandError):  # noqa: N818  nobody's error
    """Somebody wants the command to end: Ctrl-C, or a signal."""

    def __init__(self, signal_number: int) -> None:
        super().__init__("interrupted")
        self.exit_code = 128 + signal_number
