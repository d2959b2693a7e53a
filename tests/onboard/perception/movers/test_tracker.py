"""Tracks of movers: growing boxes, violations, exchanged identities, parts, forgetting."""

from __future__ import annotations

import math
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from onboard.geometry.box import Box
from onboard.perception.movers.box_rows import BoxRows
from onboard.perception.movers.static_claims import StaticClaims
from onboard.perception.movers.tracker import (
    MEMORY_S,
    MISSED_MAX,
    TRACKS_MAX,
    Bound,
    MoverTrack,
    MoverTracker,
    Sighting,
    TooFast,
    with_hidden_part,
)

E_M = 0.1
PERSON = Bound(1.5, 0.6)


def tracker() -> MoverTracker:
    return MoverTracker({"person": PERSON}, Bound(15.0, 2.0))


def box(x_m: float, y_m: float, size_m: float = 0.6) -> Box:
    half_m = size_m / 2.0
    return Box(x_m - half_m, x_m + half_m, y_m - half_m, y_m + half_m)


def holds(outer: Box, inner: Box) -> bool:
    return outer.inflated(1e-9).enclosing(inner) == outer.inflated(1e-9)


def only(tracks: MoverTracker) -> MoverTrack:
    (track,) = tracks
    return track


def seen(x_m: float, y_m: float = 0.0, *, name: str = "1", whole: bool = True) -> Sighting:
    return Sighting(f"front/{name}", "person", box(x_m, y_m), E_M, whole)


def test_a_box_grows_with_the_speed_of_its_class_until_seen_again() -> None:
    tracks = tracker()
    tracks.take("front", [seen(5.0)], 1.0, complete=True)
    assert only(tracks).predicted(1.0) == box(5.0, 0.0).inflated(E_M)
    assert holds(only(tracks).predicted(2.0), box(5.0, 0.0).inflated(E_M + 1.4999))
    tracks.take("front", [seen(5.1)], 1.1, complete=True)
    assert only(tracks).box == box(5.1, 0.0).inflated(E_M)


def test_what_has_no_declared_class_may_be_any() -> None:
    tracks = tracker()
    stranger = Sighting("front/9", "dog", box(5.0, 0.0), E_M)
    tracks.take("front", [stranger], 0.0, complete=True)
    assert only(tracks).speed_max_mps == 15.0


def test_the_box_of_a_whole_mover_is_never_cut_by_the_prediction() -> None:
    """The identity may be a neighbour's: a box that is cut would leave a part of it uncovered."""
    tracks = tracker()
    tracks.take("front", [seen(5.0)], 0.0, complete=True)
    tracks.take("front", [seen(5.15)], 0.05, complete=True)
    assert only(tracks).box == box(5.15, 0.0).inflated(E_M)


def test_faster_than_declared_is_told_face_by_face() -> None:
    tracks = tracker()
    tracks.take("front", [seen(5.0)], 0.0, complete=True)
    # The farther face may be 0.2 + 0.15 m on after 0.1 s, errors included.
    assert tracks.take("front", [seen(5.34)], 0.1, complete=True) == []
    tracks = tracker()
    tracks.take("front", [seen(5.0)], 0.0, complete=True)
    too_fast = tracks.take("front", [seen(5.5)], 0.1, complete=True)
    assert too_fast is not None
    (found,) = too_fast
    assert found == TooFast("front/1", found.speed_mps, 1.5)
    assert found.speed_mps == pytest.approx(3.0)
    fast = next(track for track in tracks if track.id == "front/1")
    assert fast.speed_max_mps == pytest.approx(1.25 * 3.0)
    # The old box goes on growing.
    assert len(tracks) == 2


def test_a_mover_that_is_a_little_too_fast_is_found_after_a_while() -> None:
    """No two frames tell: the errors of both hide it; the way since the first one does."""
    for share, found_by in ((0.99, None), (1.2, 40), (2.0, 8)):
        tracks, first = tracker(), None
        for step in range(60):
            off_m = E_M if step % 2 else -E_M
            # Another sensor sees it, too.
            ring = Sighting("ring/1", "person", box(0.075 * share * step, 0.0), E_M)
            tracks.take("ring", [ring], 0.05 * step, complete=True)
            if tracks.take(
                "front", [seen(0.075 * share * step + off_m)], 0.05 * step, complete=True
            ):
                first = first or step
        assert (first is None) if found_by is None else (first is not None and first <= found_by)


def test_a_name_that_is_given_to_a_newcomer_is_no_speed() -> None:
    tracks = tracker()
    tracks.take("front", [seen(5.0)], 0.0, complete=True)
    assert tracks.take("front", [seen(9.0), seen(5.0, name="2")], 0.1, complete=True) == []
    assert tracks.renamed == {"front/1"}
    assert tracks.take("front", [seen(9.0), seen(5.0, name="2")], 0.2, complete=True) == []
    assert tracks.renamed == set()
    for place in (box(5.0, 0.0), box(9.0, 0.0)):
        assert any(holds(track.predicted(0.2), place) for track in tracks)


