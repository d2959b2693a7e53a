"""The wheel, and what of it and of its requirements a companion computer gets."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import sysconfig
import tomllib
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.gcs_tools.missions.ground_station import WAYPOINT, north, plan, simple
from tests.onboard.test_daemon import free_port

ROOT = Path(__file__).parents[1]
CONFIG = ROOT / "config"
PACKAGES = ("onboard", "sitl", "gcs_tools")
# What the build reads; files of the packages are links to some in config.
BUILT_FROM = (*PACKAGES, "config", "pyproject.toml", "README.md", "LICENSE")
# Installed without the tests of libraries, as `make companion` does; the limit of what is copied.
COMPANION_MAX_MB = 300.0
# Neither this environment's packages nor this checkout's.
PYTHON = (sys.executable, "-S", "-P")
_SECONDS = 60.0


def requirements_of(name: str) -> dict[str, metadata.Distribution]:
    """Return what a distribution requires without extras, at any depth, and the distribution."""
    found: dict[str, metadata.Distribution] = {}
    queue = [name]
    while queue:
        distribution = metadata.distribution(queue.pop())
        found[canonicalize_name(distribution.name)] = distribution
        wanted = map(Requirement, distribution.requires or [])
        queue += [
            each.name
            for each in wanted
            if (each.marker is None or each.marker.evaluate({"extra": ""}))
            and canonicalize_name(each.name) not in found
        ]
    return found


def files_of(distribution: metadata.Distribution) -> Iterator[Path]:
    for file in distribution.files or []:
        path = Path(str(file.locate()))
        if path.suffix != ".pyc" and path.is_file():
            yield path


@pytest.fixture(scope="module")
def requirements() -> dict[str, metadata.Distribution]:
    found = requirements_of("clearway")
    del found["clearway"]
    return found


@pytest.fixture(scope="module")
def sdist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the source distribution elsewhere: an old build/ could put old files into it."""
    source = tmp_path_factory.mktemp("source")
    ignore = shutil.ignore_patterns("__pycache__")
    for name in BUILT_FROM:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, source / name, symlinks=True, ignore=ignore)
        else:
            shutil.copy(ROOT / name, source)
    out = tmp_path_factory.mktemp("sdist")
    build = [sys.executable, "-m", "build", "--sdist", "--outdir", str(out), str(source)]
    subprocess.run(build, check=True, capture_output=True)
    (archive,) = out.iterdir()
    return archive


