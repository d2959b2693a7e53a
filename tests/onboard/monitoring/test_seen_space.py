"""Which frames say what is free, and what takes the set away."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import pytest

from onboard.files.contract_file import Contract
from onboard.geometry.box import Box
from onboard.geometry.frames import LegFrame
from onboard.guidance.dense.limits import rest_limits_of
from onboard.monitoring.assumptions import Assumption, Violation
from onboard.monitoring.seen.seen_space import START_MARGIN_M, TURN_MAX_RADPS, SeenSpace
from onboard.perception.detection import Detection, DetectionFrame
from onboard.perception.line_of_sight import View
from onboard.perception.placement import POSE_TIMING_S
from onboard.perception.pose_history import PoseHistory
from onboard.perception.seen_free import CELL_M, SeenFree
from onboard.planning.corridor.horizon import Horizon
from onboard.planning.rest_certifier import certify_rest
from onboard.vehicle_state import Pose
from tests.onboard.monitoring.fake_flight import FakeFlight

PERIOD_S = 0.05
HERE = ((0.0, 0.0),)


def stem(north_m: float, east_m: float, side_m: float = 0.4, yaw_deg: float = 0.0) -> Detection:
    return Detection(
        id=f"{north_m:g} {east_m:g}",
        center_m=(north_m, east_m),
        size_m=(side_m, side_m),
        yaw_deg=yaw_deg,
        uncertainty_m=0.05,
    )


@dataclass
class Scene:
    """A vehicle on a leg north, its sensor, and the set."""

    flight: FakeFlight
    frames_needed: int = 2
    yaw_rate_radps: float = 0.0
    position_ned_m: tuple[float, float, float] = (0.0, 0.0, -4.0)
    velocity_ned_mps: tuple[float, float, float] = (0.0, 0.0, 0.0)
    yaw_rad: float = 0.0
    now_s: float = 1.0
    sequence: int = 0
    poses: PoseHistory = field(default_factory=PoseHistory)

    def __post_init__(self) -> None:
        self.space = SeenSpace(self.flight, self.poses, frames_needed=self.frames_needed)

    @property
    def pose(self) -> Pose:
        return Pose(self.now_s, self.position_ned_m, self.velocity_ned_mps, 0.0, 0.0, self.yaw_rad)

    def fly(self, seconds_s: float = PERIOD_S) -> None:
        for _ in range(round(seconds_s / 0.01)):
            self.now_s += 0.01
            self.yaw_rad += 0.01 * self.yaw_rate_radps
            north_m, east_m, down_m = self.position_ned_m
            vn, ve, vd = self.velocity_ned_mps
            self.position_ned_m = (north_m + 0.01 * vn, east_m + 0.01 * ve, down_m + 0.01 * vd)
            self.poses.add(self.pose)

    def frame(self, obstacles: Sequence[Detection] = (), **changed: Any) -> DetectionFrame:
        self.sequence += 1
        stated: dict[str, Any] = {
            "version": 1, "source": "front", "sequence": self.sequence,
            "stamp_unix_s": self.now_s, "frame": "local_ned", "range_m": 12.0,
            "field_of_view_deg": 120.0, "obstacles": tuple(obstacles),
        }  # fmt: skip
        return DetectionFrame(**stated | changed)

    def look(
        self,
        *obstacles: Detection,
        shifts_m: Sequence[tuple[float, float]] = HERE,
        late_s: float = 0.03,
        trusted: bool = True,
        **changed: Any,
    ) -> Violation | None:
        """Fly on for a frame's time, see, and have the frame counted."""
        self.fly()
        frame, stamp_s = self.frame(obstacles, **changed), self.now_s
        self.fly(late_s)
        self.space.take(frame, stamp_s, self.now_s, shifts_m)
        return self.space.advance(self.pose, trusted=trusted)

    def is_free(self, x_m: float, y_m: float) -> bool:
        return self.space.grid().is_free(x_m - 0.01, x_m + 0.01, y_m - 0.01, y_m + 0.01)


@pytest.fixture
def scene(contract: Contract) -> Scene:
    return Scene(FakeFlight.under(contract))


