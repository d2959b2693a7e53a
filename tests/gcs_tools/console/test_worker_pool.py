"""Jobs in several processes."""

from __future__ import annotations

import os

import pytest

from gcs_tools.console.errors import CommandError
from gcs_tools.console.worker_pool import run_locally


def test_several_processes_do_all_jobs() -> None:
    jobs = [(number, 2) for number in range(20)]
    assert sorted(run_locally(pow, jobs, 2)) == [number**2 for number in range(20)]


def test_a_process_that_dies_is_one_line() -> None:
    with pytest.raises(CommandError, match="a worker process died"):
        list(run_locally(os._exit, [(1,)], 2))
