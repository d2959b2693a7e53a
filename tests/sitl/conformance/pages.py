"""Tables of ``docs/conformance.md``, which the tests read."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).parents[3]
PAGE = ROOT / "docs" / "conformance.md"


def table_of(heading: str) -> list[list[str]]:
    """Return the rows of the first table below a heading, without its head."""
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    below = lines[lines.index(f"## {heading}") :]
    first = next(number for number, line in enumerate(below) if line.startswith("|"))
    rows = []
    for line in below[first:]:
        if not line.startswith("|"):
            break
        rows.append([cell.strip() for cell in line.strip("|").split("|")])
    return rows[2:]
