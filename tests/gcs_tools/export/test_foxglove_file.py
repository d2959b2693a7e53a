"""The scene in an exported file: where obstacles, vehicle and plans are drawn."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

from gcs_tools.export.foxglove_file import write_foxglove
from gcs_tools.export.scene import HEADROOM_M, TOPICS, Scene, quaternion_xyzw, timestamp
from onboard.geometry.frames import rotation_about_down
from onboard.recording.flight_log import FlightLog
from onboard.recording.messages import (
    KnownObstacle,
    Obstacles,
    PlanRecord,
    Record,
    SeenSpace,
    StateRecord,
)
from onboard.recording.mover_record import KnownMover, MoversRecord
from tests.gcs_tools.export.protobuf import decoded
from tests.gcs_tools.logs.raw_log import raw_log
from tests.gcs_tools.running import CONFIG, Clearway

T = 1_790_000_000.0
CORNERS = [(11.5, -0.1), (12.5, -0.1), (12.5, 1.1), (11.5, 1.1)]
OBSTACLE = KnownObstacle(
    id="front/1", measured_ned_m=CORNERS, keep_out_ned_m=CORNERS, region_ned_m=CORNERS,
    lane_ned_m=CORNERS, boundary_ned_m=[(10.0, -0.1), (9.0, 0.5), (10.0, 1.1)],
)  # fmt: skip


def exported(tmp_path: Path, *records: Record) -> dict[str, list[dict[str, Any]]]:
    """Return every message of the export of a log with these records, by topic."""
    path = tmp_path / "flight.mcap"
    with FlightLog(path, {}) as log:
        log.write([StateRecord(time_s=T), *records])
    write_foxglove([path], tmp_path / "scene.mcap")
    return messages_in(tmp_path / "scene.mcap")


def messages_in(path: Path) -> dict[str, list[dict[str, Any]]]:
    found: dict[str, list[dict[str, Any]]] = {}
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            assert schema is not None
            payload = (
                json.loads(message.data)
                if channel.message_encoding == "json"
                else decoded(schema.name, schema.data, message.data)
            )
            found.setdefault(channel.topic, []).append(payload)
    return found


def test_a_mover_stands_where_it_may_be_by_now_with_its_reach_around_it(tmp_path: Path) -> None:
    reach = [(9.0, -3.0), (15.0, -3.0), (15.0, 4.0), (9.0, 4.0)]
    walker = KnownMover(
        id="ring/1", kind="person", seen_s=T - 0.5, speed_max_mps=2.0, box_ned_m=CORNERS,
        reach_ned_m=reach, yields_for=True,
    )  # fmt: skip
    known = MoversRecord(time_s=T, height_m=3.0, movers=[walker])
    found = exported(tmp_path, known, MoversRecord(time_s=T + 1.0))
    update, gone = found["/scene/movers"]
    (entity,) = update["entities"]
    (cube,) = entity["cubes"]
    position, size = cube["pose"]["position"], cube["size"]
    assert (position["x"], position["y"]) == pytest.approx((12.0, 0.5))
    # A metre more on every side: half a second at 2 m/s.
    assert (size["x"], size["y"], size["z"]) == pytest.approx((3.0, 3.2, 3.0 + HEADROOM_M))
    (line,) = entity["lines"]
    assert [(point["x"], point["y"]) for point in line["points"]] == [*reach, reach[0]]
    assert [text["text"] for text in entity["texts"]] == ["ring/1 (person), yielding for it"]
    assert gone.get("entities", []) == []
    assert "/scene/obstacles" not in found


def test_the_column_stands_where_the_obstacle_is(tmp_path: Path) -> None:
    known = Obstacles(time_s=T, height_m=4.0, obstacles=[OBSTACLE])
    (update,) = exported(tmp_path, known)["/scene/obstacles"]
    (entity,) = update["entities"]
    assert (entity["id"], entity["frame_id"]) == ("front/1", "local_ned")
    (cube,) = entity["cubes"]
    position, size = cube["pose"]["position"], cube["size"]
    assert (position["x"], position["y"]) == pytest.approx((12.0, 0.5))
    assert (size["x"], size["y"], size["z"]) == pytest.approx((1.0, 1.2, 4.0 + HEADROOM_M))
    # From the ground to above the height flown: down is positive.
    assert position["z"] + size["z"] / 2.0 == pytest.approx(0.0)
    assert position["z"] - size["z"] / 2.0 == pytest.approx(-4.0 - HEADROOM_M)
    assert [len(line["points"]) for line in entity["lines"]] == [5, 5, 5, 3]
    assert all(point["z"] == -4.0 for line in entity["lines"] for point in line["points"])
    assert [text["text"] for text in entity["texts"]] == ["front/1"]
    # What was drawn before is deleted: type 1, ALL.
    assert [each["type"] for each in update["deletions"]] == ["ALL"]


@pytest.mark.parametrize(
    ("stated_m", "mission_m", "vehicle_m", "drawn_m"),
    [(4.0, 5.0, 6.0, 4.0), (None, 5.0, 6.0, 5.0), (None, None, 6.0, 6.0), (None, None, None, 0.0)],
)
def test_the_height_is_that_of_the_leg_as_far_as_it_is_known(
    stated_m: float | None, mission_m: float | None, vehicle_m: float | None, drawn_m: float
) -> None:
    scene = Scene(mission_m)
    if vehicle_m is not None:
        list(scene.draw(StateRecord(time_s=T, position_ned_m=(0.0, 0.0, -vehicle_m))))
    known = Obstacles(time_s=T, height_m=stated_m, obstacles=[OBSTACLE])
    ((topic, update),) = scene.draw(known)
    schema = type(update).get_schema()
    message = decoded(schema.name, schema.data, update.encode())
    assert topic == "/scene/obstacles"
    points = message["entities"][0]["lines"][0]["points"]
    assert {point["z"] for point in points} == {-drawn_m}


def test_an_obstacle_without_an_outline_is_left_out(tmp_path: Path) -> None:
    known = Obstacles(time_s=T, obstacles=[KnownObstacle(id="bare"), OBSTACLE])
    (update,) = exported(tmp_path, known)["/scene/obstacles"]
    assert [entity["id"] for entity in update["entities"]] == ["front/1"]


def turned(rotation: dict[str, float], vector: tuple[float, float, float]) -> list[float]:
    """Rotate a vector by a quaternion: q v q*."""
    axis, w = np.array([rotation["x"], rotation["y"], rotation["z"]]), rotation["w"]
    v = np.array(vector)
    turned_v: list[float] = (
        2.0 * np.dot(axis, v) * axis + (w * w - axis @ axis) * v + 2.0 * w * np.cross(axis, v)
    ).tolist()
    return turned_v


def test_the_map_has_east_north_up_and_the_body_follows_the_heading(tmp_path: Path) -> None:
    state = StateRecord(
        time_s=T + 1.0, position_ned_m=(5.0, 0.0, -4.0), roll_rad=0.0, pitch_rad=0.0, yaw_rad=0.7
    )
    found = exported(tmp_path, state)
    (update,) = found["/tf"]
    map_from_ned, ned_from_body = update["transforms"]
    assert turned(map_from_ned["rotation"], (1.0, 2.0, 3.0)) == pytest.approx([2.0, 1.0, -3.0])
    assert ned_from_body["translation"] == {"x": 5.0, "y": 0.0, "z": -4.0}
    nose = turned(ned_from_body["rotation"], (1.0, 0.0, 0.0))
    assert nose == pytest.approx((rotation_about_down(0.7) @ np.array([1.0, 0.0, 0.0])).tolist())
    assert found["/pose"][0]["pose"]["position"] == ned_from_body["translation"]


def test_nothing_is_drawn_of_a_vehicle_whose_position_is_unknown(tmp_path: Path) -> None:
    assert exported(tmp_path).keys() == {"/state"}


def test_roll_lowers_the_right_side_and_pitch_raises_the_nose() -> None:
    def rotated(attitude: tuple[float, float, float], v: tuple[float, float, float]) -> list[float]:
        return turned(dict(zip("xyzw", quaternion_xyzw(*attitude), strict=True)), v)

    assert rotated((0.3, 0.0, 0.0), (0.0, 1.0, 0.0))[2] == pytest.approx(math.sin(0.3))
    assert rotated((0.0, 0.3, 0.0), (1.0, 0.0, 0.0))[2] == pytest.approx(-math.sin(0.3))


def test_times_are_split_into_seconds_and_nanoseconds() -> None:
    assert repr(timestamp(T + 0.25)) == "Timestamp(sec=1790000000, nsec=250000000)"
    assert repr(timestamp(0.9999999)) == "Timestamp(sec=1, nsec=0)"


def test_a_plan_is_a_path_and_a_line(tmp_path: Path) -> None:
    path = [(0.0, 0.0, -4.0), (1.0, 0.5, -4.0), (2.0, 1.0, -4.0)]
    found = exported(tmp_path, PlanRecord(time_s=T, path_ned_m=path))
    (planned,) = found["/path/planned"]
    assert [pose["position"]["y"] for pose in planned["poses"]] == [0.0, 0.5, 1.0]
    (update,) = found["/scene/plan"]
    assert len(update["entities"][0]["lines"][0]["points"]) == 3


def test_the_flown_path_grows_twice_a_second_and_is_bounded(tmp_path: Path) -> None:
    states = [
        StateRecord(time_s=T + 0.02 * n, position_ned_m=(0.02 * n, 0.0, -4.0))
        for n in range(1, 5001)
    ]
    paths = exported(tmp_path, *states)["/path/flown"]
    lengths = [len(path["poses"]) for path in paths]
    assert lengths[:3] == [1, 2, 3]
    assert max(lengths) == 120
    assert len(paths) == pytest.approx(200, abs=5)


# ---------------------------------------------------------------------------- a whole flight


def test_the_seen_space_is_drawn_as_flat_boxes_with_its_lines(tmp_path: Path) -> None:
    record = SeenSpace(
        time_s=T, height_m=4.0, corner_ned_m=(10.0, 20.0), heading_rad=math.pi / 2.0, cell_m=0.2,
        row=[5], column_from=[10], column_to=[20], way_to_rest_ned_m=[(1.0, 2.0), (3.0, 2.0)],
        guide_ned_m=[(1.0, 2.0)],
    )  # fmt: skip
    (update,) = exported(tmp_path, record)["/scene/seen_space"]
    (entity,) = update["entities"]
    (cube,) = entity["cubes"]
    position, size = cube["pose"]["position"], cube["size"]
    # Heading east: along the leg is east, to its right is south.
    assert (position["x"], position["y"], position["z"]) == pytest.approx((7.0, 21.1, -4.0))
    assert (size["x"], size["y"]) == pytest.approx((0.2, 2.0))
    guide, way = entity["lines"]
    assert [(point["x"], point["y"]) for point in way["points"]] == [(1.0, 2.0), (3.0, 2.0)]
    assert len(guide["points"]) == 1


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The paper's flight in virtual time, exported."""
    from gcs_tools.__main__ import main  # noqa: PLC0415  only this fixture needs the simulation

    out = tmp_path_factory.mktemp("flights") / "paper-1"
    assert main(["fly", str(CONFIG / "paper.yaml"), "--virtual", "--out", str(out)]) == 0
    assert main(["export", str(out), "--foxglove"]) == 0
    return out / "flight.foxglove.mcap"


