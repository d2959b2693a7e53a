"""The adversary at work, in short: what it uses, what it leaves, and what breaks without room.

One flight along a lane, three times, each in about a second.
"""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from gcs_tools.campaign.adversary.draw import SOURCE, adversary_case
from gcs_tools.campaign.adversary.shares import summarize_shares
from gcs_tools.campaign.flight import FlightRow, fly_numbered
from gcs_tools.campaign.generator.case import FlightCase
from gcs_tools.campaign.sources import AdversarySource
from onboard.contract.terms import Terms
from sitl.plant.pinned_error import PinnedError

SEED, NUMBER = 1, 5


@dataclass(frozen=True)
class Drawn:
    """A source of one flight that has been drawn before the service is broken."""

    one: FlightCase
    name: str = SOURCE

    def case(self, _seed: int, _number: int) -> FlightCase:
        return self.one


def flown() -> FlightRow:
    return fly_numbered(AdversarySource(), SEED, NUMBER)


def shares_of(row: FlightRow) -> dict[str, float]:
    return {each.name: each.median for each in summarize_shares([row.shares])}


def test_every_allowance_is_used_and_every_promise_kept() -> None:
    row = flown()
    assert not row.findings
    assert row.outcome == "arrived"
    assert row.least_margin_m is not None
    assert 0.0 <= row.least_margin_m < 0.5
    shares = shares_of(row)
    assert {"tracking", "velocity_along", "faces", "range", "reaction"} <= set(shares)
    assert min(shares.values()) >= 0.95
    assert max(shares.values()) <= 1.0


def test_an_allowance_that_is_switched_off_shows_in_its_share(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(PinnedError, "advance", lambda *_: None)
    shares = shares_of(flown())
    assert shares["tracking"] < 0.2
    assert shares["faces"] >= 0.95


def test_without_room_for_vehicle_and_errors_promises_break(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    attack = Drawn(adversary_case(SEED, NUMBER))
    monkeypatch.setattr(Terms, "body_m", property(lambda _: 0.0))
    row = fly_numbered(attack, SEED, NUMBER)
    assert row.least_margin_m is not None
    assert row.least_margin_m < -0.1
    assert "margin: " in row.findings
