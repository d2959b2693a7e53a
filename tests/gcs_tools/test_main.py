"""The command line itself: what it lists, how each command's arguments are read, how it starts."""

from __future__ import annotations

import argparse
import importlib
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest

from gcs_tools.__main__ import build_parser, main
from gcs_tools.console.errors import CommandError, Interrupted
from gcs_tools.preflight.finding import Verdict
from onboard.files.yaml_file import FileError
from tests.gcs_tools.running import Clearway

NAMES = (
    *("init", "fly", "preflight", "fleet", "contract", "mission", "report", "export", "watch"),
    *("resume", "return", "status", "doctor", "sensor", "replay"),
    *("identify", "campaign", "benchmark", "service", "schema"),
)
C = ("--contract", "c.yaml")


def called(
    monkeypatch: pytest.MonkeyPatch, target: str, *arguments: str, returns: Any = None
) -> tuple[int, tuple[Any, ...], dict[str, Any]]:
    """Run a command line; return its exit code and what it called ``target`` with."""
    calls: list[tuple[tuple[Any, ...], dict[str, Any]]] = []

    def record(*positional: Any, **keywords: Any) -> Any:
        calls.append((positional, keywords))
        return returns

    module, _, name = target.rpartition(".")
    monkeypatch.setattr(importlib.import_module(module), name, record)
    code = main(list(arguments))
    ((positional, keywords),) = calls
    return code, positional, keywords


# ---------------------------------------------------------------------------- the list


def test_every_command_is_listed_and_has_help(clearway: Clearway) -> None:
    listed = clearway("--help")
    assert listed.code == 0
    for name in NAMES:
        assert f"\n    {name}" in listed.out
        assert clearway(name, "--help").code == 0
    (commands,) = build_parser()._subparsers._group_actions  # type: ignore[union-attr]
    assert set(commands.choices or ()) == set(NAMES)


@pytest.mark.parametrize("program", ["gcs_tools", "onboard", "sitl"])
def test_every_program_says_its_version(program: str) -> None:
    names = {"gcs_tools": "clearway", "onboard": "clearway-onboard", "sitl": "clearway-sitl"}
    command = [sys.executable, "-m", program, "--version"]
    ran = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60.0)
    assert (ran.returncode, ran.stderr) == (0, "")
    assert ran.stdout == f"{names[program]} {version('clearway')}\n"


def test_every_option_has_a_help_text() -> None:
    without = []

    def look(parser: argparse.ArgumentParser) -> None:
        for action in parser._actions:
            if isinstance(action, argparse._SubParsersAction):
                for inner in action.choices.values():
                    look(inner)
            elif action.help is None:
                without.append(f"{parser.prog} {action.dest}")

    look(build_parser())
    assert without == []


def test_help_and_version_load_nothing_heavy() -> None:
    script = (
        "import sys\nfrom gcs_tools.__main__ import build_parser\nbuild_parser()\n"
        "heavy = {'numpy', 'scipy', 'rich', 'pydantic', 'yaml', 'zenoh', 'mavsdk', 'pymavlink',\n"
        "         'matplotlib', 'pyarrow', 'shapely', 'jinja2', 'sitl', 'onboard'}\n"
        "print(sorted(heavy & set(sys.modules)))"
    )
    command = [sys.executable, "-c", script]
    ran = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60.0)
    assert ran.stdout == "[]\n"


def test_a_contract_is_shown_without_the_simulation_or_a_vehicle(config: Path) -> None:
    script = (
        "import sys\nfrom gcs_tools.__main__ import main\n"
        f"main(['contract', 'show', '--contract', {str(config / 'default_contract.yaml')!r}])\n"
        "unwanted = {'zenoh', 'mavsdk', 'pymavlink', 'matplotlib', 'pyarrow', 'sitl', 'scipy'}\n"
        "sys.stderr.write(str(sorted(unwanted & set(sys.modules))))"
    )
    command = [sys.executable, "-c", script]
    ran = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60.0)
    assert ran.stderr == "[]"


# ---------------------------------------------------------------------------- the commands


