"""What frames tell of movers: where none can be, tracks, and assumptions that movers break."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from typing import Any

import pytest

from onboard.files.contract_file import Contract
from onboard.files.yaml_file import validate
from onboard.mavlink.endpoint import TELEMETRY_RATE_HZ
from onboard.monitoring.assumptions import Assumption, Violation, check_frame
from onboard.monitoring.detection_evaluation import DetectionEvaluator
from onboard.monitoring.estimator.heading import HeadingMonitor
from onboard.monitoring.movers.mover_space import MoverSpace, bounds_of
from onboard.monitoring.movers.rest_speed import RestSpeedMonitor
from onboard.monitoring.seen.sight import Sight
from onboard.motion.trajectory import State
from onboard.perception.intake import DetectionCounters
from onboard.perception.movers.tracker import Bound
from onboard.perception.pose_history import PoseHistory
from onboard.perception.sources.json_v1 import parse_frame
from onboard.vehicle_state import Pose
from tests.onboard.monitoring.fake_flight import FakeFlight

PERIOD_S = 0.05
PERSON = {
    "id": "1", "size_m": [0.6, 0.6], "yaw_deg": 0.0, "uncertainty_m": 0.05,
    "motion": "moving", "class": "person", "box_whole": True,
}  # fmt: skip
TREE = {**PERSON, "id": "t", "motion": "static", "class": "unknown"}


def against_movers(contract: Contract, *, hidden: bool = False, level: str = "passive") -> Contract:
    """Return a contract that requires passive safety against people."""
    data = contract.model_dump(mode="json")
    person = {"class": "person", "speed_max_mps": 1.5, "size_max_m": 1.0, "hidden": hidden}
    data["vehicle"] |= {"rest_settle_s": 0.4, "setpoint_loss_run_time_s": 3.0}
    data["requirements"] |= {"stop": True, "movers": level}
    data["sensor"] |= {"all_round_range_m": 8.0}
    data["environment"] |= {"movers": [person]}
    return validate(data, Contract, source="test")


@dataclass
class Scene:
    """A vehicle at rest that two sensors look from."""

    flight: FakeFlight
    now_s: float = 1.0
    sequence: int = 0
    poses: PoseHistory = field(default_factory=PoseHistory)

    def __post_init__(self) -> None:
        counters = DetectionCounters()
        self.evaluator = DetectionEvaluator(
            self.flight, self.poses, lambda _: ((0.0, 0.0),), counters
        )
        self.heading = HeadingMonitor()

    @property
    def movers(self) -> MoverSpace:
        return self.evaluator.movers

    @property
    def pose(self) -> Pose:
        return Pose(self.now_s, (0.0, 0.0, -4.0), (0.0, 0.0, 0.0), 0.0, 0.0, 0.0)

    def look(self, *obstacles: dict[str, Any], **changed: Any) -> list[Violation]:
        """See one frame of the ring after a frame's time; return what it violates."""
        self.wait(PERIOD_S)
        self.sequence += 1
        message = {
            "version": 2, "source": "ring", "sequence": self.sequence, "frame": "local_ned",
            "stamp_unix_s": self.now_s, "range_m": 12.0, "field_of_view_deg": 360.0,
            "frame_complete": True, "obstacles": list(obstacles),
        }  # fmt: skip
        frame = parse_frame(_json({**message, **changed}))
        found = list(self.evaluator.evaluate(frame, self.now_s, self.now_s, self.heading))
        self.evaluator.seen.advance(self.pose, trusted=True)
        return found

    def wait(self, duration_s: float) -> None:
        """See nothing for a while."""
        for _ in range(round(duration_s * TELEMETRY_RATE_HZ)):
            self.now_s += 1.0 / TELEMETRY_RATE_HZ
            self.poses.add(self.pose)

    def look_late(self) -> None:
        """See a frame of the ring that is older than all that have counted."""
        self.sequence += 1
        message = {
            "version": 2, "source": "ring", "sequence": self.sequence, "frame": "local_ned",
            "stamp_unix_s": self.now_s, "range_m": 12.0, "field_of_view_deg": 360.0,
            "frame_complete": True, "obstacles": [],
        }  # fmt: skip
        sight = Sight(parse_frame(_json(message)), self.pose, 0.0, [], [], [], 0.5)
        assert self.movers.see(sight) == []

    def is_free(self, north_m: float, east_m: float, in_s: float = 0.0) -> bool:
        free = self.movers.free
        assert free is not None
        return free.is_free_at(north_m, east_m, self.now_s + in_s + 0.01)


