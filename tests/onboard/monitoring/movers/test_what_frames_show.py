"""Movers as frames show them: what counts, what is forgotten, and how far a ring is believed."""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest

from onboard.monitoring.assumptions import Violation
from onboard.monitoring.detection_evaluation import DetectionEvaluator
from onboard.monitoring.estimator.heading import HeadingMonitor
from onboard.monitoring.movers.mover_space import MoverSpace
from onboard.perception.intake import DetectionCounters
from onboard.perception.movers.mover_free import MoverFree
from onboard.perception.movers.moving_detection import MovingFrame
from onboard.perception.pose_history import PoseHistory
from onboard.vehicle_state import Pose
from tests.onboard.contract.test_movers import contract
from tests.onboard.monitoring.fake_flight import FakeFlight

PERIOD_S = 0.05
RING_M = 11.0


def pose(time_s: float, down_m: float = -4.0) -> Pose:
    still = (0.0, 0.0, 0.0)
    return Pose(time_s, (0.0, 0.0, down_m), still, roll_rad=0.0, pitch_rad=0.0, yaw_rad=0.0)


class Rig:
    """A vehicle that hovers at the start of its leg, a sensor all round, and no mover."""

    def __init__(self) -> None:
        self.now_s, self.down_m, self.shifts_m = 10.0, -4.0, [(0.0, 0.0)]
        self.flight = FakeFlight.under(contract())
        self._poses = PoseHistory()
        self.detections = DetectionEvaluator(
            self.flight, self._poses, lambda _stamp_s: self.shifts_m, DetectionCounters()
        )
        self.movers.begin_flight()
        self._sequence = 0

    @property
    def movers(self) -> MoverSpace:
        return self.detections.movers

    def see(
        self, count: int, *obstacles: dict[str, object], range_m: float = RING_M, **changes: object
    ) -> list[Violation]:
        """Take frames of a ring; return what they violate."""
        return [
            violation
            for _ in range(count)
            for violation in self._see_once(obstacles, range_m, changes)
        ]

    def _see_once(
        self, obstacles: tuple[dict[str, object], ...], range_m: float, changes: dict[str, object]
    ) -> Iterator[Violation]:
        self.now_s += PERIOD_S
        self._sequence += 1
        self._poses.add(pose(self.now_s, self.down_m))
        frame = {
            "version": 2, "source": "ring", "sequence": self._sequence, "stamp_unix_s": 0.0,
            "frame": "body_frd", "range_m": range_m, "field_of_view_deg": 360.0,
            "obstacles": obstacles, "frame_complete": True, **changes,
        }  # fmt: skip
        checked = MovingFrame.model_validate(frame)
        yield from self.detections.evaluate(checked, self.now_s, self.now_s, HeadingMonitor())
        self.detections.seen.advance(pose(self.now_s, self.down_m), trusted=True)

    def is_free(self, north_m: float, later_s: float = 0.0) -> bool:
        known = self.movers.movers
        assert known is not None
        assert isinstance(known.places, MoverFree)
        return known.places.is_free_at(north_m, 0.0, self.now_s + later_s)


def box(north_m: float, **changes: object) -> dict[str, object]:
    return {
        "id": "1", "center_m": (north_m, 0.0), "size_m": (0.4, 0.4), "yaw_deg": 0.0,
        "uncertainty_m": 0.05, "motion": "moving", "class": "person", "box_whole": True, **changes,
    }  # fmt: skip


def test_a_ring_is_believed_as_far_as_the_contract_declares_it() -> None:
    rig = Rig()
    rig.see(5, range_m=14.5)
    assert rig.is_free(RING_M - 1.5)
    assert not rig.is_free(RING_M + 0.5)


@pytest.mark.parametrize("spoilt", [{"frame_complete": False}, {"stale": True}])
def test_a_frame_that_does_not_count_begins_the_row_again(spoilt: dict[str, bool]) -> None:
    rig = Rig()
    rig.see(2)
    if spoilt.pop("stale", False):
        rig.down_m = -9.0  # off the height of the leg
        rig.see(1)
        rig.down_m = -4.0
    else:
        rig.see(1, **spoilt)
    rig.see(2)
    assert not rig.is_free(3.0)
    rig.see(1)
    assert rig.is_free(3.0)


def test_what_was_seen_at_another_height_is_not_kept() -> None:
    rig = Rig()
    rig.see(5)
    assert rig.is_free(3.0, 1.0)
    rig.down_m = -9.0
    rig.see(1)
    assert not rig.is_free(3.0)


def test_while_the_position_is_in_doubt_nothing_counts_even_if_no_obstacle_was_looked_for() -> None:
    rig = Rig()
    rig.see(5)
    assert rig.is_free(3.0)
    seen = rig.detections.seen
    seen.on_void = lambda _stands: None
    seen.void("only what stands still")
    seen.on_void = lambda stands: rig.movers.void(frame_stands=stands)
    assert rig.is_free(3.0)
    seen.advance(pose(rig.now_s), trusted=False)
    assert not rig.is_free(3.0)


def test_a_box_from_before_a_reset_is_moved_into_the_present_frame() -> None:
    rig = Rig()
    rig.shifts_m = [(2.0, 0.0)]
    rig.see(1, box(3.0), frame="local_ned")
    (track,) = rig.movers.tracks
    assert track.box.x_min_m < 4.8
    assert track.box.x_max_m > 5.2
    # Where it is not known which of two places it saw, it tracks nothing.
    rig.movers.void()
    rig.shifts_m = [(0.0, 0.0), (2.0, 0.0)]
    rig.see(1, box(3.0), frame="local_ned")
    assert len(rig.movers.tracks) == 0


def test_a_part_blocks_what_the_whole_may_cover() -> None:
    rig = Rig()
    rig.see(5, box(5.0, box_whole=False, size_m=(0.1, 0.1)))
    most_m = math.sqrt(2.0) * 1.0
    # From where the face that was seen lies farthest in.
    assert not rig.is_free(5.0 - 0.05 - 0.05 + 0.1 - most_m)
    assert rig.is_free(5.0 - most_m - 1.0)