def test_exchanged_identities_are_no_speed() -> None:
    tracks = tracker()
    tracks.take("front", [seen(5.0), seen(7.0, name="2")], 0.0, complete=True)
    swapped = [seen(7.0), seen(5.0, name="2")]
    assert tracks.take("front", swapped, 0.1, complete=True) == []
    for place in (box(5.0, 0.0), box(7.0, 0.0)):
        assert any(holds(track.predicted(0.1), place) for track in tracks)


def test_of_a_part_the_rest_may_be_anywhere_within_the_size() -> None:
    tracks = tracker()
    part = Sighting("front/1", "person", Box(5.0, 5.1, 0.0, 0.1), E_M, whole=False)
    tracks.take("front", [part], 0.0, complete=True)
    most_m = 0.6 * math.sqrt(2.0)
    # Whichever way the face that was seen is off.
    assert only(tracks).box.x_max_m == pytest.approx(5.0 + E_M + most_m)
    assert only(tracks).box.y_min_m == pytest.approx(0.1 - E_M - most_m)


@given(
    least_m=st.floats(-1.0, 1.0),
    seen_from=st.floats(0.0, 1.0),
    seen_to=st.floats(0.0, 1.0),
    size_m=st.floats(0.1, 3.0),
    errors_m=st.tuples(st.floats(-E_M, E_M), st.floats(-E_M, E_M)),
)
def test_no_part_of_a_mover_lies_outside(
    least_m: float,
    seen_from: float,
    seen_to: float,
    size_m: float,
    errors_m: tuple[float, float],
) -> None:
    """Turned by 45 degrees it extends over the diagonal, of which any part is seen, faces off."""
    extent_m = size_m * math.sqrt(2.0)
    low, high = sorted(least_m + share * extent_m for share in (seen_from, seen_to))
    one, other = sorted((low + errors_m[0], high + errors_m[1]))
    held = with_hidden_part(Box(one, other, one, other), E_M, size_m)
    assert held.x_min_m <= least_m + 1e-9
    assert held.x_max_m >= least_m + extent_m - 1e-9
    assert (held.y_min_m, held.y_max_m) == (held.x_min_m, held.x_max_m)


def test_what_is_not_seen_of_a_known_mover_cannot_have_gone_farther_than_all_of_it() -> None:
    tracks = tracker()
    tracks.take("front", [seen(5.0)], 0.0, complete=True)
    part = Sighting("front/1", "person", Box(4.7, 4.9, -0.3, 0.3), E_M, whole=False)
    tracks.take("front", [part], 0.1, complete=True)
    assert holds(box(5.0, 0.0).inflated(E_M + 0.15), only(tracks).box)
    near = Sighting("front/2", "person", box(5.5, 0.0), E_M)
    tracks.take("front", [part, near], 0.2, complete=True)
    tracks.take("front", [part, near], 0.3, complete=True)
    kept = next(track for track in tracks if track.id == "front/1")
    # Another may be there, too: then nothing is cut.
    assert kept.box.x_max_m == pytest.approx(4.7 + E_M + 0.6 * math.sqrt(2.0))


def test_who_is_in_none_of_a_few_complete_frames_is_unseen() -> None:
    tracks = tracker()
    tracks.take("front", [seen(5.0)], 0.0, complete=True)
    for index in range(1, MISSED_MAX):
        tracks.take("front", [], 0.1 * index, complete=True)
        tracks.take("ring", [], 0.1 * index, complete=True)
        tracks.take("front", [], 0.1 * index, complete=False)
        assert len(tracks) == 1
    tracks.take("front", [], 1.0, complete=True)
    assert len(tracks) == 0


def test_a_sensor_that_never_says_all_is_forgotten_by_age() -> None:
    tracks = tracker()
    tracks.take("front", [seen(5.0)], 0.0, complete=False)
    tracks.take("front", [], 4.0, complete=False)
    assert len(tracks) == 1
    tracks.take("front", [], 6.0, complete=False)
    assert len(tracks) == 0


def crowd(count: int, *, first: int = 0) -> list[Sighting]:
    return [seen(5.0 * index, name=str(index)) for index in range(first, first + count)]


