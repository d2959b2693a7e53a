from __future__ import annotations

import json
import math
from collections.abc import Iterator
from typing import Any, Literal

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from onboard.files.obstacle_field import Obstacle, ObstacleField
from sitl.environment.sensor import ObstacleSensor, SensorConfig, SensorFault
from sitl.environment.view_geometry import distance_in_view_m
from sitl.plant.truth import VehicleTruth

START_UNIX_S = 1_790_000_000.0


def looking(
    north_m: float = 0.0, east_m: float = 0.0, yaw_rad: float = 0.0, time_s: float = 0.0
) -> VehicleTruth:
    return VehicleTruth(
        time_s=time_s,
        position_ned_m=(north_m, east_m, -4.0),
        velocity_ned_mps=(0.0, 0.0, 0.0),
        acceleration_ned_mps2=(0.0, 0.0, 0.0),
        attitude_quaternion=(math.cos(yaw_rad / 2.0), 0.0, 0.0, math.sin(yaw_rad / 2.0)),
        body_rates_radps=(0.0, 0.0, 0.0),
        rotor_speeds_rpm=(0.0, 0.0, 0.0, 0.0),
    )


def pillar(north_m: float, east_m: float, name: str = "7", yaw_deg: float = 0.0) -> Obstacle:
    return Obstacle(id=name, center_ned_m=(north_m, east_m), size_m=(1.0, 1.2), yaw_deg=yaw_deg)


def sensor(*obstacles: Obstacle, seed: int = 1, **config: Any) -> ObstacleSensor:
    settings_ = SensorConfig(**{"latency_s": 0.0, **config})
    return ObstacleSensor(settings_, ObstacleField.of(obstacles), seed, START_UNIX_S)


def frames(device: ObstacleSensor, truths: Iterator[VehicleTruth]) -> list[dict[str, Any]]:
    return [
        json.loads(payload) for truth in truths for payload in device.sense(truth.time_s, truth)
    ]


def seen(device: ObstacleSensor, truth: VehicleTruth) -> list[dict[str, Any]]:
    (frame,) = frames(device, iter([truth]))
    found: list[dict[str, Any]] = frame["obstacles"]
    return found


def standing(duration_s: float, tick_s: float = 0.01) -> Iterator[VehicleTruth]:
    return (looking(time_s=tick_s * tick) for tick in range(round(duration_s / tick_s)))


def test_frame_has_the_documented_form() -> None:
    (frame,) = frames(sensor(pillar(10.0, 0.6)), iter([looking(time_s=0.25)]))
    assert frame == {
        "version": 1,
        "source": "front",
        "sequence": 0,
        "stamp_unix_s": START_UNIX_S + 0.25,
        "frame": "local_ned",
        "range_m": 12.0,
        "field_of_view_deg": 120.0,
        "obstacles": [
            {
                "id": "7",
                "center_m": [10.0, 0.6],
                "size_m": [1.0, 1.2],
                "yaw_deg": 0.0,
                "uncertainty_m": 0.05,
            }
        ],
    }


def test_looking_at_nothing_is_an_empty_frame() -> None:
    assert seen(sensor(pillar(100.0, 0.0)), looking()) == []


def test_range_is_to_the_nearest_point_of_the_face() -> None:
    assert seen(sensor(pillar(12.6, 0.0)), looking()) == []
    assert len(seen(sensor(pillar(12.6, 0.0)), looking(north_m=0.11))) == 1


def test_an_obstacle_counts_by_its_part_in_view() -> None:
    # The near corner is out of the narrow view; what is in view lies beyond the range.
    wall = Obstacle(id="wall", center_ned_m=(10.0, 0.0), size_m=(0.2, 30.0))
    aside = Obstacle(id="aside", center_ned_m=(2.0, 6.0), size_m=(1.0, 1.0))
    assert [o["id"] for o in seen(sensor(wall, aside, field_of_view_deg=60.0), looking())] == [
        "wall"
    ]
    assert seen(sensor(wall, field_of_view_deg=60.0, range_m=9.8), looking()) == []
    turned = looking(yaw_rad=math.radians(45.0))
    assert seen(sensor(wall, field_of_view_deg=20.0, range_m=12.1), turned)
    assert not seen(sensor(wall, field_of_view_deg=20.0, range_m=12.0), turned)


