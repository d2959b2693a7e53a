"""The operator's word about the start: taken once, in the frame in which it was given."""

import numpy as np
import pytest

from onboard.monitoring.seen.operators_word import OperatorsWord

FAR = ((5.0, -0.5), (6.0, -0.5), (6.0, 0.5), (5.0, 0.5))
AROUND = ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))


@pytest.fixture
def word() -> OperatorsWord:
    return OperatorsWord()


def test_it_is_taken_once(word: OperatorsWord) -> None:
    assert word.may_be_taken
    word.take(0.0, 0.0, 3.0)
    assert not word.may_be_taken
    word.forget(frame_stands=True)
    assert not word.may_be_taken


@pytest.mark.parametrize("stands", [True, False])
def test_before_it_is_taken_a_doubt_of_its_frame_ends_it(
    word: OperatorsWord, *, stands: bool
) -> None:
    word.forget(frame_stands=stands)
    assert word.may_be_taken is stands


def test_a_frame_that_has_moved_ends_it(word: OperatorsWord) -> None:
    word.shift(0.1, 0.0)
    assert not word.may_be_taken


@pytest.mark.parametrize(
    ("box", "margin_m", "found"),
    [(FAR, 0.0, None), (FAR, -2.1, 0), (AROUND, 0.0, 0), (AROUND, 3.1, None)],
)
def test_a_box_inside_by_more_than_its_error_contradicts_it(
    word: OperatorsWord, box: tuple[tuple[float, float], ...], margin_m: float, found: int | None
) -> None:
    assert word.contradicted_by([box], margin_m) is None
    word.take(0.0, 0.0, 3.0)
    assert word.contradicted_by([box], margin_m) == found


def test_what_was_taken_moves_with_the_frame(word: OperatorsWord) -> None:
    word.take(0.0, 0.0, 3.0)
    word.shift(3.0, 0.0)
    assert word.contradicted_by([FAR], 0.9) == 0
    assert word.contradicted_by([FAR], 1.1) is None
    word.forget(frame_stands=False)
    assert word.contradicted_by([FAR], 0.0) is None


def test_it_moves_north_and_east(word: OperatorsWord) -> None:
    word.take(1.0, -2.0, 1.0)
    word.shift(3.0, 5.0)  # to north 4, east 3
    inside = ((4.2, 3.2), (4.4, 3.2), (4.4, 3.4), (4.2, 3.4))
    assert word.contradicted_by([inside], 0.0) == 0
    aside = tuple((north_m, east_m + 2.0) for north_m, east_m in inside)
    assert word.contradicted_by([aside], 0.0) is None


POINT = ((5.0, 0.0),) * 4
LINE = ((5.0, -1.0), (5.0, -1.0), (5.0, 1.0), (5.0, 1.0))


@pytest.mark.parametrize("box", [POINT, LINE])
@pytest.mark.parametrize(("margin_m", "found"), [(0.0, None), (-2.1, 0)])
def test_a_box_without_an_extent_is_where_it_is(
    word: OperatorsWord, box: tuple[tuple[float, float], ...], margin_m: float, found: int | None
) -> None:
    # An adversary's detector reports a thin obstacle as a point; it contradicted every word.
    word.take(0.0, 0.0, 3.0)
    assert word.contradicted_by([box], margin_m) == found


def test_the_distance_of_a_box_is_that_of_its_nearest_point(word: OperatorsWord) -> None:
    """Turned boxes around a disc off the origin, against dense points of their edges."""
    random = np.random.default_rng(11)
    for _ in range(60):
        centre_m, turn_rad = random.uniform(-4.0, 4.0, 2), random.uniform(-3.0, 3.0)
        half_m = random.uniform(0.05, 1.5, 2)
        signs = np.array(((-1, -1), (1, -1), (1, 1), (-1, 1)))[:: random.choice((-1, 1))]
        cosine, sine = np.cos(turn_rad), np.sin(turn_rad)
        corners_m = centre_m + signs * half_m @ np.array(((cosine, sine), (-sine, cosine)))
        offset_m = np.array((0.7, -1.2)) - centre_m
        beyond_m = np.abs((offset_m @ (cosine, sine), offset_m @ (-sine, cosine))) - half_m
        distance_m = float(np.hypot(*np.maximum(beyond_m, 0.0)))
        box = tuple((float(x), float(y)) for x, y in corners_m)
        word.take(0.7, -1.2, 2.0)
        assert word.contradicted_by([box], 2.0 - distance_m - 1e-6) == 0
        assert word.contradicted_by([box], 2.0 - distance_m + 1e-6) is None
