"""Simplifications of a failing flight, with flights that fail by rule instead of by flying."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_tools.campaign import shrink as shrinking
from gcs_tools.campaign.command import scenario_document
from gcs_tools.campaign.generator.generators import generated
from gcs_tools.campaign.shrink import _changed, _rounded, _simpler, shrink

Document = dict[str, Any]


@pytest.fixture
def document() -> Document:
    """A drawn flight with three obstacles and two faults."""
    drawn = scenario_document(generated("faults", 1, 0).scenario)
    obstacle = drawn["field"][0]
    drawn["field"] = [{**obstacle, "id": name} for name in ("a", "b", "c")]
    drawn["faults"] = [{"kind": "gust", "amount": 3.14}, {"kind": "detections_off"}]
    return drawn


def failing(monkeypatch: pytest.MonkeyPatch, fails: Callable[[Document], bool]) -> list[Document]:
    """Let flights fail as a rule says; return what was flown."""
    flown: list[Document] = []

    def fly(document: Document, _seed: int) -> str:
        flown.append(document)
        return "no_collision: hit\ntracking: off" if fails(document) else ""

    monkeypatch.setattr(shrinking, "_findings", fly)
    return flown


def kinds(document: Document) -> list[str]:
    return [fault["kind"] for fault in document["faults"]]


def test_what_does_not_fail_alone_is_not_shrunk(
    monkeypatch: pytest.MonkeyPatch, document: Document
) -> None:
    flown = failing(monkeypatch, lambda _: False)
    assert shrink(document, frozenset({"no_collision"}), 1, 60) is None
    assert len(flown) == 1


def test_another_oracle_s_finding_is_another_failure(
    monkeypatch: pytest.MonkeyPatch, document: Document
) -> None:
    failing(monkeypatch, lambda _: True)
    assert shrink(document, frozenset({"outcome"}), 1, 60) is None


def test_only_what_the_failure_needs_is_left(
    monkeypatch: pytest.MonkeyPatch, document: Document
) -> None:
    def fails(candidate: Document) -> bool:
        ids = {obstacle["id"] for obstacle in candidate["field"]}
        return "gust" in kinds(candidate) and "b" in ids

    flown = failing(monkeypatch, fails)
    shrunk = shrink(document, frozenset({"no_collision"}), 1, 200)
    assert shrunk is not None
    assert kinds(shrunk.document) == ["gust"]
    assert [obstacle["id"] for obstacle in shrunk.document["field"]] == ["b"]
    assert shrunk.document["faults"][0]["amount"] == 3.1
    assert shrunk.document["mission"]["climb_max_m"] == 0.0
    assert "wind" not in shrunk.document["sitl"]
    assert shrunk.flights == len(flown)
    assert shrunk.findings.startswith("no_collision: ")


def test_it_stops_after_so_many_flights(
    monkeypatch: pytest.MonkeyPatch, document: Document
) -> None:
    flown = failing(monkeypatch, lambda _: True)
    shrunk = shrink(document, frozenset({"tracking"}), 1, 3)
    assert shrunk is not None
    assert (shrunk.flights, len(flown)) == (3, 3)


def test_the_document_itself_is_left_alone(
    monkeypatch: pytest.MonkeyPatch, document: Document
) -> None:
    before = copy.deepcopy(document)
    failing(monkeypatch, lambda _: True)
    shrink(document, frozenset({"tracking"}), 1, 30)
    assert document == before


def test_the_last_obstacle_stays(document: Document) -> None:
    document["field"] = document["field"][:1]
    assert all(candidate["field"] for candidate in _simpler(document))
    document["faults"] = document["faults"][:1]
    assert any(not candidate["faults"] for candidate in _simpler(document))


def test_a_document_that_is_no_scenario_finds_nothing() -> None:
    assert shrinking._findings({"contract": 3}, 1) == ""


def test_a_value_changes_or_goes_away() -> None:
    whole = {"a": {"b": [1.0, {"c": 2.0}]}}
    assert _changed(whole, ("a", "b", 1, "c"), 3.0) == {"a": {"b": [1.0, {"c": 3.0}]}}
    assert _changed(whole, ("a", "b"), None) == {"a": {}}
    assert whole == {"a": {"b": [1.0, {"c": 2.0}]}}


@given(st.floats(-1e3, 1e3).filter(lambda value: abs(value) > 0.01))
def test_a_number_that_is_there_is_not_rounded_away(value: float) -> None:
    rounded = _rounded(value)
    assert rounded != 0.0
    assert abs(rounded - value) <= 0.0500001
    assert _rounded(rounded) == rounded


def test_only_numbers_are_rounded() -> None:
    assert _rounded({"a": [1.26, "x", None, True, 3], "b": (0.04, 0.001)}) == {
        "a": [1.3, "x", None, True, 3],
        "b": [0.04, 0.0],
    }
