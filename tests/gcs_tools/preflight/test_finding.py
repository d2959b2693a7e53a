"""Verdicts, and how several make one."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_tools.preflight.finding import Finding, Verdict

verdicts = st.sampled_from(Verdict)


@given(st.lists(verdicts), st.lists(verdicts))
def test_the_worst_of_all_is_the_worst_of_the_worst(one: list[Verdict], two: list[Verdict]) -> None:
    assert Verdict.worst(one + two) is Verdict.worst([Verdict.worst(one), Verdict.worst(two)])


@pytest.mark.parametrize("order", list(itertools.permutations(Verdict)))
def test_broken_is_the_worst_in_any_order(order: tuple[Verdict, ...]) -> None:
    assert Verdict.worst(order) is Verdict.BROKEN


def test_nothing_to_check_holds() -> None:
    assert Verdict.worst([]) is Verdict.HOLDS


def test_unknown_is_not_fine() -> None:
    assert Verdict.worst([Verdict.HOLDS, Verdict.UNKNOWN]) is Verdict.UNKNOWN
    assert not Finding("vehicle", "link", Verdict.UNKNOWN, "").holds
    assert Finding("vehicle", "link", Verdict.of(holds=True), "").holds


def test_a_finding_as_json() -> None:
    finding = Finding("daemon", "version", Verdict.of(holds=False), "0.1, expected 0.2")
    assert finding.document() == {
        "subject": "daemon", "name": "version", "verdict": "broken", "text": "0.1, expected 0.2",
        "settings": {},
    }  # fmt: skip
