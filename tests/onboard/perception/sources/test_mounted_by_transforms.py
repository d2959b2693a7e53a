"""A sensor mounted by static transforms: unheard before they are known, refused if they change."""

import math
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from onboard.perception.intake import Refusal
from onboard.perception.ros2.transform_tree import FRAMES_MAX, TransformTree
from onboard.perception.sources.mounted_by_transforms import MountedByTransforms
from onboard.perception.sources.registry import sensor, transforms_key
from tests.onboard.perception.ros2.encoding import point_cloud, scan_all_round, transforms
from tests.onboard.perception.sources.scenes import EPOCH_UNIX_S, lidar, pose_at, poses_of
from tests.onboard.perception.test_sensor_channels import Bench, source

HALF = math.sqrt(0.5)
BACKWARDS = (0.0, 0.0, 1.0, 0.0)  # 180° about z
# Of a camera: x right, y down, z ahead.
OPTICAL = (-0.5, 0.5, -0.5, 0.5)
TF: dict[str, Any] = {"mounting": {"tf_topic": "/tf_static"}}
TF_KEY = "0/tf_static/tf2_msgs::msg::dds_::TFMessage_/TypeHashNotSupported"
UNKNOWN = "mounting not known yet: no transforms from its frame to base_frame"
CHANGED = "mounting changed since the first transforms"


def mounted(turn: tuple[float, float, float, float] = BACKWARDS, x_m: float = 0.1) -> bytes:
    return transforms(("base_link", "laser", (x_m, 0.05, 0.2), turn))


def scan() -> bytes:
    """Return a scan with a wall of 5 m behind the sensor and free air around."""
    ranges_m = np.full(360, 9.0)
    ranges_m[:20] = ranges_m[-20:] = 5.0
    return scan_all_round(ranges_m, stamp_unix_s=EPOCH_UNIX_S)


def reader(**keys: Any) -> MountedByTransforms:
    found = sensor(lidar(**(TF | keys)), poses_of(pose_at())).input
    assert isinstance(found, MountedByTransforms)
    return found


def test_what_transforms_say_is_what_the_file_would_say() -> None:
    stated = {"x_m": 0.1, "y_m": -0.05, "z_m": -0.2, "yaw_deg": 180.0}
    by_file = sensor(lidar(mounting=stated), poses_of(pose_at())).input
    by_transforms = reader()
    by_transforms.take_transforms(mounted())
    (expected,), (found,) = (each.read(scan(), EPOCH_UNIX_S) for each in (by_file, by_transforms))
    assert len(found.obstacles) == len(expected.obstacles) > 0
    for one, other in zip(found.obstacles, expected.obstacles, strict=True):
        assert one.center_m == pytest.approx(other.center_m, abs=1e-6)
    assert found.obstacles[0].center_m[0] > 4.0  # behind the sensor is ahead of the vehicle
    assert found.free_range_m == pytest.approx(expected.free_range_m, abs=2e-3)


def test_optical_axes_come_from_the_transforms_too() -> None:
    points_m = np.array([(x, y, 4.0) for x in np.linspace(-3, 3, 200) for y in (-0.1, 0.1)])
    cloud = point_cloud(points_m, stamp_unix_s=EPOCH_UNIX_S, frame_id="eye")
    config = source("pointcloud2", axes="optical", **TF)
    camera = sensor(config, poses_of(pose_at())).input
    assert isinstance(camera, MountedByTransforms)
    camera.take_transforms(transforms(("base_link", "eye", (0.2, 0.0, 0.0), OPTICAL)))
    (frame,) = camera.read(cloud, EPOCH_UNIX_S)
    assert min(box.center_m[0] for box in frame.obstacles) == pytest.approx(4.2, abs=0.1)


def test_before_the_transforms_a_sensor_is_not_heard_and_says_why_once() -> None:
    bench = Bench(source("laserscan", "front", middleware="zenoh-bridge-ros2dds", **TF))
    for _ in range(2):
        bench.channels.receive("front", scan(), 0.0)
        assert bench.sources_taken() == []
    assert bench.channels.take_news() == [Refusal("front", UNKNOWN)]
    assert bench.counters.malformed_frames == 2
    bench.channels.receive_transforms("front", mounted())
    bench.channels.receive("front", scan(), 0.1)
    assert bench.sources_taken() == ["front"]


def test_a_mounting_that_changes_is_not_taken_and_blinds_the_sensor() -> None:
    bench = Bench(source("laserscan", "front", middleware="zenoh-bridge-ros2dds", **TF))
    taken: list[list[str]] = []
    # 1 mm is the same; 2 cm is another mounting; the first one again is as before.
    for x_m in (0.1, 0.101, 0.12, 0.1):
        bench.channels.receive_transforms("front", mounted(x_m=x_m))
        bench.channels.receive("front", scan(), 0.0)
        taken.append(bench.sources_taken())
    assert taken == [["front"], ["front"], [], ["front"]]
    assert bench.channels.take_news() == [Refusal("front", CHANGED)]