def test_frames_free_what_they_show(scene: Scene) -> None:
    assert scene.look() is None
    assert scene.space.size == 0
    assert scene.look() is None
    assert scene.is_free(6.0, 0.0)
    assert not scene.is_free(-6.0, 0.0)
    assert not scene.is_free(12.1, 0.0)
    assert scene.space.version > 0


def test_an_empty_frame_of_a_crashed_detector_frees_nothing(contract: Contract) -> None:
    scene = Scene(FakeFlight.under(contract), frames_needed=3)
    wall = stem(5.0, 0.0, 3.0)
    for _ in range(3):
        scene.look(wall)
    assert not scene.is_free(9.0, 0.0)
    for _ in range(2):
        scene.look()  # the detector has crashed, and starts again
        assert not scene.is_free(5.0, 0.0)
        assert not scene.is_free(9.0, 0.0)
    scene.look(wall)
    scene.look()
    assert not scene.is_free(9.0, 0.0)


def test_what_the_map_remembers_stays_in_the_way(scene: Scene) -> None:
    corners = [(4.0, -1.0), (5.0, -1.0), (5.0, 1.0), (4.0, 1.0)]
    scene.flight.obstacles.add("front/1", corners, 0.05)
    for _ in range(4):
        scene.look()
    assert scene.is_free(3.5, 0.0)
    assert not scene.is_free(4.5, 0.0)
    assert not scene.is_free(9.0, 0.0)
    assert scene.space.boxes() == [Box(4.0, 5.0, -1.0, 1.0)]


@pytest.mark.parametrize(
    "changed",
    [
        {"late_s": 1.0},
        {"shifts_m": ((0.0, 0.0), (1.0, 0.0))},
        {"trusted": False},
        {"crowd": tuple(stem(50.0, float(n)) for n in range(300))},
    ],
)
def test_a_frame_that_may_be_wrong_does_not_count(scene: Scene, changed: dict[str, Any]) -> None:
    changed = dict(changed)
    scene.look()
    scene.look(*changed.pop("crowd", ()), **changed)
    assert scene.space.size == 0
    scene.look()
    assert scene.space.size == 0  # the row has begun again
    scene.look()
    assert scene.space.size > 0


def test_a_skipped_frame_breaks_the_row_after_those_that_wait(scene: Scene) -> None:
    scene.look()
    scene.fly()
    scene.space.take(scene.frame(), scene.now_s, scene.now_s, HERE)  # waits
    scene.space.skip(scene.frame())
    scene.fly()
    scene.space.take(scene.frame(), scene.now_s, scene.now_s, HERE)
    scene.space.advance(scene.pose, trusted=True)
    assert scene.space.size > 0  # the first two are successive
    scene.space.void("for the rest")
    scene.look()
    scene.fly()
    scene.space.skip(scene.frame())
    scene.space.take(scene.frame(), scene.now_s, scene.now_s, HERE)
    scene.space.advance(scene.pose, trusted=True)
    assert scene.space.size == 0


def test_frames_on_both_sides_of_a_skipped_one_are_not_successive(scene: Scene) -> None:
    scene.fly()
    scene.space.take(scene.frame(), scene.now_s, scene.now_s, HERE)
    scene.space.skip(scene.frame())
    scene.fly()
    scene.space.take(scene.frame(), scene.now_s, scene.now_s, HERE)
    for _ in range(3):
        scene.space.advance(scene.pose, trusted=True)
    assert scene.space.size == 0


def test_the_same_frame_counts_once(scene: Scene) -> None:
    scene.fly()
    frame, stamp_s = scene.frame(), scene.now_s
    for _ in range(4):
        scene.fly(0.02)
        scene.space.take(frame, stamp_s, scene.now_s, HERE)
        scene.space.advance(scene.pose, trusted=True)
    assert scene.space.size == 0


def test_a_frame_without_a_pose_of_its_time_does_not_count(scene: Scene) -> None:
    for _ in range(4):
        scene.now_s += 0.3  # no telemetry
        stamp_s = scene.now_s
        scene.space.take(scene.frame(), stamp_s, scene.now_s, HERE)
        scene.space.advance(scene.pose, trusted=True)
    assert scene.space.size == 0


