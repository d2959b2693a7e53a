"""What is seen free at one height, among obstacles of which some are lower or higher."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from onboard.contract.assessment import Assessment, assess
from onboard.contract.heights import LEVEL_M, half_band_m
from onboard.files.contract_file import Contract
from onboard.geometry.frames import FloatArray, LegFrame
from onboard.guidance.dense.limits import rest_limits_of
from onboard.monitoring.detection_evaluation import DetectionEvaluator
from onboard.monitoring.estimator.heading import HeadingMonitor
from onboard.monitoring.seen.seen_space import SeenSpace
from onboard.motion.trajectory import State, Trajectory
from onboard.perception.detection import DetectionFrame
from onboard.perception.intake import DetectionCounters
from onboard.perception.obstacle_map import ObstacleMap
from onboard.perception.pose_history import PoseHistory
from onboard.planning.rest_certifier import certify_rest
from onboard.vehicle_state import Pose
from tests.onboard.monitoring.fake_flight import FakeFlight

LEG = LegFrame((0.0, 0.0, -5.0), 0.0)
UP_RAD = math.radians(30.0)
BODY_M, CONTROL_M, DRIFT_M, ERROR_Z_M = 0.2, 0.4, 0.3, 0.2


def under_heights(contract: Contract) -> Assessment:
    assessment = assess(contract, mission_altitude_m=5.0)
    return replace(
        assessment,
        terms=replace(
            assessment.terms,
            tracking_error_z_m=CONTROL_M,
            radius_z_m=BODY_M,
            height_drift_m=DRIFT_M,
            position_error_z_m=ERROR_Z_M,
            view_up_rad=UP_RAD,
            view_down_rad=UP_RAD,
            heading_error_rad=0.0,
        ),
    )


class Rig:
    """A vehicle at rest on a leg at 5 m, whose frames the whole evaluation takes."""

    def __init__(self, contract: Contract) -> None:
        assessment = under_heights(contract)
        half_m = half_band_m(assessment.terms)
        known = ObstacleMap(LEG, assessment.region_around, 0.0, half_m)
        self.flight = FakeFlight(assessment, known, leg=LEG)
        self.poses, self.now_s, self.sequence = PoseHistory(), 1.0, 0
        here = lambda _stamp_s: [(0.0, 0.0)]  # noqa: E731  a placement
        self.evaluator = DetectionEvaluator(self.flight, self.poses, here, DetectionCounters())
        self.heading = HeadingMonitor()

    @property
    def seen(self) -> SeenSpace:
        return self.evaluator.seen

    def look(
        self,
        obstacles: Sequence[dict[str, Any]],
        times: int = 3,
        position_m: tuple[float, float, float] = (0.0, 0.0, -5.0),
        tilt_rad: tuple[float, float] = (0.0, 0.0),
        **changed: Any,
    ) -> list[str]:
        """Take frames; return the assumptions that they violate."""
        found = []
        for _ in range(times):
            for _ in range(5):
                self.now_s += 0.01
                self.poses.add(Pose(self.now_s, position_m, (0.0, 0.0, 0.0), *tilt_rad, 0.0))
            self.sequence += 1
            stated: dict[str, Any] = {
                "version": 1, "source": "front", "sequence": self.sequence,
                "stamp_unix_s": self.now_s, "frame": "body_frd", "range_m": 12.0,
                "field_of_view_deg": 120.0,
                "obstacles": [{"uncertainty_m": 0.05, "yaw_deg": 0.0} | o for o in obstacles],
            }  # fmt: skip
            frame = DetectionFrame.model_validate(stated | changed)
            found += [
                violation.assumption.value
                for violation in self.evaluator.evaluate(
                    frame, self.now_s, self.now_s, self.heading
                )
            ]
            violation = self.seen.advance(self.poses.at(self.now_s), trusted=True)
            found += [violation.assumption.value] if violation is not None else []
        return found

    def is_free(self, x_m: float, y_m: float) -> bool:
        return self.seen.grid().is_free(x_m - 0.01, x_m + 0.01, y_m - 0.01, y_m + 0.01)


HEDGE: dict[str, Any] = {"id": "hedge", "center_m": (8.0, 0.0), "size_m": (0.6, 14.0)}


def test_a_low_hedge_hides_nothing_at_the_height_of_the_flight(contract: Contract) -> None:
    rig = Rig(contract)
    assert rig.look([HEDGE | {"down_m": (3.5, None)}]) == []
    assert rig.is_free(8.0, 0.0)  # above it
    assert rig.is_free(10.5, 0.0)  # behind it
    assert len(rig.flight.obstacles) == 0


@pytest.mark.parametrize(
    "height",
    [
        {},
        {"down_m": (None, None)},
        {"down_m": (1.0, None)},
        {"down_m": (3.5, None), "partial": True},
    ],
    ids=["unsaid", "unknown", "tall", "partial"],
)
def test_what_may_reach_into_the_band_hides_as_a_pillar(
    contract: Contract, height: dict[str, Any]
) -> None:
    rig = Rig(contract)
    rig.look([HEDGE | height])
    assert rig.is_free(6.5, 0.0)
    assert not rig.is_free(8.0, 0.0)
    assert not rig.is_free(10.5, 0.0)


def test_a_ceiling_above_the_flight_hides_nothing(contract: Contract) -> None:
    rig = Rig(contract)
    rig.look([HEDGE | {"down_m": (None, -2.0)}])
    assert rig.is_free(8.0, 0.0)
    low = Rig(contract)
    low.look([HEDGE | {"down_m": (None, -0.9)}])
    assert not low.is_free(8.0, 0.0)


def test_a_top_that_goes_out_of_view_contradicts_nothing(contract: Contract) -> None:
    rig = Rig(contract)
    rig.look([HEDGE | {"down_m": (3.5, None)}])
    assert rig.look([HEDGE]) == []
    assert rig.is_free(8.0, 0.0)


def test_a_top_that_turns_out_higher_is_a_contradiction(contract: Contract) -> None:
    rig = Rig(contract)
    rig.look([HEDGE | {"down_m": (3.5, None)}])
    assert "sensor_contradiction" in rig.look([HEDGE | {"down_m": (0.2, None)}])
    assert rig.seen.size == 0


@pytest.mark.parametrize(
    ("first_m", "then_m", "contradicts"),
    [
        # The band begins 0.95 m below the body: 1.2 is out of it, whatever the error of 0.2.
        ((1.2, None), (1.1, None), False),
        ((1.2, None), (0.8, None), False),  # and may be, drift included
        ((1.2, None), (0.3, None), True),
        ((None, -1.2), (None, -0.8), False),
        ((None, -1.2), (None, -0.3), True),
        ((1.2, 1.4), (-0.05, 0.05), True),  # thinner than its error, and amid the band
        ((1.2, 1.4), (0.7, 0.8), False),
    ],
)
def test_two_measurements_that_may_both_be_right_contradict_nothing(
    contract: Contract,
    first_m: tuple[float | None, float | None],
    then_m: tuple[float | None, float | None],
    *,
    contradicts: bool,
) -> None:
    rig = Rig(contract)
    assert rig.look([HEDGE | {"down_m": first_m}]) == []
    assert rig.is_free(8.0, 0.0)
    assert ("sensor_contradiction" in rig.look([HEDGE | {"down_m": then_m}])) is contradicts
    # What is in doubt is in the way all the same.
    assert (len(rig.flight.obstacles) == 1) is (then_m != (1.2, None))


def test_near_the_vehicle_nothing_is_seen_free(contract: Contract) -> None:
    """The band is not all in view there: a branch just below is not seen from beside it."""
    rig = Rig(contract)
    rig.look([])
    assert not rig.is_free(1.2, 0.0)
    assert rig.is_free(4.0, 0.0)
    tilted = Rig(contract)
    tilted.look([], tilt_rad=(0.0, 0.2))
    assert not tilted.is_free(4.0, 0.0)
    assert tilted.is_free(8.0, 0.0)


def test_a_look_round_shows_no_place_to_start_from(contract: Contract) -> None:
    rig = Rig(contract)
    rig.look([], field_of_view_deg=360.0)
    assert not rig.seen.confirm_start(0.0, 0.0)


@pytest.mark.parametrize(
    "changed", [{"vertical_field_of_view_deg": (0.0, 0.0)}, {"reported_height_m": (0.5, 0.5)}]
)
def test_a_planar_scan_shows_nothing_free(contract: Contract, changed: dict[str, Any]) -> None:
    rig = Rig(contract)
    rig.look([], **changed)
    assert rig.seen.size == 0


def test_a_band_that_grows_voids_what_was_seen(contract: Contract) -> None:
    rig = Rig(contract)
    rig.look([])
    terms = replace(rig.flight.assessment.terms, tracking_error_z_m=0.6)
    rig.flight.assessment = replace(rig.flight.assessment, terms=terms)
    assert not rig.is_free(6.0, 0.0)
    assert rig.seen.void_reason == "the heights flown at have grown"
    rig.look([])
    assert rig.is_free(6.0, 0.0)


def test_a_small_shift_of_the_height_voids_the_set(contract: Contract) -> None:
    rig = Rig(contract)
    rig.look([])
    rig.seen.shift((0.0, 0.0, 0.1))
    assert rig.seen.size == 0


@pytest.mark.parametrize("by_reset", [False, True])
def test_many_small_moves_of_the_height_add_up(contract: Contract, *, by_reset: bool) -> None:
    """A band that was seen at 5 m says nothing of a leg that has come to 5.08 m by and by."""
    rig = Rig(contract)
    rig.look([])
    for number in (1, 2):
        if by_reset:
            rig.seen.shift((0.0, 0.0, 0.04))
        else:
            rig.flight.leg = LegFrame((0.0, 0.0, -5.0 - 0.04 * number), 0.0)
        if number == 1:
            assert rig.seen.grid().level_m == pytest.approx(LEVEL_M - 0.04)
            assert rig.is_free(6.0, 0.0)
    assert rig.seen.grid().level_m == pytest.approx(LEVEL_M)
    assert rig.seen.size == 0


@pytest.mark.parametrize(("off_m", "valid"), [(0.0, True), (0.04, True), (-0.2, False)])
def test_a_way_to_rest_at_another_height_is_not_certified(
    contract: Contract, off_m: float, *, valid: bool
) -> None:
    rig = Rig(contract)
    rig.look([])
    at = State((6.0, 0.0, off_m), (0.0, 0.0, 0.0))
    zeros = np.zeros((1, 3))
    resting = Trajectory(0.0, np.array((1.0,)), np.array((at.position_leg_m,)), zeros, zeros, zeros)
    limits = rest_limits_of(rig.flight.assessment, any_heading=True)
    certificate = certify_rest(resting, at, 0.0, limits, rig.seen.grid())
    assert certificate.valid is valid
    if not valid:
        assert certificate.failures == ("flown 0.2 m off the height that was seen free",)


# ------------------------------------------------------------------ against the truth


def _points(box: Sequence[float]) -> FloatArray:
    """Return points all over the surface of a box (n, 3): N, E, D."""
    axes = [
        np.linspace(low, high, max(2, math.ceil((high - low) / 0.25) + 1))
        for low, high in zip(box[::2], box[1::2], strict=True)
    ]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    surface = np.ones(grid.shape[:3], np.bool_)
    surface[1:-1, 1:-1, 1:-1] = False
    points: FloatArray = grid[surface]
    return points


class View:
    """What a sensor with a view of 120 by 60 degrees sees of boxes (m, 6), in local NED."""

    def __init__(self, sensor_m: FloatArray, roll_rad: float, pitch_rad: float) -> None:
        self._sensor_m = sensor_m
        self._turn = Rotation.from_euler("ZYX", (0.0, pitch_rad, roll_rad)).as_matrix()

    def holds(self, points: FloatArray) -> NDArray[np.bool_]:
        rays = points - self._sensor_m
        x, y, z = (rays @ self._turn).T
        held: NDArray[np.bool_] = np.abs(np.arctan2(y, x)) <= math.radians(60.0)
        held &= np.abs(np.arctan2(-z, np.hypot(x, y))) <= UP_RAD
        held &= np.linalg.norm(rays, axis=1) <= 12.0
        return held

    def met_first(self, points: FloatArray, boxes: FloatArray) -> set[int]:
        """Return the boxes that lines of sight to some points meet first."""
        rays = points - self._sensor_m
        rays = np.where(np.abs(rays) < 1e-9, 1e-9, rays)
        one = (boxes[:, None, ::2] - self._sensor_m) / rays
        other = (boxes[:, None, 1::2] - self._sensor_m) / rays
        enter = np.minimum(one, other).max(axis=2)
        leave = np.maximum(one, other).min(axis=2)
        met = np.where((enter <= leave + 1e-9) & (leave >= 0.0), enter, math.inf)
        return set(met.argmin(axis=0).tolist())


sizes = st.one_of(st.floats(0.2, 0.4), st.floats(0.2, 3.0))
HALF_M = BODY_M + CONTROL_M + DRIFT_M + LEVEL_M
# Heights (top, bottom) that just reach into the band, from below or above, and any others.
tall = st.one_of(st.floats(0.05, 0.6), sizes)
just = st.floats(0.01, 0.3)
downs = st.one_of(
    st.builds(lambda into, size: (-5.0 + HALF_M - into, -5.0 + HALF_M - into + size), just, tall),
    st.builds(lambda into, size: (-5.0 - HALF_M + into - size, -5.0 - HALF_M + into), just, tall),
    st.builds(lambda top, size: (top, top + size), st.floats(-9.0, 0.0), tall),
)
drawn_boxes = st.tuples(
    st.one_of(st.floats(1.0, 4.0), st.floats(2.0, 11.0)), st.floats(-4.0, 2.0), sizes, sizes, downs
)
signs = st.sampled_from([-1.0, 0.0, 1.0])
drawn_looks = st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), signs, signs, signs)


def reported(
    view: View, truth: FloatArray, body_down_m: float, face: float, z: float
) -> list[dict[str, Any]]:
    """Return what is reported: faces and heights off by their bounds, cut where the view ends."""
    points = [_points(box) for box in truth.tolist()]
    every = np.concatenate(points)
    found = []
    for number in sorted(view.met_first(every[view.holds(every)], truth)):
        n0, n1, e0, e1, _, _ = truth[number].tolist()
        downs_m = points[number][view.holds(points[number]), 2]
        if not downs_m.size:  # only between the points
            downs_m = truth[number, 4:]
        grown_m = 2.0 * face * 0.05
        found.append(
            {
                "id": str(number),
                "center_m": ((n0 + n1) / 2.0, (e0 + e1) / 2.0),
                "size_m": (n1 - n0 + grown_m, e1 - e0 + grown_m),
                "down_m": tuple(
                    float(down_m) + z * ERROR_Z_M - body_down_m
                    for down_m in (downs_m.min(), downs_m.max())
                ),
            }
        )
    return found


@settings(max_examples=80, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    drawn=st.lists(drawn_boxes, min_size=1, max_size=5),
    looks=st.lists(drawn_looks, min_size=1, max_size=3),
)
def test_no_part_of_an_obstacle_is_where_the_band_was_seen_free(
    contract: Contract,
    drawn: list[tuple[float, float, float, float, tuple[float, float]]],
    looks: list[tuple[float, float, float, float, float]],
) -> None:
    """The vehicle is off by E_z, the sensor by r_z, top and bottom by e_z, faces by e."""
    truth = np.array(
        [(n, n + along, e, e + across, *down_m) for n, e, along, across, down_m in drawn]
    )
    rig = Rig(contract)
    for roll, pitch, off, face, z in looks:
        body_down_m = -5.0 + off * CONTROL_M
        view = View(np.array((0.0, 0.0, body_down_m + z * BODY_M)), roll, pitch)
        if view.holds(np.concatenate([_points(box) for box in truth.tolist()])).any():
            seen = reported(view, truth, body_down_m, face, z)
        else:
            seen = []
        rig.look(seen, 3, (0.0, 0.0, body_down_m), (roll, pitch))
    assert half_band_m(rig.flight.assessment.terms) == pytest.approx(HALF_M)
    grid = rig.seen.grid()
    for box in truth.tolist():
        for north, east, down in _points(box).tolist():
            if abs(down + 5.0) <= HALF_M:
                assert not grid.is_free(north - 1e-6, north + 1e-6, east - 1e-6, east + 1e-6)