def test_the_layout_for_viewers_shows_what_the_export_has(scene: Path) -> None:
    layout = json.loads((CONFIG / "layout.json").read_text(encoding="utf-8"))
    panels = layout["configById"]
    assert set(panels) == set(re.findall(r"\w+!\w+", json.dumps(layout["layout"])))
    found = messages_in(scene)
    topics = [*panels["3D!flight"]["topics"], panels["RawMessages!events"]["topicPath"]]
    assert "/scene/seen_space" in topics
    without = {"/scene/seen_space", "/scene/movers"}  # the paper flies without them
    assert set(topics) - without <= found.keys()
    assert TOPICS.keys() - without <= found.keys()
    for path in (path["value"] for panel in panels.values() for path in panel.get("paths", ())):
        topic, *names = path.partition("[")[0].split(".")
        value = found[topic][-1]
        for name in names:
            value = value[name]


def test_every_record_of_the_log_is_in_the_export(scene: Path) -> None:
    found = messages_in(scene)
    with scene.with_name("flight.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    counts = {
        channel.topic: summary.statistics.channel_message_counts[number]
        for number, channel in summary.channels.items()
    }
    assert {topic: len(found[topic]) for topic in counts} == counts
    # The log itself holds no scene: that is built here.
    assert not counts.keys() & TOPICS.keys()


