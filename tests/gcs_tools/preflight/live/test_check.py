"""Live checks without a vehicle: what is learnt, and what it means."""

from __future__ import annotations

import dataclasses
import json
import math
from dataclasses import replace
from typing import Any

import pytest

from gcs_tools.preflight.finding import Verdict
from gcs_tools.preflight.live.daemon import (
    Status,
    clock_ahead_s,
    contract_finding,
    detections_finding,
    telemetry_finding,
)
from gcs_tools.preflight.live.detections import Sample, check_detections
from gcs_tools.preflight.live.vehicle import evaluate, flight_time_s
from gcs_tools.vehicle.clock import (
    ClockComparison,
    SystemTime,
    compare_clocks,
    compare_one_way,
    unix_offset_s,
)
from gcs_tools.vehicle.geofence import GeographicOrigin
from gcs_tools.vehicle.survey import EstimatorStatus, VehicleFacts, version_of
from onboard.contract.assessment import assess
from onboard.files.contract_file import load_contract
from onboard.files.mission_file import Mission
from onboard.mavlink.profiles.ardupilot import ARDUPILOT
from onboard.mavlink.profiles.parameter_rules import ParameterRule, at_least, at_most
from onboard.mavlink.profiles.profile import (
    AutopilotProfile,
    Firmware,
    Measured,
    ParameterFacts,
    TakeOver,
)
from onboard.mavlink.profiles.px4 import PX4
from onboard.mavlink.profiles.registry import OTHER
from onboard.mission_items.fence_items import FenceItem
from tests.gcs_tools.running import CONFIG

CONTRACT = load_contract(CONFIG / "paper_contract.yaml")
ASSESSMENT = assess(CONTRACT)
MISSION = Mission.model_validate({"altitude_m": 4.0, "legs": [{"end_ned_m": (46.0, 0.0)}]})
NOW_UNIX_S = 1_790_000_000.0
HOLDS, BROKEN, UNKNOWN = Verdict.HOLDS, Verdict.BROKEN, Verdict.UNKNOWN

FACTS = VehicleFacts(
    profile=PX4,
    version=(1, 15, 0),
    rates_hz={"ATTITUDE": 10.0, "LOCAL_POSITION_NED": 10.0},
    estimator=EstimatorStatus(flags=0x33F, worst_ratio=0.1),
    radio_heard=True,
    clock=ClockComparison(round_trip_s=0.004, unsteady_s=0.0),
    home_ned_m=(0.0, 0.0, 0.0),
    position_ned_m=(0.2, 0.0, 0.0),
    battery_share=0.9,
    battery_time_s=600.0,
    origin=GeographicOrigin(47.4, 8.5),
    fence=(),
)


def judged(endurance_s: float | None = None, **changes: Any) -> dict[str, Verdict]:
    found = evaluate(replace(FACTS, **changes), ASSESSMENT, MISSION, endurance_s)
    return {each.name: each.verdict for each in found}


@pytest.mark.parametrize(
    ("name", "profile", "verdict", "words"),
    [
        ("default", PX4, BROKEN, "coasts for 0.5 s, then brakes, but PX4 keeps flying to"),
        ("default", ARDUPILOT, HOLDS, "coasts for 0.5 s, then brakes"),
        ("px4", PX4, HOLDS, "frozen setpoint, gains 1.5/s and 1.8/s; measured 3.5 m at 2.8 m/s"),
    ],
)
def test_the_run_after_a_loss_of_the_stream_fits_the_autopilot(
    name: str, profile: AutopilotProfile, verdict: Verdict, words: str
) -> None:
    assessment = assess(load_contract(CONFIG / f"{name}_contract.yaml"))
    facts = replace(FACTS, profile=profile)
    (found,) = (
        each for each in evaluate(facts, assessment, None, None) if each.name == "setpoint_loss"
    )
    assert found.verdict is verdict
    assert words in found.text


def test_without_passive_safety_no_run_is_counted_on() -> None:
    assert "setpoint_loss" not in judged()


