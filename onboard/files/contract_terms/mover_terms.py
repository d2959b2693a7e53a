"""What a contract declares of things that move: classes, and what is required against them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Final, Literal, NamedTuple

from pydantic import ConfigDict, Field

from onboard.files.yaml_file import FileModel

MoversLevel = Literal["none", "passive_in_view", "passive", "avoid"]
# What a sensor does not name, and what it names otherwise than the contract does.
UNKNOWN: Final = "unknown"


class MoverClass(FileModel):
    """One class of movers.

    Attributes:
        kind: its name, as sensors state it; ``unknown`` for what they do not name.
        speed_max_mps: v_o, of any point of it, in any direction.
        size_max_m: largest horizontal extent.
        hidden: whether some may be hidden behind obstacles that stand still.  Without, what nothing
            has been seen to enter holds none, as far as obstacles hide it.
        top_max_m: how high above the ground below it any part of it is; None: at any height.
    """

    model_config = ConfigDict(populate_by_name=True, serialize_by_alias=True)

    kind: Annotated[str, Field(alias="class", min_length=1, max_length=32, pattern=r"^[a-z0-9_]+$")]
    speed_max_mps: Annotated[float, Field(gt=0.0, le=100.0)] = Field(
        description="v_o, of any point of such a mover, in any direction"
    )
    size_max_m: Annotated[float, Field(gt=0.0, le=100.0)] = Field(
        description="largest horizontal extent"
    )
    hidden: bool = Field(False, description="some may be hidden behind what stands still")
    top_max_m: Annotated[float, Field(gt=0.0, le=1000.0)] | None = Field(
        None, description="of any part of it, above the ground; null: it may be at any height"
    )


def check_movers(movers: Sequence[MoverClass]) -> None:
    """Check that classes are stated once, and that unknown movers may be as any known one.

    Raises:
        ValueError: they are not; says which value is wrong.
    """
    kinds = [mover.kind for mover in movers]
    for kind in kinds:
        if kinds.count(kind) > 1:
            raise ValueError(f"class '{kind}' is stated {kinds.count(kind)} times; state it once")
    for mover in movers:
        fastest = max(movers, key=lambda each: each.speed_max_mps)
        if mover.kind == UNKNOWN and mover.speed_max_mps < fastest.speed_max_mps:
            raise ValueError(
                f"class unknown has speed_max_mps = {mover.speed_max_mps:g} m/s, but what a sensor "
                f"does not name may be a {fastest.kind}: state at least "
                f"{fastest.speed_max_mps:g} m/s, or leave the class out"
            )
        largest = max(movers, key=lambda each: each.size_max_m)
        if mover.kind == UNKNOWN and mover.size_max_m < largest.size_max_m:
            raise ValueError(
                f"class unknown has size_max_m = {mover.size_max_m:g} m, but what a sensor does "
                f"not name may be a {largest.kind}: state at least {largest.size_max_m:g} m, or "
                "leave the class out"
            )
        _check_top(mover, movers)


def _check_top(mover: MoverClass, movers: Sequence[MoverClass]) -> None:
    """Check that what a sensor does not name may be as high as what it names.

    Raises:
        ValueError: it may not.
    """
    top_m = mover.top_max_m
    if mover.kind != UNKNOWN or top_m is None:
        return
    higher = [each for each in movers if each.top_max_m is None or each.top_max_m > top_m]
    if higher:
        least = "no top_max_m" if higher[0].top_max_m is None else f"{higher[0].top_max_m:g} m"
        raise ValueError(
            f"class unknown has top_max_m = {top_m:g} m, but what a sensor does not name may be a "
            f"{higher[0].kind}, which has {least}: state as much, or leave the class out"
        )


class Declared(NamedTuple):
    """What a contract declares, as far as a level of safety against movers needs it.

    Attributes:
        movers: the declared classes.
        stop: whether a way to rest is required.
        best_effort: whether passing obstacles is not guaranteed.
        rest_settle_s: as declared.
        sees_all_round: whether an all-round sensor is declared.
        run_time_known: whether it is known how long the vehicle runs on without setpoints, where
            that matters.
        as_pillars: whether obstacles count as pillars of any height.
        drifts_m: of the estimated height, until an obstacle is passed and over a whole flight.
    """

    movers: Sequence[MoverClass]
    stop: bool
    best_effort: bool
    rest_settle_s: float
    sees_all_round: bool
    run_time_known: bool
    as_pillars: bool
    drifts_m: tuple[float | None, float | None] = (None, None)


def movers_objection(level: MoversLevel, declared: Declared) -> str | None:
    """Return why a level of safety against movers cannot be required; None if it can."""
    if level == "none":
        return None
    name = f"requirements.movers = {level}"
    if level == "avoid" and declared.best_effort:
        return (
            f"{name} with progress = best_effort: movers are passed from the cruise only, which "
            "best effort does not fly; require passive"
        )
    needed = (
        (bool(declared.movers), "environment.movers: the classes that may move, with their speed"),
        (declared.stop, "requirements.stop = true: it rests on a way to rest that is held"),
        (
            declared.rest_settle_s > 0.0,
            "vehicle.rest_settle_s above 0 s: reference at rest to vehicle at rest, as measured",
        ),
        (
            declared.run_time_known,
            "vehicle.setpoint_loss_run_time_s: last setpoint to rest, where the setpoint is frozen",
        ),
    )
    for holds, what in needed:
        if not holds:
            return f"{name} needs {what}"
    if not declared.as_pillars:
        return _heights_objection(name, level, declared)
    return _view_objection(name, level, declared)


def _view_objection(name: str, level: MoversLevel, declared: Declared) -> str | None:
    """Return why a level cannot be required with what is seen around the vehicle."""
    if level == "passive_in_view":
        return _in_view_objection(name, best_effort=declared.best_effort)
    if not declared.sees_all_round:
        return (
            f"{name} needs sensor.all_round_range_m above 0 m, or field_of_view_deg = 360: who "
            "comes from behind is seen by nothing else"
        )
    return None


def _heights_objection(name: str, level: MoversLevel, declared: Declared) -> str | None:
    """Return why a level cannot be required beside declared heights: there movers are flown over.

    Near by, what moves may be below or above the vertical view.
    """
    if level != "passive":
        return (
            f"{name} beside vehicle.radius_z_m: what moves is flown over there, out of its reach; "
            "require passive"
        )
    short_m, flight_m = declared.drifts_m
    if flight_m is None or flight_m < (short_m or 0.0):
        stated = "null" if flight_m is None else f"{flight_m:g} m"
        return (
            f"{name} beside vehicle.radius_z_m: vehicle.height_drift_flight_m = {stated}, expected "
            f"at least height_drift_m = {short_m or 0.0:g} m: what moves below the view is not "
            "measured, so that the height above the ground counts, with all that it drifts"
        )
    flying = next((each.kind for each in declared.movers if each.top_max_m is None), None)
    if flying is not None:
        return (
            f"{name} beside vehicle.radius_z_m needs top_max_m [m] of class {flying} in "
            "environment.movers: what may be at any height may come from above or below the "
            "vertical view, and is not covered"
        )
    return None


def _in_view_objection(name: str, *, best_effort: bool) -> str | None:
    if best_effort:
        return (
            f"{name} with progress = best_effort: what was in view counts only in a steady cruise, "
            "which best effort does not fly; require passive, with an all-round sensor"
        )
    return None
