"""A command whose output is closed, full or of another alphabet never answers another question."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import IO, Any

import pytest

from tests.gcs_tools.running import CONFIG, Clearway

# Complies: exit code 0 means "may fly", 1 that it may not.
PREFLIGHT = ("preflight", "--contract", str(CONFIG / "paper_contract.yaml"))
SHOW = ("contract", "show", "--contract", str(CONFIG / "default_contract.yaml"))
SCRIPT = "import sys; from gcs_tools.__main__ import main; sys.exit(main())"


def run(
    *arguments: str,
    stdout: IO[Any] | int = subprocess.PIPE,
    encoding: str = "utf-8",
    redirected: str = "",
) -> subprocess.CompletedProcess[bytes]:
    command = [sys.executable, "-c", SCRIPT, *arguments]
    if redirected:
        command = ["sh", "-c", f'exec "$@" {redirected}', "sh", *command]
    return subprocess.run(
        command,
        stdout=stdout,
        stderr=subprocess.PIPE,
        env={**os.environ, "PYTHONIOENCODING": encoding},
        timeout=60.0,
        check=False,
    )


def test_a_closed_pipe_is_neither_yes_nor_no() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    done = run(*PREFLIGHT, stdout=writing)
    os.close(writing)
    assert (done.returncode, done.stderr) == (141, b"")


@pytest.mark.parametrize(
    ("redirected", "reason"),
    [(">/dev/full", "No space left on device"), (">&-", "Bad file descriptor")],
)
def test_output_that_cannot_be_written_is_one_line(redirected: str, reason: str) -> None:
    done = run(*PREFLIGHT, redirected=redirected)
    expected = f"clearway: error: standard output: cannot be used: {reason}\n"
    assert (done.returncode, done.stderr.decode()) == (2, expected)


def test_no_output_is_needed_where_none_is_written(tmp_path: Path) -> None:
    done = run(*PREFLIGHT, "-o", str(tmp_path / "verdict.txt"), redirected=">&- 2>&-")
    assert done.returncode == 0
    assert "PROGRESS GUARANTEED" in (tmp_path / "verdict.txt").read_text(encoding="utf-8")


def test_a_full_disk_under_a_file_is_one_line(clearway: Clearway) -> None:
    ran = clearway(*PREFLIGHT, "-o", "/dev/full")
    assert ran.code == 2
    assert ran.err == "clearway: error: /dev/full: cannot be written: No space left on device\n"


def test_what_cannot_be_encoded_is_replaced(clearway: Clearway) -> None:
    done, plain = run(*PREFLIGHT, encoding="latin-1"), clearway(*PREFLIGHT)
    assert (done.returncode, done.stderr) == (0, b"")
    expected = plain.out.encode("latin-1", "replace")
    assert expected.decode("latin-1") != plain.out
    assert done.stdout == expected


def test_json_stays_json_in_any_encoding(clearway: Clearway) -> None:
    done = run(*SHOW, "--format", "json", encoding="ascii")
    assert done.returncode == 0
    plain = clearway(*SHOW, "--format", "json").out
    assert not plain.isascii()
    assert json.loads(done.stdout.decode("ascii")) == json.loads(plain)
