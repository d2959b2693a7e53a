import math
from collections.abc import Iterable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.monitoring.assumptions import Assumption
from onboard.monitoring.detection_consistency import (
    PLACES_MAX,
    SETTLED_AFTER_S,
    DetectionConsistencyMonitor,
    Placement,
    Sighting,
)

ERROR_M = 0.1
Bounds = tuple[float, float, float, float]


def seen(north: tuple[float, float], east: tuple[float, float] = (0.0, 1.0)) -> Sighting:
    return Sighting(*north, *east, ERROR_M)


def take_all(sightings: Iterable[Sighting], *, period_s: float = 0.05) -> list[Placement]:
    monitor = DetectionConsistencyMonitor()
    return [
        monitor.take("front/1", sighting, step * period_s)
        for step, sighting in enumerate(sightings)
    ]


def contradicts(sightings: Iterable[Sighting]) -> bool:
    return any(placement.violation is not None for placement in take_all(sightings))


@pytest.mark.parametrize(
    ("what", "north_m", "contradicted"),
    [
        ("stands", [(0.0, 1.0)] * 3, False),
        ("moved within both errors", [(0.0, 1.0), (0.19, 1.19)], False),
        ("moved farther", [(0.0, 1.0), (0.21, 1.21)], True),
        ("moved back", [(0.0, 1.0), (-0.21, 0.79)], True),
        ("elsewhere", [(0.0, 1.0), (5.0, 6.0)], True),
        ("seen more and more of", [(0.5 - 0.1 * n, 0.6 + 0.2 * n) for n in range(20)], False),
        ("grows to one side", [(0.0, 0.1 + 0.3 * n) for n in range(10)], False),
        ("seen in part after whole", [(0.0, 3.0), (0.0, 1.0), (2.0, 3.0)], False),
        ("seen whole between its parts", [(0.0, 1.0), (0.0, 3.0), (2.0, 3.0)], False),
        ("never seen whole", [(0.0, 1.0), (1.0, 2.0)], True),
        ("seen whole elsewhere", [(0.0, 1.0), (-3.0, 1.0), (0.5, 1.5)], True),
        ("creeps", [(0.02 * n, 1.0 + 0.02 * n) for n in range(11)], False),
        ("creeps too far", [(0.02 * n, 1.0 + 0.02 * n) for n in range(12)], True),
        ("grows, then moves", [(0.0, 1.0), (0.0, 2.0), (0.5, 2.5)], True),
        ("swings about", [(0.1 * (-1) ** n, 1.0 + 0.1 * (-1) ** n) for n in range(9)], False),
    ],
)
def test_only_what_cannot_be_one_box_at_rest_contradicts(
    what: str, north_m: list[tuple[float, float]], *, contradicted: bool
) -> None:
    assert contradicts([seen(bounds_m) for bounds_m in north_m]) is contradicted, what
    mirrored = [seen((-high, -low)) for low, high in north_m]
    assert contradicts(mirrored) is contradicted, what
    across = [seen((0.0, 1.0), bounds_m) for bounds_m in north_m]
    assert contradicts(across) is contradicted, what


errors_m = st.floats(-ERROR_M, ERROR_M)


@given(st.lists(st.tuples(errors_m, errors_m, errors_m, errors_m), min_size=2, max_size=30))
def test_faces_within_their_error_never_contradict(noise_m: list[Bounds]) -> None:
    box_m = (10.0, 12.0, -1.0, 0.5)
    sightings = []
    for noise in noise_m:
        south_m, north_m, west_m, east_m = (b + off for b, off in zip(box_m, noise, strict=True))
        sightings.append(Sighting(south_m, north_m, west_m, east_m, ERROR_M))
    assert not contradicts(sightings)


@given(
    st.floats(0.0, 2.0 * math.pi),
    st.floats(0.35, 3.0),
    st.integers(1, 40),
    st.lists(st.tuples(errors_m, errors_m), min_size=41, max_size=41),
)
def test_a_box_that_moves_is_noticed_however_slowly(
    course_rad: float, way_m: float, steps: int, noise_m: list[tuple[float, float]]
) -> None:
    """A shift by twice the errors of two sightings, and their noise, along either axis."""
    sightings = []
    for step in range(steps + 1):
        gone_m = 2.0 * way_m * step / steps
        north_m = gone_m * math.cos(course_rad) + noise_m[step][0] / 2.0
        east_m = gone_m * math.sin(course_rad) + noise_m[step][1] / 2.0
        sightings.append(seen((north_m, 1.0 + north_m), (east_m, 1.0 + east_m)))
    assert contradicts(sightings)


@pytest.mark.parametrize("heading_error_deg", [2.0, 3.5, 18.0])
@pytest.mark.parametrize("distance_m", [8.0, 12.0, 15.0])
def test_a_wandering_heading_is_noticed_unless_it_is_declared(
    heading_error_deg: float, distance_m: float
) -> None:
    def turned(heading_rad: float, declared_rad: float) -> Sighting:
        corners = [
            (
                north * math.cos(heading_rad) - east * math.sin(heading_rad),
                north * math.sin(heading_rad) + east * math.cos(heading_rad),
            )
            for north, east in (
                (distance_m, -0.5),
                (distance_m + 1.0, -0.5),
                (distance_m + 1.0, 0.5),
                (distance_m, 0.5),
            )
        ]
        return Sighting.of(corners, ERROR_M, 2.0 * (distance_m + 1.2) * math.sin(declared_rad / 2))

    wander_rad = [math.radians(heading_error_deg) * math.sin(n / 8.0) for n in range(26)]
    assert contradicts([turned(heading_rad, 0.0) for heading_rad in wander_rad])
    declared_rad = math.radians(heading_error_deg)
    assert not contradicts([turned(heading_rad, declared_rad) for heading_rad in wander_rad])


