"""The record of what moves: where it was seen, and what it may reach until the vehicle rests."""

from __future__ import annotations

from dataclasses import dataclass, field

from onboard.files.record_schema import Number, UnixTime, Vector2


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownMover:
    """One mover, seen from above.

    Attributes:
        id: source and the source's own id; ``~`` and a number follow where it may be another one.
        kind: its class, as the contract names it.
        seen_s: stamp of the newest frame that showed it.
        speed_max_mps: what its class is declared with, or more once it was faster.
        velocity_ned_mps: north and east, as its sensor estimates it.
        box_ned_m: corners of the box that held it at ``seen_s``, errors included; it grows by
            ``speed_max_mps`` times its age on every side.
        reach_ned_m: corners of the box that holds it until ``until_s`` of the record.
        yields_for: whether the vehicle waits, or comes to rest, for it.
    """

    id: str
    kind: str = ""
    seen_s: UnixTime
    speed_max_mps: Number = 0.0
    velocity_ned_mps: Vector2 | None = None
    box_ned_m: list[Vector2] = field(default_factory=list)
    reach_ned_m: list[Vector2] = field(default_factory=list)
    yields_for: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class MoversRecord:
    """What is known of movers; whenever it changes, at most 4 Hz.  None where no mover is required.

    The mover-free set is stated as runs of cells: cell (i, j) reaches from (i, j) to
    (i + 1, j + 1) times ``cell_m``, north and east of the corner.

    Attributes:
        height_m: at which the leg is flown.
        until_s: when the vehicle rests at the latest on the way that is held, settling included;
            now where it holds none, or has ended it.
        stamp_error_s: how far stamps may be off; counts as further age.
        movers: the nearest first.
        left_out: how many others are known.
        yielding: why the vehicle yields; None while it does not.
        missing: what is missing before any place counts as free of movers; None if nothing is.
        corner_ned_m: of the grid.
        cell_m: edge of a cell.
        row, column_from, column_to: runs of cells that hold no mover until ``until_s``;
            ``column_to`` is the one after the last of a run.
    """

    time_s: UnixTime
    height_m: Number | None = None
    until_s: UnixTime | None = None
    stamp_error_s: Number = 0.0
    movers: list[KnownMover] = field(default_factory=list)
    left_out: int = 0
    yielding: str | None = None
    missing: str | None = None
    corner_ned_m: Vector2 = (0.0, 0.0)
    cell_m: Number = 0.0
    row: list[int] = field(default_factory=list)
    column_from: list[int] = field(default_factory=list)
    column_to: list[int] = field(default_factory=list)


def box_at(mover: KnownMover, time_s: float, stamp_error_s: float) -> list[Vector2]:
    """Return the corners of the box that holds a mover at a time, if it keeps to its speed.

    Args:
        mover: as recorded.
        time_s: Unix time; before `seen_s` nothing has grown yet.
        stamp_error_s: of its record.
    """
    if not mover.box_ned_m:
        return []
    grown_m = mover.speed_max_mps * (max(time_s - mover.seen_s, 0.0) + stamp_error_s)
    return corners(*extent(mover.box_ned_m, grown_m))


def extent(outline: list[Vector2], grown_m: float = 0.0) -> tuple[float, float, float, float]:
    """Return least and greatest north, then east, of an outline that is grown on all sides."""
    norths_m, easts_m = zip(*outline, strict=True)
    return (
        min(norths_m) - grown_m,
        max(norths_m) + grown_m,
        min(easts_m) - grown_m,
        max(easts_m) + grown_m,
    )


def corners(
    north_min_m: float, north_max_m: float, east_min_m: float, east_max_m: float
) -> list[Vector2]:
    """Return the corners of a box along north and east, in turn."""
    return [
        (north_min_m, east_min_m),
        (north_max_m, east_min_m),
        (north_max_m, east_max_m),
        (north_min_m, east_max_m),
    ]