def test_fly_passes_its_arguments_on(monkeypatch: pytest.MonkeyPatch) -> None:
    target = "gcs_tools.fly.command.fly"
    code, positional, keywords = called(monkeypatch, target, "fly", returns=True)
    assert (code, positional) == (0, (None,))
    assert keywords == {
        "virtual": False, "seed": 1, "out": None, "fly_outside_contract": False,
        "accept_no_progress": False, "clearance_wish_m": None,
        "mavlink_key_file": None,
    }  # fmt: skip
    line = ("fly", "s.yaml", "--virtual", "--seed", "7", "--out", "d", "--fly-outside-contract",
        "--accept-no-progress", "--clearance-wish", "0.7", "--mavlink-key", "k")  # fmt: skip
    code, positional, keywords = called(monkeypatch, target, *line, returns=False)
    assert (code, positional) == (1, (Path("s.yaml"),))
    assert keywords == {
        "virtual": True, "seed": 7, "out": Path("d"), "fly_outside_contract": True,
        "accept_no_progress": True, "clearance_wish_m": 0.7,
        "mavlink_key_file": Path("k"),
    }  # fmt: skip


@pytest.mark.parametrize(
    ("verdict", "code"), [(Verdict.HOLDS, 0), (Verdict.BROKEN, 1), (Verdict.UNKNOWN, 2)]
)
def test_preflight_answers_by_its_exit_code(
    monkeypatch: pytest.MonkeyPatch, verdict: Verdict, code: int
) -> None:
    target = "gcs_tools.preflight.command.run_preflight"
    line = ("preflight", *C, "--field", "f.csv", "--authorize", "9.5", "--set", "a=1", "b=2",
        "--accept-no-progress")  # fmt: skip
    answer, (files,), keywords = called(monkeypatch, target, *line, returns=verdict)
    assert answer == code
    assert (files.contract, files.field, files.mission) == (Path("c.yaml"), Path("f.csv"), None)
    assert files.overrides == ("a=1", "b=2")
    assert (keywords["authorize_s"], keywords["vehicle_url"]) == (9.5, None)
    assert (keywords["input_set"], keywords["form"]) == ("inner", "table")
    assert keywords["accept_no_progress"]


def test_contract_actions_pass_their_arguments_on(monkeypatch: pytest.MonkeyPatch) -> None:
    show = "gcs_tools.contract.show.show_contract"
    line = ("contract", "show", *C, "--input-set", "paper", "--format", "csv", "-o", "out.csv")
    _, positional, keywords = called(monkeypatch, show, *line)
    assert positional == (Path("c.yaml"),)
    assert keywords == {
        "overrides": (), "input_set": "paper", "form": "csv", "output": Path("out.csv")
    }  # fmt: skip
    solve = "gcs_tools.contract.solve.solve_contract"
    _, _, keywords = called(monkeypatch, solve, "contract", "solve", *C, "--for", "vehicle.x")
    assert keywords["key"] == "vehicle.x"
    surface = "gcs_tools.contract.surface.write_surface"
    line = ("contract", "surface", *C, "--x", "a=1:2:3", "--z", "margin", "--plot", "p.svg")
    _, (_, request), keywords = called(monkeypatch, surface, *line)
    assert (request.figure, request.x, request.y, request.quantity) == (
        None, "a=1:2:3", None, "margin",
    )  # fmt: skip
    assert keywords["plot"] == Path("p.svg")


def test_report_takes_one_flight_or_two(monkeypatch: pytest.MonkeyPatch) -> None:
    target = "gcs_tools.flight_report.command.run_report"
    _, positional, _ = called(monkeypatch, target, "report", "a")
    assert positional == ([Path("a")], None)
    _, positional, _ = called(monkeypatch, target, "report", "a", "b", "-o", "c.html")
    assert positional == ([Path("a"), Path("b")], Path("c.html"))


def test_export_takes_one_form(monkeypatch: pytest.MonkeyPatch) -> None:
    target = "gcs_tools.export.command.export"
    _, positional, _ = called(monkeypatch, target, "export", "a", "--tlog")
    assert positional == (Path("a"), "tlog", None)
    _, positional, _ = called(monkeypatch, target, "export", "a", "--foxglove", "-o", "b.mcap")
    assert positional == (Path("a"), "foxglove", Path("b.mcap"))


def test_watch_serves_foxglove_if_asked_to(monkeypatch: pytest.MonkeyPatch) -> None:
    target = "gcs_tools.watch.command.watch"
    for line, port in (((), None), (("--foxglove",), 8765), (("--foxglove", "0"), 0)):
        _, _, keywords = called(monkeypatch, target, "watch", *line)
        assert keywords["foxglove_port"] == port