@pytest.mark.parametrize(("share", "counts"), [(0.9, True), (1.1, False), (-1.1, False)])
def test_frames_of_a_fast_turn_do_not_count(scene: Scene, share: float, counts: bool) -> None:
    scene.yaw_rate_radps = share * TURN_MAX_RADPS
    scene.fly(0.5)
    for _ in range(4):
        scene.look()
    assert (scene.space.size > 0) == counts


def test_frames_of_climb_and_descent_do_not_count(scene: Scene) -> None:
    limit_m = scene.flight.assessment.terms.tracking_error_z_m
    for down_m in (-4.0 + 1.1 * limit_m, -4.0 - 1.1 * limit_m):
        scene.position_ned_m = (0.0, 0.0, down_m)
        for _ in range(4):
            scene.look()
        assert scene.space.size == 0
    scene.position_ned_m = (0.0, 0.0, -4.0 - 0.9 * limit_m)
    for _ in range(2):
        scene.look()
    assert scene.space.size > 0


def test_leaving_the_height_ends_a_look_all_round(scene: Scene) -> None:
    look_round(scene, free_range_m=(2.0,) * 4)
    scene.space._set.void()
    scene.position_ned_m = (0.0, 0.0, 0.0)
    scene.space.advance(scene.pose, trusted=True)
    scene.position_ned_m = (0.0, 0.0, -4.0)
    assert not scene.space.confirm_start(0.0, 0.0)


def test_leaving_the_height_voids_the_set(scene: Scene) -> None:
    for _ in range(2):
        scene.look()
    assert scene.space.size > 0
    scene.position_ned_m = (0.0, 0.0, 0.0)
    scene.space.advance(scene.pose, trusted=True)
    assert scene.space.size == 0
    assert "height" in scene.space.void_reason


def test_range_and_view_are_those_of_the_frame_and_never_more_than_the_contracts(
    scene: Scene,
) -> None:
    for _ in range(2):
        scene.look(range_m=40.0, field_of_view_deg=360.0)
    terms = scene.flight.assessment.terms
    assert not scene.is_free(terms.detection_range_m, 0.0)
    assert not scene.is_free(-4.0, 0.0)
    other = Scene(scene.flight)
    for _ in range(2):
        other.look(range_m=5.0, field_of_view_deg=40.0)
    assert other.is_free(4.5, 0.0)
    assert not other.is_free(5.5, 0.0)
    assert not other.is_free(3.0, 2.0)
    assert scene.is_free(3.0, 2.0)


def test_a_scan_limits_what_boxes_leave_free(scene: Scene) -> None:
    for _ in range(2):
        scene.look(stem(3.0, 0.0, 1.0), free_range_m=(8.0, 8.0, 0.0, 8.0))
    assert scene.is_free(5.0, -3.0)
    assert not scene.is_free(9.0, -5.0)
    assert not scene.is_free(5.0, 1.0)
    assert not scene.is_free(5.0, 0.0)
    assert not scene.is_free(5.0, -0.2)  # behind the stem


def declaring(contract: Contract, **sensor: float) -> Scene:
    changed = contract.sensor.model_copy(update=sensor)
    return Scene(FakeFlight.under(contract.model_copy(update={"sensor": changed})))


def test_no_return_shows_no_free_space_unless_that_is_declared(contract: Contract) -> None:
    scan = (8.0, None, None, 8.0)
    silent, declared = declaring(contract), declaring(contract, no_return_is_free_to_m=6.0)
    for scene in (silent, declared):
        for _ in range(2):
            scene.look(free_range_m=scan)
        assert scene.is_free(5.0, -4.0)
    assert not silent.is_free(5.0, 0.0)
    assert declared.is_free(5.0, 0.0)
    assert not declared.is_free(6.5, 0.0)