def _json(message: dict[str, Any]) -> bytes:
    return json.dumps(message).encode()


def person(north_m: float, east_m: float = 0.0, **keys: Any) -> dict[str, Any]:
    return {**PERSON, "center_m": [north_m, east_m], **keys}


def tree(north_m: float, east_m: float = 0.0, **keys: Any) -> dict[str, Any]:
    return {**TREE, "center_m": [north_m, east_m], **keys}


def names(found: list[Violation]) -> list[Assumption]:
    return [violation.assumption for violation in found]


@pytest.fixture
def scene(contract: Contract) -> Scene:
    return Scene(FakeFlight.under(against_movers(contract)))


def test_movers_are_tracked_and_no_part_of_the_map(scene: Scene) -> None:
    for step in range(6):
        assert scene.look(person(5.0 - 0.07 * step), tree(0.0, 6.0)) == []
    assert [track.id for track in scene.movers.tracks] == ["ring/1"]
    assert [obstacle.id for obstacle in scene.flight.obstacles] == ["ring/t"]
    movers = scene.movers.movers
    assert movers is not None
    assert len(movers.tracks) == 1
    assert scene.is_free(1.0, 0.0)
    assert not scene.is_free(1.0, 0.0, in_s=2.5)
    assert not scene.is_free(4.6, 0.0)


def missing(scene: Scene) -> str | None:
    movers = scene.movers.movers
    assert movers is not None
    return movers.missing


def test_what_is_missing_before_a_place_counts_is_told(scene: Scene) -> None:
    assert missing(scene) == "no sensor has said where no mover is"
    scene.look(source="front", field_of_view_deg=120.0)
    scene.look()
    assert missing(scene) == "1 of 3 successive frames of ring have counted"
    assert scene.movers.refusal is None
    scene.look()
    scene.look()
    assert missing(scene) is None


def test_a_ring_of_1_hz_beside_a_sensor_of_10_hz_shows_where_no_mover_is(scene: Scene) -> None:
    """However many frames of the other come between: three of the ring make a row."""
    for tick in range(70):
        found = scene.look(source="front", field_of_view_deg=120.0)
        assert found == []
        scene.wait(PERIOD_S)
        if tick % 10 == 9:
            scene.look()
            rings = (tick + 1) // 10
            assert missing(scene) == (
                f"{rings} of 3 successive frames of ring have counted" if rings < 3 else None
            )
            # Behind, where it alone looks: in the first of the three it was seen far around.
            assert scene.is_free(-2.0, 0.0, in_s=0.3) == (rings >= 3)


def test_frames_that_never_count_are_a_reason_not_to_depart(scene: Scene) -> None:
    """A vehicle that departs all the same would wait for a mover that is not there."""
    for _ in range(3):
        assert scene.movers.refusal is None
        scene.look(frame_complete=False)
    assert scene.movers.refusal is not None
    assert "frames of ring show no place free of movers" in scene.movers.refusal
    assert "frame_complete" in (missing(scene) or "")
    # One that does not say so ahead matters little.
    for _ in range(3):
        scene.look()
        scene.look(source="front", field_of_view_deg=120.0, frame_complete=False)
    assert scene.movers.refusal is None
    assert missing(scene) is None


def test_frames_that_others_overtake_by_too_much_are_told_of(scene: Scene) -> None:
    for _ in range(12):
        scene.look(source="front", field_of_view_deg=120.0)
    free = scene.movers.free
    assert free is not None
    for _ in range(3):
        scene.look_late()
    assert free.dropped == 3
    assert "overtaken" in (scene.movers.refusal or "")


def test_the_space_seen_free_grows_around_movers_which_contradict_nothing(scene: Scene) -> None:
    for _ in range(6):
        assert scene.look() == []
    seen = scene.evaluator.seen
    size = seen.size
    assert size > 1000
    # It walks in from beyond the range, into what is seen free for what stands still.
    for step in range(60):
        found = scene.look(person(13.0 - 0.074 * step, motion="moving")) if step > 10 else []
        assert found == []
    assert seen.size >= size


