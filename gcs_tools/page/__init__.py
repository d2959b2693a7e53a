"""What the report and the live view show: style sheet, scripts and pages."""

from __future__ import annotations

from importlib import resources


def asset(name: str) -> str:
    """Return the text of a file of the page."""
    return resources.files(__name__).joinpath(name).read_text(encoding="utf-8")