def test_a_scan_frees_only_what_its_rays_resolve(contract: Contract) -> None:
    """Beyond that, the thinnest obstacle declared may stand between two of them."""
    bins, half_m = 60, 6.0
    thin_m = half_m * math.radians(120.0) / bins
    scene = declaring(contract, thinnest_obstacle_m=thin_m)
    for _ in range(2):
        scene.look(free_range_m=(12.0,) * bins)
    assert scene.is_free(half_m - 0.5, 0.0)
    assert not scene.is_free(half_m + 0.2, 0.0)
    boxes = declaring(contract, thinnest_obstacle_m=thin_m)
    for _ in range(2):
        boxes.look()
    assert boxes.is_free(9.0, 0.0)


# ------------------------------------------------------------------ contradictions


def contradicted(violation: Violation | None) -> bool:
    return violation is not None and violation.assumption is Assumption.SENSOR_CONTRADICTION


def test_an_obstacle_where_all_was_seen_free_is_a_contradiction(scene: Scene) -> None:
    for _ in range(2):
        scene.look()
    violation = scene.look(stem(6.0, 0.0))
    assert contradicted(violation)
    assert violation is not None
    assert violation.subject == "front/6 0"
    assert scene.space.size == 0
    assert "front/6 0" in scene.space.void_reason
    for _ in range(4):
        assert scene.look(stem(6.0, 0.0)) is None  # seen anew, it fits
    assert scene.is_free(3.0, 0.0)


@pytest.mark.parametrize("yaw_deg", [0.0, 30.0, 45.0, 170.0])
def test_an_obstacle_at_the_end_of_what_was_seen_is_none(scene: Scene, yaw_deg: float) -> None:
    for _ in range(2):
        scene.look(range_m=6.0)
    for _ in range(4):
        assert scene.look(stem(6.5, 0.3, 1.0, yaw_deg=yaw_deg)) is None
    assert scene.is_free(3.0, 0.0)


@pytest.mark.parametrize("yaw_deg", [0.0, 20.0, 45.0])
def test_faces_that_are_off_by_their_error_contradict_nothing(scene: Scene, yaw_deg: float) -> None:
    e = scene.flight.assessment.terms.position_error_m
    for step in range(20):
        off_m = e if step % 2 else -e
        seen = stem(6.0 + off_m, 0.0, 1.0, yaw_deg=yaw_deg)
        assert not contradicted(scene.look(seen.model_copy(update={"id": "1"})))
    assert scene.is_free(4.0, 0.0)


def test_a_box_far_larger_than_the_grid_is_looked_at_quickly(scene: Scene) -> None:
    for _ in range(2):
        scene.look()
    assert not contradicted(scene.look(stem(0.0, 3000.0, 6000.0, yaw_deg=1.0)))


# ------------------------------------------------------------------ start, legs, resets


def test_the_start_is_confirmed_where_no_obstacle_is_known(scene: Scene) -> None:
    terms = scene.flight.assessment.terms
    look_round(scene)
    assert scene.space.confirm_start(0.0, 0.0)
    body_m = terms.body_m
    assert scene.space.grid().is_free(-body_m, body_m, -body_m, body_m)
    scene.space.void("for the next place")
    scene.flight.obstacles.add("front/1", [(20.0, 0.6), (20.5, 0.6), (20.5, 1.1), (20.0, 1.1)], 0.0)
    for north_m, confirmed in ((20.0, False), (15.0, True)):
        scene.position_ned_m = (north_m, 0.0, -4.0)
        look_round(scene)
        assert scene.space.confirm_start(north_m, 0.0) == confirmed
        assert scene.is_free(north_m, 0.0) == confirmed


@pytest.mark.parametrize(
    "blind",
    [
        {"field_of_view_deg": 20.0},
        {"range_m": 0.8},
        {"free_range_m": (0.0, 0.0, 12.0, 12.0)},
    ],
)
def test_a_start_that_frames_do_not_show_all_round_is_not_confirmed(
    scene: Scene, blind: dict[str, Any]
) -> None:
    assert not scene.space.confirm_start(0.0, 0.0)  # no frame has shown it
    look_round(scene, **blind)
    assert not scene.space.confirm_start(0.0, 0.0)
    assert not scene.is_free(0.0, 0.0)
    look_round(scene)
    assert not scene.space.confirm_start(5.0, 0.0)  # from elsewhere
    assert scene.space.confirm_start(0.0, 0.0)


