"""The table of the benchmarks, for the terminal and for ``docs/speed.md``."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from tests.benchmarks.measurement import Measurement

BEGIN: Final = "<!-- the table of make bench begins -->"
END: Final = "<!-- it ends -->"
_HEADER: Final = ("benchmark", "figure", "limit", "peer", "times as good as the peer", "passes")


def rows(measured: dict[str, Measurement]) -> list[tuple[str, ...]]:
    """Return the table, its header first."""
    return [_HEADER, *(_row(name, one) for name, one in measured.items())]


def _row(name: str, one: Measurement) -> tuple[str, ...]:
    sign = "≥" if one.more_is_better else "≤"
    limit = "" if one.limit is None else f"{sign} {one.limit:g}"
    peer = "" if one.peer is None else f"{one.peer:.3g} ({one.peer_name})"
    ratio = "" if one.ratio is None else f"{one.ratio:.3g}"
    if one.ratio_min is not None:
        ratio += f", limit ≥ {one.ratio_min:g}"
    verdict = {None: "", True: "yes", False: "**no**"}[one.passes]
    return name, f"{one.value:.3g} {one.unit}", limit, peer, ratio, verdict


def write_table(page: Path, measured: dict[str, Measurement]) -> None:
    """Replace the table between the two marks of a page.

    Raises:
        ValueError: the page lacks the marks.
    """
    before, begin, rest = page.read_text(encoding="utf-8").partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"{page}: has no table between {BEGIN!r} and {END!r}")
    header, *lines = rows(measured)
    ruled = [header, ("---",) * len(header), *lines]
    table = "\n".join(f"| {' | '.join(line)} |" for line in ruled)
    text = f"{before}{BEGIN}\n\n{table}\n\n{END}{after}"
    page.write_text(text, encoding="utf-8")
