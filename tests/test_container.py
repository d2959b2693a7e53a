"""The container file, without a builder: its steps are those that the companion's tests play.

What `tests/test_packaging.py` runs from the wheel without extras is what the image holds.
"""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

from onboard.__main__ import main
from tests.tools.wheels import project, supported

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "Containerfile").read_text(encoding="utf-8")
KNOWN = {
    "FROM", "COPY", "RUN", "USER", "VOLUME", "ENV", "WORKDIR", "STOPSIGNAL", "ENTRYPOINT", "CMD",
}  # fmt: skip


def instructions() -> list[tuple[str, str]]:
    """Return keyword and argument of each instruction, lines joined and comments left out."""
    lines = [line for line in TEXT.splitlines() if not line.lstrip().startswith("#")]
    joined = re.sub(r"\\\n", " ", "\n".join(lines))
    return [
        (word, " ".join(rest.split()))
        for word, _, rest in (line.partition(" ") for line in joined.splitlines() if line.strip())
    ]


def arguments(keyword: str) -> list[str]:
    return [rest for word, rest in instructions() if word == keyword]


def test_it_is_made_of_known_instructions_in_two_stages() -> None:
    assert {word for word, _ in instructions()} == KNOWN
    first, second = arguments("FROM")
    assert first == f"{second} AS build"
    (copied,) = [each for each in arguments("COPY") if each.startswith("--from=")]
    assert copied.split()[0] == "--from=build"
    # A name that is the same for every machine: the builder takes the image of its own.
    image, version = re.fullmatch(r"(docker\.io/library/python):(3\.\d+)-slim-\w+", second).groups()  # type: ignore[union-attr]
    assert image == "docker.io/library/python"
    assert version in supported()


def test_it_runs_as_a_user_without_rights_who_may_write_its_state_only() -> None:
    (user,) = arguments("USER")
    assert user.isdecimal()
    assert int(user) > 0
    words = [word for word, _ in instructions()]
    assert words.index("USER") > max(n for n, word in enumerate(words) if word == "RUN")
    made = arguments("RUN")[-1]
    assert f"--uid {user} " in made
    assert "--groups dialout" in made
    assert "install --directory --owner clearway" in made
    state = "/var/lib/clearway"
    assert f"STATE_DIRECTORY={state}" in arguments("ENV")[0].split()
    assert json.loads(arguments("VOLUME")[0]) == ["/etc/clearway", state]


def test_it_installs_the_daemon_with_its_metrics_and_nothing_of_the_ground() -> None:
    steps = [shlex.split(step) for step in arguments("RUN")[0].split(" && ")]
    installed = [step for step in steps if "/source[metrics]" in step]
    assert len(installed) == 1
    assert installed[0][-5:] == [
        "--constraint", "/source/constraints.txt", "--only-binary", ":all:", "/source[metrics]",
    ]  # fmt: skip
    assert "metrics" in project()["optional-dependencies"]
    assert not [word for step in steps for word in step if "ground" in word or "sitl" in word]
    # As `make companion`, which the index's wheels and the companion's tests stand for.
    companion = (ROOT / "Makefile").read_text("utf-8").partition("\ncompanion:")[2]
    for kept in ("-type d -name tests -prune", "site-packages/pymavlink/dialects/v10"):
        assert kept in companion
        assert kept in arguments("RUN")[0]


def test_its_command_is_one_that_the_daemon_takes(capsys: object) -> None:
    (entry,), (command,) = arguments("ENTRYPOINT"), arguments("CMD")
    assert json.loads(entry) == ["clearway-onboard"]
    assert project()["scripts"]["clearway-onboard"] == "onboard.__main__:main"
    option, path = json.loads(command)
    assert (option, path) == ("--config", "/etc/clearway/onboard.yaml")
    assert main([option, str(ROOT / "missing.yaml")]) == 2


def test_what_is_sent_to_the_builder_leaves_out_caches_and_logs() -> None:
    ignored = (ROOT / ".containerignore").read_text("utf-8").split()
    assert {".*", "build", "flights"} <= set(ignored)