def test_version_1_says_nothing_of_motion_so_that_all_may_move(scene: Scene) -> None:
    static = {key: TREE[key] for key in ("id", "size_m", "yaw_deg", "uncertainty_m")}
    scene.look({**static, "center_m": [5.0, 0.0]}, version=1)
    assert len(scene.movers.tracks) == 1
    assert len(scene.flight.obstacles) == 0


def test_without_the_requirement_everything_stands_still(contract: Contract) -> None:
    scene = Scene(FakeFlight.under(contract))
    assert scene.look(person(5.0)) == []
    assert not scene.movers.active
    assert scene.movers.movers is None
    assert [obstacle.id for obstacle in scene.flight.obstacles] == ["ring/1"]
    assert scene.movers.check_ring(100.0) is None


def test_what_moves_tells_no_heading(scene: Scene) -> None:
    """Seen from the body, a mover that passes turns as all would by an error of the heading."""
    for step in range(60):
        walks = person(4.0, -2.0 + 0.07 * step)
        assert names(scene.look(walks, frame="body_frd")) == []


def test_faster_than_its_class(scene: Scene) -> None:
    scene.look(person(5.0))
    (found,) = scene.look(person(4.5))
    assert found.assumption is Assumption.MOVER_CLASS
    assert found.limit == 1.5
    assert found.measured > 5.0


def test_a_known_name_where_no_mover_could_be_is_a_first_sight(scene: Scene) -> None:
    for _ in range(8):
        assert scene.look(person(5.0)) == []
    assert names(scene.look(person(-3.0))) == [Assumption.MOVER_FIRST_SIGHT]


def test_larger_than_its_class(scene: Scene) -> None:
    assert names(scene.look(person(5.0, size_m=[1.5, 0.4]))) == [Assumption.MOVER_CLASS]


def test_a_static_claim_that_moves_is_a_mover_from_then_on(scene: Scene) -> None:
    assert scene.look(tree(5.0)) == []
    found = scene.look(tree(5.4))
    assert Assumption.STATIC_CLAIM in names(found)
    scene.look(tree(5.5))
    assert [track.id for track in scene.movers.tracks] == ["ring/t"]


def test_who_is_first_seen_where_none_could_be(scene: Scene) -> None:
    for _ in range(8):
        assert scene.look() == []
    assert Assumption.MOVER_FIRST_SIGHT in names(scene.look(person(3.0)))


def test_a_new_name_for_a_known_mover_is_no_first_sight(scene: Scene) -> None:
    for _ in range(8):
        scene.look(person(3.0))
    assert scene.look(person(3.0, id="other")) == []


def test_a_frame_that_does_not_name_all_shows_nothing_free(scene: Scene) -> None:
    for _ in range(8):
        scene.look(frame_complete=False)
    assert not scene.is_free(1.0, 0.0)
    assert scene.evaluator.seen.size == 0


def test_behind_a_tree_none_hides_unless_the_contract_says_so(contract: Contract) -> None:
    for hidden in (False, True):
        scene = Scene(FakeFlight.under(against_movers(contract, hidden=hidden)))
        for _ in range(6):
            scene.look(tree(3.0))
        assert scene.is_free(5.0, 0.0) != hidden


def test_the_ring_has_to_be_heard(scene: Scene) -> None:
    age_max_s = scene.flight.assessment.terms.frame_age_max_s
    silent = scene.movers.check_ring(scene.now_s)
    assert silent is not None
    assert silent.assumption is Assumption.DETECTION_AGE
    scene.look(field_of_view_deg=120.0)
    assert scene.movers.check_ring(scene.now_s) is not None
    scene.look()
    assert scene.movers.check_ring(scene.now_s + 0.99 * age_max_s) is None
    assert scene.movers.check_ring(scene.now_s + 1.01 * age_max_s) is not None


def in_view(contract: Contract) -> Scene:
    return Scene(FakeFlight.under(against_movers(contract, level="passive_in_view")))


def test_in_view_no_ring_has_to_be_heard(contract: Contract) -> None:
    assert in_view(contract).movers.check_ring(100.0) is None


