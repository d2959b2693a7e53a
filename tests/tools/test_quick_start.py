"""The commands of docs/quick_start.md are read, typed and checked; `make quick-start` plays all."""

import re
import shlex
import socket
import sys
from pathlib import Path

import pytest

from gcs_tools.setup.command import FILES
from tests.tools.quick_start import PAGE, PORTS, Step, busy_ports, play, steps

PAGE_TEXT = """
```sh
not played
```

<!-- played -->
```sh
mkdir mine
cd mine
ls missing  # exit code 2
sleep 60 &
```
"""
ENVIRONMENT = {"PATH": "/usr/bin:/bin"}


def test_what_is_played_is_read_from_the_page() -> None:
    lines = [Step("mkdir mine"), Step("cd mine"), Step("ls missing", 2), Step("sleep 60 &")]
    assert steps(PAGE_TEXT) == [lines]


def test_commands_are_typed_into_one_shell_and_end_with_it(tmp_path: Path) -> None:
    (played,) = steps(PAGE_TEXT)
    printed = play([*played, Step("pwd")], tmp_path, ENVIRONMENT)
    assert f"$ pwd\n{tmp_path}/mine\n" in printed


@pytest.mark.parametrize(("command", "expected"), [("false", 0), ("true", 1)])
def test_a_command_that_ends_otherwise_is_named(
    tmp_path: Path, command: str, expected: int
) -> None:
    later = Step("echo later")
    with pytest.raises(AssertionError, match=f"ended with {1 - expected}, expected {expected}"):
        play([Step(command, expected), later], tmp_path, ENVIRONMENT)


def test_the_page_plays_what_a_new_user_needs() -> None:
    played = [step for block in steps(PAGE.read_text(encoding="utf-8")) for step in block]
    commands = [shlex.split(step.command)[1] for step in played if "clearway " in step.command]
    assert list(dict.fromkeys(commands)) == [
        *("init", "preflight", "fly", "report", "identify", "status", "doctor")
    ]
    codes = [step.exit_code for step in played if " preflight " in step.command]
    assert codes == [0, 1, 0, 0, 0]
    contract = (FILES / "px4" / "contract.yaml").read_text(encoding="utf-8")
    for step in played:
        if step.command.startswith("sed"):
            _, written, changed, _ = step.command.split("/")
            assert written in contract
            contract = contract.replace(written, changed)


@pytest.mark.parametrize("kind", [socket.SOCK_DGRAM, socket.SOCK_STREAM])
def test_a_port_in_use_is_named(kind: socket.SocketKind) -> None:
    with socket.socket(socket.AF_INET, kind) as taken:
        taken.bind(("127.0.0.1", 0))
        if kind == socket.SOCK_STREAM:
            taken.listen()
        number = taken.getsockname()[1]
        name = "UDP" if kind == socket.SOCK_DGRAM else "TCP"
        assert busy_ports([(kind, number)]) == [f"{name} {number}"]
    assert busy_ports([(kind, number)]) == []


def test_the_ports_are_those_of_the_files() -> None:
    files = {
        each: (FILES / each).read_text(encoding="utf-8")
        for each in ("px4/sitl.yaml", "both/onboard.yaml")
    }
    assert all(any(str(number) in text for text in files.values()) for _, number in PORTS)


def test_the_check_on_paper_ends_as_the_page_says(tmp_path: Path) -> None:
    """Refused and cured, with the contract as it is shipped; what flies is left out."""
    played = [step for block in steps(PAGE.read_text(encoding="utf-8")) for step in block]
    flies = next(i for i, step in enumerate(played) if " fly " in step.command)
    path = f"{Path(sys.executable).parent}:{ENVIRONMENT['PATH']}"
    printed = play(played[:flies], tmp_path, {"PATH": path})
    assert printed.count("DO NOT FLY") == 2  # the verdict is repeated
    (refused,) = re.findall(r"• (passive_safety: requires .*)", printed)
    assert refused in PAGE.read_text(encoding="utf-8")
