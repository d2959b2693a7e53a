"""Which sources can be used under a contract with movers: each objection names file and value."""

from __future__ import annotations

from typing import Any

import pytest

from onboard.files.contract_file import Contract
from onboard.files.yaml_file import FileError, validate
from onboard.perception.movers.permitted_sources import check_permitted
from tests.onboard.monitoring.movers.test_mover_space import against_movers
from tests.onboard.perception.test_sensor_channels import source

TRAFFIC: dict[str, Any] = {
    "kind": "traffic", "name": "others", "range_m": 100.0, "uncertainty_m": 2.0,
    "messages": ["global_position_int"], "mover_class": "person", "latency_s": 0.5,
    "accuracy_m": 5.0,
}  # fmt: skip
FIELD: dict[str, Any] = {
    "kind": "field_file", "name": "wood", "field": "f.yaml", "range_m": 12.0, "uncertainty_m": 0.1,
}  # fmt: skip


def with_unknown(contract: Contract) -> Contract:
    data = against_movers(contract).model_dump(mode="json")
    unknown = {"class": "unknown", "speed_max_mps": 2.0, "size_max_m": 2.0}
    data["environment"]["movers"].append(unknown)
    return validate(data, Contract, source="test")


def check(contract: Contract, kind: str, **keys: Any) -> None:
    check_permitted([source(kind, **keys)], contract, "onboard.yaml")


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        ({"kind": "occupancygrid"}, "'occupancygrid' (occupancygrid) does not say when a cell"),
        (FIELD, "'wood' (field_file) shows free space without looking"),
        ({"kind": "detection3d", "labels": {"dog": "animal"}},
         "labels.dog = 'animal', but environment.movers declares person"),
        ({"kind": "tracked_objects"}, "has to declare class unknown"),
        (TRAFFIC | {"mover_class": "drone"},
         "'others' mover_class = 'drone', but environment.movers declares person"),
        (TRAFFIC | {"height_m": 7.0}, "height_m = 7 m, expected at least 7.5 m"),
    ],
)  # fmt: skip
def test_what_could_not_be_relied_on_is_refused(
    contract: Contract, stated: dict[str, Any], said: str
) -> None:
    with pytest.raises(FileError, match=r"onboard\.yaml: sources: ") as caught:
        check_permitted([_source(dict(stated))], against_movers(contract), "onboard.yaml")
    assert said in str(caught.value)
    assert "requirements.movers = passive" in str(caught.value)


def _source(keys: dict[str, Any]) -> Any:
    return source(keys.pop("kind"), keys.pop("name", ""), **keys)


def test_without_movers_all_but_reports_of_them_can_be_used(contract: Contract) -> None:
    for kind in ("laserscan", "detection3d", "occupancygrid", "obstacle_distance"):
        check(contract, kind)
    with pytest.raises(FileError, match="tells of movers only, and would be ignored"):
        check(contract, "tracked_objects")


def test_what_sees_or_reports_movers_can_be_used(contract: Contract) -> None:
    movers = with_unknown(contract)
    for kind in ("laserscan", "pointcloud2", "obstacle_distance"):
        check(against_movers(contract), kind)
    check(movers, "tracked_objects", labels={"pedestrian": "person"})
    check(movers, "detection3d", labels={"human": "person", "dog": "unknown"})
    check_permitted([_source(dict(TRAFFIC) | {"height_m": 8.0})], movers, "onboard.yaml")