def test_the_export_says_what_flew(scene: Path) -> None:
    with scene.open("rb") as file:
        metadata = {each.name: each.metadata for each in make_reader(file).iter_metadata()}
    assert metadata["clearway"]["contract_sha256"]


# ---------------------------------------------------------------------------- bad input


@pytest.mark.parametrize("form", ["--tlog", "--foxglove"])
@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"\x89MCAP0\r\n", None])
def test_bad_input_is_one_line_and_exit_code_2(
    clearway: Clearway, tmp_path: Path, form: str, content: bytes | None
) -> None:
    path = tmp_path / "flight.mcap"
    if content is not None:
        path.write_bytes(content)
    ran = clearway("export", path, form)
    assert (ran.code, ran.out) == (2, "")
    assert ran.err.startswith("clearway: error: ")
    assert ran.err.count("\n") == 1
    assert "flight.mcap" in ran.err
    assert not (tmp_path / "flight.tlog").exists()
    assert not (tmp_path / "flight.foxglove.mcap").exists()


def test_a_log_without_a_flight_is_refused(clearway: Clearway, tmp_path: Path) -> None:
    with FlightLog(tmp_path / "flight.mcap", {}):
        pass
    ran = clearway("export", tmp_path, "--foxglove")
    assert ran.code == 2
    assert "there is no flight in it, expected records of /state" in ran.err


