"""Sights wait in order, with the breaks of their sensors' rows; only the newest few do."""

from __future__ import annotations

from onboard.monitoring.seen.sight_queue import PENDING_MAX, SightQueue


def test_as_many_as_may_wait_do_and_one_more_drops_the_oldest() -> None:
    broken: list[str] = []
    queue = SightQueue[int](broken.append)
    for number in range(PENDING_MAX):
        queue.add("front", number)
    assert len(queue) == PENDING_MAX
    assert broken == []
    queue.add("front", PENDING_MAX)
    assert len(queue) == PENDING_MAX
    assert broken == ["front"]
    assert [queue.pop() for _ in range(PENDING_MAX + 1)] == [*range(1, PENDING_MAX + 1), None]


def test_a_break_comes_after_what_waits_before_it() -> None:
    broken: list[str] = []
    queue = SightQueue[int](broken.append)
    queue.add_break("front")
    assert broken == ["front"]  # nothing waits
    queue.add("front", 1)
    queue.add_break("front")
    queue.add_break("front")
    queue.add("left", 2)
    assert len(queue) == 2
    assert queue.pop() == 1
    assert broken == ["front"]
    assert queue.pop() == 2
    assert broken == ["front", "front"]
    queue.add("left", 3)
    queue.clear()
    assert (len(queue), queue.pop()) == (0, None)
