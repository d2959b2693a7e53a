"""`clearway service install`: the unit, and what keeps it from being written."""

from __future__ import annotations

import getpass
import shlex
import sys
from collections import defaultdict
from pathlib import Path

import pytest

from gcs_tools.service import command
from tests.gcs_tools.running import Clearway

INSTALL = ("service", "install")


def parsed(unit: str) -> dict[str, dict[str, list[str]]]:
    """Read a unit: sections, keys, and the values of each, as systemd.syntax says."""
    sections: dict[str, dict[str, list[str]]] = {}
    for line in unit.splitlines():
        if not line or line.startswith("#"):
            continue
        if line.startswith("["):
            section = sections[line.strip("[]")] = defaultdict(list)
            continue
        key, _, value = line.partition("=")
        section[key].append(value)
    return sections


@pytest.fixture
def folder(clearway: Clearway, tmp_path: Path) -> Path:
    assert clearway("init", tmp_path / "mine").code == 0
    return tmp_path / "mine"


def test_the_unit_keeps_the_daemon_running_and_confined(clearway: Clearway) -> None:
    ran = clearway(
        *INSTALL, "--dry-run", "--user", "pilot", "--daemon-config", "/etc/c/onboard.yaml"
    )
    assert ran.code == 0
    unit = parsed(ran.out)
    service = unit["Service"]
    program, *arguments = shlex.split(service["ExecStart"][0])
    assert Path(program) == Path(sys.executable).parent / "clearway-onboard"
    assert Path(program).is_file()
    assert arguments == ["--config", "/etc/c/onboard.yaml"]
    assert service["User"] == ["pilot"]
    expected = {
        "Type": "notify", "Restart": "always", "WatchdogSec": "2", "LimitRTPRIO": "1",
        "SupplementaryGroups": "dialout", "StateDirectory": "clearway",
        "NoNewPrivileges": "yes", "ProtectSystem": "strict", "CapabilityBoundingSet": "",
        "DevicePolicy": "closed",
    }  # fmt: skip
    assert {key: service[key][0] for key in expected} == expected
    # Real-time priority and netlink are needed: neither may be forbidden.
    assert "RestrictRealtime" not in service
    assert "AF_NETLINK" in service["RestrictAddressFamilies"][0]
    assert unit["Unit"]["StartLimitIntervalSec"] == ["0"]
    assert "time-sync.target" in unit["Unit"]["After"][0]
    assert "Requires" not in unit["Unit"]
    assert unit["Install"]["WantedBy"] == ["multi-user.target"]
    assert "@PROGRAM@" not in ran.out


def test_characters_that_systemd_would_read_are_escaped(clearway: Clearway) -> None:
    ran = clearway(*INSTALL, "--dry-run", "--daemon-config", '/a b/50%/$x/"q".yaml')
    (line,) = parsed(ran.out)["Service"]["ExecStart"]
    assert line.endswith('--config "/a b/50%%/$$x/\\"q\\".yaml"')
    ran = clearway(*INSTALL, "--dry-run", "--daemon-config", "/a\nExecStartPre=/bin/x")
    assert ran.code == 2
    assert "control characters" in ran.err


def test_the_unit_is_written_and_the_next_step_said(
    clearway: Clearway, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(command, "SYSTEMD_RUNS", tmp_path / "nowhere")
    units = tmp_path / "units"
    units.mkdir()
    options = ("--daemon-config", folder / "onboard.yaml", "--unit-directory", units)
    ran = clearway(*INSTALL, *options, "--user", getpass.getuser())
    assert (ran.code, ran.err) == (0, "")
    text = (units / "clearway.service").read_text(encoding="utf-8")
    assert str(folder / "onboard.yaml") in text
    assert "systemctl enable --now clearway" in ran.out


def test_systemd_reads_its_units_again_where_it_runs(
    clearway: Clearway, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    systemctl, said = tmp_path / "systemctl", tmp_path / "said"
    systemctl.write_text(f'#!/bin/sh\necho "$@" >>{said}\n', encoding="utf-8")
    systemctl.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(command, "SYSTEMD_RUNS", tmp_path)
    options = ("--daemon-config", folder / "onboard.yaml", "--unit-directory", tmp_path)
    ran = clearway(*INSTALL, *options, "--user", getpass.getuser())
    assert ran.code == 0, ran
    assert said.read_text(encoding="utf-8") == "daemon-reload\n"
    systemctl.write_text("#!/bin/sh\necho no such bus >&2\nexit 1\n", encoding="utf-8")
    ran = clearway(*INSTALL, *options, "--user", getpass.getuser())
    assert ran.code == 2
    assert "systemctl daemon-reload failed: no such bus" in ran.err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--daemon-config", "nowhere.yaml"), ("nowhere.yaml", "No such file")),
        (("--daemon-config", "contract.yaml"), ("contract.yaml", "not a known key")),
        (("--user", "no-such-user-here"), ("useradd --system --groups dialout",)),
        (("--user", "Robert'; --"), ("--user", "expected a user name")),
        (("--unit-directory", "nowhere"), ("nowhere/clearway.service", "cannot be written")),
    ],
)
def test_a_mistake_is_one_line_and_writes_nothing(
    clearway: Clearway,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    options: tuple[str, str],
    words: tuple[str, ...],
) -> None:
    monkeypatch.chdir(folder)
    chosen = {
        "--daemon-config": "onboard.yaml", "--user": getpass.getuser(), "--unit-directory": ".",
        options[0]: options[1],
    }  # fmt: skip
    ran = clearway(*INSTALL, *(word for pair in chosen.items() for word in pair))
    assert ran.code == 2, ran
    assert ran.err.count("\n") == 1
    for word in words:
        assert word in ran.err
    assert not list(folder.rglob("clearway.service"))