def test_a_vehicle_in_order() -> None:
    names = (
        "health",
        "firmware",
        "ATTITUDE",
        "link delay",
        "clock",
        "estimator",
        "home",
        "start",
        "battery",
        "geofence areas",
    )
    found = judged()
    assert {name: found[name] for name in names} == dict.fromkeys(names, HOLDS)


@pytest.mark.parametrize(
    ("changes", "name", "verdict"),
    [
        ({"unhealthy": "local position"}, "health", BROKEN),
        ({"version": (1, 13, 3)}, "firmware", BROKEN),
        ({"version": None}, "firmware", UNKNOWN),
        ({"profile": OTHER}, "parameters", UNKNOWN),
        ({"profile": OTHER}, "firmware", UNKNOWN),
        ({"rates_hz": {"ATTITUDE": 10.0}}, "LOCAL_POSITION_NED", BROKEN),
        ({"clock": ClockComparison(0.2, 0.0)}, "link delay", BROKEN),
        ({"clock": ClockComparison(0.2, None, "PING")}, "link delay", BROKEN),
        ({"clock": ClockComparison(0.004, None, "PING")}, "link delay", HOLDS),
        ({"clock": ClockComparison(0.004, None, "PING")}, "clock", UNKNOWN),
        ({"clock": None}, "link delay", UNKNOWN),
        ({"clock": ClockComparison(0.004, 0.15)}, "clock", BROKEN),
        ({"clock": None}, "clock", UNKNOWN),
        ({"estimator": None}, "estimator", UNKNOWN),
        ({"estimator": EstimatorStatus(0x33F, math.nan)}, "estimator", UNKNOWN),
        ({"estimator": EstimatorStatus(0x33F, 0.6)}, "estimator", BROKEN),
        ({"estimator": EstimatorStatus(0x33F & ~2, 0.1)}, "estimator", BROKEN),
        ({"estimator": EstimatorStatus(0x33F | 1024, 0.1)}, "estimator", BROKEN),
        # As recorded of a real PX4 that rests: its position is kept constant.
        ({"estimator": EstimatorStatus(0x3FF, 0.1), "on_ground": True}, "estimator", HOLDS),
        ({"estimator": EstimatorStatus(0x3FF, 0.1)}, "estimator", BROKEN),
        ({"estimator": EstimatorStatus(0x3FF & ~24, 0.1), "on_ground": True}, "estimator", BROKEN),
        ({"estimator": EstimatorStatus(0x3FF, 0.6), "on_ground": True}, "estimator", BROKEN),
        (
            {
                "profile": ARDUPILOT,
                "estimator": EstimatorStatus(0x3FF, 0.1),
                "on_ground": True,
            },
            "estimator",
            BROKEN,
        ),
        (
            {"profile": ARDUPILOT, "estimator": EstimatorStatus(0x33F | 32768, 0.1)},
            "estimator",
            BROKEN,
        ),
        ({"radio_heard": None}, "take-over", UNKNOWN),
        ({"radio_heard": None, "parameters": {"COM_RC_IN_MODE": 4.0}}, "take-over", HOLDS),
        ({"radio_heard": False}, "take-over", HOLDS),
        (
            {"profile": ARDUPILOT, "parameters": {"FENCE_TOTAL": 5.0}},
            "geofence areas",
            UNKNOWN,
        ),
        ({"parameters": {"FENCE_TOTAL": 5.0}}, "geofence areas", HOLDS),
        ({"home_ned_m": None}, "home", UNKNOWN),
        ({"home_ned_m": (0.0, 0.0, -3.0)}, "home", BROKEN),
        ({"position_ned_m": None}, "start", UNKNOWN),
        ({"position_ned_m": (3.0, 0.0, 0.0)}, "start", BROKEN),
        ({"fence": None}, "geofence areas", UNKNOWN),
        ({"origin": None}, "geofence areas", UNKNOWN),
        ({"fence": (FenceItem(5003, 100.0, 47.4, 8.5),)}, "geofence areas", HOLDS),
        ({"fence": (FenceItem(5003, 48.0, 47.4, 8.5),)}, "geofence areas", BROKEN),
        ({"fence": (FenceItem(5003, 0.0, 47.4, 8.5),)}, "geofence areas", UNKNOWN),
        ({"battery_time_s": 70.0}, "battery", BROKEN),
        ({"battery_time_s": None}, "battery", UNKNOWN),
        # Reckoned with the motors off.
        (
            {"battery_time_s": 90_000.0, "battery_share": 0.25, "endurance_s": 900.0},
            "battery",
            BROKEN,
        ),
        ({"battery_time_s": None, "battery_share": None, "endurance_s": 900.0}, "battery", UNKNOWN),
        ({"battery_time_s": None, "endurance_s": 900.0}, "battery", HOLDS),
        (
            {"battery_time_s": None, "battery_share": 0.25, "endurance_s": 900.0},
            "battery",
            BROKEN,
        ),
    ],
)
def test_each_answer_has_its_verdict(changes: dict[str, Any], name: str, verdict: Verdict) -> None:
    assert judged(**changes)[name] is verdict