@given(
    st.floats(-14.0, 14.0),
    st.floats(-14.0, 14.0),
    st.floats(-3.1, 3.1),
    st.sampled_from((20.0, 120.0, 200.0, 360.0)),
)
def test_what_is_told_at_once_is_what_the_cut_polygon_tells(
    north_m: float, east_m: float, yaw_rad: float, field_of_view_deg: float
) -> None:
    truth = looking(yaw_rad=yaw_rad)
    reported = bool(
        seen(sensor(pillar(north_m, east_m), field_of_view_deg=field_of_view_deg), truth)
    )
    cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
    corners_ned_m = [
        (north_m + half_m, east_m + side_m)
        for half_m, side_m in ((0.5, 0.6), (-0.5, 0.6), (-0.5, -0.6), (0.5, -0.6))
    ]
    polygon_m = [(cosine * n + sine * e, cosine * e - sine * n) for n, e in corners_ned_m]
    distance_m = distance_in_view_m(polygon_m, math.radians(field_of_view_deg) / 2.0)
    assume(abs(distance_m - 12.0) > 1e-9)
    assert reported is (distance_m <= 12.0)


def test_a_sensor_may_look_aside() -> None:
    beside = pillar(0.0, -5.0)
    assert seen(sensor(beside), looking()) == []
    assert len(seen(sensor(beside, yaw_deg=-90.0), looking())) == 1


def test_body_frame_is_turned_by_the_heading() -> None:
    (found,) = seen(
        sensor(pillar(3.0, 9.0, yaw_deg=90.0), frame="body_frd"),
        looking(north_m=3.0, east_m=4.0, yaw_rad=math.radians(90.0)),
    )
    assert found["center_m"] == pytest.approx([5.0, 0.0], abs=1e-12)
    assert found["yaw_deg"] == pytest.approx(0.0, abs=1e-12)


def test_frames_come_at_the_rate_and_after_the_latency() -> None:
    device = sensor(rate_hz=20.0, latency_s=0.12)
    arrivals = [
        (truth.time_s, json.loads(payload))
        for truth in standing(2.0)
        for payload in device.sense(truth.time_s, truth)
    ]
    assert [frame["sequence"] for _, frame in arrivals] == list(range(38))
    for number, (arrival_s, frame) in enumerate(arrivals):
        assert frame["stamp_unix_s"] - START_UNIX_S == pytest.approx(number / 20.0, abs=1e-6)
        assert arrival_s == pytest.approx(number / 20.0 + 0.12)


def test_noise_is_bounded_and_repeatable() -> None:
    def centers(seed: int) -> list[list[float]]:
        device = sensor(pillar(6.0, 1.0), seed=seed, noise_m=0.2)
        return [frame["obstacles"][0]["center_m"] for frame in frames(device, standing(5.0))]

    first = centers(1)
    errors = [abs(c - true) for center in first for c, true in zip(center, (6.0, 1.0), strict=True)]
    assert 0.15 < max(errors) <= 0.2
    assert first == centers(1) != centers(2)


def test_silent_sensor_sends_nothing_while_the_fault_lasts() -> None:
    fault = SensorFault(kind="silent", start_s=0.5, end_s=1.0)
    stamps = [
        frame["stamp_unix_s"] - START_UNIX_S
        for frame in frames(sensor(faults=(fault,)), standing(1.5))
    ]
    assert len(stamps) == 20
    assert not [stamp for stamp in stamps if 0.5 <= stamp < 1.0]


def test_stuck_sensor_repeats_its_last_frame() -> None:
    fault = SensorFault(kind="stuck", start_s=0.5)
    device = sensor(pillar(6.0, 0.0), faults=(fault,))
    sequences = [frame["sequence"] for frame in frames(device, standing(1.0))]
    assert sequences == [*range(10), *(9,) * 10]


def test_range_fault_shortens_the_range_and_says_so() -> None:
    fault = SensorFault(kind="range", start_s=0.5, range_m=4.0)
    device = sensor(pillar(6.0, 0.0), faults=(fault,))
    (before, *_, after) = frames(device, standing(1.0))
    assert (before["range_m"], len(before["obstacles"])) == (12.0, 1)
    assert (after["range_m"], len(after["obstacles"])) == (4.0, 0)


corners = st.tuples(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0))