def test_a_look_round_survives_a_declared_reset(scene: Scene) -> None:
    look_round(scene)
    scene.space.shift((2.0, -1.0, 0.0))
    assert not scene.space.confirm_start(0.0, 0.0)
    assert scene.space.confirm_start(2.0, -1.0)


def test_frames_of_two_sensors_do_not_make_up_for_each_other(scene: Scene) -> None:
    for source in ("front", "second", "front"):
        scene.look(source=source)
    assert scene.space.frames_counted == 2


def look_round(scene: Scene, **changed: Any) -> None:
    for quarter in range(4):
        scene.yaw_rad = quarter * math.pi / 2.0
        scene.fly(0.5)
        for _ in range(scene.frames_needed):
            scene.look(**changed)


def test_what_was_seen_before_the_position_was_doubted_is_not_free_afterwards(
    scene: Scene,
) -> None:
    for _ in range(2):
        scene.look()
    assert scene.space.size > 0
    scene.space.advance(scene.pose, trusted=False)
    assert scene.space.size == 0


def test_the_set_is_stated_in_the_frame_of_the_next_leg(scene: Scene) -> None:
    for _ in range(2):
        scene.look()
    assert scene.is_free(6.0, 0.5)
    before = scene.space.version
    scene.flight.leg = LegFrame((4.0, 0.0, -4.0), math.pi / 2.0)  # on to the east
    assert scene.is_free(0.5, -2.0)
    assert not scene.is_free(0.5, 5.0)
    assert scene.space.version > before
    # Frames that wait were seen in the frame of the leg before.
    scene.fly()
    scene.space.take(scene.frame(), scene.now_s, scene.now_s, HERE)
    scene.flight.leg = LegFrame((4.0, 0.0, -4.0), 0.0)
    size = scene.space.size
    scene.space.advance(scene.pose, trusted=True)
    assert scene.space.size <= size


@pytest.mark.parametrize("turn_deg", [30.0, 45.0, 90.0, 200.0])
def test_where_the_vehicle_rests_between_two_legs_stays_certified(
    contract: Contract, turn_deg: float
) -> None:
    """The cells of another raster take up to two of theirs from the place: not from the disc."""
    scene = Scene(FakeFlight.under(contract))
    limits = rest_limits_of(scene.flight.assessment, any_heading=True)
    scene.space._set.confirm(3.0, 0.2, limits.body_radius_m + 0.2)
    assert rests_at(scene, 3.0, 0.2)
    assert not rests_at(scene, 3.15, 0.2)
    scene.flight.leg = LegFrame((3.0, 0.2, -4.0), math.radians(turn_deg))
    assert rests_at(scene, 0.0, 0.0)
    assert not rests_at(scene, 0.3, 0.0)
    scene.space.shift((0.4, 0.0, 0.0))
    x_m, y_m, _ = scene.flight.leg.vector_leg((0.4, 0.0, 0.0))
    assert rests_at(scene, x_m, y_m)
    scene.space.void("a contradiction")
    assert not rests_at(scene, x_m, y_m)


def rests_at(scene: Scene, x_m: float, y_m: float) -> bool:
    limits = rest_limits_of(scene.flight.assessment, any_heading=True)
    hover = Horizon.at_rest(0.0, x_m, y_m).trajectory(0.0)
    return certify_rest(hover, hover.sample(0.0), 0.0, limits, scene.space.grid()).valid


def test_a_leg_at_another_height_has_not_been_seen(scene: Scene) -> None:
    for _ in range(2):
        scene.look()
    scene.flight.leg = LegFrame((0.0, 0.0, -9.0), 0.0)
    assert not scene.is_free(6.0, 0.0)
    assert scene.space.size == 0