def test_in_view_the_operators_word_is_taken_for_the_place_of_the_vehicle(
    contract: Contract,
) -> None:
    scene = in_view(contract)
    scene.movers.begin_flight()
    assert not scene.is_free(0.0, 0.0)
    scene.movers.take_word(scene.pose, 6.0, scene.now_s)
    assert scene.is_free(0.0, 0.0, in_s=3.0)  # 1.5 m/s
    assert not scene.is_free(0.0, 0.0, in_s=4.1)
    for _ in range(5):
        assert scene.look(source="front", field_of_view_deg=120.0, range_m=12.0) == []
    assert scene.is_free(9.0, 0.0)
    assert not scene.is_free(-7.0, 0.0)
    # Where a ring is required, the operator's word counts for nothing.
    ringed = Scene(FakeFlight.under(against_movers(contract)))
    ringed.movers.take_word(ringed.pose, 6.0, ringed.now_s)
    assert not ringed.is_free(0.0, 0.0)


def test_a_mover_that_is_seen_contradicts_the_word(contract: Contract) -> None:
    scene = in_view(contract)
    scene.look(person(5.0), source="front", field_of_view_deg=120.0)
    near = scene.movers.near
    assert near(scene.pose, 6.0, scene.now_s) == ["front/1"]
    assert near(scene.pose, 3.0, scene.now_s) == []
    assert near(scene.pose, 3.0, scene.now_s + 2.0) == ["front/1"]
    assert near(None, 6.0, scene.now_s) == []


def test_a_ring_may_see_less_far_than_what_looks_ahead(contract: Contract) -> None:
    terms = FakeFlight.under(against_movers(contract)).assessment.terms
    message = {
        "version": 2, "source": "ring", "sequence": 1, "stamp_unix_s": 0.0, "frame": "local_ned",
        "range_m": 8.0, "field_of_view_deg": 360.0, "obstacles": [],
    }  # fmt: skip
    assert check_frame(parse_frame(_json(message)), terms) == []
    shorter = parse_frame(_json({**message, "range_m": 7.9}))
    assert names(check_frame(shorter, terms)) == [Assumption.DETECTION_RANGE]
    ahead = parse_frame(_json({**message, "field_of_view_deg": 120.0}))
    assert Assumption.DETECTION_RANGE in names(check_frame(ahead, terms))


def test_a_doubt_takes_all_that_is_known(scene: Scene) -> None:
    for _ in range(8):
        scene.look(person(5.0))
    assert scene.is_free(1.0, 0.0)
    scene.evaluator.seen.void("the estimator was reset")
    assert not scene.is_free(1.0, 0.0)
    assert len(scene.movers.tracks) == 0


def test_bounds_of_classes() -> None:
    bounds, unknown = bounds_of(())
    assert bounds == {}
    assert unknown == Bound(0.0, 0.0)


def test_the_vehicle_has_to_rest_once_its_setpoint_has(contract: Contract) -> None:
    terms = FakeFlight.under(against_movers(contract)).assessment.terms
    monitor, still = RestSpeedMonitor(), State((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    moving = State((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))

    def check(now_s: float, reference: State | None, speed_mps: float) -> Violation | None:
        pose = Pose(now_s, (0.0, 0.0, 0.0), (speed_mps, 0.0, 0.0), 0.0, 0.0, 0.0)
        return monitor.check(pose, reference, now_s, terms, 0.2)

    assert check(0.0, moving, 1.0) is None
    assert check(0.1, still, 1.0) is None
    assert check(0.4, still, 1.0) is None
    found = check(0.51, still, 0.3)
    assert found is not None
    assert found.assumption is Assumption.REST_SPEED
    assert check(0.6, still, 0.1) is None
    assert check(0.7, moving, 1.0) is None
    assert check(0.8, still, 1.0) is None
    assert check(9.0, None, 1.0) is None
    assert math.isclose(terms.rest_settle_s, 0.4)


@pytest.mark.parametrize(("level", "free"), [("passive", True), ("passive_in_view", False)])
def test_without_a_ring_who_is_out_of_view_may_step_behind_an_obstacle(
    contract: Contract, level: str, *, free: bool
) -> None:
    """None hides at the start, as the contract says; but from beside, one goes there unseen."""
    scene = Scene(FakeFlight.under(against_movers(contract, level=level)))
    for _ in range(6):
        scene.look(tree(4.0))
    assert scene.is_free(1.0, 0.0)
    assert scene.is_free(6.0, 0.0) == free
