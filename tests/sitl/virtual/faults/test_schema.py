"""Every kind of fault has a meaning, a description and a module that applies it."""

from typing import get_args

import pytest
from pydantic import ValidationError

from sitl.virtual.faults import detections, mavlink, service, vehicle
from sitl.virtual.faults.schema import FAULTS, Fault, FaultKind, Target

KINDS: tuple[FaultKind, ...] = get_args(FaultKind)
APPLIED = {
    Target.DETECTIONS: detections.KINDS,
    Target.MAVLINK: mavlink.KINDS,
    Target.VEHICLE: vehicle.KINDS,
    Target.SERVICE: service.KINDS,
}


def test_every_kind_has_a_meaning_and_nothing_else_has() -> None:
    assert set(FAULTS) == set(KINDS)
    assert len(KINDS) == len(set(KINDS))


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_is_applied_exactly_where_it_says(kind: FaultKind) -> None:
    applied = {target for target, kinds in APPLIED.items() if kind in kinds}
    assert applied == set(FAULTS[kind].targets)


def test_no_module_applies_a_kind_that_no_file_can_state() -> None:
    assert set().union(*APPLIED.values()) == set(KINDS)


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_is_described_in_the_schema_with_its_unit(kind: FaultKind) -> None:
    text = Fault.model_json_schema()["properties"]["kind"]["description"]
    (line,) = [line for line in text.splitlines() if line.startswith(f"- {kind}:")]
    meaning = FAULTS[kind]
    assert meaning.effect in line
    assert (f"(amount: {meaning.unit}" in line) is bool(meaning.unit)


def test_the_schema_lists_the_kinds_in_the_order_that_campaigns_draw_from() -> None:
    assert Fault.model_json_schema()["properties"]["kind"]["enum"] == list(KINDS)
    assert KINDS[0] == "detections_off"
    assert KINDS[-1] == "operator_resumes"


@pytest.mark.parametrize("kind", [kind for kind in KINDS if not FAULTS[kind].unit])
def test_kinds_without_a_unit_have_no_amount(kind: FaultKind) -> None:
    assert FAULTS[kind].amount == 0.0


def test_the_amount_of_the_file_replaces_the_default() -> None:
    assert Fault(kind="gust").value == 6.0
    assert Fault(kind="gust", amount=2.5).value == 2.5
    assert Fault(kind="gust", amount=0.0).value == 0.0
    assert Fault(kind="tick_stall").value == 0.0


@pytest.mark.parametrize(
    "stated",
    [
        {"kind": "wind_shear"},
        {"kind": "gust", "start_s": -1.0},
        {"kind": "gust", "duration_s": 0.0},
        {"kind": "gust", "phase": "landing"},
        {"kind": "gust", "entry": 0},
        {"kind": "gust", "strength": 3.0},
        {},
    ],
)
def test_what_makes_no_sense_is_refused(stated: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        Fault.model_validate(stated)
