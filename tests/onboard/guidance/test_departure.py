"""Why a leg may not be started, and how often that is reported."""

import pytest

from onboard.files.contract_file import Contract
from onboard.files.yaml_file import validate
from onboard.guidance.departure import (
    REFUSAL_PERIOD_S,
    START_TOLERANCE_M,
    Refusal,
    RefusalKind,
    RefusalReport,
    departure_refusals,
)
from onboard.guidance.envelope import at_rest_speed_mps
from tests.onboard.guidance.perfect_flight import PerfectFlight, mission_to, pose_at


def refusals(flight: PerfectFlight, *place: float, **pose: object) -> list[Refusal]:
    return departure_refusals(flight.situation, pose_at(*place, **pose))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "place",
    [
        (0.0, 0.0, -4.0),
        (-START_TOLERANCE_M, 0.0, -4.0),
        (58.4, 0.0, -4.0),
        (20.0, 8.0, -4.0),
        (20.0, -8.0, -4.0),
        (0.0, 0.0, -4.0 - START_TOLERANCE_M),
        (0.0, 0.0, -4.0 + START_TOLERANCE_M),
    ],
)
def test_near_the_leg_and_at_rest_it_may_start(
    flight: PerfectFlight, place: tuple[float, float, float]
) -> None:
    assert refusals(flight, *place) == []


@pytest.mark.parametrize(
    ("place", "kind", "text"),
    [
        (
            (-1.6, 0.0, -4.0),
            RefusalKind.BEFORE_LEG,
            "1.6 m before the start of the leg (limit 1.5 m)",
        ),
        ((58.6, 0.0, -4.0), RefusalKind.LEG_FLOWN, "the leg is already flown"),
        ((20.0, 8.2, -4.0), RefusalKind.BESIDE_LEG, "8.2 m beside the leg (limit 8 m)"),
        ((20.0, -8.2, -4.0), RefusalKind.BESIDE_LEG, "8.2 m beside the leg (limit 8 m)"),
        (
            (0.0, 0.0, -5.6),
            RefusalKind.OFF_HEIGHT,
            "1.6 m off the cruise height (limits 1.5 m above, 1.5 m below)",
        ),
        (
            (0.0, 0.0, -2.4),
            RefusalKind.OFF_HEIGHT,
            "1.6 m off the cruise height (limits 1.5 m above, 1.5 m below)",
        ),
    ],
)
def test_a_refusal_says_what_is_wrong_and_what_is_expected(
    flight: PerfectFlight, place: tuple[float, float, float], kind: RefusalKind, text: str
) -> None:
    assert refusals(flight, *place) == [Refusal(kind, text)]


def test_near_the_ground_less_is_allowed_below(contract: Contract) -> None:
    flight = PerfectFlight(contract, mission_to((60.0, 0.0), altitude_m=2.0))
    (clause,) = (c for c in flight.navigator.assessment.clauses if c.name == "ground_clearance")
    assert 0.0 < clause.margin < START_TOLERANCE_M
    assert refusals(flight, 0.0, 0.0, -2.0 + clause.margin - 0.01) == []
    (refusal,) = refusals(flight, 0.0, 0.0, -2.0 + clause.margin + 0.01)
    assert refusal.kind is RefusalKind.OFF_HEIGHT
    assert refusal.text.endswith(f"1.5 m above, {clause.margin:.1f} m below)")


def test_a_moving_vehicle_does_not_start(flight: PerfectFlight) -> None:
    limit_mps = at_rest_speed_mps(flight.navigator.assessment)
    assert refusals(flight, velocity_ned_mps=(0.0, limit_mps - 0.01, 0.0)) == []
    (refusal,) = refusals(flight, velocity_ned_mps=(0.0, 0.0, limit_mps + 0.5))
    expected = f"not at rest ({limit_mps + 0.5:.1f} m/s, limit {limit_mps:.1f} m/s)"
    assert refusal == Refusal(RefusalKind.MOVING, expected)


