"""The cause of what Clearway reports, and what the operator does about it."""

from __future__ import annotations

from typing import NamedTuple


class Cure(NamedTuple):
    """What an operator needs to know of one kind of report.

    Attributes:
        cause: what is wrong, or what has happened.
        cure: what to do; "nothing" where the service goes on by itself.
    """

    cause: str
    cure: str
