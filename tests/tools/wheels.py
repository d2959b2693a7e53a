"""Check that wheels of every dependency exist: ``python -m tests.tools.wheels``.

For each supported CPython, on x86-64 and on aarch64 (Raspberry Pi, Jetson), pip resolves what the
daemon requires, at the versions of constraints.txt and from wheels alone, and installs nothing.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path
from typing import Any, Final

ROOT: Final = Path(__file__).parents[2]
# Raspberry Pi OS and Ubuntu of 2021 and later have at least glibc 2.31.
_GLIBC: Final = ("_2_31", "_2_28", "_2_27", "_2_24", "_2_17", "2014")
PLATFORMS: Final = {
    machine: tuple(f"manylinux{glibc}_{machine}" for glibc in _GLIBC)
    for machine in ("x86_64", "aarch64")
}
_VERSION: Final = re.compile(r"Programming Language :: Python :: (3\.\d+)")


def project() -> dict[str, Any]:
    """Return the table ``project`` of pyproject.toml."""
    document = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    table: dict[str, Any] = document["project"]
    return table


def supported() -> list[str]:
    """Return the versions of CPython that the package states."""
    return _VERSION.findall("\n".join(project()["classifiers"]))


def command(version: str, machine: str, target: str) -> list[str]:
    """Return pip's command that resolves the daemon's requirements for another computer."""
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet", "install"]
    pip += ["--dry-run", "--ignore-installed", "--target", target, "--only-binary", ":all:"]
    pip += ["--implementation", "cp", "--python-version", version]
    pip += ["--constraint", str(ROOT / "constraints.txt")]
    pip += [f"--platform={platform}" for platform in PLATFORMS[machine]]
    return [*pip, *project()["dependencies"]]


def verdict(done: subprocess.CompletedProcess[str]) -> str:
    """Return what pip found, in one line."""
    if done.returncode == 0:
        return "every wheel exists"
    errors = [line for line in done.stderr.splitlines() if line.startswith("ERROR: ")]
    return (errors or ["pip failed"])[-1]


def main() -> int:
    """Check every version on every machine; return 1 if a wheel is missing."""
    missing = False
    with tempfile.TemporaryDirectory() as target:
        for version in supported():
            for machine in PLATFORMS:
                done = subprocess.run(
                    command(version, machine, target), capture_output=True, text=True, check=False
                )
                missing |= done.returncode != 0
                sys.stdout.write(f"CPython {version}, {machine}: {verdict(done)}\n")
    return int(missing)


if __name__ == "__main__":
    sys.exit(main())
