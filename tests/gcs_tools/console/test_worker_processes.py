"""One function over many jobs, in this process and in others."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest

from gcs_tools.console.errors import CommandError
from gcs_tools.console.worker_processes import in_processes


def test_one_process_runs_in_order_and_on_demand() -> None:
    drawn: list[int] = []

    def jobs() -> Iterator[tuple[int, int]]:
        for number in range(9):
            drawn.append(number)
            yield number, 2

    results = in_processes(pow, jobs(), 1)
    assert [next(results) for _ in range(3)] == [0, 1, 4]
    assert drawn == [0, 1, 2]


def test_several_processes_run_all_jobs() -> None:
    jobs = [(number, 2) for number in range(20)]
    assert sorted(in_processes(pow, jobs, 2)) == [number**2 for number in range(20)]


def test_a_process_that_dies_is_one_line() -> None:
    with pytest.raises(CommandError, match="a worker process died"):
        list(in_processes(os._exit, [(1,)], 2))