def test_the_contradiction_is_named_by_shift_and_limit() -> None:
    *_, last = take_all([seen((0.0, 1.0)), seen((1.5, 2.5))])
    assert last.violation is not None
    assert last.violation.assumption is Assumption.DETECTION_CONSISTENCY
    assert last.violation.measured == pytest.approx(1.5)
    assert last.violation.limit == pytest.approx(2.0 * ERROR_M)
    assert last.violation.subject == "front/1"


def test_each_place_keeps_its_sightings() -> None:
    ids = [
        placement.track_id
        for placement in take_all(
            [seen((0.0, 1.0)), seen((3.0, 4.0)), seen((0.1, 1.1)), seen((3.1, 4.1))]
        )
    ]
    assert ids == ["front/1", "front/1~2", "front/1", "front/1~2"]


def test_places_are_bounded() -> None:
    placements = take_all([seen((3.0 * n, 3.0 * n + 1.0)) for n in range(3 * PLACES_MAX)])
    assert len({placement.track_id for placement in placements}) == PLACES_MAX


def test_what_is_seen_in_part_only_is_not_compared() -> None:
    monitor = DetectionConsistencyMonitor()
    monitor.take("front/1", seen((0.0, 1.0)), 0.0)
    assert monitor.take("front/1", None, 0.05) == Placement("front/1", apart=False, violation=None)


def test_a_contradiction_is_over_once_the_last_place_has_been_seen_for_long() -> None:
    monitor = DetectionConsistencyMonitor()
    monitor.take("front/1", seen((0.0, 1.0)), 0.0)
    for step in range(1, 101):
        now_s = 0.1 * step
        monitor.take("front/1", seen((3.0, 4.0)), now_s)
        contradicted = monitor.contradicted(now_s) == ["front/1"]
        # For two seconds it is new; for two more it may come back.
        assert contradicted is (now_s < 0.1 + 2.0 * SETTLED_AFTER_S), now_s


@pytest.mark.parametrize("yaw_deg", [0.0, 30.0, 45.0, 90.0, 135.0])
def test_bounds_of_a_turned_box_are_off_by_both_components_of_a_face(yaw_deg: float) -> None:
    yaw_rad = math.radians(yaw_deg)
    along = (math.cos(yaw_rad), math.sin(yaw_rad))

    def corners(grown_m: float) -> list[tuple[float, float]]:
        length_m, width_m = 1.0 + grown_m, 0.5 + grown_m
        return [
            (x * along[0] - y * along[1], x * along[1] + y * along[0])
            for x, y in (
                (-length_m, -width_m),
                (length_m, -width_m),
                (length_m, width_m),
                (-length_m, width_m),
            )
        ]

    exact, grown = Sighting.of(corners(0.0), ERROR_M, 0.0), Sighting.of(corners(ERROR_M), 0.0, 0.0)
    assert grown.north_max_m == pytest.approx(exact.north_max_m + exact.error_m)
    assert grown.east_min_m == pytest.approx(exact.east_min_m - exact.error_m)


# Vehicle north, and south and west face of one box [m], as a PX4 with wandering heading saw it
# from the body in flight; the sensor declared 0.10 m.
RECORDED = [
    (10.27, 24.73, -2.40),
    (10.82, 24.72, -2.43),
    (11.43, 24.71, -2.52),
    (12.01, 24.66, -2.59),
    (12.59, 24.65, -2.65),
    (13.18, 24.63, -2.71),
    (13.74, 24.58, -2.79),
    (14.42, 24.52, -2.84),
    (15.00, 24.49, -2.89),
]


def test_the_recorded_heading_wander_is_noticed_before_the_avoidance_begins() -> None:
    """The vehicle then flew on, and came into contact: boxes had grown until no plan was left."""
    monitor = DetectionConsistencyMonitor()
    noticed_m = []
    for step, (vehicle_m, south_m, west_m) in enumerate(RECORDED):
        sighting = Sighting(south_m, south_m + 1.98, west_m, west_m + 1.95, ERROR_M)
        if monitor.take("front/o1", sighting, 0.2 * step).violation is not None:
            noticed_m.append(vehicle_m)
    assert noticed_m
    assert noticed_m[0] < 13.5


@pytest.mark.parametrize(
    ("what", "faces_m", "contradicted"),
    [
        # South and west face of one box, from flights of real autopilots.
        (
            "ArduPilot, nominal",
            [(23.53, -0.49), (23.53, -0.51), (23.51, -0.52), (23.48, -0.52), (23.43, -0.52)],
            False,
        ),
        ("PX4, nominal", [(25.36, -0.21), (25.35, -0.22), (25.33, -0.22), (25.30, -0.26)], False),
        (
            "PX4, after GPS was lost",
            [(25.36, -0.21), (25.30, -0.26), (25.25, -0.35), (25.16, -0.47), (25.07, -0.61)],
            True,
        ),
        (
            "ArduPilot, after GPS was lost",
            [(46.97, -3.63), (46.91, -3.65), (46.85, -3.67), (46.80, -3.69), (46.72, -3.72)],
            True,
        ),
    ],
)
def test_recorded_sightings_contradict_only_where_the_estimate_went_wrong(
    what: str, faces_m: list[tuple[float, float]], *, contradicted: bool
) -> None:
    sightings = [
        Sighting(south_m, south_m + 0.8, west_m, west_m + 1.7, ERROR_M)
        for south_m, west_m in faces_m
    ]
    assert contradicts(sightings) is contradicted, what