def square(half_m: float) -> tuple[FenceItem, ...]:
    """An inclusion polygon around the middle of the mission."""
    per_degree_m = math.radians(1.0) * 6_371_000.0
    north, east = half_m / per_degree_m, half_m / per_degree_m / math.cos(math.radians(47.4))
    corners = ((north, east), (north, -east), (-north, -east), (-north, east))
    middle = 47.4 + 23.0 / per_degree_m
    return tuple(FenceItem(5001, 4.0, middle + n, 8.5 + e) for n, e in corners)


@pytest.mark.parametrize(
    ("half_m", "enabled", "verdict"),
    [(60.0, 1.0, HOLDS), (60.0, 0.0, HOLDS), (20.0, 1.0, BROKEN), (24.0, 1.0, BROKEN)],
)
def test_a_polygon_on_ardupilot_is_judged_by_where_it_is(
    half_m: float, enabled: float, verdict: Verdict
) -> None:
    fence = {
        "FENCE_ENABLE": enabled, "FENCE_TYPE": 7.0, "FENCE_TOTAL": 6.0,
        "FENCE_ALT_MAX": 100.0, "FENCE_RADIUS": 150.0, "FENCE_ACTION": 4.0,
    }  # fmt: skip
    found = judged(profile=ARDUPILOT, parameters=fence, fence=square(half_m))
    geofence = {name: each for name, each in found.items() if "FENCE" in name or "fence" in name}
    assert geofence.pop("geofence areas") is verdict
    assert set(geofence.values()) == {HOLDS}


def test_clocks_are_compared_within_what_the_link_allows() -> None:
    # The vehicle is 5 s behind; ways there and back differ from one exchange to the next.
    exchanges = [
        (10_000_000_000, 5_001_000_000, 10_003_000_000),
        (11_000_000_000, 6_001_000_000, 11_002_000_000),
    ]
    found = compare_clocks(exchanges)
    assert found.round_trip_s == pytest.approx(0.003)
    assert found.unsteady_s == 0.0
    # Set by 50 ms: 1 ms of that the link may have been.
    jumped = compare_clocks([*exchanges, (12_000_000_000, 7_051_000_000, 12_002_000_000)])
    assert jumped.unsteady_s == pytest.approx(0.048)


def told(arrived_s: float, boot_s: float, unix_s: float = 0.0) -> SystemTime:
    return SystemTime(arrived_s, arrived_s + NOW_UNIX_S, boot_s, unix_s)


