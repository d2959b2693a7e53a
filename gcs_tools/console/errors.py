"""What ends a command early, and the exit codes that say why."""

from __future__ import annotations

from typing import Final

# The command ran; its answer is no: refused, not flown to the end, a flight failed.
EXIT_NO: Final = 1
# The command could not run: bad input, or a file or connection that cannot be used.
EXIT_BAD_INPUT: Final = 2


class CommandError(Exception):
    """The command cannot do its work; the message is one line fit for an operator."""

    exit_code = EXIT_BAD_INPUT


class Interrupted(CommandError):  # noqa: N818  a request, not an error
    """The command received Ctrl-C or a signal to stop."""

    def __init__(self, signal_number: int) -> None:
        super().__init__("interrupted")
        self.exit_code = 128 + signal_number
