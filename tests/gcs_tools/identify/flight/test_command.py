"""What the operator is told and asked before an identification flight."""

from __future__ import annotations

import io
import sys

import pytest

from gcs_tools.console.errors import CommandError
from gcs_tools.identify.flight.command import _confirm
from gcs_tools.identify.flight.free_air import FreeAir
from gcs_tools.identify.flight.programme import Programme, programme
from onboard.contract.assessment import assess
from onboard.files.contract_file import load_contract
from tests.gcs_tools.running import CONFIG


@pytest.fixture(scope="module")
def flown() -> Programme:
    assessment = assess(load_contract(CONFIG / "px4_contract.yaml"))
    return programme(assessment, FreeAir(80.0, 20.0), None, run_on=True)


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(
    ("answer", "vouches"), [("free\n", True), (" FREE \n", True), ("yes\n", False)]
)
def test_the_operator_types_the_word(
    flown: Programme,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    answer: str,
    *,
    vouches: bool,
) -> None:
    monkeypatch.setattr(sys, "stdin", Terminal(answer))
    if vouches:
        _confirm(flown, 3.5, vouched=False)
    else:
        with pytest.raises(CommandError, match="not flown: the answer was 'yes', not 'free'"):
            _confirm(flown, 3.5, vouched=False)
    said = capsys.readouterr().out
    assert "5 passes at 2.8 m/s" in said
    assert f"{80.0 - flown.margin_m:.1f} m ahead of its nose, 10.0 m to each side" in said
    assert "No sensor is read" in said
    assert "run on 3.5 m" in said


def test_a_program_has_to_vouch_in_so_many_words(
    flown: Programme, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO("free\n"))
    with pytest.raises(CommandError, match="--vouch"):
        _confirm(flown, None, vouched=False)
    _confirm(flown, None, vouched=True)
