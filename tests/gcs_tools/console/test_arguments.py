"""Number types, renamed options and `--version`."""

from __future__ import annotations

import argparse

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_tools.console.arguments import (
    DIGITS_MAX,
    PORT_MAX,
    RenamedOption,
    VersionOption,
    add_output_options,
    count,
    natural,
    port,
    positive,
)


@given(st.integers(0, 10**DIGITS_MAX - 1))
def test_whole_numbers_are_read(number: int) -> None:
    assert natural(str(number)) == number


@pytest.mark.parametrize(
    "text", ["", "-1", "1.0", "1e3", " 1", "+1", "one", "\u0661", "9" * 19, "0x1"]
)
def test_what_is_not_a_whole_number_is_refused(text: str) -> None:
    for kind in (natural, count, port):
        with pytest.raises(argparse.ArgumentTypeError, match="is not a whole number, 0 or more"):
            kind(text)


def test_a_long_text_is_not_repeated_in_full() -> None:
    with pytest.raises(argparse.ArgumentTypeError) as refused:
        natural("7" * 1000)
    assert len(str(refused.value)) < 100


def test_a_count_begins_at_one() -> None:
    assert count("1") == 1
    with pytest.raises(argparse.ArgumentTypeError, match="0 is not a whole number, 1 or more"):
        count("0")


def test_ports_end_at_the_last_one() -> None:
    assert (port("0"), port(str(PORT_MAX))) == (0, PORT_MAX)
    with pytest.raises(argparse.ArgumentTypeError, match="65536 is not a port from 0 to 65535"):
        port("65536")


@given(st.floats(min_value=0.0, exclude_min=True, allow_infinity=False))
def test_positive_numbers_are_read(number: float) -> None:
    assert positive(repr(number)) == number


@pytest.mark.parametrize("text", ["0", "-0.0", "-1", "inf", "nan", "", "1,5", "ten"])
def test_what_is_not_above_zero_is_refused(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="is not a number above 0"):
        positive(text)


def test_a_renamed_option_names_the_new_one(capsys: pytest.CaptureFixture[str]) -> None:
    parser = argparse.ArgumentParser(prog="tool")
    parser.add_argument("--new", action="store_true")
    parser.add_argument("--old", action=RenamedOption, const="--new")
    with pytest.raises(SystemExit) as ended:
        parser.parse_args(["--old"])
    assert ended.value.code == 2
    assert "--old was renamed: use --new" in capsys.readouterr().err
    assert "--old" not in parser.format_help()
    assert parser.parse_args(["--new"]).new


def test_version_is_the_package_s(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("importlib.metadata.version", lambda name: f"{name}-9.8.7")
    parser = argparse.ArgumentParser(prog="tool")
    parser.add_argument("--version", action=VersionOption)
    with pytest.raises(SystemExit) as ended:
        parser.parse_args(["--version"])
    assert ended.value.code == 0
    assert capsys.readouterr().out == "tool clearway-9.8.7\n"


def test_the_first_form_of_output_is_the_default() -> None:
    parser = argparse.ArgumentParser()
    add_output_options(parser, "table", "json")
    assert parser.parse_args([]).form == "table"
    assert parser.parse_args(["--format", "json"]).form == "json"
    with pytest.raises(SystemExit):
        parser.parse_args(["--format", "csv"])
