"""Names of boxes by where they are."""

import numpy as np

from onboard.perception.scan.box_tracks import TRACKS_MAX, BoxTracks


def box(north_m: float, east_m: float, side_m: float = 0.5) -> list[float]:
    half_m = side_m / 2.0
    return [north_m - half_m, north_m + half_m, east_m - half_m, east_m + half_m]


def test_what_is_near_keeps_its_name() -> None:
    tracks = BoxTracks(near_m=0.3, size_max_m=2.0)
    assert tracks.name(np.array([box(5, 0), box(5, 4)])) == [1, 2]
    assert tracks.name(np.array([box(5.1, 4.1), box(5, 0.1)])) == [2, 1]
    assert tracks.name(np.array([box(5, 0.9)])) == [3]  # 0.4 m beside what was ever seen of 1


def test_the_nearest_of_several_is_taken_and_each_only_once() -> None:
    tracks = BoxTracks(near_m=0.3, size_max_m=2.0)
    tracks.name(np.array([box(5, 0), box(5, 0.7)]))
    assert tracks.name(np.array([box(5, 0.6), box(5, 0.55)])) == [2, 1]


def test_what_would_grow_beyond_a_box_is_a_part_of_something_larger() -> None:
    tracks = BoxTracks(near_m=0.3, size_max_m=1.0)
    assert tracks.name(np.array([box(5, 0, 0.8)])) == [1]
    assert tracks.name(np.array([box(5, 0.6, 0.8)])) == [None]
    assert tracks.name(np.array([box(5, 0.1, 0.8)])) == [1]


def test_names_never_come_again() -> None:
    tracks = BoxTracks(near_m=0.3, size_max_m=1.0)
    tracks.name(np.array([box(5, 0)]))
    tracks.forget()
    assert tracks.name(np.array([box(5, 0)])) == [2]


def comparable(tracks: BoxTracks, *boxes: list[float], north_m: float = 0.0) -> list[bool]:
    bounds = np.array(boxes)
    found = tracks.comparable(bounds, tracks.name(bounds), (north_m, 0.0), 0.05)
    return [bool(each) for each in found]


def test_what_stands_close_together_is_not_compared() -> None:
    tracks = BoxTracks(near_m=0.3, size_max_m=1.0)
    assert comparable(tracks, box(5, 0), box(5, 1.2), box(5, 4)) == [False, False, True]
    assert comparable(tracks, box(5, 0)) == [False]  # the other is out of sight now


def test_from_another_side_only_what_is_seen_whole_is_compared() -> None:
    tracks = BoxTracks(near_m=0.3, size_max_m=2.0)
    south_face, whole, north_face = [4.8, 4.9, 2, 3], [4.8, 5.8, 2, 3], [5.7, 5.8, 2, 3]
    assert comparable(tracks, south_face) == [True]
    assert comparable(tracks, whole, north_m=5.0) == [True]
    assert comparable(tracks, south_face, north_m=1.0) == [False]
    assert comparable(tracks, north_face, north_m=9.0) == [False]
    assert comparable(tracks, whole, north_m=9.0) == [True]
    assert comparable(tracks, north_face, north_m=9.5) == [True]


def test_no_boxes() -> None:
    tracks = BoxTracks(0.3, 1.0)
    assert tracks.name(np.empty((0, 4))) == []
    assert tracks.comparable(np.empty((0, 4)), [], (0.0, 0.0), 0.1).tolist() == []


def test_only_so_many_are_remembered() -> None:
    tracks = BoxTracks(near_m=0.1, size_max_m=1.0)
    first = box(-10, 0)
    for row in range(5):
        scan = [box(2.0 * row, 2.0 * column) for column in range(TRACKS_MAX // 4)]
        tracks.name(np.array([first, *scan]))
    assert len(tracks._names) <= TRACKS_MAX
    assert tracks.name(np.array([first])) == [1]  # seen all the time