@pytest.mark.parametrize("late_s", [0.0, 0.003])
def test_times_that_are_told_one_way_bound_the_same(late_s: float) -> None:
    # 5 s behind; up to 3 ms on their way; set by 50 ms at the third.
    steady = [told(10.0, 5.0), told(11.0 + late_s, 6.0)]
    found = compare_one_way(0.004, steady)
    assert (found.unsteady_s, found.source) == (0.0, "PING and SYSTEM_TIME")
    jumped = compare_one_way(0.004, [*steady, told(12.0, 7.05)])
    assert jumped.unsteady_s == pytest.approx(0.050 - 0.005 + late_s)


@pytest.mark.parametrize("times", [[], [told(10.0, 5.0)]])
def test_one_time_cannot_show_a_jump(times: list[SystemTime]) -> None:
    found = compare_one_way(0.004, times)
    assert (found.round_trip_s, found.unsteady_s, found.source) == (0.004, None, "PING")


def test_the_unix_time_is_of_the_quickest_message_and_of_a_clock_that_was_set() -> None:
    late = [told(10.0 + late_s, 5.0, NOW_UNIX_S + 30.0) for late_s in (0.4, 0.0, 0.2)]
    assert unix_offset_s(late) == pytest.approx(20.0)
    assert unix_offset_s([told(10.0, 5.0), told(11.0, 6.0, 6.0)]) is None


def test_a_clock_is_described_in_words() -> None:
    clock = ClockComparison(0.004, 0.0, "PING and SYSTEM_TIME", unix_offset_s=-1199.9)
    found = evaluate(replace(FACTS, clock=clock), ASSESSMENT, MISSION, None)
    (text,) = (each.text for each in found if each.name == "clock")
    assert "its Unix time is 1199.900 s behind this computer's" in text
    assert "PING and SYSTEM_TIME" in text


@pytest.mark.parametrize(
    ("number", "version", "stage"),
    [
        (0x01100040, (1, 16, 0), "alpha"),  # as recorded of the measured PX4
        (0x04070000, (4, 7, 0), "dev"),
        (0x010E03FF, (1, 14, 3), ""),
        (0x01110080, (1, 17, 0), "beta"),
        (0x011100C1, (1, 17, 0), "rc"),
        (0, None, ""),
        (0xFF, None, ""),
    ],
)
def test_the_version_is_read_with_its_stage(
    number: int, version: tuple[int, int, int] | None, stage: str
) -> None:
    assert version_of(number) == (version, stage)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"version": (1, 16, 0), "stage": "alpha"}, "system id 1, PX4 1.16.0 alpha"),
        ({"system_id": 7, "profile": ARDUPILOT}, "system id 7, ArduPilot 1.15.0"),
        ({"version": None}, "system id 1, PX4"),
        ({"profile": OTHER, "version": None}, "system id 1, unknown autopilot"),
    ],
)
def test_the_vehicle_is_named(changes: dict[str, Any], words: str) -> None:
    found = evaluate(replace(FACTS, **changes), ASSESSMENT, MISSION, None)
    assert [each.text for each in found if each.name == "identity"] == [words]


@pytest.mark.parametrize(
    ("profile", "heard", "words"),
    [
        (PX4, True, "POSCTL"),
        (PX4, False, "PX4 refuses POSCTL then: take over from the ground station with HOLD"),
        (ARDUPILOT, True, "LOITER"),
        (ARDUPILOT, False, "take over from the ground station with BRAKE"),
        (OTHER, True, "its mode switch"),
        (OTHER, False, "take over from the ground station"),
    ],
)
def test_how_the_pilot_takes_over_is_said(
    profile: AutopilotProfile, heard: bool, words: str
) -> None:
    found = evaluate(
        replace(FACTS, profile=profile, radio_heard=heard), ASSESSMENT, MISSION, endurance_s=None
    )
    (text,) = (each.text for each in found if each.name == "take-over")
    assert words in text


