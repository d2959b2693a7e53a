"""Flights in this process, and in several."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from gcs_tools.campaign import workers
from gcs_tools.campaign.flight import FlightRow
from gcs_tools.campaign.sources import GeneratedSource, Source
from gcs_tools.campaign.workers import FlightJob, fly_locally, fly_on_cluster
from gcs_tools.console.errors import CommandError
from tests.gcs_tools.campaign.rows import row

QUICK = GeneratedSource("quick")


def fly(source: Source, campaign_seed: int, number: int) -> FlightRow:
    return row(source=source.name, campaign_seed=campaign_seed, number=number)


def test_one_process_flies_in_order_and_on_demand(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "fly_numbered", fly)
    drawn: list[int] = []

    def jobs() -> Iterator[FlightJob]:
        for number in range(100):
            drawn.append(number)
            yield FlightJob(QUICK, 5, number)

    rows = fly_locally(jobs(), 1)
    assert [next(rows).number for _ in range(3)] == [0, 1, 2]
    assert drawn == [0, 1, 2]


def test_a_job_names_its_flight() -> None:
    job = FlightJob(QUICK, 5, 7)
    assert fly(*job) == row(source="quick", campaign_seed=5, number=7)


def test_no_jobs_give_no_rows() -> None:
    assert list(fly_locally([], 1)) == []


def test_no_scheduler_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "_CONNECT_TIMEOUT_S", 0.5)
    with pytest.raises(CommandError, match=r"--dask tcp://127\.0\.0\.1:9: no scheduler answers"):
        next(fly_on_cluster([FlightJob(QUICK, 1, 0)], "tcp://127.0.0.1:9"))