def test_identify_passes_its_arguments_on(monkeypatch: pytest.MonkeyPatch) -> None:
    target = "gcs_tools.identify.command.identify"
    line = ("identify", "a.ulg", "b", "--system-id", "3", "--margin", "0.5", "--format", "json")
    _, positional, keywords = called(monkeypatch, target, *line)
    assert positional == ([Path("a.ulg"), Path("b")], 3)
    assert keywords == {"margin": 0.5, "form": "json", "output": None}


def test_campaign_passes_its_arguments_on(monkeypatch: pytest.MonkeyPatch) -> None:
    target = "gcs_tools.campaign.command.run_campaign"
    code, (request,), _ = called(monkeypatch, target, "campaign", "quick", returns=True)
    assert (code, request.scenarios, request.flights, request.seed) == (0, ("quick",), 100, 1)
    assert (request.only, request.processes, request.dask, request.out) == (None, None, None, None)
    line = ("campaign", "quick", "x.yaml", "--flights", "5", "--jobs", "2", "--shrink", "0")
    code, (request,), _ = called(monkeypatch, target, *line, returns=False)
    assert (code, request.scenarios, request.flights) == (1, ("quick", "x.yaml"), 5)
    assert (request.processes, request.shrink) == (2, 0)


def test_schema_passes_its_directory_on(monkeypatch: pytest.MonkeyPatch) -> None:
    target = "gcs_tools.schemas.write_schemas"
    code, positional, _ = called(monkeypatch, target, "schema", "-o", "d")
    assert (code, positional) == (0, (Path("d"),))


@pytest.mark.parametrize(
    ("line", "names"),
    [
        (("fly", "--force"), ("--force", "--fly-outside-contract")),
        (("preflight", *C, "--authorise"), ("--authorise", "--authorize")),
    ],
)
def test_options_of_before_are_refused_with_the_new_name(
    clearway: Clearway, line: tuple[str, ...], names: tuple[str, str]
) -> None:
    ran = clearway(*line)
    assert (ran.code, ran.out) == (2, "")
    assert ran.err.startswith(f"clearway: error: {names[0]} was renamed: use {names[1]}")
    assert ran.err.count("\n") == 1


@pytest.mark.parametrize(
    "line",
    [
        ("watch", "--zenoh-config", "a", "--daemon-config", "b"),
        ("campaign", "quick", "--jobs", "2", "--dask", "tcp://a:1"),
        ("campaign", "quick", "--jobs", "0"),
        ("watch", "--port", "65536"),
        ("watch", "--foxglove", "65536"),
        ("export",),
        ("export", "a"),
        ("export", "a", "--tlog", "--foxglove"),
        ("identify",),
        ("identify", "a", "--margin", "0"),
        ("contract", "solve", *C),
        ("contract", "surface", *C, "--figure", "14"),
        ("report",),
        ("preflight", *C, "--input-set", "outer"),
    ],
)
def test_arguments_that_make_no_sense_are_one_line(
    clearway: Clearway, line: tuple[str, ...]
) -> None:
    ran = clearway(*line)
    assert ran.code == 2
    assert ran.err.startswith("clearway: error: ")
    assert f"(see clearway {line[0]}" in ran.err
    assert ran.err.count("\n") == 1


# ---------------------------------------------------------------------------- how it ends


@pytest.mark.parametrize(
    ("error", "code", "message"),
    [
        (CommandError("no such thing"), 2, "no such thing"),
        (FileError("f.yaml: bad"), 2, "f.yaml: bad"),
        (Interrupted(15), 143, "interrupted"),
        (KeyboardInterrupt(), 130, "interrupted"),
        (
            ModuleNotFoundError(name="mavsdk"),
            2,
            "mavsdk is not installed: pip install 'clearway[ground]'",
        ),
    ],
)
def test_an_error_is_one_line_and_an_exit_code(
    monkeypatch: pytest.MonkeyPatch,
    clearway: Clearway,
    error: BaseException,
    code: int,
    message: str,
) -> None:
    def fail(*_: object) -> None:
        raise error

    monkeypatch.setattr("gcs_tools.schemas.write_schemas", fail)
    ran = clearway("schema", "-o", "d")
    assert (ran.code, ran.err) == (code, f"clearway: error: {message}\n")


def test_a_module_of_ours_that_is_missing_is_a_defect(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise ModuleNotFoundError(name="gcs_tools.nowhere")

    monkeypatch.setattr("gcs_tools.schemas.write_schemas", fail)
    with pytest.raises(ModuleNotFoundError):
        main(["schema", "-o", "d"])