OWN = replace(
    OTHER,
    autopilot=13,
    key="own",
    name="Own",
    firmware=Firmware(Measured((2, 3), ("",), "2.3 of May"), oldest=(2, 0), newest=(2, 4)),
    parameters=ParameterFacts(
        setpoint_timeout="TIMEOUT",
        no_radio=("RADIO", 0.0),
        fence_prefixes=("FENCE",),
        rules=lambda demands, _: [
            ParameterRule("late", (at_most("TIMEOUT", demands.setpoint_timeout_s, "s"),))
        ],
        fence_rules=lambda demands, _: [
            ParameterRule("near", (at_least("FENCE_R", demands.radius_m, "m"),))
        ],
        fence_count="FENCE_N",
    ),
    take_over=TakeOver("the red button", "the blue button", sticks_ignored=("RADIO", 0.0)),
)


def test_an_own_profile_decides_on_firmware_parameters_fence_and_take_over() -> None:
    """As another project's would: nothing of it is known elsewhere."""
    right = {"TIMEOUT": 0.05, "FENCE_R": 100.0, "RADIO": 1.0}
    own: dict[str, Any] = {"profile": OWN, "version": (2, 3, 1)}
    found = judged(**own, parameters=right)
    assert set(found.values()) == {HOLDS}
    assert {"TIMEOUT", "FENCE_R"} <= found.keys()
    assert judged(**own, parameters=right | {"TIMEOUT": 9.0})["TIMEOUT"] is BROKEN
    assert judged(**own, parameters=right | {"FENCE_R": 9.0})["FENCE_R"] is BROKEN
    assert judged(**own, parameters=right | {"FENCE_N": 4.0})["geofence areas"] is UNKNOWN
    assert judged(**(own | {"version": (1, 9, 0)}), parameters=right)["firmware"] is BROKEN
    for radio, words in ((1.0, "take over with the red button"), (0.0, "the blue button")):
        facts = replace(FACTS, **own, parameters=right | {"RADIO": radio})
        texts = {each.name: each.text for each in evaluate(facts, ASSESSMENT, MISSION, None)}
        assert words in texts["take-over"]


def test_the_flight_time_has_a_reserve() -> None:
    assert flight_time_s(MISSION, ASSESSMENT) == pytest.approx(60.0 + 46.0 / 2.8 * 4.0 / 3.0)


def frame(sequence: int, **changes: Any) -> Sample:
    stamp_s = NOW_UNIX_S + 0.05 * sequence
    document = {
        "version": 1, "source": "front", "sequence": sequence, "stamp_unix_s": stamp_s,
        "frame": "local_ned", "range_m": 12.0, "field_of_view_deg": 120.0, "obstacles": [],
    }  # fmt: skip
    arrived_s = stamp_s + changes.pop("delay_s", 0.03)
    return Sample(arrived_s, json.dumps(document | changes).encode())


def detected(
    *samples: Sample, announced: tuple[str, ...] = ("front",), daemon_ahead_s: float | None = 0.0
) -> dict[str, Verdict]:
    found = check_detections(samples, announced, ASSESSMENT.terms, 3.0, daemon_ahead_s)
    return {each.name: each.verdict for each in found}


def test_a_sensor_in_order() -> None:
    found = detected(*map(frame, range(60)))
    assert set(found.values()) == {HOLDS}
    assert {"front age", "front reaction", "front clock", "front order"} < found.keys()


def test_silence_cannot_be_checked_and_an_announced_sensor_must_speak() -> None:
    assert detected(announced=()) == {"frames": UNKNOWN}
    assert detected() == {"frames": UNKNOWN, "front": BROKEN}
    both = detected(*map(frame, range(60)), announced=("front", "rear"))
    assert both["rear"] is BROKEN


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({"delay_s": 0.26}, "front age"),
        ({"delay_s": 0.12}, "front reaction"),
        ({"delay_s": -0.2}, "front clock"),
        ({"delay_s": 5.0}, "front clock"),
        ({"stamp_unix_s": NOW_UNIX_S}, "front order"),
        ({"range_m": 11.0}, "front detection_range"),
        ({"field_of_view_deg": 90.0}, "front field_of_view"),
    ],
)
def test_what_breaks_the_contract(changes: dict[str, Any], name: str) -> None:
    assert detected(*(frame(n, **changes) for n in range(60)))[name] is BROKEN


