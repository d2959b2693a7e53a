"""Shows the live view in a terminal."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, fields
from typing import Final

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from gcs_tools.watch.departure import Departure
from gcs_tools.watch.feed import Feed
from onboard.events import EventName
from onboard.guidance.phases import Phase
from onboard.recording.messages import (
    DropCounters,
    EventRecord,
    Margins,
    Monitors,
    Reading,
    SeenSpace,
    StateRecord,
)
from onboard.recording.mover_record import KnownMover, MoversRecord, box_at, extent

PERIOD_S: Final = 0.25
EVENTS_SHOWN: Final = 8
MOVERS_SHOWN: Final = 6
# The daemon publishes its state five times a second.
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
        Panel(
            _state(
                feed.latest(StateRecord), feed.latest(SeenSpace), _reason(feed.events()), now_unix_s
            ),
            title=vehicle,
            title_align="left",
        ),
        *_departure(feed.departure),
        *_movers(feed.latest(MoversRecord), feed.latest(StateRecord)),
        Panel(_monitors(feed.latest(Monitors)), title="monitors", title_align="left"),
        Panel(_margins(feed.latest(Margins)), title="contract", title_align="left"),
        Panel(_events(feed.events()), title="events", title_align="left"),
    )


def _departure(departure: Departure) -> Iterator[Panel]:
    """Yield a panel of what is missing before departure; none once the vehicle flies."""
    if departure.waiting:
        lines = [
            Text.assemble((lack.text, "yellow"), f" → {lack.cure}" if lack.cure else "")
            for lack in departure.missing
        ] or [Text("nothing is missing", style="green")]
        yield Panel(Group(*lines), title="before departure", title_align="left")


def _movers(known: MoversRecord | None, state: StateRecord | None) -> Iterator[Panel]:
    """Yield a panel of what moves, as far as it may have come by now; none where nothing does."""
    if known is None:
        return
    lines: list[RenderableType] = []
    if known.yielding is not None:
        lines.append(Text(f"YIELD: {known.yielding}", style="bold yellow"))
    if known.missing is not None:
        text = f"no place is known to hold no mover: {known.missing}"
        lines.append(Text(text, style="yellow"))
    now_s = known.time_s if state is None else max(state.time_s, known.time_s)
    table = Table.grid(padding=(0, 2))
    for mover in known.movers[:MOVERS_SHOWN]:
        away = _away(mover, now_s, known.stamp_error_s, state)
        age = f"seen {max(now_s - mover.seen_s, 0.0):.1f} s ago"
        waits = Text("yields for it" if mover.yields_for else "", style="yellow")
        speed = f"at most {mover.speed_max_mps:.1f} m/s"
        table.add_row(mover.id, mover.kind, away, age, speed, waits)
    lines.append(table if known.movers else Text("none is seen", style="dim"))
    more = max(len(known.movers) - MOVERS_SHOWN, 0) + known.left_out
    if more > 0:
        lines.append(Text(f"and {more} more, farther away"))
    yield Panel(Group(*lines), title="what moves", title_align="left")


def _away(mover: KnownMover, now_s: float, error_s: float, state: StateRecord | None) -> str:
    """Return how near a mover may be by now."""
    box = box_at(mover, now_s, error_s)
    if state is None or state.position_ned_m is None or not box:
        return "distance not known"
    north_m, east_m, _ = state.position_ned_m
    north_min_m, north_max_m, east_min_m, east_max_m = extent(box)
    away_m = math.hypot(
        max(north_min_m - north_m, 0.0, north_m - north_max_m),
        max(east_min_m - east_m, 0.0, east_m - east_max_m),
    )
    return f"{away_m:.1f} m away or more"


def _reason(events: Sequence[EventRecord]) -> str | None:
    """Return why the vehicle holds; None while it does not."""
    changes = (event for event in reversed(events) if event.name == EventName.PHASE)
    last = next(changes, None)
    holds = last is not None and last.data.get("to") == "hold"
    return last.text.removeprefix("holding: ") if last is not None and holds else None


def _state(
    state: StateRecord | None, seen: SeenSpace | None, reason: str | None, now_unix_s: float
) -> RenderableType:
    if state is None:
        return Text("waiting for the daemon", style="yellow")
    silent_s = now_unix_s - state.time_s
    table = Table.grid(padding=(0, 2))
    table.add_row("phase", Text(state.phase.upper(), style="bold"), "mode", str(state.mode))
    if reason is not None:
        table.add_row("because", Text(reason, style="yellow"))
    table.add_row("position", _vector(state.position_ned_m, "m north, east, down"))
    table.add_row("goal", _goal(state), "battery", _battery(state.battery_charge))
    table.add_row("velocity", _vector(state.velocity_ned_mps, "m/s"))
    table.add_row("obstacles", str(state.obstacles_known))
    table.add_row("dropped", _dropped(state.dropped))
    # What it yields for is told beside the movers.
    if seen is not None and seen.pause is not None and state.phase != Phase.YIELD:
        table.add_row("pausing", Text(seen.pause, style="yellow"))
    shown: list[RenderableType] = [table]
    if state.virtual_obstacles:
        text = "VIRTUAL OBSTACLES: real ones are not seen"
        shown.insert(0, Text(text, style="bold yellow"))
    if silent_s > SILENCE_S:
        shown.insert(0, Text(f"no contact for {silent_s:.0f} s", style="bold red"))
    return Group(*shown)


def _goal(state: StateRecord) -> str:
    if state.goal_ned_m is None or state.position_ned_m is None:
        return "not known"
    return f"{math.dist(state.position_ned_m[:2], state.goal_ned_m):.1f} m away"


def _battery(charge: float | None) -> str:
    return "not known" if charge is None else f"{100.0 * charge:.0f} %"


def _dropped(counters: DropCounters) -> str:
    """Return what of the input was not used."""
    counts = asdict(counters).items()
    lost = [f"{count} {name.replace('_', ' ')}" for name, count in counts if count]
    return ", ".join(lost) or "nothing"


def _vector(vector: tuple[float, float, float] | None, unit: str) -> str:
    if vector is None:
        return "not known"
    return ", ".join(f"{value:.2f}" for value in vector) + f" {unit}"


def _monitors(monitors: Monitors | None) -> RenderableType:
    table = Table.grid(padding=(0, 2))
    for name, reading in _readings(monitors):
        measured, limit, unit = reading.measured, reading.limit, reading.unit
        shown = "not known" if measured is None else f"{measured:.3f} {unit}"
        allowed = "" if limit is None else f"limit {limit:.3f} {unit}"
        style = _style(reading, lower_limit=name == "clearance")
        table.add_row(name.replace("_", " "), Text(shown, style=style), allowed)
    return table


def _readings(monitors: Monitors | None) -> Iterator[tuple[str, Reading]]:
    """Yield the readings of a record by name."""
    if monitors is None:
        return
    for each in fields(monitors):
        reading = getattr(monitors, each.name)
        if isinstance(reading, Reading):
            yield each.name, reading


def _style(reading: Reading, *, lower_limit: bool) -> str:
    measured, limit = reading.measured, reading.limit
    if measured is None or limit is None:
        return ""
    broken = measured <= limit if lower_limit else measured > limit
    return "bold red" if broken else "green"


def _margins(margins: Margins | None) -> RenderableType:
    """Return a table with two clauses in a row, so that all of them fit a terminal."""
    table = Table.grid(padding=(0, 2))
    cells: list[RenderableType] = []
    for clause in () if margins is None else margins.clauses:
        style = "green" if clause.holds else "bold red"
        margin = Text(f"{clause.margin:+.2f} {clause.unit}", style=style)
        cells += [clause.name.replace("_", " "), margin]
    for first in range(0, len(cells), 4):
        table.add_row(*cells[first : first + 4])
    return table


def _events(events: Sequence[EventRecord]) -> RenderableType:
    lines = [
        Text(
            f"{time.strftime('%H:%M:%S', time.localtime(event.time_s))}  {event.text}",
            style=_STYLES.get(event.severity, ""),
        )
        for event in events[-EVENTS_SHOWN:]
    ]
    return Group(*lines)
