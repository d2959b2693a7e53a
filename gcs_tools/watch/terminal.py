"""The live view in a terminal."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Final

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from gcs_tools.watch.feed import Feed

PERIOD_S: Final = 0.25
EVENTS_SHOWN: Final = 8
# The daemon speaks five times a second; after this long it is gone.
SILENCE_S: Final = 1.5

_STYLES: Final = {"critical": "bold red", "error": "red", "warning": "yellow", "notice": "cyan"}


def show(feed: Feed, vehicle: str, check: Callable[[], None]) -> None:
    """Show the flight until ``check`` raises."""
    with Live(console=Console(), auto_refresh=False, screen=True) as live:
        while True:
            check()
            live.update(view(feed, vehicle, time.time()), refresh=True)
            time.sleep(PERIOD_S)


def view(feed: Feed, vehicle: str, now_unix_s: float) -> RenderableType:
    """Return everything on one screen."""
    return Group(
        Panel(_state(feed.latest("status"), now_unix_s), title=vehicle, title_align="left"),
        Panel(_monitors(feed.latest("monitors")), title="monitors", title_align="left"),
        Panel(_margins(feed.latest("margins")), title="contract", title_align="left"),
        Panel(_events(feed.events()), title="events", title_align="left"),
    )


def _state(status: dict[str, Any], now_unix_s: float) -> RenderableType:
    if not status:
        return Text("waiting for the daemon", style="yellow")
    silent_s = now_unix_s - status["time_s"]
    table = Table.grid(padding=(0, 2))
    table.add_row("phase", Text(status["phase"].upper(), style="bold"), "mode", str(status["mode"]))
    table.add_row("position", _vector(status["position_ned_m"], "m north, east, down"))
    table.add_row("velocity", _vector(status["velocity_ned_mps"], "m/s"))
    table.add_row("obstacles", str(status["obstacles_known"]))
    table.add_row("dropped", _dropped(status.get("dropped", {})))
    if silent_s > SILENCE_S:
        return Group(Text(f"no contact for {silent_s:.0f} s", style="bold red"), table)
    return table


def _dropped(counts: dict[str, int]) -> str:
    """Say what of the link was of no use."""
    lost = [f"{count} {name.replace('_', ' ')}" for name, count in counts.items() if count]
    return ", ".join(lost) or "nothing"


def _vector(vector: list[float] | None, unit: str) -> str:
    if vector is None:
        return "not known"
    return ", ".join(f"{value:.2f}" for value in vector) + f" {unit}"


def _monitors(monitors: dict[str, Any]) -> RenderableType:
    table = Table.grid(padding=(0, 2))
    for name, monitor in monitors.items():
        if name == "time_s":
            continue
        measured, limit, unit = monitor["measured"], monitor["limit"], monitor["unit"]
        shown = "not known" if measured is None else f"{measured:.3f} {unit}"
        allowed = "" if limit is None else f"limit {limit:.3f} {unit}"
        table.add_row(name.replace("_", " "), Text(shown, style=_style(name, monitor)), allowed)
    return table


def _style(name: str, monitor: dict[str, Any]) -> str:
    measured, limit = monitor["measured"], monitor["limit"]
    if measured is None or limit is None:
        return ""
    # Of clearance there can be too little, of everything else too much.
    broken = measured <= limit if name == "clearance" else measured > limit
    return "bold red" if broken else "green"


def _margins(margins: dict[str, Any]) -> RenderableType:
    """Two clauses in a row, so that all of them and the events below fit a terminal."""
    table = Table.grid(padding=(0, 2))
    cells: list[RenderableType] = []
    for clause in margins.get("clauses", ()):
        margin = f"{clause['margin']:+.2f} {clause['unit']}"
        style = "green" if clause["holds"] else "bold red"
        cells += [clause["name"].replace("_", " "), Text(margin, style=style)]
    for first in range(0, len(cells), 4):
        table.add_row(*cells[first : first + 4])
    return table


def _events(events: list[dict[str, Any]]) -> RenderableType:
    lines = [
        Text(f"{time.strftime('%H:%M:%S', time.localtime(event['time_s']))}  {event['text']}",
             style=_STYLES.get(event["severity"], ""))
        for event in events[-EVENTS_SHOWN:]
    ]  # fmt: skip
    return Group(*lines)