def test_one_gap_is_enough() -> None:
    samples = [frame(n) for n in range(60) if not 20 < n < 28]
    assert detected(*samples)["front age"] is BROKEN
    assert detected(frame(0))["front age"] is BROKEN


@pytest.mark.parametrize(
    ("thinnest_m", "bins", "verdict"),
    [
        (0.05, 600, HOLDS),
        (0.05, 500, BROKEN),
        (0.6, 48, HOLDS),
        (None, 2, None),
        (0.05, None, None),
    ],
)
def test_the_rays_of_a_scan_must_meet_the_thinnest_obstacle(
    thinnest_m: float | None, bins: int | None, verdict: Verdict | None
) -> None:
    """At 12 m a view of 120 degrees is 25.1 m wide."""
    terms = dataclasses.replace(ASSESSMENT.terms, thinnest_obstacle_m=thinnest_m)
    scan = None if bins is None else [12.0] * bins
    samples = [frame(n, free_range_m=scan) for n in range(60)]
    found = check_detections(samples, ("front",), terms, 3.0, 0.0)
    resolutions = [each for each in found if each.name == "front resolution"]
    assert [each.verdict for each in resolutions] == ([] if verdict is None else [verdict])


@pytest.mark.parametrize(
    ("view_deg", "needed", "verdict"),
    [(360.0, True, HOLDS), (120.0, True, BROKEN), (120.0, False, UNKNOWN)],
)
def test_against_movers_a_sensor_has_to_see_all_round(
    view_deg: float, *, needed: bool, verdict: Verdict
) -> None:
    terms = dataclasses.replace(ASSESSMENT.terms, movers_level="passive")
    samples = [frame(n, field_of_view_deg=view_deg) for n in range(60)]
    found = check_detections(samples, ("front",), terms, 3.0, 0.0, needed=needed)
    assert [each.verdict for each in found if each.name == "all_round"] == [verdict]
    assert "all_round" not in detected(*samples)
    in_view = dataclasses.replace(ASSESSMENT.terms, movers_level="passive_in_view")
    found = check_detections(samples, ("front",), in_view, 3.0, 0.0, needed=needed)
    assert "all_round" not in {each.name for each in found}


@pytest.mark.parametrize(("complete", "verdicts"), [(True, []), (False, [BROKEN])])
def test_against_movers_frames_have_to_name_all_they_see(
    *, complete: bool, verdicts: list[Verdict]
) -> None:
    terms = dataclasses.replace(ASSESSMENT.terms, movers_level="passive")
    changes = {"version": 2, "field_of_view_deg": 360.0, "frame_complete": complete}
    found = check_detections([frame(n, **changes) for n in range(60)], (), terms, 3.0, 0.0)
    assert [each.verdict for each in found if each.name == "frame_complete"] == verdicts


def test_garbage_is_reported() -> None:
    found = detected(*map(frame, range(60)), Sample(NOW_UNIX_S, b"\xff"))
    assert found["format"] is BROKEN


def test_the_daemon_must_hold_the_contract_that_was_checked() -> None:
    same = json.dumps({"sha256": CONTRACT.sha256}).encode()
    other = json.dumps({"sha256": "0" * 64}).encode()
    assert contract_finding([same], CONTRACT).verdict is HOLDS
    assert contract_finding([other], CONTRACT).verdict is BROKEN
    assert contract_finding([same, other], CONTRACT).verdict is BROKEN
    for answers in ([], [b"\xff"], [b"[]"], [b"{}"]):
        assert contract_finding(answers, CONTRACT).verdict is UNKNOWN