def test_a_frame_of_more_movers_than_are_followed_changes_nothing() -> None:
    tracks = tracker()
    assert tracks.take("front", crowd(TRACKS_MAX), 1.0, complete=True) == []
    before = list(tracks)
    assert len(before) == TRACKS_MAX
    assert tracks.take("front", crowd(TRACKS_MAX + 1), 1.1, complete=True) is None
    # Nor do those of several frames, or sensors, together.
    assert tracks.take("front", crowd(1, first=TRACKS_MAX), 1.1, complete=True) is None
    ring = [Sighting("ring/1", "person", box(0.0, 0.0), E_M)]
    assert tracks.take("ring", ring, 1.1, complete=True) is None
    assert list(tracks) == before
    # Who is known already takes no room, and neither does who is forgotten.
    assert tracks.take("front", crowd(TRACKS_MAX), 1.2, complete=True) == []
    new = crowd(TRACKS_MAX, first=TRACKS_MAX)
    assert tracks.take("front", new, 1.2 + MEMORY_S + 0.01, complete=True) == []
    assert {track.id for track in tracks} == {sighting.track_id for sighting in new}


def test_more_returns_than_are_followed_change_nothing() -> None:
    tracks = tracker()
    assert tracks.replace_returns("front", crowd(TRACKS_MAX), 1.0)
    before = list(tracks)
    assert not tracks.replace_returns("front", crowd(TRACKS_MAX + 1), 1.1)
    assert list(tracks) == before
    # None is one of the frame before.
    assert tracks.replace_returns("front", crowd(TRACKS_MAX, first=7), 1.2)
    assert len(tracks) == TRACKS_MAX


def test_no_stream_of_new_names_makes_more_tracks_than_a_bound() -> None:
    """Names that another mover had, one frame after the other, leave a ghost each besides."""
    tracks, most = tracker(), 0
    for index in range(40):
        names = crowd(100, first=70 * index)
        elsewhere = [each._replace(measured=each.measured.shifted_by(0.0, 3.0)) for each in names]
        for frame in (names, elsewhere):
            tracks.take("front", frame, 1.0 + 0.05 * index, complete=False)
            most = max(most, len(tracks))
    assert most > TRACKS_MAX - 100
    assert most <= 2 * TRACKS_MAX


@given(seed=st.integers(0, 2**32 - 1))
def test_boxes_meet_in_rows_as_they_do_one_by_one(seed: int) -> None:
    random = Random(seed)
    places = [random.choice((-0.6, -0.1, 0.0, 0.1, 0.6)) for _ in range(12)]
    boxes = [box(x_m, y_m) for x_m, y_m in zip(places[:6], places[6:], strict=True)]
    measured, error_m = box(random.choice(places), 0.55), random.choice((0.0, 0.05))
    expected = [each.inflated(error_m).intersects(measured) for each in boxes]
    assert BoxRows(boxes).meet(measured, error_m).tolist() == expected
    assert BoxRows([]).meet(measured, error_m).tolist() == []


def test_an_older_frame_changes_nothing() -> None:
    tracks = tracker()
    tracks.take("front", [seen(5.0)], 1.0, complete=True)
    tracks.take("front", [seen(9.0)], 0.9, complete=True)
    assert only(tracks).box == box(5.0, 0.0).inflated(E_M)


@given(seed=st.integers(0, 2**32 - 1), swaps=st.booleans())
@settings(max_examples=40, deadline=None)
def test_movers_at_their_speed_are_always_held_and_never_too_fast(seed: int, swaps: bool) -> None:
    """Zigzagging neighbours, errors pinned to their bounds, identities exchanged at random."""
    random, tracks = Random(seed), tracker()
    places = [(random.uniform(-3, 3), random.uniform(-3, 3)) for _ in range(4)]
    names = [str(index) for index in range(4)]
    for step in range(60):
        stamp_s = step * 0.1
        places = [
            (x + 0.15 * math.cos(turn), y + 0.15 * math.sin(turn))
            for (x, y), turn in zip(places, (random.uniform(-4, 4) for _ in places), strict=True)
        ]
        if swaps and random.random() < 0.3:
            random.shuffle(names)
        errors = [random.choice((-E_M, E_M)) for _ in places]
        found = tracks.take(
            "front",
            [
                Sighting(f"front/{name}", "person", box(x + error, y - error), E_M)
                for name, (x, y), error in zip(names, places, errors, strict=True)
            ],
            stamp_s,
            complete=True,
        )
        assert found == []
        for x, y in places:
            later = box(x, y).inflated(0.1 * 1.5)
            assert any(holds(track.predicted(stamp_s), box(x, y)) for track in tracks)
            assert any(holds(track.predicted(stamp_s + 0.1), later) for track in tracks)


def test_a_claim_to_stand_still_is_compared_with_its_first_sighting() -> None:
    claims = StaticClaims()
    limit_m = 2.0 * E_M
    assert claims.check("front/1", box(5.0, 0.0), E_M) is None
    for creep in range(1, 30):
        moved = claims.check("front/1", box(5.0 + 0.01 * creep, 0.0), E_M)
        assert (moved is not None) == (creep == math.floor(limit_m / 0.01) + 1)
    assert claims.is_broken("front/1")
    claims.clear()
    assert claims.is_broken("front/1")
    assert not claims.is_broken("front/2")
