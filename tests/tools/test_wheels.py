"""Which Python versions are stated, and how pip is asked for wheels of another computer."""

import subprocess
import sys

import pytest

from tests.tools.wheels import PLATFORMS, command, project, supported, verdict


def test_the_versions_that_are_stated_include_this_one() -> None:
    assert supported() == ["3.11", "3.12", "3.13"]
    assert f"{sys.version_info.major}.{sys.version_info.minor}" in supported()
    assert project()["requires-python"] == f">={supported()[0]}"


def test_pip_resolves_the_daemons_requirements_from_wheels_and_installs_nothing() -> None:
    asked = command("3.12", "aarch64", "target")
    assert {"--dry-run", "--only-binary", "--constraint"} <= set(asked)
    assert asked[asked.index("--python-version") + 1] == "3.12"
    assert [each for each in asked if each.startswith("--platform")] == [
        f"--platform={platform}" for platform in PLATFORMS["aarch64"]
    ]
    assert set(project()["dependencies"]) <= set(asked)


@pytest.mark.parametrize(
    ("code", "stderr", "said"),
    [
        (0, "WARNING: an old index", "every wheel exists"),
        (1, "WARNING: x\nERROR: No matching distribution found for osqp", "for osqp"),
        (1, "", "pip failed"),
    ],
)
def test_what_is_missing_is_said_in_one_line(code: int, stderr: str, said: str) -> None:
    done = subprocess.CompletedProcess([], code, "", stderr)
    assert verdict(done).endswith(said)
