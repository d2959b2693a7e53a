"""What oracles read in a flight: frames, onsets, the true tracking error."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_tools.campaign.oracles.evidence import in_leg, onset_s
from gcs_tools.campaign.oracles.registry import ORACLES, findings
from onboard.contract.assessment import TICK_S
from sitl.virtual.faults.schema import Fault
from tests.gcs_tools.campaign.oracles.evidence import (
    AVOIDS,
    BEGAN_S,
    changed,
    flown,
    result,
    state,
)


def test_the_synthetic_flight_has_no_finding() -> None:
    assert findings(flown()) == {}


@given(
    st.tuples(*[st.floats(-100.0, 100.0)] * 2),
    st.floats(-math.pi, math.pi),
)
def test_a_leg_s_frame_is_a_rotation(vector: tuple[float, float], heading_rad: float) -> None:
    along, across = in_leg(vector, heading_rad)
    assert math.hypot(along, across) == pytest.approx(math.hypot(*vector))
    ahead = in_leg((math.cos(heading_rad), math.sin(heading_rad)), heading_rad)
    assert ahead == pytest.approx((1.0, 0.0))


def test_down_is_left_out_of_a_leg_s_frame() -> None:
    assert in_leg([1.0, 2.0, 3.0], math.pi / 2.0) == pytest.approx((2.0, -1.0))


def test_a_fault_without_a_phase_begins_with_the_log() -> None:
    assert onset_s(flown(), None, 1, 2.5) == pytest.approx(BEGAN_S - TICK_S + 2.5)


@pytest.mark.parametrize(
    ("phase", "entry", "tick"),
    [("cruise", 1, 10), ("avoid", 1, AVOIDS), ("cruise", 2, AVOIDS + 50)],
)
def test_a_fault_begins_with_an_entry_into_its_phase(phase: str, entry: int, tick: int) -> None:
    assert onset_s(flown(), phase, entry, 0.5) == pytest.approx(BEGAN_S + tick * TICK_S + 0.5)


@pytest.mark.parametrize(("phase", "entry"), [("hold", 1), ("cruise", 3), ("standby", 1)])
def test_a_phase_that_was_never_entered_begins_nothing(phase: str, entry: int) -> None:
    assert onset_s(flown(), phase, entry, 0.0) is None


def test_the_true_tracking_error_is_horizontal_and_counts_in_flight_only() -> None:
    states = [state(tick) for tick in range(30)]
    truths: list[dict[str, Any]] = [
        {"position_ned_m": list(each["reference_position_ned_m"]), "collisions": 0}
        for each in states
    ]
    truths[5]["position_ned_m"][0] += 9.0  # in standby
    truths[20]["position_ned_m"][2] += 7.0  # vertical
    truths[21]["position_ned_m"][1] += 0.3
    states[22]["reference_position_ned_m"] = None
    evidence = flown(states=states, plans=[], truths=truths)
    assert evidence.true_tracking_error_m == pytest.approx(0.3)


def test_a_flight_without_a_reference_has_no_tracking_error() -> None:
    states = [state(tick, reference_position_ned_m=None) for tick in range(30)]
    assert flown(states=states).true_tracking_error_m == 0.0


def test_faults_and_violations_disturb_a_flight() -> None:
    assert flown().undisturbed
    assert not flown(faults=(Fault(kind="gust", amount=3.0),)).undisturbed
    assert not flown(ended=result(violations=("tracking_error",))).undisturbed


def test_only_the_first_finding_of_an_oracle_is_kept() -> None:
    states = changed(60, obstacles_known=10_000)
    states[20]["reference_acceleration_ned_mps2"] = [60.0, 0.0, 0.0]
    states[30]["reference_acceleration_ned_mps2"] = [50.0, 0.0, 0.0]
    found = findings(flown(states=states))
    assert set(found) == {"bounded_memory", "setpoints_in_limits"}
    assert "60.000 m/s²" in found["setpoints_in_limits"]
    assert set(found) < set(ORACLES)
