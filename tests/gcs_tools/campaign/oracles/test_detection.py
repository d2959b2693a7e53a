"""The oracle about monitors: a broken assumption is noticed in time."""

from __future__ import annotations

from typing import Any, get_args

import pytest

from gcs_tools.campaign.detection_bounds import DetectionBound, detection_bound
from gcs_tools.campaign.oracles.detection import detected_in_time
from onboard.contract.assessment import TICK_S
from onboard.files.contract_file import Contract
from onboard.guidance.phases import Phase
from sitl.virtual.faults.schema import Fault, FaultKind
from tests.gcs_tools.campaign.oracles.evidence import event, flown, scenario

BEGINS = 10  # the tick of the first cruise
CONTRACT = scenario().contract


def fault(kind: str = "detections_off", **more: Any) -> Fault:
    return Fault.model_validate({"kind": kind, "phase": "cruise", **more})


def bound(each: Fault) -> DetectionBound:
    found = detection_bound(each, CONTRACT)
    assert found is not None
    return found


def within(each: Fault) -> int:
    """Ticks from the fault's beginning to its bound."""
    return round(bound(each).within_s / TICK_S)


def test_a_fault_that_goes_unnoticed_is_a_finding() -> None:
    (found,) = detected_in_time(flown(faults=(fault(),)))
    expected_s = CONTRACT.sensor.frame_age_max_s + 2.0 * TICK_S
    assert found == f"detections_off went unnoticed for {expected_s:.2f} s: no detection_age"


def test_a_violation_within_the_bound_is_in_time() -> None:
    ticks = within(fault())
    for tick, unnoticed in ((BEGINS, 0), (BEGINS + ticks - 1, 0), (BEGINS + ticks + 1, 1)):
        noticed = [event("violation", tick, assumption="detection_age")]
        assert len(list(detected_in_time(flown(faults=(fault(),), events=noticed)))) == unnoticed


def test_another_assumption_does_not_count() -> None:
    other = [event("violation", BEGINS + 1, assumption="tracking_error")]
    assert list(detected_in_time(flown(faults=(fault(),), events=other)))


def test_an_event_of_that_name_counts() -> None:
    full = fault("disk_full")
    assert list(detected_in_time(flown(faults=(full,))))
    ended = [event("log_ended", BEGINS + 1)]
    assert not list(detected_in_time(flown(faults=(full,), events=ended)))


def test_a_fault_that_passes_sooner_need_not_be_noticed() -> None:
    assert not list(detected_in_time(flown(faults=(fault(duration_s=0.1),))))
    assert list(detected_in_time(flown(faults=(fault(duration_s=5.0),))))


def test_a_fault_that_never_begins_need_not_be_noticed() -> None:
    never = Fault(kind="detections_off", phase=Phase.HOLD)
    assert not list(detected_in_time(flown(faults=(never,))))


def test_a_service_that_is_not_in_flight_need_not_notice() -> None:
    early = Fault(kind="detections_off", start_s=0.02)
    assert not list(detected_in_time(flown(faults=(early,))))


def test_a_flight_that_ends_sooner_was_not_exposed() -> None:
    late = fault(start_s=3.9)
    assert not list(detected_in_time(flown(faults=(late,))))


# ---------------------------------------------------------------------------- the bounds


@pytest.mark.parametrize("kind", get_args(FaultKind))
def test_bounds_are_positive_and_short(kind: str) -> None:
    for amount in (None, 0.01, 0.5, 2.0, 50.0):
        try:
            each = Fault.model_validate({"kind": kind, "amount": amount, "duration_s": 1.0})
        except ValueError:
            continue
        found = detection_bound(each, CONTRACT)
        if found is not None:
            assert 0.0 < found.within_s < 60.0
            assert isinstance(found.assumptions, frozenset)


@pytest.mark.parametrize(
    ("kind", "certain", "uncertain"),
    [
        ("detections_short_range", 1.0, 1e4),
        ("detections_narrow_view", 20.0, 359.0),
        ("detections_late", 0.9, 0.01),
    ],
)
def test_only_amounts_beyond_the_contract_must_be_noticed(
    kind: str, certain: float, uncertain: float
) -> None:
    assert detection_bound(fault(kind, amount=certain), CONTRACT) is not None
    assert detection_bound(fault(kind, amount=uncertain), CONTRACT) is None


def test_a_stall_is_noticed_when_it_is_over() -> None:
    assert bound(fault("tick_stall", duration_s=0.5)).within_s == pytest.approx(0.5 + 2.0 * TICK_S)
    assert detection_bound(fault("tick_stall", duration_s=0.03), CONTRACT) is None


@pytest.mark.parametrize("kind", ["gust", "detections_hidden", "link_lossy"])
def test_what_breaks_nothing_for_certain_has_no_bound(kind: str) -> None:
    assert detection_bound(fault(kind, amount=0.3), CONTRACT) is None


@pytest.mark.parametrize(
    ("kind", "assumptions"),
    [("heartbeats_lost", {"telemetry_age"}), ("operator_takes_over", set())],
)
def test_some_faults_end_the_control(kind: str, assumptions: set[str]) -> None:
    assert bound(fault(kind, duration_s=30.0)).assumptions == assumptions


def test_an_end_of_control_has_to_be_noticed() -> None:
    (sentence,) = detected_in_time(flown(faults=(fault("operator_takes_over", duration_s=30.0),)))
    assert sentence.endswith("no end of control")


@pytest.mark.parametrize(("model", "within_s"), [("frozen", 1.2), ("coast", 5.0)])
def test_an_autopilot_without_setpoints_leaves_its_mode_or_is_seen_to_stay_behind(
    model: str, within_s: float
) -> None:
    """ArduPilot stays in GUIDED: no heartbeat tells."""
    gains = {"gain_per_s": 1.3, "velocity_gain_per_s": 4.5} if model == "frozen" else {}
    stated = CONTRACT.model_dump()
    timeout_s = stated["vehicle"]["setpoint_loss_timeout_s"]
    loss = gains or {"timeout_s": timeout_s}
    stated["vehicle"]["setpoint_loss"] = {"model": model, **loss}
    found = detection_bound(fault("setpoints_lost"), Contract.model_validate(stated))
    assert found is not None
    assert found.assumptions == {"second_commander", "tracking_error"}
    assert found.within_s == pytest.approx(timeout_s + within_s)
