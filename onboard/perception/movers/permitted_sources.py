"""Which sensors of a daemon's file can be used where a contract requires safety against movers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from onboard.files.contract_file import Contract
from onboard.files.sensor_sources import AnySource, FieldFileSource, OccupancyGridSource
from onboard.files.yaml_file import FileError


def check_permitted(sources: Sequence[AnySource], contract: Contract, stated_in: str) -> None:
    """Check that no sensor of a daemon's file would show places free that it saw no mover in.

    Args:
        sources: of the file.
        contract: that is flown.
        stated_in: the file, for the message.

    Raises:
        FileError: one would, or says what the contract does not declare.
    """
    if contract.requirements.movers == "none":
        return
    level = f"requirements.movers = {contract.requirements.movers}"
    for objection in _objections(sources):
        raise FileError(f"{stated_in}: sources: {objection} (the contract has {level})")


def _objections(sources: Iterable[AnySource]) -> Iterable[str]:
    for source in sources:
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