@pytest.mark.parametrize("ahead_s", [0.0, 1199.9, -1199.9, 1.8e9, -0.2])
def test_the_operators_clock_does_not_matter(ahead_s: float) -> None:
    """Stamps and the daemon agree; this computer's clock differs from both."""
    samples = [frame(n, delay_s=0.03 - ahead_s) for n in range(60)]
    found = check_detections(samples, ("front",), ASSESSMENT.terms, 3.0, ahead_s)
    assert {each.verdict for each in found} == {HOLDS}
    (clock,) = (each.text for each in found if each.name == "front clock")
    side = "the same as" if ahead_s == 0.0 else "ahead of" if ahead_s > 0.0 else "behind"
    assert f"{side} this computer's" in clock
    (age,) = (each.text for each in found if each.name == "front age")
    assert "newest frame up to 0.080 s old" in age


@pytest.mark.parametrize("ahead_s", [0.0, 1199.9, -1199.9])
@pytest.mark.parametrize(
    ("off_s", "verdicts"),
    [
        # The sensor's clock against the daemon's, this computer's being any.
        (1199.9, {"front clock": BROKEN, "front age": UNKNOWN, "front reaction": UNKNOWN}),
        (0.2, {"front clock": BROKEN, "front age": UNKNOWN, "front reaction": UNKNOWN}),
        (-20.0, {"front clock": BROKEN, "front age": BROKEN, "front reaction": BROKEN}),
        (-0.1, {"front clock": HOLDS, "front age": HOLDS, "front reaction": BROKEN}),
    ],
)
def test_a_sensor_whose_clock_is_wrong_is_told(
    ahead_s: float, off_s: float, verdicts: dict[str, Verdict]
) -> None:
    samples = [frame(n, delay_s=0.03 - off_s - ahead_s) for n in range(60)]
    found = detected(*samples, daemon_ahead_s=ahead_s)
    assert {name: found[name] for name in verdicts} == verdicts


def test_without_a_daemon_stamps_cannot_be_judged() -> None:
    found = detected(*map(frame, range(60)), daemon_ahead_s=None)
    names = ("front age", "front reaction", "front clock")
    assert {name: found[name] for name in names} == dict.fromkeys(names, UNKNOWN)
    assert found["front order"] is found["front declares"] is HOLDS


def statuses(key: str, ages_s: list[Any]) -> list[Status]:
    return [Status(NOW_UNIX_S, {key: age_s}) for age_s in ages_s]


AGES = pytest.mark.parametrize(
    ("ages_s", "verdict"),
    [
        ([0.01, 0.02], HOLDS),
        ([0.01, 0.6], BROKEN),
        ([0.01, None], BROKEN),
        ([None], BROKEN),
        ([0.01, "0.01"], BROKEN),
        ([True], BROKEN),
        ([math.nan], BROKEN),
        ([], UNKNOWN),
    ],
)


@AGES
def test_the_daemon_needs_fresh_telemetry(ages_s: list[Any], verdict: Verdict) -> None:
    assert telemetry_finding(statuses("telemetry_age_s", ages_s)).verdict is verdict


@AGES
def test_the_daemon_itself_needs_fresh_detections(ages_s: list[Any], verdict: Verdict) -> None:
    found = detections_finding(statuses("detection_age_s", ages_s), ASSESSMENT.terms)
    assert found.verdict is verdict


def test_a_daemon_that_sees_nothing_is_told() -> None:
    blind = detections_finding(statuses("detection_age_s", [None]), ASSESSMENT.terms)
    assert blind.text == "the daemon has no detections"
    old = detections_finding(statuses("detection_age_s", [31.0]), ASSESSMENT.terms)
    assert "31.000 s old, limit 0.3 s" in old.text


def test_the_daemons_clock_is_told_by_the_quickest_status() -> None:
    def status(late_s: float, time_s: object) -> Status:
        return Status(NOW_UNIX_S + late_s, {"time_s": time_s})

    late = [status(late_s, NOW_UNIX_S + 20.0) for late_s in (0.3, 0.001, 0.1)]
    assert clock_ahead_s(late) == pytest.approx(19.999)
    assert clock_ahead_s([status(0.0, each) for each in (None, "now", True, math.inf)]) is None
    assert clock_ahead_s([]) is None