def test_the_corridor_stays_in_force(scene: Scene) -> None:
    scene.space.limit(1.0)
    for _ in range(2):
        scene.look()
    assert scene.is_free(6.0, 0.5)
    assert not scene.is_free(6.0, 1.5)
    scene.flight.leg = LegFrame((0.0, 0.0, -4.0), 0.1)
    assert scene.is_free(6.0, 0.0)
    assert not scene.is_free(6.0, 1.5)


def test_a_declared_reset_shifts_the_set(scene: Scene) -> None:
    for _ in range(2):
        scene.look(stem(6.0, 0.0, 1.0))
    assert scene.is_free(4.0, 1.0)
    scene.space.shift((0.0, 3.0, 0.2))
    assert scene.is_free(4.0, 4.0)
    assert not scene.is_free(4.0, -4.5)
    assert not scene.is_free(6.0, 3.0)
    scene.space.shift((0.0, 0.0, 5.0))
    assert scene.space.size == 0


def test_frames_before_a_reset_are_not_counted_after_it(scene: Scene) -> None:
    scene.look()
    scene.fly()
    scene.space.take(scene.frame(), scene.now_s, scene.now_s, HERE)
    scene.space.shift((0.0, 3.0, 0.0))
    scene.space.advance(scene.pose, trusted=True)
    assert scene.space.size == 0


def test_one_frame_a_tick_unless_more_wait(scene: Scene) -> None:
    for source in ("left", "right"):
        for _ in range(2):
            scene.fly()
            frame = scene.frame(source=source, field_of_view_deg=90.0)
            scene.space.take(frame, scene.now_s, scene.now_s, HERE)
    sizes = []
    for _ in range(4):
        scene.space.advance(scene.pose, trusted=True)
        sizes.append(scene.space.size)
    assert sizes[0] > 0  # two of four
    assert sizes[3] >= sizes[0]
    for _ in range(40):
        scene.fly()
        scene.space.take(scene.frame(), scene.now_s, scene.now_s, HERE)
    for _ in range(10):
        scene.space.advance(scene.pose, trusted=True)
    assert scene.space.advance(scene.pose, trusted=True) is None


# ------------------------------------------------------------------ a tracker in the sensor


def false_cells(contract: Contract, *, confirms_on: int, frames_needed: int) -> int:
    """Fly past stems which a tracker reports from its n-th sight on; count false cells."""
    flight = FakeFlight.under(contract)
    flight.assessment = replace(
        flight.assessment,
        terms=replace(flight.assessment.terms, field_of_view_rad=math.radians(90.0)),
    )
    scene = Scene(flight, frames_needed=frames_needed, velocity_ned_mps=(6.0, 0.0, 0.0))
    stems = [(13.0 + 4.3 * n, (-3.1, 0.9, 2.6, -1.2)[n % 4]) for n in range(12)]
    sights = [0] * len(stems)
    wrong = 0
    for _ in range(100):
        scene.fly(0.1)
        north_m, east_m, _ = scene.position_ned_m
        reported = []
        for index, (x_m, y_m) in enumerate(stems):
            ahead_m, aside_m = x_m - north_m, abs(y_m - east_m)
            near = math.hypot(max(ahead_m - 0.2, 0.0), max(aside_m - 0.2, 0.0)) <= 12.0
            inside = near and ahead_m + 0.2 > 0.0 and aside_m - 0.2 <= ahead_m + 0.2
            sights[index] = sights[index] + 1 if inside else 0
            if inside and sights[index] >= confirms_on:
                reported.append(stem(x_m, y_m))
        scene.space.take(scene.frame(reported), scene.now_s, scene.now_s, HERE)
        scene.space.advance(scene.pose, trusted=True)
        wrong += sum(
            scene.space.grid().is_free(x_m + dx, x_m + dx, y_m + dy, y_m + dy)
            for x_m, y_m in stems
            for dx in (-0.19, 0.0, 0.19)
            for dy in (-0.19, 0.0, 0.19)
        )
    assert scene.space.size > 1000
    return wrong


