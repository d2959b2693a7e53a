"""More movers than are followed: no place counts as free of them until they would be forgotten."""

from __future__ import annotations

from typing import Any

import pytest

from onboard.files.contract_file import Contract
from onboard.monitoring.assumptions import Assumption
from onboard.monitoring.movers.frame_rows import Uncounted
from onboard.perception.line_of_sight import BOXES_MAX
from onboard.perception.movers.moving_detection import ReportsFrame
from onboard.perception.movers.tracker import MEMORY_S, TRACKS_MAX
from tests.onboard.monitoring.fake_flight import FakeFlight
from tests.onboard.monitoring.movers.test_mover_space import (
    PERIOD_S,
    Scene,
    against_movers,
    missing,
    person,
)


@pytest.fixture
def scene(contract: Contract) -> Scene:
    return Scene(FakeFlight.under(against_movers(contract)))


def crowd(count: int) -> list[dict[str, Any]]:
    """Return people far beyond the range, whom only their number makes matter."""
    return [person(100.0 + 2.0 * index, id=str(index)) for index in range(count)]


def look_around(scene: Scene) -> None:
    for _ in range(4):
        assert scene.look() == []


def test_as_many_as_are_followed_leave_places_free(scene: Scene) -> None:
    for _ in range(4):
        # In one frame of more boxes no line of sight is computed.
        assert scene.look(*crowd(BOXES_MAX)) == []
        assert scene.look(*crowd(TRACKS_MAX - BOXES_MAX), source="other") == []
    assert len(scene.movers.tracks) == TRACKS_MAX
    assert scene.is_free(1.0, 0.0)
    # One more of another sensor is too many.
    scene.look(person(100.0), source="front", field_of_view_deg=120.0)
    assert not scene.is_free(1.0, 0.0)
    assert len(scene.movers.tracks) == TRACKS_MAX


def test_of_one_more_none_is_left_out_silently(scene: Scene) -> None:
    look_around(scene)
    age_max_s = scene.flight.assessment.terms.frame_age_max_s
    scene.look(*crowd(TRACKS_MAX + 1))
    assert not scene.is_free(1.0, 0.0)
    for _ in range(round(age_max_s / PERIOD_S) + 1):
        scene.look(*crowd(TRACKS_MAX + 1))
        assert not scene.is_free(1.0, 0.0)
    assert Uncounted.CROWDED in (missing(scene) or "")
    # The ring counts as silent, and the reason is told.
    silent = scene.movers.check_ring(scene.now_s)
    assert silent is not None
    assert silent.assumption is Assumption.DETECTION_AGE
    assert silent.note == Uncounted.CROWDED


def test_places_count_again_once_all_would_have_been_forgotten(scene: Scene) -> None:
    scene.look(*crowd(TRACKS_MAX + 1))
    crowded_s = scene.now_s
    while scene.now_s + PERIOD_S < crowded_s + MEMORY_S:
        scene.look()
        assert not scene.is_free(1.0, 0.0)
        assert missing(scene) is not None
    look_around(scene)
    assert scene.is_free(1.0, 0.0)
    assert missing(scene) is None
    assert scene.movers.check_ring(scene.now_s) is None


def test_too_many_reports_are_as_bad_though_a_ring_shows_places_free(scene: Scene) -> None:
    """Who is reported may be one whom no sensor sees."""
    look_around(scene)
    report = {
        "version": 2, "source": "traffic", "sequence": 1, "stamp_unix_s": scene.now_s,
        "frame": "local_ned", "range_m": 200.0, "field_of_view_deg": 360.0,
        "obstacles": crowd(TRACKS_MAX + 1),
    }  # fmt: skip
    frame = ReportsFrame.model_validate(report)
    now_s = scene.now_s
    assert list(scene.evaluator.evaluate(frame, now_s, now_s, scene.heading)) == []
    assert not scene.is_free(1.0, 0.0)
    look_around(scene)
    assert not scene.is_free(1.0, 0.0)
