"""Every file that any command reads, in every condition that a file can be in: one line, exit 2."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from onboard.__main__ import main as onboard_main
from sitl.__main__ import main as sitl_main
from tests.gcs_tools.running import CONFIG, Clearway

CONTRACT = ("--contract", CONFIG / "default_contract.yaml")

COMMANDS: dict[str, Callable[[Path], tuple[object, ...]]] = {
    "show": lambda path: ("contract", "show", "--contract", path),
    "solve": lambda path: (
        "contract", "solve", "--contract", path, "--for", "vehicle.cruise_speed_mps",
    ),
    "surface": lambda path: ("contract", "surface", "--contract", path, "--figure", "11"),
    "preflight": lambda path: ("preflight", "--contract", path),
    "field": lambda path: ("preflight", *CONTRACT, "--field", path),
    "stems": lambda path: ("preflight", *CONTRACT, "--field", path.with_suffix(".csv")),
    "mission": lambda path: ("preflight", *CONTRACT, "--mission", path),
    "bus": lambda path: ("preflight", *CONTRACT, "--zenoh-config", path),
    "fly": lambda path: ("fly", path),
    "fly virtual": lambda path: ("fly", path, "--virtual"),
    "campaign": lambda path: ("campaign", path, "--flights", "1", "--jobs", "1"),
    "campaign stems": lambda path: (
        "campaign", path.with_suffix(".csv"), "--flights", "1", "--jobs", "1",
    ),
    "benchmark pillars": lambda path: ("benchmark", "sando", "--data", path, "--jobs", "1"),
    "benchmark boxes": lambda path: ("benchmark", "competition", "--data", path, "--jobs", "1"),
    "report": lambda path: ("report", path.with_suffix(".mcap")),
    "identify mcap": lambda path: ("identify", path.with_suffix(".mcap")),
    "identify ulg": lambda path: ("identify", path.with_suffix(".ulg")),
    "identify tlog": lambda path: ("identify", path.with_suffix(".tlog")),
    "import": lambda path: ("mission", "import", path.with_suffix(".plan")),
    "import stems": lambda path: ("mission", "stems", path.with_suffix(".csv")),
    "fleet": lambda path: ("fleet", "check", path),
    "geofence": lambda path: (
        "preflight", *CONTRACT, "--mission", CONFIG / "default_mission.yaml", "--geofence", path,
    ),
    "doctor": lambda path: ("doctor", "--daemon-config", path),
    "service": lambda path: ("service", "install", "--daemon-config", path),
    "watch": lambda path: ("watch", "--zenoh-config", path),
    "watch daemon": lambda path: ("watch", "--daemon-config", path),
}  # fmt: skip

CONTENTS = {
    "empty": b"",
    "one byte": b"\0",
    "binary": b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + bytes(range(256)),
    "utf-16": "vehicle: {}\n".encode("utf-16"),
    "words": b"this is not one of our files\n",
    "number": b"1e3\n",
    "list": b"- 1\n- 2\n",
    "bad date": b"a: 2026-13-45\n",
    "list as key": b"? [a, b]\n: 1\n",
    "deep": b"[" * 1000 + b"]" * 1000,
    "laughs": b"a: &a [1, 1]\nb: &b [*a, *a]\nc: [*b, *c]\n",
    "another's keys": b"apiVersion: v1\nkind: Pod\n",
    "git lfs": b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 1\n",
}


def written(directory: Path, kind: str, suffixes: tuple[str, ...]) -> Path:
    """Leave files of a kind under every suffix that a command may read; return one's path."""
    for suffix in suffixes:
        path = directory / f"file{suffix}"
        if kind == "directory":
            path.mkdir()
        elif kind != "missing":
            path.write_bytes(CONTENTS[kind])
    return directory / "file.yaml"


SUFFIXES = (".yaml", ".csv", ".mcap", ".ulg", ".tlog", ".plan")


@pytest.mark.parametrize("kind", ["missing", "directory", *CONTENTS])
@pytest.mark.parametrize("command", COMMANDS)
def test_a_file_that_cannot_be_used_is_one_line(
    clearway: Clearway, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str, kind: str
) -> None:
    monkeypatch.chdir(tmp_path)
    ran = clearway(*COMMANDS[command](written(tmp_path, kind, SUFFIXES)))
    assert ran.code == 2, ran
    assert ran.err.startswith("clearway: error: "), ran.err
    assert ran.err.count("\n") == 1, ran.err
    assert str(tmp_path / "file") in ran.err, ran.err
    assert len(ran.err) < 1000, ran.err


