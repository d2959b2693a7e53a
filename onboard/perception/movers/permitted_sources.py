"""Which sensors of a daemon's file can be used where a contract requires safety against movers."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from onboard.files.contract_file import Contract
from onboard.files.contract_terms.mover_terms import UNKNOWN
from onboard.files.sensor_sources import (
    AnySource,
    FieldFileSource,
    LabelledSource,
    OccupancyGridSource,
    TrafficSource,
    only_adds_movers,
)
from onboard.files.yaml_file import FileError
from onboard.perception.movers.tracker import MEMORY_S as REPORT_MEMORY_S


def check_permitted(sources: Sequence[AnySource], contract: Contract, stated_in: str) -> None:
    """Check that no sensor of a daemon's file would show places free that it saw no mover in.

    Args:
        sources: of the file.
        contract: that is flown.
        stated_in: the file, for the message.

    Raises:
        FileError: one would, or says what the contract does not declare.
    """
    level = f"requirements.movers = {contract.requirements.movers}"
    for objection in _objections(sources, contract):
        raise FileError(f"{stated_in}: sources: {objection} (the contract has {level})")


def _objections(sources: Iterable[AnySource], contract: Contract) -> Iterator[str]:
    for source in sources:
        if contract.requirements.movers == "none":
            if only_adds_movers(source):
                yield (
                    f"'{source.name}' ({source.kind}) tells of movers only, and would be ignored: "
                    "remove it, or require safety against movers"
                )
            continue
        if isinstance(source, FieldFileSource):
            yield (
                f"'{source.name}' (field_file) shows free space without looking: who moves there "
                "is real; remove it, or fly a contract without movers"
            )
        if isinstance(source, OccupancyGridSource):
            yield (
                f"'{source.name}' (occupancygrid) does not say when a cell was last looked at: "
                "state the sensor that the map is made from, such as laserscan"
            )
        if isinstance(source, LabelledSource):
            yield from _labels(source, contract)
        if isinstance(source, TrafficSource):
            yield from _traffic(source, contract)


def _labels(source: LabelledSource, contract: Contract) -> Iterator[str]:
    """Object to labels of classes that are not declared, and to boxes that may be of none."""
    kinds = {mover.kind for mover in contract.environment.movers}
    for label, kind in source.labels.items():
        if kind not in kinds:
            yield (
                f"'{source.name}' labels.{label} = '{kind}', but environment.movers declares "
                f"{_names(kinds)}"
            )
    if UNKNOWN not in kinds:
        yield (
            f"'{source.name}' may name what its labels do not: environment.movers "
            f"has to declare class {UNKNOWN} for that, with the greatest speed that it may have"
        )


def _traffic(source: TrafficSource, contract: Contract) -> Iterator[str]:
    """Object to a class that is not declared, and to a height from which it comes in time."""
    by_kind = {mover.kind: mover for mover in contract.environment.movers}
    mover = by_kind.get(source.mover_class)
    if mover is None:
        yield (
            f"'{source.name}' mover_class = '{source.mover_class}', but environment.movers "
            f"declares {_names(by_kind)}"
        )
    elif source.height_m is not None and source.height_m < mover.speed_max_mps * REPORT_MEMORY_S:
        need_m = mover.speed_max_mps * REPORT_MEMORY_S
        yield (
            f"'{source.name}' height_m = {source.height_m:g} m, expected at least {need_m:g} m: a "
            f"{mover.kind} of {mover.speed_max_mps:g} m/s comes so far while its report counts"
        )


def _names(kinds: Iterable[str]) -> str:
    return ", ".join(sorted(kinds)) or "none"
