"""The page docs/traceability.md: one row for each assumption."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Final

from tests.tools.traceability.chain import Link, chain
from tests.tools.traceability.figures import Figure

PAGE: Final = Path(__file__).parents[3] / "docs" / "traceability.md"
HEAD: Final = (
    "assumption",
    "terms of the contract",
    "clauses",
    "monitor",
    "response",
    "scenarios",
    "campaigns: flights in which it failed",
)
_TEXT: Final = """# From assumption to evidence

Each row leads from an assumption to the clauses of the contract that rest on it, to the monitor
that checks it in flight, to the response, to the scenario files (`config/scenarios`) that break it,
and to the flights of campaigns in which it failed, in the spirit of ASTM F3269.

`python -m tests.tools.traceability` makes this page from the code, and a test checks that it is up
to date and that no cell is empty. A clause is listed if its margin changes when the term does. The
response is the one with a way to rest held and progress guaranteed; [responses.md](responses.md)
has the others. The last column is counted from the tables of campaigns
(`--figures campaigns/DIRECTORY ...`, as many as there are; with `--add` what is stated of other
campaigns stays) and stated in `docs/data/campaign_figures.csv`; a scenario file there is one
flight.

"""


def page(figures: tuple[Figure, ...] | None = None) -> str:
    """Return the page's text, with the figures that the repository states or with others."""
    cells = (HEAD, ["---"] * len(HEAD), *table(figures))
    rows = ["| " + " | ".join(each) + " |" for each in cells]
    return _TEXT + "\n".join(rows) + "\n"


def table(figures: tuple[Figure, ...] | None = None) -> list[tuple[str, ...]]:
    """Return the cells of every assumption."""
    return [_cells(link) for link in chain(figures)]


def _cells(link: Link) -> tuple[str, ...]:
    return (
        f"`{link.assumption.value}`",
        _code(link.terms),
        _code(link.clauses),
        _code(each.removeprefix("onboard.") for each in link.monitors),
        _response(link.response),
        _code(link.scenarios),
        "; ".join(map(str, _shown(link.figures))),
    )


def _code(names: Iterable[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _response(ended: str) -> str:
    """Say what a response that is named by how it ends is: the vehicle hovers until then."""
    hovers = ended in ("the pilot", "`clearway resume`")
    return f"hover, ended by {ended}" if hovers else ended


def _shown(figures: tuple[Figure, ...]) -> list[Figure]:
    """Return those of generated flights; of scenario files, only where there are no others."""
    generated = [figure for figure in figures if not figure.campaign.endswith(".yaml")]
    return generated or list(figures[:2])
