"""The budget of the battery."""

import pytest

from onboard.files.mission_file import EnergyBudget, Mission
from onboard.monitoring.energy import EnergyMonitor, at_reserve, shortage, there_and_back_s

BUDGET = EnergyBudget(reserve_fraction=0.25, endurance_s=1000.0)
LEGS = [{"end_ned_m": [60.0, 0.0]}, {"end_ned_m": [60.0, 40.0]}]
MISSION = Mission.model_validate({"altitude_m": 4.0, "legs": LEGS})


@pytest.mark.parametrize(
    ("charge", "after_s", "returns"),
    [
        (0.90, 10.0, False),
        # Used 33 %, one more for the resolution: 57 - 34 = 23.
        (0.57, 10.0, True),
        (0.60, 10.0, False),
        # Used little, as the battery says; but hovered for 600 of 1000 s.
        (0.84, 600.0, True),
        (0.88, 600.0, False),
        (None, 0.0, True),
    ],
)
def test_it_turns_while_the_way_back_and_the_reserve_are_left(
    charge: float | None, after_s: float, returns: bool
) -> None:
    monitor = EnergyMonitor()
    monitor.begin_flight(0.90, 100.0)
    cause = monitor.return_cause(BUDGET, charge, 100.0 + after_s)
    assert (cause is not None) is returns


def test_the_cause_has_its_figures() -> None:
    monitor = EnergyMonitor()
    monitor.begin_flight(None, 0.0)
    assert monitor.return_cause(BUDGET, 0.62, 1.0) == (
        "battery at 62 %, the way back may take 39 %, reserve 25 %"
    )
    assert monitor.return_cause(BUDGET, None, 1.0) == "the battery has not been reported for 5 s"


def test_a_mission_needs_enough_for_there_back_and_the_reserve() -> None:
    assert there_and_back_s(MISSION, 2.0) == pytest.approx(2.0 * (100.0 / 2.0 + 20.0))
    assert shortage(BUDGET, 0.39, MISSION, 2.0) is None
    assert shortage(BUDGET, 0.38, MISSION, 2.0) == (
        "battery at 38 %: 140 s there and back and the reserve take 39 %"
    )
    assert "unknown" in str(shortage(BUDGET, None, MISSION, 2.0))


def test_at_the_reserve_the_pilot_is_told_to_land() -> None:
    assert at_reserve(BUDGET, 0.26) is None
    assert at_reserve(BUDGET, None) is None
    assert at_reserve(BUDGET, 0.25) == "battery at 25 %, reserve 25 %: land now"
