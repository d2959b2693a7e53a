"""An assessed contract as JSON: the published keys."""

from __future__ import annotations

import json

import pytest

from gcs_tools.contract.document import clause_document, contract_document, derived_document
from onboard.contract.assessment import assess
from onboard.files.contract_file import load_contract
from tests.gcs_tools.running import CONFIG

PATHS = (
    "paper_contract.yaml",
    "default_contract.yaml",
    "px4_contract.yaml",
    "ardupilot_contract.yaml",
)


@pytest.mark.parametrize("name", PATHS)
def test_a_contract_is_json_with_the_published_keys(name: str) -> None:
    document = contract_document(assess(load_contract(CONFIG / name)))
    assert json.loads(json.dumps(document, allow_nan=False)) == document
    assert list(document) == [
        "contract_sha256", "input_set", "accel_mps2", "nominal", "inflated", "clauses", "binding",
        "compliant", "movers",
    ]  # fmt: skip
    assert document["nominal"].keys() == document["inflated"].keys()
    assert set(document["accel_mps2"]) == {"brake", "forward", "left", "right"}


@pytest.mark.parametrize("name", PATHS)
def test_the_binding_clause_is_one_of_them_and_decides(name: str) -> None:
    assessment = assess(load_contract(CONFIG / name))
    document = contract_document(assessment)
    (binding,) = (each for each in document["clauses"] if each["name"] == document["binding"])
    assert binding["holds"] is document["compliant"]
    shares = [each["margin"] / each["declared"] for each in document["clauses"]]
    assert binding["margin"] / binding["declared"] == min(shares)


def test_margins_are_declared_less_required() -> None:
    for clause in assess(load_contract(CONFIG / "paper_contract.yaml")).clauses:
        document = clause_document(clause)
        assert document["margin"] == pytest.approx(document["declared"] - document["required"])
        assert document["holds"] is (document["margin"] > 0.0)


def test_the_lane_includes_coasting_in_the_inflated_reading_alone() -> None:
    assessment = assess(load_contract(CONFIG / "paper_contract.yaml"))
    nominal, inflated = derived_document(assessment.nominal), derived_document(assessment.inflated)
    assert inflated["roi_length_m"] > nominal["roi_length_m"]
    assert inflated["lane_overhang_m"]["left"] >= assessment.inflated.region.overhang_left_m
    region = assessment.nominal.region
    assert nominal["lane_overhang_m"]["right"] == pytest.approx(
        region.overhang_right_m + region.coast_right_m
    )
    assert nominal["csb_shape"] in {"flat", "pointed"}
