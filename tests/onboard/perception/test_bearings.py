import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.geometry.frames import LegFrame
from onboard.perception.bearings import KNOWN_AFTER, WANDER_M, BearingMemory, BearingResidual
from onboard.perception.detection import Corners
from onboard.vehicle_state import Pose

HERE = (3.0, -7.0)


def pose(yaw_rad: float = 0.0) -> Pose:
    return Pose(0.0, (*HERE, -4.0), (0.0, 0.0, 0.0), 0.0, 0.0, yaw_rad)


def box(
    bearing_rad: float, range_m: float, *, side_m: float = 1.0, yaw_rad: float = 0.0
) -> Corners:
    """Corners of a square box seen from here."""
    center_m = (
        HERE[0] + range_m * math.cos(bearing_rad),
        HERE[1] + range_m * math.sin(bearing_rad),
        0.0,
    )
    frame, half_m = LegFrame(center_m, yaw_rad), side_m / 2.0
    corners = [(-half_m, -half_m), (half_m, -half_m), (half_m, half_m), (-half_m, half_m)]
    return [frame.position_ned((x_m, y_m, 0.0))[:2] for x_m, y_m in corners]


def known(memory: BearingMemory, **boxes: Corners) -> BearingMemory:
    for _ in range(KNOWN_AFTER):
        assert memory.residuals(pose(), boxes, 0.1) == []
    return memory


ANGLE = st.floats(-math.pi, math.pi)


@given(ANGLE, st.floats(4.0, 40.0), st.floats(-math.radians(40.0), math.radians(40.0)))
def test_a_wrong_heading_is_the_residual_of_every_track(
    bearing_rad: float, range_m: float, turn_rad: float
) -> None:
    memory = known(BearingMemory(), a=box(bearing_rad, range_m), b=box(bearing_rad + 1.0, 9.0))
    seen = {
        "a": box(bearing_rad + turn_rad, range_m, yaw_rad=turn_rad),
        "b": box(bearing_rad + 1.0 + turn_rad, 9.0, yaw_rad=turn_rad),
    }
    residuals = memory.residuals(pose(turn_rad), seen, 0.1)
    assert [residual.angle_rad for residual in residuals] == pytest.approx([turn_rad] * 2)
    expected_rad = math.asin((0.2 + WANDER_M) / range_m)
    assert residuals[0].error_rad == pytest.approx(expected_rad, rel=1e-6)


def test_a_track_has_to_be_seen_a_few_times_before_it_is_known() -> None:
    memory = known(BearingMemory(), a=box(0.0, 8.0))
    assert memory.residuals(pose(), {"a": box(0.2, 8.0)}, 0.1) != []
    assert memory.residuals(pose(), {"new": box(0.2, 8.0)}, 0.1) == []


def test_the_first_sightings_are_averaged() -> None:
    memory = BearingMemory()
    for number in range(KNOWN_AFTER):
        memory.residuals(pose(), {"a": box(0.02 * (number - 2), 8.0)}, 0.1)
    (residual,) = memory.residuals(pose(), {"a": box(0.0, 8.0)}, 0.1)
    assert residual.angle_rad == pytest.approx(0.0, abs=1e-9)


def test_a_box_that_is_seen_in_part_explains_more() -> None:
    memory = known(BearingMemory(), a=box(0.0, 8.0, side_m=2.0))
    (whole,) = memory.residuals(pose(), {"a": box(0.0, 8.0, side_m=2.0)}, 0.1)
    (part,) = memory.residuals(pose(), {"a": box(0.0, 8.0, side_m=0.5)}, 0.1)
    assert part.error_rad > 1.5 * whole.error_rad


@pytest.mark.parametrize("range_m", [0.0, 0.3, WANDER_M + 0.19])
def test_what_is_too_near_has_no_bearing(range_m: float) -> None:
    memory = known(BearingMemory(), a=box(0.0, 8.0), b=box(0.0, range_m))
    seen = {"a": box(0.0, range_m), "b": box(0.0, 8.0)}
    assert memory.residuals(pose(), seen, 0.1) == []


def test_it_begins_anew_where_the_estimator_moved_everything() -> None:
    memory = known(BearingMemory(), a=box(0.0, 8.0))
    memory.forget()
    known(memory, a=box(0.5, 8.0))
    (residual,) = memory.residuals(pose(), {"a": box(0.5, 8.0)}, 0.1)
    assert isinstance(residual, BearingResidual)
    assert residual.angle_rad == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("heading_error_rad", [0.02, 0.07])
@pytest.mark.parametrize(("known_from_m", "seen_from_m"), [(60.0, 6.0), (15.0, 5.0), (20.0, 20.0)])
def test_what_was_placed_from_afar_by_a_tolerated_heading_shows_no_wrong_one(
    heading_error_rad: float, known_from_m: float, seen_from_m: float
) -> None:
    """The vehicle has flown towards it meanwhile, and its heading errs the other way now."""
    memory = known(BearingMemory(), a=box(heading_error_rad, known_from_m))
    there_m = (HERE[0] + known_from_m - seen_from_m, HERE[1], -4.0)
    here = pose()._replace(position_ned_m=there_m)
    ahead_m = seen_from_m * math.cos(heading_error_rad) - seen_from_m
    aside_m = -seen_from_m * math.sin(heading_error_rad)
    seen = [(north + ahead_m, east + aside_m) for north, east in box(0.0, known_from_m)]
    (residual,) = memory.residuals(here, {"a": seen}, 0.1, heading_error_rad)
    assert abs(residual.angle_rad) <= residual.error_rad + 2.0 * heading_error_rad
