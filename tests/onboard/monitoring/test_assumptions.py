import math
from dataclasses import replace

import pytest

from onboard.contract.region import Encounter, RegionOfInfluence
from onboard.geometry.box import Box
from onboard.monitoring.assumptions import Assumption, Violation, check_frame, check_obstacle
from onboard.perception.detection import Detection, DetectionFrame
from onboard.perception.obstacle_map import Obstacle
from tests.onboard.contract.example_terms import TERMS


def frame(
    range_m: float = 12.0, field_of_view_deg: float = 120.0, uncertainty_m: float = 0.05
) -> DetectionFrame:
    seen = Detection(
        id="1", center_m=(5.0, 0.0), size_m=(1.0, 1.0), yaw_deg=0.0, uncertainty_m=uncertainty_m
    )
    return DetectionFrame(
        version=1,
        source="front",
        sequence=0,
        stamp_unix_s=0.0,
        frame="local_ned",
        range_m=range_m,
        field_of_view_deg=field_of_view_deg,
        obstacles=(seen,),
    )


def names(violations: list[Violation]) -> list[Assumption]:
    return [violation.assumption for violation in violations]


def test_frame_as_assumed_is_accepted() -> None:
    assert check_frame(frame(), TERMS) == []


@pytest.mark.parametrize(
    ("seen", "broken"),
    [
        (frame(range_m=11.9), Assumption.DETECTION_RANGE),
        (frame(field_of_view_deg=119.0), Assumption.FIELD_OF_VIEW),
        (frame(uncertainty_m=0.06), Assumption.DETECTION_UNCERTAINTY),
    ],
)
def test_frame_that_sees_less_than_assumed_is_a_violation(
    seen: DetectionFrame, broken: Assumption
) -> None:
    assert names(check_frame(seen, TERMS)) == [broken]


def obstacle(size_m: float) -> Obstacle:
    box = Box(10.0, 10.0 + size_m, -0.5, 0.5)
    encounter = Encounter(2.6, 2.6, 2.6, 2.6, 3.0, 0.1, *box.size_m, 0.15, 0.15, 0.0, 0.0, 0.0)
    return Obstacle("front/1", ("front/1",), box, 0.05, RegionOfInfluence.around(box, encounter))


@pytest.mark.parametrize(("size_m", "allowed"), [(4.14, True), (4.15, False)])
def test_size_limit_allows_for_the_error_of_both_faces(size_m: float, allowed: bool) -> None:
    """Of a box across the leg, whose errors along both of its axes add up."""
    assert (names(check_obstacle(obstacle(size_m), None, TERMS)) == []) is allowed


def test_size_limit_allows_for_what_a_heading_error_displaces() -> None:
    """By the chord of the farthest corner: 12 m of range, and the diagonal of 4 m."""
    turned = replace(TERMS, heading_error_rad=0.02)
    limit_m = 4.0 + 2.0 * (math.sqrt(2.0) * 0.05 + 2.0 * (12.0 + math.sqrt(32.0)) * math.sin(0.01))
    assert check_obstacle(obstacle(limit_m - 0.01), None, turned) == []
    assert names(check_obstacle(obstacle(limit_m + 0.01), None, turned)) == [
        Assumption.OBSTACLE_SIZE
    ]


@pytest.mark.parametrize(("size_m", "allowed"), [(7.9, True), (8.1, False)])
def test_what_was_seen_from_afar_only_is_as_large_as_it_may_be(
    size_m: float, *, allowed: bool
) -> None:
    """Wandering by its error of 2 m, a pillar of 4 m is enclosed by a box of 8 m."""
    far = replace(obstacle(size_m), position_error_m=2.0)
    assert (check_obstacle(far, None, TERMS) == []) is allowed


def test_intersecting_regions_name_both_obstacles() -> None:
    (violation,) = check_obstacle(obstacle(1.0), obstacle(1.0), TERMS)
    assert violation.assumption is Assumption.ROI_INTERSECTION
    assert violation.subject == "front/1 and front/1"
