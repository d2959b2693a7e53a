"""What ends a command early."""

from __future__ import annotations


class CommandError(Exception):
    """A command that cannot do its work; the message is one line fit for an operator."""