@pytest.mark.parametrize("frames", [2, 4])
def test_as_many_frames_as_a_tracker_needs_to_confirm_let_no_stem_be_free(
    contract: Contract, frames: int
) -> None:
    assert false_cells(contract, confirms_on=frames, frames_needed=frames) == 0
    # One frame less is not enough: the test would see it.
    assert false_cells(contract, confirms_on=frames, frames_needed=frames - 1) > 0


# ------------------------------------------------------------------ the operator's word


def test_the_operators_word_is_taken_once_and_is_void_with_the_set(scene: Scene) -> None:
    scene.space.confirm_by_word(0.0, 0.0, 3.0)
    assert scene.is_free(-2.0, 0.0)
    scene.space.void("tested")
    scene.space.confirm_by_word(0.0, 0.0, 3.0)
    assert not scene.is_free(0.0, 0.0)


@pytest.mark.parametrize("moved", ["reset", "doubt"])
def test_a_word_about_a_frame_that_moved_or_is_in_doubt_is_never_taken(
    scene: Scene, moved: str
) -> None:
    if moved == "reset":
        scene.space.shift((2.0, 0.0, 0.0))
    else:
        scene.space.void("tested")
    scene.space.confirm_by_word(0.0, 0.0, 3.0)
    assert not scene.is_free(0.0, 0.0)


def test_a_climb_before_the_departure_leaves_the_word(scene: Scene) -> None:
    scene.space.void("tested", frame_stands=True)
    scene.space.confirm_by_word(0.0, 0.0, 3.0)
    assert scene.is_free(0.0, 0.0)


def test_an_obstacle_seen_inside_the_operators_disc_contradicts_the_word(scene: Scene) -> None:
    scene.space.confirm_by_word(0.0, 0.0, 3.0)
    found = scene.look(stem(3.5, 0.0, side_m=2.0))
    assert found is not None
    assert found.assumption is Assumption.SENSOR_CONTRADICTION
    assert scene.space.size == 0


# ------------------------------------------------------------------ what a frame may be wrong about


def seen_as(scene: Scene, monkeypatch: pytest.MonkeyPatch, *obstacles: Detection) -> View:
    """Return the view as which a frame is counted."""
    views: list[View] = []
    monkeypatch.setattr(SeenFree, "see", lambda _, view, __: views.append(view))
    scene.look(*obstacles, late_s=0.0)
    (view,) = views
    return view


@pytest.mark.parametrize("speed_mps", [0.0, 3.0])
def test_a_frame_is_seen_from_where_the_vehicle_was_and_off_by_all_its_errors(
    contract: Contract, monkeypatch: pytest.MonkeyPatch, speed_mps: float
) -> None:
    leg = LegFrame((2.0, 1.0, -4.0), math.radians(30.0))
    flight = FakeFlight.under(contract)
    terms = replace(flight.assessment.terms, heading_error_rad=0.02)
    flight.assessment, flight.leg = replace(flight.assessment, terms=terms), leg
    scene = Scene(flight, position_ned_m=(5.0, 3.0, -4.0), yaw_rad=0.7)
    scene.velocity_ned_mps = (0.6 * speed_mps, -0.8 * speed_mps, 0.0)
    view = seen_as(scene, monkeypatch)
    assert view.position_leg_m == pytest.approx(leg.position_leg(scene.position_ned_m)[:2])
    assert view.heading_leg_rad == pytest.approx(0.7 - math.radians(30.0))
    assert view.heading_error_rad == pytest.approx(0.02)
    assert view.pose_error_m == pytest.approx(speed_mps * POSE_TIMING_S)
    e = terms.map_error_m
    assert view.face_error_m == pytest.approx(1.02 * e)
    assert view.placing_error_m == pytest.approx(math.sqrt(2.0) * e)


@pytest.mark.parametrize("frame", ["body_frd", "local_ned"])
def test_boxes_are_placed_by_the_pose_if_their_frame_is_the_body_s(
    scene: Scene, monkeypatch: pytest.MonkeyPatch, frame: str
) -> None:
    scene.position_ned_m, scene.yaw_rad = (5.0, 3.0, -4.0), math.pi / 2.0
    monkeypatch.setattr(
        scene, "frame", lambda obstacles: Scene.frame(scene, obstacles, frame=frame)
    )
    view = seen_as(scene, monkeypatch, stem(2.0, 1.0))
    (box,) = view.boxes
    middle_m = ((box.x_min_m + box.x_max_m) / 2.0, (box.y_min_m + box.y_max_m) / 2.0)
    # Two metres ahead, which is east, and one to the right, which is south.
    assert middle_m == pytest.approx((4.0, 5.0) if frame == "body_frd" else (2.0, 1.0))


