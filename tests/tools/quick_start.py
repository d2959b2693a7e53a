"""Play docs/quick_start.md from the built wheel in a bare environment: ``make quick-start``.

Every ``sh`` block below a line ``<!-- played -->`` is typed into one shell, line by line.  A
comment ``# exit code N`` states how a command ends; it is 0 where there is none.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import venv
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Final, NamedTuple

ROOT: Final = Path(__file__).parents[2]
PAGE: Final = ROOT / "docs" / "quick_start.md"
_BLOCK: Final = re.compile(r"^<!-- played -->\n```sh\n(.*?)^```", re.MULTILINE | re.DOTALL)
_EXIT_CODE: Final = re.compile(r"\s+# exit code (\d+)$")
# A loaded computer takes several times the two minutes of a quiet one.
_TIMEOUT_S: Final = 900.0
# Of the vehicle's two MAVLink links, and of simulation and daemon on Zenoh.
PORTS: Final = (
    (socket.SOCK_DGRAM, 14540),
    (socket.SOCK_DGRAM, 14550),
    (socket.SOCK_STREAM, 7447),
    (socket.SOCK_STREAM, 7448),
)
# What the build reads.
_BUILT_FROM: Final = (
    "onboard",
    "sitl",
    "gcs_tools",
    "config",
    "pyproject.toml",
    "README.md",
    "LICENSE",
)


class Step(NamedTuple):
    """One command of the page, and how it ends."""

    command: str
    exit_code: int = 0


def steps(page: str) -> list[list[Step]]:
    """Return the commands of each block that is played."""
    return [[_step(line) for line in block.splitlines()] for block in _BLOCK.findall(page)]


def _step(line: str) -> Step:
    stated = _EXIT_CODE.search(line)
    return Step(_EXIT_CODE.sub("", line), 0 if stated is None else int(stated[1]))


def play(played: list[Step], directory: Path, environment: dict[str, str]) -> str:
    """Type commands into one shell; return what they printed.

    What they leave running is ended.

    Raises:
        AssertionError: a command ended otherwise than stated; the message is what was printed.
    """
    lines = []
    for command, exit_code in played:
        lines += [f"echo {_quoted('$ ' + command)}", command]
        if not command.endswith("&"):
            ended = f'{{ echo "ended with $code, expected {exit_code}"; exit 1; }}'
            lines += ["code=$?", f"[ $code -eq {exit_code} ] || {ended}"]
    # Into a file: what runs in the background would keep a pipe open.
    with tempfile.TemporaryFile("w+", encoding="utf-8") as printed:
        shell = subprocess.Popen(
            ["/bin/sh", "-c", "\n".join(lines)],
            stdin=subprocess.DEVNULL, stdout=printed, stderr=subprocess.STDOUT,
            cwd=directory, env=environment, start_new_session=True,
        )  # fmt: skip
        try:
            code = shell.wait(_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            code = None
        finally:
            with suppress(ProcessLookupError):  # no process is left
                os.killpg(shell.pid, signal.SIGTERM)
        printed.seek(0)
        text = printed.read()
    assert code is not None, f"{text}\nthe last command has not ended within {_TIMEOUT_S:g} s"
    assert code == 0, text
    return text


def _quoted(text: str) -> str:
    return "'" + text.replace("'", "'\\''") + "'"


def busy_ports(ports: Iterable[tuple[socket.SocketKind, int]] = PORTS) -> list[str]:
    """Return which ports of the files of ``clearway init`` another program has, in words."""
    busy = []
    for kind, number in ports:
        with socket.socket(socket.AF_INET, kind) as probe:
            # As the processes do: a connection that has just ended does not count.
            if kind == socket.SOCK_STREAM:
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind(("127.0.0.1", number))
            except OSError:
                busy.append(f"{'UDP' if kind == socket.SOCK_DGRAM else 'TCP'} {number}")
    return busy


def _wheel(directory: Path) -> Path:
    """Build the wheel elsewhere than in the checkout: an old build/ could put old files into it."""
    source = directory / "source"
    for name in _BUILT_FROM:
        if (ROOT / name).is_dir():
            ignore = shutil.ignore_patterns("__pycache__")
            shutil.copytree(ROOT / name, source / name, symlinks=True, ignore=ignore)
        else:
            shutil.copy(ROOT / name, source)
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check", "wheel"]
    subprocess.run([*pip, "--no-deps", "--wheel-dir", directory, source], check=True)
    (wheel,) = directory.glob("*.whl")
    return wheel


def main() -> int:
    """Build, install, play; print what the commands printed."""
    if busy := busy_ports():
        sys.stderr.write(
            f"not played: {', '.join(busy)} of this computer in use, expected free: end the daemon "
            "or simulation that runs here\n"
        )
        return 2
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        wheel = _wheel(directory)
        environment = directory / "environment"
        venv.create(environment, with_pip=False)
        pip = [sys.executable, "-m", "pip", "--python", str(environment), "--quiet", "install"]
        pip += ["--no-compile", "--constraint", str(ROOT / "constraints.txt")]
        subprocess.run([*pip, f"{wheel}[ground,sitl]"], check=True)
        home = directory / "home"
        home.mkdir()
        path = f"{environment / 'bin'}:/usr/bin:/bin"
        played = [step for block in steps(PAGE.read_text(encoding="utf-8")) for step in block]
        try:
            sys.stdout.write(play(played, home, {"PATH": path, "HOME": str(home)}))
        except AssertionError as error:
            sys.stdout.write(f"{error}\n")
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
