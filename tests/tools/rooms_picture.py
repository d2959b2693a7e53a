"""Draw the rooms and their imports as SVG; ``python -m tests.tools.structure --picture``.

One picture for each package; its rows are the layers of the import contracts in pyproject.toml, so
that every arrow points down.  An arrow that follows from others (a -> c beside a -> b -> c) is left
out.
"""

from __future__ import annotations

import tomllib
from graphlib import TopologicalSorter
from typing import Final
from xml.sax.saxutils import escape

import grimp

from tests.tools.layered_layout import place
from tests.tools.structure import ROOT

_BOX_WIDTH, _BOX_HEIGHT = 148, 44
_GAP_X, _GAP_Y = 14, 40
_TITLE = 50
_TITLES: Final = {
    "onboard": "onboard: the daemon",
    "sitl": "sitl: the simulated vehicle",
    "gcs_tools": "gcs_tools: the operator's commands",
}
_ARROW_HEAD: Final = (
    '<defs><marker id="head" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="7" '
    'markerHeight="7" orient="auto"><path class="head" d="M0 0 8 4 0 8z"/></marker></defs>'
)
_STYLE: Final = """
    text { font-family: Helvetica, Arial, sans-serif; fill: #1c2733; text-anchor: middle }
    .title { font-size: 16px; font-weight: bold }
    .room { font-size: 14px; font-weight: bold }
    .module { font-size: 13px }
    .inner { font-size: 11px; fill: #4d5b6a }
    .panel { fill: #f5f7f9; stroke: #c4ccd4 }
    .box { fill: #ffffff; stroke: #2f6f9f; stroke-width: 1.5 }
    .box.single { stroke: #8a97a5; stroke-width: 1 }
    .arrow { fill: none; stroke: #5b6b7b; stroke-width: 1.2 }
    .head { fill: #5b6b7b }
"""


def layers(package: str) -> list[list[str]]:
    """Return the rooms of a package by layer, the outermost first, from pyproject.toml."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    for contract in settings["tool"]["importlinter"]["contracts"]:
        if contract["type"] == "layers" and contract.get("containers") == [package]:
            rows = [
                [room.strip(" ()") for room in layer.replace(":", "|").split("|")]
                for layer in contract["layers"]
            ]
            there = {path.stem for path in (ROOT / package).iterdir()}
            return [shown for row in rows if (shown := [room for room in row if room in there])]
    raise LookupError(f"pyproject.toml has no layers contract for {package}")


def room_imports(package: str) -> dict[str, set[str]]:
    """Return the rooms of a package, each with those in lower layers that it imports.

    Nested rooms are folded into the outer one.  Imports that the contract forbids are not shown:
    `lint-imports` reports them.
    """
    layer_of = {room: index for index, row in enumerate(layers(package)) for room in row}
    graph = grimp.build_graph(package)
    found: dict[str, set[str]] = {room: set() for room in layer_of}
    for importer in graph.modules - {package}:
        room = importer.split(".")[1]
        for imported in graph.find_modules_directly_imported_by(importer) - {package}:
            other = imported.split(".")[1]
            if layer_of[other] > layer_of[room]:
                found[room].add(other)
    return found


def without_implied(imports: dict[str, set[str]]) -> dict[str, set[str]]:
    """Drop each arrow that a longer way replaces.

    Args:
        imports: the rooms that each room imports; they form no cycle.
    """
    below: dict[str, set[str]] = {}
    for room in TopologicalSorter(imports).static_order():
        below[room] = imports[room].union(*(below[each] for each in imports[room]))
    return {
        room: direct - set().union(*(below[each] for each in direct))
        for room, direct in imports.items()
    }


def draw(package: str) -> str:
    """Return a package's picture as SVG text, the same for the same code."""
    rows = layers(package)
    arrows = [
        (room, imported)
        for room, direct in sorted(without_implied(room_imports(package)).items())
        for imported in sorted(direct)
    ]
    layout = place(rows, arrows, _BOX_WIDTH, _GAP_X)
    width = layout.width + 2 * _GAP_X
    height = _TITLE + len(rows) * (_BOX_HEIGHT + _GAP_Y)
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height}" role="img">',
        f"<title>Rooms of {package} and the direction of their imports</title>",
        f"<style>{_STYLE}</style>",
        _ARROW_HEAD,
        f'<rect class="panel" width="{width:.0f}" height="{height}" rx="8"/>',
        _text("title", width / 2, 28, _TITLES[package]),
    ]
    lines += [
        _arrow([(_GAP_X + x, _y(row)) for x, row in points]) for points in layout.arrows.values()
    ]
    for row, rooms in enumerate(rows):
        for room in rooms:
            lines += _drawn(package, room, _GAP_X + layout.x[room], _y(row))
    return "\n".join([*lines, "</svg>"]) + "\n"


def _y(row: int) -> float:
    return _TITLE + _BOX_HEIGHT / 2 + row * (_BOX_HEIGHT + _GAP_Y)


def _drawn(package: str, room: str, x: float, y: float) -> list[str]:
    path = ROOT / package / room
    left, top = x - _BOX_WIDTH / 2, y - _BOX_HEIGHT / 2
    kind = "box" if path.is_dir() else "box single"
    frame = (
        f'<rect class="{kind}" x="{left:.0f}" y="{top:.0f}" width="{_BOX_WIDTH}" '
        f'height="{_BOX_HEIGHT}" rx="5"/>'
    )
    if not path.is_dir():
        return [frame, _text("module", x, y + 5, f"{room}.py")]
    inner = sorted(each.parent.name for each in path.rglob("*/__init__.py") if each.parent != path)
    if not inner:
        return [frame, _text("room", x, y + 5, f"{room}/")]
    beneath = ", ".join(f"{name}/" for name in inner)
    return [frame, _text("room", x, y - 2, f"{room}/"), _text("inner", x, y + 14, beneath)]


def _text(kind: str, x: float, y: float, content: str) -> str:
    return f'<text class="{kind}" x="{x:.0f}" y="{y:.0f}">{escape(content)}</text>'


def _arrow(points: list[tuple[float, float]]) -> str:
    """Return a curve from the lower edge of a box by its waypoints to the upper edge of another."""
    x, y = points[0][0], points[0][1] + _BOX_HEIGHT / 2
    path = [f"M{x:.0f} {y:.0f}"]
    for index, (next_x, centre_y) in enumerate(points[1:], start=1):
        is_last = index == len(points) - 1
        top = centre_y - _BOX_HEIGHT / 2 - is_last
        bend = (top - y) / 2
        path.append(f"C{x:.0f} {y + bend:.0f} {next_x:.0f} {top - bend:.0f} {next_x:.0f} {top:.0f}")
        if not is_last:  # straight down between the boxes of this row
            path.append(f"V{centre_y + _BOX_HEIGHT / 2:.0f}")
        x, y = next_x, centre_y + _BOX_HEIGHT / 2
    return f'<path class="arrow" marker-end="url(#head)" d="{" ".join(path)}"/>'