def test_the_log_is_never_overwritten_by_its_export(clearway: Clearway, tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    with FlightLog(path, {}) as log:
        log.write([StateRecord(time_s=T)])
    before = path.read_bytes()
    ran = clearway("export", path, "--foxglove", "-o", path)
    assert ran.code == 2
    assert "is the log itself" in ran.err
    assert path.read_bytes() == before


def test_an_unwritable_export_is_one_line(clearway: Clearway, tmp_path: Path) -> None:
    with FlightLog(tmp_path / "flight.mcap", {}) as log:
        log.write([StateRecord(time_s=T)])
    ran = clearway("export", tmp_path, "--foxglove", "-o", tmp_path / "nowhere" / "scene.mcap")
    assert ran.code == 2
    assert "cannot be written" in ran.err


def test_malformed_and_cut_logs_are_exported_as_far_as_they_go(
    clearway: Clearway, tmp_path: Path
) -> None:
    path = tmp_path / "flight.mcap"
    with raw_log(path, mission="no mission") as write:
        for number in range(3000):
            position = [0.1 * number, 0.0, -4.0] if number % 100 else ["x"]
            write("state", T + number, {"time_s": T + number, "position_ned_m": position})
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    ran = clearway("export", path, "--foxglove")
    assert ran.code == 0
    assert "breaks off before its end" in ran.err
    assert "records of /state are malformed" in ran.err
    found = messages_in(tmp_path / "flight.foxglove.mcap")
    assert 100 < len(found["/state"]) < 3000
    assert len(found["/pose"]) == len(found["/state"])