@pytest.fixture(scope="module")
def wheel(sdist: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Install the wheel of the source distribution, and nothing else, into a directory."""
    site = tmp_path_factory.mktemp("wheel") / "site"
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "install", "--no-deps"]
    subprocess.run([*pip, "--no-compile", "--target", site, sdist], check=True, capture_output=True)
    return site


@pytest.fixture(scope="module")
def ground(wheel: Path) -> dict[str, str]:
    """Return an environment that has the wheel and what the extras install, not this checkout."""
    # A directory on PYTHONPATH gets no .pth file read, so an editable install stays out.
    site = sysconfig.get_paths()["purelib"]
    return {"PYTHONPATH": os.pathsep.join((str(wheel), site)), "PYTHONDONTWRITEBYTECODE": "1"}


@pytest.fixture(scope="module")
def companion(
    wheel: Path,
    requirements: dict[str, metadata.Distribution],
    tmp_path_factory: pytest.TempPathFactory,
) -> dict[str, str]:
    """Return an environment that has the wheel and what it requires without extras, linked."""
    site = tmp_path_factory.mktemp("companion")
    for distribution in requirements.values():
        root = Path(str(distribution.locate_file("")))
        tops = {path.relative_to(root).parts[0] for path in files_of(distribution)
                if path.is_relative_to(root)}  # fmt: skip
        for top in tops - {"__pycache__"}:
            link = site / top
            if not link.exists():
                link.symlink_to(root / top)
    return {"PYTHONPATH": os.pathsep.join(map(str, (wheel, site))), "PYTHONDONTWRITEBYTECODE": "1"}


def python(
    environment: dict[str, str], *arguments: str, cwd: Path | None = None
) -> subprocess.CompletedProcess[str]:
    """Run Python without the packages of this environment."""
    return subprocess.run(
        [*PYTHON, *arguments],
        env=environment,
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=_SECONDS,
        check=False,
    )


def test_the_wheel_has_every_file_of_the_packages(wheel: Path) -> None:
    def contents(root: Path) -> set[str]:
        paths = (path for package in PACKAGES for path in (root / package).rglob("*"))
        return {
            str(path.relative_to(root))
            for path in paths
            if path.is_file() and "__pycache__" not in path.parts
        }

    packed = contents(wheel)
    assert packed == contents(ROOT)
    assert "onboard/contract/THEORY.md" in packed
    assert "gcs_tools/fly/example/paper_contract.yaml" in packed
    assert not [path for path in wheel.rglob("*") if path.is_symlink()]
    assert {f"{package}/py.typed" for package in PACKAGES} <= packed


def test_the_wheel_has_its_commands_and_its_licence(wheel: Path) -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    (installed,) = metadata.distributions(path=[str(wheel)])
    scripts = {point.name: point.value for point in installed.entry_points}
    assert scripts == settings["project"]["scripts"]
    assert all((wheel / "bin" / name).is_file() for name in scripts)
    assert any(file.name == "LICENSE" for file in installed.files or [])


def test_the_companion_gets_nothing_of_the_ground(
    requirements: dict[str, metadata.Distribution], companion: dict[str, str]
) -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    extras = settings["project"]["optional-dependencies"]
    ground = {
        canonicalize_name(Requirement(each).name) for each in (*extras["ground"], *extras["sitl"])
    }
    assert "mavsdk" in ground
    assert not (ground - {"jinja2"}) & requirements.keys()  # OSQP itself depends on Jinja
    done = python(companion, "-c", "import mavsdk")
    assert "No module named 'mavsdk'" in done.stderr


def test_what_the_companion_gets_is_small(requirements: dict[str, metadata.Distribution]) -> None:
    sizes_mb = {
        name: sum(path.stat().st_size for path in files_of(each) if "tests" not in path.parts)
        / 2**20
        for name, each in requirements.items()
    }
    assert sum(sizes_mb.values()) < COMPANION_MAX_MB, sizes_mb


@pytest.mark.parametrize("package", ["onboard", "sitl"])
def test_a_package_starts_from_the_wheel_without_extras(
    companion: dict[str, str], package: str
) -> None:
    done = python(companion, "-m", package, "--help")
    assert done.returncode == 0, done.stderr
    assert "--config" in done.stdout


def test_sensors_are_checked_without_any_package_of_the_ground(
    companion: dict[str, str], tmp_path: Path
) -> None:
    settings = {
        "contract": "c.yaml",
        "mission": "m.yaml",
        "mavlink": {"url": "udpout://127.0.0.1:9"},
        "zenoh": {"listen": [f"tcp/127.0.0.1:{free_port()}"]},
    }
    path = tmp_path / "onboard.yaml"
    path.write_text(yaml.safe_dump(settings), encoding="utf-8")
    done = python(companion, "-m", "gcs_tools", "sensor", "check", str(path), "--for", "0.1")
    assert (done.returncode, done.stderr) == (1, "")
    assert "NOTHING  JSON detections" in done.stdout


def test_the_daemon_serves_without_any_package_of_the_ground(
    companion: dict[str, str], tmp_path: Path
) -> None:
    settings = yaml.safe_load((CONFIG / "onboard.yaml").read_text(encoding="utf-8"))
    settings |= {
        "contract": str(CONFIG / settings["contract"]),
        "mission": str(CONFIG / settings["mission"]),
        "mavlink": {"url": "udpout://127.0.0.1:9"},
        "zenoh": {"listen": [f"tcp/127.0.0.1:{free_port()}"]},
        "log_directory": str(tmp_path),
    }
    path = tmp_path / "onboard.yaml"
    path.write_text(yaml.safe_dump(settings), encoding="utf-8")
    daemon = subprocess.Popen(
        [*PYTHON, "-m", "onboard", "--config", path],
        env=companion,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert daemon.stderr is not None
        said = ""
        while "ready: " not in said:
            line = daemon.stderr.readline()
            assert line, said
            said += line
        daemon.send_signal(signal.SIGTERM)
        assert daemon.wait(_SECONDS) == 0
    finally:
        daemon.kill()
        daemon.communicate()
    assert list(tmp_path.glob("flight-*.mcap"))


def test_a_folder_is_written_and_checked_with_the_wheel_alone(
    ground: dict[str, str], tmp_path: Path
) -> None:
    clearway = ("-m", "gcs_tools")
    done = python(ground, *clearway, "init", "mine", "--vehicle", "ardupilot", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    files = ("--contract", "contract.yaml", "--field", "field.yaml", "--mission", "mission.yaml")
    done = python(ground, *clearway, "preflight", *files, cwd=tmp_path / "mine")
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_default_flight_is_in_the_wheel(
    ground: dict[str, str], wheel: Path, tmp_path: Path
) -> None:
    """Flown by `clearway fly` without a file, from any folder."""
    program = (
        "from gcs_tools.fly.command import DEFAULT_SCENARIO\n"
        "from gcs_tools.scenario import load_scenario\n"
        "print(DEFAULT_SCENARIO, len(load_scenario(DEFAULT_SCENARIO).obstacles))"
    )
    done = python(ground, "-c", program, cwd=tmp_path)
    assert done.stdout == f"{wheel / 'gcs_tools/fly/example/paper.yaml'} 3\n", done.stderr


def test_what_the_companion_needs_runs_there(companion: dict[str, str], tmp_path: Path) -> None:
    document = plan(simple(WAYPOINT, *north(1.0)))
    (tmp_path / "a.plan").write_text(json.dumps(document), encoding="utf-8")
    (tmp_path / "trees.csv").write_text("x_m,y_m,dbh_cm\n1,2,30\n", encoding="utf-8")
    files = {"contract": "contract", "field": "field", "mission": "mission"}
    checked = [word for key, name in files.items() for word in (f"--{key}", f"mine/{name}.yaml")]
    commands = {
        ("init", "mine"): 0,
        ("service", "install", "--dry-run"): 0,
        ("mission", "import", "a.plan", "-o", "mission.yaml"): 0,
        ("mission", "stems", "trees.csv", "-o", "field.csv"): 0,
        ("doctor", "--daemon-config", "mine/onboard.yaml"): 2,  # no daemon runs
        ("contract", "show", "--contract", "mine/contract.yaml"): 0,
        ("preflight", *checked, "--daemon-config", "mine/onboard.yaml"): 0,
    }
    for arguments, code in commands.items():
        done = python(companion, "-m", "gcs_tools", *arguments, cwd=tmp_path)
        assert done.returncode == code, done.stderr
        assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    "arguments",
    [
        ("preflight", "--contract", "contract.yaml", "--field", "field.yaml", "--picture", "a.png"),
        ("preflight", "--contract", "contract.yaml", "--vehicle", "udpin://127.0.0.1:14550"),
    ],
)
def test_what_needs_the_ground_names_it_in_one_line(
    companion: dict[str, str], arguments: tuple[str, ...]
) -> None:
    files = ROOT / "gcs_tools" / "setup" / "files" / "px4"
    done = python(companion, "-m", "gcs_tools", *arguments, cwd=files)
    assert done.returncode == 2
    assert re.fullmatch(
        r"clearway: error: \w+ is not installed: pip install 'clearway\[ground\]'\n", done.stderr
    )
