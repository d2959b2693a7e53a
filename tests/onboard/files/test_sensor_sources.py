"""The `sources` of a daemon's file: three lines suffice; an error names file, key, value, unit."""

import re
from pathlib import Path
from typing import Any, get_args

import pytest
import yaml

from onboard.files.daemon_config import DaemonConfig
from onboard.files.sensor_sources import AnySource, LaserScanSource, OccupancyGridSource
from onboard.files.yaml_file import FileError, load_yaml

ROOT = Path(__file__).parents[3]
THREE_LINES = """
sources:
- {kind: laserscan, name: lidar, topic: /scan, range_m: 12.0, uncertainty_m: 0.05}
- {kind: obstacle_distance, name: proximity, range_m: 6.0, uncertainty_m: 0.2}
"""
LIDAR: dict[str, Any] = {
    "kind": "laserscan",
    "name": "lidar",
    "topic": "/scan",
    "range_m": 12.0,
    "uncertainty_m": 0.05,
}


def load(tmp_path: Path, text: str) -> DaemonConfig:
    path = tmp_path / "d.yaml"
    path.write_text("contract: c.yaml\nmission: m.yaml\n" + text)
    return load_yaml(path, DaemonConfig)


def error(tmp_path: Path, *sources: dict[str, Any]) -> str:
    with pytest.raises(FileError) as caught:
        load(tmp_path, yaml.safe_dump({"sources": list(sources)}))
    return str(caught.value)


def test_three_lines_suffice(tmp_path: Path) -> None:
    lidar, proximity = load(tmp_path, THREE_LINES).sources
    assert isinstance(lidar, LaserScanSource)
    assert (lidar.middleware, lidar.domain_id, lidar.no_return_is_free_to_m) == (
        "rmw_zenoh",
        0,
        None,
    )
    assert (lidar.points_min, proximity.points_min) == (2, 1)


@pytest.mark.parametrize(
    "mounting", [{}, {"x_m": 0.1}, {"tf_topic": "/tf_static", "base_frame": "base"}]
)
def test_what_was_read_can_be_written_with_its_defaults_and_read_again(
    tmp_path: Path, mounting: dict[str, Any]
) -> None:
    config = load(tmp_path, yaml.safe_dump({"sources": [LIDAR | {"mounting": mounting}]}))
    assert DaemonConfig.model_validate(config.model_dump(mode="json")) == config


def test_no_sources_is_the_default(tmp_path: Path) -> None:
    assert load(tmp_path, "").sources == ()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"range_m": -1.0}, "range_m [m] = -1.0"),
        ({"range_m": "12"}, "range_m [m] = '12'"),
        ({"uncertainty_m": 11.0}, "uncertainty_m [m] = 11.0"),
        ({"topic": "/scan/*"}, "topic = '/scan/*'"),
        ({"topic": "scan**"}, "topic = 'scan**'"),
        ({"name": "front lidar"}, "name = 'front lidar'"),
        ({"mounting": {"yaw": 3.0}}, "mounting.yaw is not a known key"),
        ({"mounting": {"yaw_deg": 400.0}}, "mounting.yaw_deg [°] = 400.0"),
        ({"no_return_is_free_to_m": 13.0}, "no_return_is_free_to_m 13 m is more than range_m 12 m"),
        ({"blind_sectors_deg": [[10.0]]}, "blind_sectors_deg"),
        ({"domain_id": 233}, "domain_id = 233"),
        ({"middleware": "dds"}, "middleware = 'dds'"),
        ({"view_deg": [90.0, 60.0]}, "view_deg [°] is not a known key"),
        ({"kind": "sonar"}, "sources.0"),
    ],
)
def test_an_error_names_file_key_value_and_unit(
    tmp_path: Path, change: dict[str, Any], said: str
) -> None:
    message = error(tmp_path, LIDAR | change)
    assert "d.yaml: sources.0" in message
    assert said in message
    assert "\n" not in message


def test_what_must_be_stated_is_named(tmp_path: Path) -> None:
    for key in ("name", "topic", "range_m", "uncertainty_m", "kind"):
        left = {name: value for name, value in LIDAR.items() if name != key}
        assert key in error(tmp_path, left)


def test_each_sensor_has_a_name_of_its_own(tmp_path: Path) -> None:
    assert "2 sensors are called 'lidar'" in error(tmp_path, LIDAR, LIDAR | {"topic": "/other"})


def test_a_grid_says_in_which_frame_it_is() -> None:
    keys = LIDAR | {"kind": "occupancygrid", "grid_frame": "local_enu"}
    assert OccupancyGridSource.model_validate(keys).grid_frame == "local_enu"


def test_the_page_names_every_kind_and_key_and_its_example_loads(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "sensors.md").read_text(encoding="utf-8")
    example, *_ = re.findall(r"^```yaml\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    assert len(load(tmp_path, example).sources) == 2
    models = get_args(get_args(AnySource)[0])
    assert len(models) == 10
    for model in models:
        for key in model.model_fields:
            assert f"`{key}" in page or f"{key}:" in page, key


def test_the_lines_of_the_shipped_file_load(tmp_path: Path) -> None:
    shipped = (ROOT / "config" / "onboard.yaml").read_text(encoding="utf-8")
    lines = [line.removeprefix("# ") for line in shipped.splitlines()]
    begin = lines.index("sources:")
    (lidar,) = load(tmp_path, "\n".join(lines[begin : begin + 2])).sources
    assert isinstance(lidar, LaserScanSource)