@given(corners, st.floats(0.2, 6.0), st.floats(0.2, 6.0), st.floats(-3.1, 3.1), st.floats(0.1, 3.2))
@settings(max_examples=150, deadline=None)
def test_distance_in_view_agrees_with_sampling(
    center: tuple[float, float], along: float, across: float, yaw_rad: float, half_view_rad: float
) -> None:
    cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)

    def place(u: float, v: float) -> tuple[float, float]:
        return (
            center[0] + cosine * u * along - sine * v * across,
            center[1] + sine * u * along + cosine * v * across,
        )

    grid = [index / 40.0 - 0.5 for index in range(41)]
    inside = [place(u, v) for u in grid for v in grid]
    in_view = [math.hypot(*p) for p in inside if abs(math.atan2(p[1], p[0])) <= half_view_rad]
    sampled_m = min(in_view, default=math.inf)
    exact_m = distance_in_view_m(
        [place(0.5, 0.5), place(-0.5, 0.5), place(-0.5, -0.5), place(0.5, -0.5)], half_view_rad
    )
    assert exact_m <= sampled_m + 1e-9
    if sampled_m < math.inf and half_view_rad > 0.3:
        coarse_m = 2.0 * math.hypot(along, across) / 40.0
        assert exact_m >= sampled_m - coarse_m / math.sin(min(half_view_rad, 1.5))


@given(
    st.tuples(st.floats(0.3, 4.0), st.floats(0.3, 4.0)),
    st.sampled_from([(0.1, 0.0, None), (0.1, 0.03, None), (0.1, 0.0, 0.04)]),
)
def test_each_face_is_off_by_itself_and_by_no_more_than_is_declared(
    size_m: tuple[float, float], noise: tuple[float, float, float | None]
) -> None:
    uncertainty_m, noise_m, face_noise_m = noise
    bound_m = uncertainty_m if face_noise_m is None else face_noise_m
    field = ObstacleField.of([Obstacle(id="a", center_ned_m=(6.0, 1.0), size_m=size_m, yaw_deg=0)])
    config = SensorConfig(uncertainty_m=uncertainty_m, noise_m=noise_m, face_noise_m=face_noise_m)
    device = ObstacleSensor(config, field, 3, ideal=False)
    faces_m = []
    for index in range(60):
        for payload in device.sense(index / 20.0, looking()):
            (box,) = json.loads(payload)["obstacles"]
            (north_m, east_m), (along_m, across_m) = box["center_m"], box["size_m"]
            faces_m.append(
                (
                    north_m + along_m / 2.0 - 6.0 - size_m[0] / 2.0,
                    6.0 - size_m[0] / 2.0 - north_m + along_m / 2.0,
                    east_m + across_m / 2.0 - 1.0 - size_m[1] / 2.0,
                    1.0 - size_m[1] / 2.0 - east_m + across_m / 2.0,
                )
            )
    for each in zip(*faces_m, strict=True):
        assert 0.6 * bound_m < max(each) <= bound_m + 1e-9
        assert -bound_m - 1e-9 <= min(each) < -0.6 * bound_m
    sums_m = [front_m + back_m for front_m, back_m, *_ in faces_m]
    assert max(sums_m) - min(sums_m) > bound_m  # the box is not only displaced, it changes its size


def test_an_ideal_sensor_leaves_faces_alone_unless_told_otherwise() -> None:
    field = ObstacleField.of([Obstacle(id="a", center_ned_m=(6.0, 1.0), size_m=(1, 2), yaw_deg=0)])
    device = ObstacleSensor(SensorConfig(), field, 3)
    (payload,) = [each for now_s in (0.0, 0.04) for each in device.sense(now_s, looking())]
    assert json.loads(payload)["obstacles"][0]["size_m"] == [1.0, 2.0]


@pytest.mark.parametrize(
    ("frame", "placed_by", "expected_m"),
    [
        (
            "local_ned",
            "pose",
            (
                0.5 + 6.0 * math.cos(0.1) - 1.0 * math.sin(0.1),
                -0.2 + 6.0 * math.sin(0.1) + 1.0 * math.cos(0.1),
            ),
        ),
        ("local_ned", "position", (6.5, 0.8)),
        ("body_frd", "pose", (6.0, 1.0)),
    ],
)
def test_boxes_in_local_ned_are_placed_by_the_autopilots_own_estimate(
    frame: Literal["local_ned", "body_frd"],
    placed_by: Literal["pose", "position"],
    expected_m: tuple[float, float],
) -> None:
    field = ObstacleField.of([Obstacle(id="a", center_ned_m=(6.0, 1.0), size_m=(1, 1), yaw_deg=0)])
    device = ObstacleSensor(SensorConfig(frame=frame, placed_by=placed_by, latency_s=0.0), field, 1)
    here = looking()
    half_rad = 0.05
    believed = here._replace(
        position_ned_m=(0.5, -0.2, here.position_ned_m[2]),
        attitude_quaternion=(math.cos(half_rad), 0.0, 0.0, math.sin(half_rad)),
    )
    (payload,) = device.sense(0.0, here, believed)
    north_m, east_m = json.loads(payload)["obstacles"][0]["center_m"]
    assert (north_m, east_m) == pytest.approx(expected_m)