@pytest.mark.parametrize(("gap_s", "counts"), [(0.04, True), (0.08, False)])
def test_a_frame_counts_only_with_a_pose_of_about_its_time(
    scene: Scene, gap_s: float, counts: bool
) -> None:
    for _ in range(2):
        scene.fly(0.3)
        scene.now_s += gap_s  # without telemetry
        scene.space.take(scene.frame(), scene.now_s, scene.now_s, HERE)
        scene.space.advance(scene.pose, trusted=True)
    assert (scene.space.size > 0) is counts


def test_a_contradiction_is_one_box_too_many(scene: Scene) -> None:
    for _ in range(2):
        scene.look()
    violation = scene.look(stem(6.0, 0.0))
    assert violation is not None
    assert (violation.measured, violation.limit, violation.unit) == (1.0, 0.0, "boxes")


def test_obstacles_are_known_in_every_direction(scene: Scene) -> None:
    boxes = [Box(5.0, 5.5, -0.2, 0.2), Box(-5.5, -5.0, -0.2, 0.2), Box(-0.2, 0.2, -5.5, -5.0)]
    for number, box in enumerate(boxes):
        north_m, east_m = (box.x_min_m, box.x_max_m), (box.y_min_m, box.y_max_m)
        corners = [(north_m[i], east_m[j]) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
        scene.flight.obstacles.add(f"front/{number}", corners, 0.0)
    known = sorted(scene.space.boxes(), key=lambda box: (box.x_min_m, box.y_min_m))
    assert known == sorted(boxes, key=lambda box: (box.x_min_m, box.y_min_m))


def test_an_obstacle_that_may_reach_into_the_disc_by_its_error_denies_the_word(
    contract: Contract,
) -> None:
    for share, confirmed in ((0.9, False), (1.1, True)):
        scene = Scene(FakeFlight.under(contract))
        reach_m = 3.0 + share * math.sqrt(2.0) * scene.flight.assessment.terms.map_error_m
        corners = [(reach_m, -0.5), (reach_m + 1.0, -0.5), (reach_m + 1.0, 0.5), (reach_m, 0.5)]
        scene.flight.obstacles.add("front/1", corners, 0.0)
        scene.space.confirm_by_word(0.0, 0.0, 3.0)
        assert scene.is_free(0.0, 0.0) is confirmed


def test_a_look_at_another_height_leaves_the_operators_word(scene: Scene) -> None:
    for _ in range(2):
        scene.look()
    scene.position_ned_m = (0.0, 0.0, 0.0)
    scene.space.advance(scene.pose, trusted=True)
    assert "height" in scene.space.void_reason
    scene.space.confirm_by_word(0.0, 0.0, 3.0)
    assert scene.is_free(0.0, 0.0)


def test_a_confirmed_start_holds_the_body_wherever_it_drifts_and_little_more(scene: Scene) -> None:
    look_round(scene)
    scene.space._set.void()
    assert scene.space.confirm_start(0.0, 0.0)
    body_m, grid = scene.flight.assessment.terms.body_m, scene.space.grid()
    for turn_deg in range(0, 360, 15):
        turn_rad = math.radians(turn_deg)
        x_m, y_m = START_MARGIN_M * math.cos(turn_rad), START_MARGIN_M * math.sin(turn_rad)
        assert grid.is_free(x_m - body_m, x_m + body_m, y_m - body_m, y_m + body_m)
    beyond_m = math.sqrt(2.0) * (body_m + CELL_M) + START_MARGIN_M + 0.01
    assert not scene.is_free(beyond_m, 0.0)
    assert not scene.is_free(0.0, -beyond_m)
