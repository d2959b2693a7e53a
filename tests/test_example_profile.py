"""The autopilot profile of examples/own_autopilot_profile.py is one that the service flies."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
PROGRAM = ROOT / "examples" / "own_autopilot_profile.py"


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, PROGRAM, *arguments],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=60.0,
        check=False,
    )


def test_the_registered_profile_decides_which_mode_is_flown() -> None:
    done = run()
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [
        "without it: unknown autopilot",
        "Example autopilot: MANUAL, the service does not fly it",
        "Example autopilot: HOVER, the service does not fly it",
        "Example autopilot: FOLLOW, the service may fly it",
    ]


def test_the_daemon_runs_with_the_profile() -> None:
    done = run("--help")
    assert done.returncode == 0, done.stderr
    assert "--config" in done.stdout


def test_the_daemon_refuses_bad_files_as_ever(tmp_path: Path) -> None:
    done = run("--config", str(tmp_path / "absent.yaml"))
    assert done.returncode == 2
    assert "absent.yaml" in done.stderr