@pytest.mark.parametrize(("y_m", "inside"), [(0.0, True), (2.5, True), (5.0, False), (-5.0, False)])
def test_inside_a_region_it_does_not_start(flight: PerfectFlight, y_m: float, inside: bool) -> None:
    flight.see(5.0, 0.0)
    found = refusals(flight, 0.0, y_m)
    text = "inside the region of influence of obstacle front/1"
    assert found == ([Refusal(RefusalKind.INSIDE_REGION, text, "front/1")] if inside else [])


def test_every_reason_is_given(flight: PerfectFlight) -> None:
    found = refusals(flight, -3.0, 9.0, 0.0, velocity_ned_mps=(3.0, 0.0, 0.0))
    assert [refusal.kind for refusal in found] == [
        RefusalKind.BEFORE_LEG,
        RefusalKind.BESIDE_LEG,
        RefusalKind.OFF_HEIGHT,
        RefusalKind.MOVING,
    ]
    assert flight.navigator.departure_refusals(pose_at(-3.0, 9.0, 0.0)) == found[:3]


# ---------------------------------------------------------------------------- the report

MOVING = Refusal(RefusalKind.MOVING, "not at rest")
WIND = Refusal(RefusalKind.WIND, "more wind than 3 m/s")


def test_a_report_lists_the_reasons() -> None:
    event = RefusalReport().news([MOVING, WIND], 7.0)
    assert event is not None
    assert (event.time_s, event.name) == (7.0, "refused")
    assert event.text == "not leaving standby: not at rest; more wind than 3 m/s"
    assert event.data["reasons"] == [
        {"kind": "moving", "subject": "", "text": "not at rest"},
        {"kind": "wind", "subject": "", "text": "more wind than 3 m/s"},
    ]


def test_the_same_kinds_are_reported_once_whatever_their_numbers() -> None:
    report = RefusalReport()
    assert report.news([Refusal(RefusalKind.MOVING, "1.0 m/s")], 0.0) is not None
    assert report.news([Refusal(RefusalKind.MOVING, "2.0 m/s")], 60.0) is None


def test_another_kind_waits_for_its_time() -> None:
    report = RefusalReport()
    assert report.news([MOVING], 0.0) is not None
    assert report.news([MOVING, WIND], REFUSAL_PERIOD_S - 0.1) is None
    assert report.news([MOVING, WIND], REFUSAL_PERIOD_S) is not None


def test_another_subject_is_another_reason() -> None:
    report, kind = RefusalReport(), RefusalKind.INSIDE_REGION
    assert report.news([Refusal(kind, "inside", "front/1")], 0.0) is not None
    assert report.news([Refusal(kind, "inside", "front/2")], 9.0) is not None


def test_after_the_end_it_reports_again() -> None:
    report = RefusalReport()
    report.news([MOVING], 0.0)
    report.end()
    assert report.news([MOVING], REFUSAL_PERIOD_S) is not None


@pytest.mark.parametrize(("stated_m", "says"), [(None, "is 0 m"), (2.0, "is 2 m"), (9.0, None)])
def test_without_a_ring_the_operator_has_to_vouch_for_enough(
    contract: Contract, stated_m: float | None, says: str | None
) -> None:
    data = contract.model_dump(mode="json")
    data["vehicle"] |= {"rest_settle_s": 0.4}
    data["requirements"] |= {"stop": True, "passive_safety": False, "movers": "passive_in_view"}
    data["environment"]["movers"] = [{"class": "person", "speed_max_mps": 0.5, "size_max_m": 1.0}]
    mission = mission_to((60.0, 0.0)).model_copy(update={"start_clear_of_movers_m": stated_m})
    flight = PerfectFlight(validate(data, Contract, source="test"), mission)
    found = [each for each in refusals(flight, 0.0, 0.0, -4.0) if each.kind == "start_word"]
    assert bool(found) == (says is not None)
    assert all(says in each.text and "needed" in each.text for each in found if says)