def test_transforms_of_another_type_hash_or_form_are_refused_by_name() -> None:
    bench = Bench(source("laserscan", "front", **TF))
    bench.channels.receive_transforms("front", mounted(), key=TF_KEY + "x")
    bench.channels.receive_transforms("front", mounted(), key="0/tf_static/std_msgs/String_/x")
    bench.channels.receive_transforms("front", mounted()[:30], key=TF_KEY)
    assert set(bench.channels.take_news()) == {
        Refusal("front", "transforms: unknown hash of the type"),
        Refusal("front", "transforms: another type"),
        Refusal("front", "transforms: sequence longer than the payload"),
    }
    assert bench.counters.malformed_frames == 3


def test_of_many_transforms_between_two_ticks_none_is_lost() -> None:
    """Latched messages all come at once, one of each publisher."""
    bench = Bench(source("laserscan", "front", middleware="zenoh-bridge-ros2dds", **TF))
    bench.channels.receive_transforms("front", mounted())
    for number in range(200):
        other = transforms(("map", f"frame{number}", (0.0, 0.0, 0.0), BACKWARDS))
        bench.channels.receive_transforms("front", other)
    bench.channels.receive("front", scan(), 0.0)
    assert bench.sources_taken() == ["front"]
    assert bench.channels.take_news() == []
    assert bench.counters.dropped_frames == 0


def test_transforms_for_a_sensor_that_its_file_mounts_are_left_alone() -> None:
    bench = Bench(source("laserscan", "front", middleware="zenoh-bridge-ros2dds"))
    bench.channels.receive_transforms("front", mounted(x_m=2.0))
    bench.channels.receive("front", scan(), 0.0)
    assert bench.sources_taken() == ["front"]


def test_the_frame_of_the_messages_is_the_one_that_counts() -> None:
    by_transforms = reader(frame_id="other")
    by_transforms.take_transforms(mounted())
    assert by_transforms.read(scan(), EPOCH_UNIX_S) == ()
    assert by_transforms.refused == {"another frame_id": 1}


def test_a_sensor_far_from_its_base_is_refused() -> None:
    by_transforms = reader()
    by_transforms.take_transforms(mounted(x_m=3.5))
    assert by_transforms.read(scan(), EPOCH_UNIX_S) == ()
    assert by_transforms.refused == {"mounting too far from base_frame": 1}


def test_a_pose_that_is_not_a_rotation_mounts_nothing_and_is_counted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    mirrored = np.diag([1.0, 1.0, -1.0, 1.0])
    monkeypatch.setattr(TransformTree, "pose", lambda *_: mirrored)
    by_transforms = reader()
    by_transforms.take_transforms(mounted())
    assert by_transforms.read(scan(), EPOCH_UNIX_S) == ()
    assert by_transforms.refused == {"mounting not a rotation": 1}


def test_a_full_tree_does_not_hide_a_mounting_that_changed() -> None:
    by_transforms = reader()
    others = [("map", f"frame{k}", (0.0, 0.0, 0.0), BACKWARDS) for k in range(FRAMES_MAX)]
    by_transforms.take_transforms(transforms(*others[:-1]))
    by_transforms.take_transforms(mounted())
    assert len(by_transforms.read(scan(), EPOCH_UNIX_S)) == 1
    # The tree is full: of this message the mounting is taken, and the new frame is not.
    moved = ("base_link", "laser", (2.0, 0.05, 0.2), BACKWARDS)
    by_transforms.take_transforms(transforms(others[-1], moved))
    assert by_transforms.read(scan(), EPOCH_UNIX_S) == ()
    assert by_transforms.refused == {"transforms: too many frames": 1, CHANGED: 1}


def test_the_key_of_the_transforms() -> None:
    assert transforms_key(lidar(**TF)) == "0/tf_static/tf2_msgs::msg::dds_::TFMessage_/**"
    bridged = lidar(middleware="zenoh-bridge-ros2dds", **TF)
    assert transforms_key(bridged) == "tf_static"
    assert transforms_key(lidar()) is None
    assert transforms_key(source("obstacle_distance")) is None


@pytest.mark.parametrize(
    ("kind", "mounting", "words"),
    [
        ("laserscan", {"tf_topic": "/tf_static", "x_m": 0.1}, "tf_topic replaces x_m"),
        ("laserscan", {"base_frame": "body"}, "base_frame needs tf_topic"),
        ("obstacle_distance", {"tf_topic": "/tf_static"}, "name no frame"),
        ("occupancygrid", {"tf_topic": "/tf_static"}, "grid_frame says where"),
    ],
)
def test_mountings_that_contradict_are_refused(kind: str, mounting: Any, words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        source(kind, mounting=mounting)