@pytest.mark.parametrize("kind", ["missing", "directory", *CONTENTS])
@pytest.mark.parametrize(
    ("main", "name"), [(onboard_main, "clearway-onboard"), (sitl_main, "clearway-sitl")]
)
def test_a_process_refuses_such_a_file_too(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    main: Callable[[list[str]], int],
    name: str,
    kind: str,
) -> None:
    path = written(tmp_path, kind, (".yaml",))
    assert main(["--config", str(path)]) == 2
    err = capsys.readouterr().err
    assert err.startswith(f"{name}: error: "), err
    assert err.count("\n") == 1, err
    assert str(path) in err


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        *[
            (("fly", "--seed", text), "--seed")
            for text in ("abc", "-1", "1.5", "", "9" * 30, "\u0661")
        ],
        *[(("campaign", "quick", "--seed", text), "--seed") for text in ("abc", "-1", "1e3")],
        *[(("campaign", "quick", "--flights", text), "--flights") for text in ("-1", "many", "")],
        *[(("campaign", "quick", "--jobs", text), "--jobs") for text in ("0", "-1", "all")],
        *[(("campaign", "quick", "--only", text), "--only") for text in ("-1", "first")],
        *[(("campaign", "quick", "--shrink", text), "--shrink") for text in ("-1", "yes")],
        *[(("watch", "--port", text), "--port") for text in ("80000", "-1", "http", "65536")],
        *[(("identify", "x", "--margin", text), "--margin") for text in ("0", "-1", "nan", "inf")],
        *[
            (("preflight", *CONTRACT, "--endurance", text), "--endurance")
            for text in ("0", "-5", "nan", "15 min")
        ],
        *[
            (("preflight", *CONTRACT, "--authorize", text), "--authorize")
            for text in ("0", "inf", "yes")
        ],
        (("campaign", "quick", "--jobs", "1", "--dask", "tcp://h:1"), "--dask"),
        (("campaign", "no-such-set"), "no-such-set"),
        (("contract", "solve", *CONTRACT, "--for", "vehicle.colour"), "vehicle.colour"),
        (("contract", "surface", *CONTRACT, "--x", "vehicle.cruise_speed_mps"), "--x"),
        (("contract", "surface", *CONTRACT, "--figure", "14"), "--figure"),
        (("contract", "surface", *CONTRACT, "--figure", "11", "--plot", "a.xyz"), "a.xyz"),
        (("preflight", *CONTRACT, "--picture", "field.png"), "--field"),
        (("watch", "--host", "no-such-host.invalid"), "no-such-host.invalid"),
        (("watch", "--host", "a..b"), "a..b"),
    ],
)
def test_a_bad_value_is_one_line(
    clearway: Clearway,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: tuple[object, ...],
    word: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    ran = clearway(*arguments)
    assert ran.code == 2, ran
    assert ran.err.startswith("clearway: error: "), ran.err
    assert ran.err.count("\n") == 1, ran.err
    assert word in ran.err, ran.err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "arguments",
    [
        ("fly", "--virtual", "--out", "PLACE"),
        ("campaign", "quick", "--flights", "1", "--jobs", "1", "--out", "PLACE"),
        ("schema", "-o", "PLACE"),
        ("contract", "show", *CONTRACT, "-o", "PLACE/x.json"),
        ("contract", "solve", *CONTRACT, "--for", "vehicle.radius_m", "-o", "PLACE/x"),
        ("contract", "surface", *CONTRACT, "--figure", "11", "-o", "PLACE/x"),
        ("preflight", *CONTRACT, "-o", "PLACE/x"),
    ],
)
def test_a_file_in_the_place_of_a_directory_is_one_line(
    clearway: Clearway, tmp_path: Path, arguments: tuple[object, ...]
) -> None:
    place = tmp_path / "occupied"
    place.write_text("mine")
    ran = clearway(*(str(each).replace("PLACE", str(place)) for each in arguments))
    assert ran.code == 2, ran
    assert ran.err.count("\n") == 1, ran.err
    assert str(place) in ran.err
    assert "cannot be written" in ran.err
    assert place.read_text() == "mine"
