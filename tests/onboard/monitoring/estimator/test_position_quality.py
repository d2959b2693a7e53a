"""Each sign that a position is not what it should be, on both autopilots, with GPS and without."""

from collections.abc import Callable
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.mavlink.position_reports import (
    EstimatorReport,
    GpsReport,
    HealthReport,
    PositionReports,
)
from onboard.mavlink.profiles import ardupilot, px4, registry
from onboard.mavlink.profiles.profile import EstimatorFacts
from onboard.monitoring.assumptions import Assumption
from onboard.monitoring.estimator.position_quality import (
    ACCURACY_MAX_M,
    DEAD_RECKONING_S,
    FIX_MEMORY_S,
    PositionQualityMonitor,
    Sign,
    Worth,
)

NAN = float("nan")
PX4, ARDUPILOT = px4.PX4.estimator, ardupilot.ARDUPILOT.estimator
OTHER = registry.OTHER.estimator
# As recorded in flight; optical flow and visual odometry give a relative position only.
GOOD_FLAGS = {PX4: 0x37F, ARDUPILOT: 0x33F, OTHER: 0x37F}
ABSOLUTE, RELATIVE = 0x10, 0x08
GPS_BIT, AHRS_BIT, XY_BIT = 0x20, 0x200000, 0x4000
HEALTHY = GPS_BIT | AHRS_BIT | XY_BIT | 0x0F
TICK_S = 0.02


@dataclass
class Flight:
    """An autopilot that says what it is told to say, at the rates that are asked of it."""

    facts: EstimatorFacts = PX4
    by_gps: bool = True
    now_s: float = 0.0

    def __post_init__(self) -> None:
        self.reports = PositionReports(facts=self.facts)
        self.monitor = PositionQualityMonitor(self.reports)
        self.flags: int | None = GOOD_FLAGS[self.facts]
        self.fix_type: int | None = 3
        if not self.by_gps:
            self.flags = GOOD_FLAGS[self.facts] & ~ABSOLUTE
            self.fix_type = 0
        self.ratios = [0.1, 0.1, 0.1]
        self.accuracy_m = 0.3 if self.facts is PX4 else NAN
        self.health: int | None = HEALTHY if self.by_gps else HEALTHY & ~GPS_BIT
        self.present = HEALTHY

    def run(self, seconds: float) -> list[Sign]:
        seen = []
        for _ in range(round(seconds / TICK_S)):
            self.now_s += TICK_S
            tick = round(self.now_s / TICK_S)
            if tick % 10 == 0:
                self._say()
            if tick % 25 == 0 and self.health is not None:
                self.reports.health.hear(
                    HealthReport(self.present, self.present, self.health), self.now_s
                )
            sign = self.monitor.check(self.now_s)
            if sign is not None:
                seen.append(sign)
        return seen

    def _say(self) -> None:
        if self.flags is not None:
            name = "EKF_STATUS_REPORT" if self.facts is ARDUPILOT else "ESTIMATOR_STATUS"
            velocity, position, height = self.ratios
            report = EstimatorReport(name, self.flags, velocity, position, height, self.accuracy_m)
            self.reports.estimator.hear(report, self.now_s)
        if self.fix_type is not None:
            self.reports.hear_gps(GpsReport(self.fix_type), self.now_s)

    def depart(self) -> "Flight":
        assert self.run(3.0) == []
        assert self.monitor.departure_failures(self.now_s) == []
        self.monitor.depart(self.now_s)
        assert self.run(5.0) == []
        return self


Change = Callable[[Flight], None]


def changed(**values: object) -> Change:
    def change(flight: Flight) -> None:
        for name, value in values.items():
            setattr(flight, name, value)

    return change


def without(flags: int) -> Change:
    def change(flight: Flight) -> None:
        assert flight.flags is not None
        flight.flags &= ~flags

    return change


def with_flag(flags: int) -> Change:
    def change(flight: Flight) -> None:
        assert flight.flags is not None
        flight.flags |= flags

    return change


def unhealthy(bits: int) -> Change:
    def change(flight: Flight) -> None:
        assert flight.health is not None
        flight.health &= ~bits

    return change


def text(words: str) -> Change:
    return lambda flight: flight.reports.hear_text(words, flight.now_s)


DOUBTED, DEAD_RECKONED, MADE_UP = Worth.DOUBTED, Worth.DEAD_RECKONED, Worth.MADE_UP
BOTH = (PX4, ARDUPILOT)
NONE = None

# What happens, on which autopilots, what it is worth with GPS and without, words of the sentence.
SIGNS: list[tuple[str, Change, tuple[EstimatorFacts, ...], Worth | None, Worth | None, str]] = [
    ("no fix", changed(fix_type=1), BOTH, DEAD_RECKONED, NONE, "GPS fix lost (fix type 1)"),
    ("no gps", changed(fix_type=0), BOTH, DEAD_RECKONED, NONE, "GPS fix lost (fix type 0)"),
    ("2d fix", changed(fix_type=2), BOTH, DEAD_RECKONED, NONE, "GPS fix lost (fix type 2)"),
    ("gps silent", changed(fix_type=None), BOTH, DEAD_RECKONED, NONE, "GPS_RAW_INT silent"),
    ("absolute gone", without(ABSOLUTE), BOTH, DEAD_RECKONED, NONE, "absolute horizontal pos"),
    ("horizontal gone", without(ABSOLUTE | RELATIVE), BOTH, MADE_UP, MADE_UP, "horizontal pos"),
    ("velocity gone", without(0x02), BOTH, MADE_UP, MADE_UP, "horizontal velocity lost"),
    ("vertical velocity gone", without(0x04), BOTH, MADE_UP, MADE_UP, "vertical velocity lost"),
    ("height gone", without(0x60), BOTH, MADE_UP, MADE_UP, "vertical position lost"),
    ("attitude gone", without(0x01), BOTH, MADE_UP, MADE_UP, "attitude lost"),
    ("constant position", with_flag(0x80), BOTH, MADE_UP, MADE_UP, "constant position mode"),
    ("uninitialised", with_flag(0x400), (ARDUPILOT,), MADE_UP, MADE_UP, "not initialized"),
    ("gps glitch", with_flag(0x400), (PX4,), DOUBTED, DOUBTED, "GPS glitch"),
    ("gps glitching", with_flag(0x8000), (ARDUPILOT,), DOUBTED, DOUBTED, "GPS glitch"),
    ("accelerometer", with_flag(0x800), (PX4,), DOUBTED, DOUBTED, "accelerometer error"),
    ("velocity ratio", changed(ratios=[1.1, 0.1, 0.1]), BOTH, DOUBTED, DOUBTED, "velocity test"),
    ("position ratio", changed(ratios=[0.1, 1.1, 0.1]), BOTH, DOUBTED, DOUBTED, "position test"),
    ("height ratio", changed(ratios=[0.1, 0.1, 1.1]), BOTH, DOUBTED, DOUBTED, "height test"),
    ("variance", changed(ratios=[0.85, 0.1, 0.1]), (ARDUPILOT,), DOUBTED, DOUBTED, "limit 0.80"),
    ("accuracy", changed(accuracy_m=2.1), (PX4,), DOUBTED, NONE, "horizontal accuracy 2.1 m"),
    ("gps unhealthy", unhealthy(GPS_BIT), BOTH, DEAD_RECKONED, NONE, "GPS unhealthy"),
    ("gps not present", changed(present=HEALTHY & ~GPS_BIT), BOTH, DEAD_RECKONED, NONE, "GPS unh"),
    ("local position", unhealthy(XY_BIT), (PX4,), DOUBTED, DOUBTED, "estimate unhealthy"),
    ("ahrs", unhealthy(AHRS_BIT), (ARDUPILOT,), DOUBTED, DOUBTED, "estimate unhealthy"),
    ("estimator silent", changed(flags=None), BOTH, DOUBTED, DOUBTED, "cannot be confirmed"),
    ("health silent", changed(health=None), BOTH, DOUBTED, DOUBTED, "SYS_STATUS silent"),
    ("lane switch", text("EKF3 lane switch 1"), (ARDUPILOT,), DOUBTED, DOUBTED, "lane switch"),
    ("primary", text("EKF primary changed:1"), (ARDUPILOT,), DOUBTED, DOUBTED, "primary"),
    ("variance said", text("EKF variance"), (ARDUPILOT,), DOUBTED, DOUBTED, "EKF variance"),
    (
        "failsafe said",
        text("EKF Failsafe: changed to LAND Mode"),
        (ARDUPILOT,),
        DOUBTED,
        DOUBTED,
        "LAND",
    ),
    ("aiding", text("EKF3 IMU0 stopped aiding"), (ARDUPILOT,), DOUBTED, DOUBTED, "stopped aiding"),
    ("reckoning", text("Dead Reckoning started"), BOTH, DOUBTED, DOUBTED, "Dead Reckoning"),
    ("gps lost said", text("GPS fix lost"), (PX4,), DOUBTED, DOUBTED, "GPS fix lost"),
]
# Silence takes as long as it takes; SYS_STATUS shows a failure half a second late, at 2 Hz.
SLOW = {
    "gps silent": 1.05,
    "estimator silent": 1.55,
    "health silent": 3.05,
    **dict.fromkeys(("gps unhealthy", "gps not present", "local position", "ahrs"), 1.15),
}
CASES = [
    pytest.param(
        change, facts, by_gps, worth, words, SLOW.get(name, 1.0), id=f"{name}-{autopilot}-{gps}"
    )
    for name, change, autopilots, with_gps, without_gps, words in SIGNS
    for facts in autopilots
    for by_gps, worth in ((True, with_gps), (False, without_gps))
    for autopilot in ("px4" if facts is PX4 else "ardupilot",)
    for gps in ("gps" if by_gps else "no_gps",)
]


@pytest.mark.parametrize(("change", "facts", "by_gps", "worth", "words", "within_s"), CASES)
def test_sign_is_noticed_within_a_second_and_said_in_a_sentence(
    change: Change,
    facts: EstimatorFacts,
    by_gps: bool,
    worth: Worth | None,
    words: str,
    within_s: float,
) -> None:
    flight = Flight(facts, by_gps).depart()
    change(flight)
    seen = flight.run(within_s)
    if worth is None:
        assert seen + flight.run(10.0) == []
        return
    assert seen
    sign = seen[-1]
    assert sign.worth is worth
    assert words in sign.sentence
    violation = sign.violation()
    assert violation.assumption is Assumption.POSITION_QUALITY
    assert str(violation) == violation.event(0.0).text == f"position_quality: {sign.sentence}"
    assert "\n" not in sign.sentence


@pytest.mark.parametrize(
    "said",
    [
        "EKF3 IMU0 is using GPS",
        "GPS Glitch or Compass error cleared",
        "EKF3 IMU0 MAG0 in-flight yaw alignment complete",
        "Dead Reckoning stopped",
        "Arming motors",
        "Vibration compensation OFF",
    ],
)
def test_texts_that_say_nothing_bad_are_none(said: str) -> None:
    flight = Flight(ARDUPILOT).depart()
    text(said)(flight)
    assert flight.run(2.0) == []


@pytest.mark.parametrize("facts", BOTH)
@pytest.mark.parametrize(
    ("change", "back", "period_s"),
    [
        (changed(fix_type=1), changed(fix_type=3), 0.2),
        (changed(ratios=[1.5, 1.5, 1.5]), changed(ratios=[0.1] * 3), 0.2),
        (unhealthy(GPS_BIT), changed(health=HEALTHY), 0.5),
    ],
)
def test_a_single_message_is_a_glitch(
    facts: EstimatorFacts, change: Change, back: Change, period_s: float
) -> None:
    flight = Flight(facts).depart()
    change(flight)
    seen = flight.run(period_s)
    back(flight)
    assert seen + flight.run(2.0) == []


@pytest.mark.parametrize("ratio", [NAN, 0.79])
@pytest.mark.parametrize("facts", BOTH)
def test_a_ratio_that_says_nothing_or_is_within_its_limit_is_none(
    facts: EstimatorFacts, ratio: float
) -> None:
    flight = Flight(facts).depart()
    flight.ratios = [ratio] * 3
    assert flight.run(2.0) == []


@pytest.mark.parametrize(("departed_m", "limit_m"), [(0.3, ACCURACY_MAX_M), (1.0, 3.0)])
def test_accuracy_is_judged_by_what_it_was(departed_m: float, limit_m: float) -> None:
    flight = Flight(PX4)
    flight.accuracy_m = departed_m
    flight.depart()
    flight.accuracy_m = limit_m - 0.05
    assert flight.run(2.0) == []
    flight.accuracy_m = limit_m + 0.05
    assert flight.run(1.0)


@pytest.mark.parametrize("facts", [PX4, ARDUPILOT, OTHER])
@pytest.mark.parametrize("by_gps", [True, False])
def test_a_good_flight_shows_no_sign(facts: EstimatorFacts, *, by_gps: bool) -> None:
    assert Flight(facts, by_gps).depart().run(60.0) == []


def test_terrain_that_comes_and_goes_is_no_sign() -> None:
    """PX4 took the flag of the height above ground away and gave it back in nominal flights."""
    flight = Flight(PX4).depart()
    without(0x40)(flight)
    assert flight.run(5.0) == []


def test_dead_reckoning_counts_from_its_first_sign_and_ends_with_it() -> None:
    flight = Flight(ARDUPILOT).depart()
    flight.fix_type = 1
    (*_, sign) = flight.run(1.0)
    assert flight.monitor.lost_for_s(sign, flight.now_s) == pytest.approx(0.8, abs=0.21)
    flight.fix_type = None  # another sign of the same
    (*_, sign) = flight.run(3.0)
    assert sign.worth is DEAD_RECKONED
    assert flight.monitor.lost_for_s(sign, flight.now_s) > DEAD_RECKONING_S
    flight.fix_type = 3
    flight.run(0.5)
    assert flight.monitor.check(flight.now_s) is None
    flight.fix_type = 1
    (*_, sign) = flight.run(1.0)
    assert flight.monitor.lost_for_s(sign, flight.now_s) < 1.01


def test_what_is_made_up_is_lost_at_once_and_what_is_doubted_is_not() -> None:
    flight = Flight(PX4).depart()
    flight.ratios = [1.5, 0.1, 0.1]
    (*_, sign) = flight.run(10.0)
    assert flight.monitor.lost_for_s(sign, flight.now_s) == 0.0
    without(0x18)(flight)
    (*_, sign) = flight.run(0.22)
    assert flight.monitor.lost_for_s(sign, flight.now_s) == float("inf")


@pytest.mark.parametrize("interval_s", [0.5, 1.0, 2.0])
def test_a_source_that_is_slow_is_not_silent(interval_s: float) -> None:
    """A link may not grant the rates that are asked for."""
    reports = PositionReports(facts=PX4)
    monitor = PositionQualityMonitor(reports)
    seen = []
    for tick in range(3000):
        now_s = tick * TICK_S
        if tick % round(interval_s / TICK_S) == 0:
            report = EstimatorReport("ESTIMATOR_STATUS", 0x37F, 0.1, 0.1, 0.1, 0.3)
            reports.estimator.hear(report, now_s)
            reports.hear_gps(GpsReport(3), now_s)
        if now_s == 20.0:
            assert monitor.departure_failures(now_s) == []
            monitor.depart(now_s)
        seen.append(monitor.check(now_s))
    assert not any(seen)


DEPARTURES: list[tuple[Change, tuple[EstimatorFacts, ...], str]] = [
    (changed(fix_type=1), BOTH, "GPS fix lost (fix type 1)"),
    (changed(fix_type=None), BOTH, "GPS_RAW_INT silent"),
    (without(0x18), BOTH, "horizontal position lost"),
    (with_flag(0x80), BOTH, "constant position mode"),
    (changed(ratios=[1.5] * 3), BOTH, "test ratio 1.50"),
    (changed(flags=None), BOTH, "silent for"),
    (unhealthy(XY_BIT), (PX4,), "position estimate unhealthy"),
    (unhealthy(AHRS_BIT), (ARDUPILOT,), "position estimate unhealthy"),
    (text("EKF variance"), (ARDUPILOT,), "EKF variance"),
]


@pytest.mark.parametrize(
    ("change", "facts", "words"),
    [(change, facts, words) for change, autopilots, words in DEPARTURES for facts in autopilots],
)
def test_departure_is_refused_with_the_reason(
    change: Change, facts: EstimatorFacts, words: str
) -> None:
    flight = Flight(facts)
    flight.run(3.0)
    assert flight.monitor.departure_failures(flight.now_s) == []
    change(flight)
    flight.run(2.0)
    failures = flight.monitor.departure_failures(flight.now_s)
    assert any(words in failure for failure in failures)


def test_a_text_does_not_keep_the_vehicle_on_the_spot_for_ever() -> None:
    flight = Flight(ARDUPILOT)
    text("EKF3 lane switch 1")(flight)
    flight.run(4.0)
    assert flight.monitor.departure_failures(flight.now_s)
    flight.run(2.0)
    assert flight.monitor.departure_failures(flight.now_s) == []
    flight.depart()


def test_a_fix_that_was_just_lost_is_no_flight_without_gps() -> None:
    """Within seconds of the loss the flags are still good: the vehicle would depart on a guess."""
    flight = Flight(PX4)
    flight.run(3.0)
    flight.fix_type = 0
    flight.run(FIX_MEMORY_S - 1.0)
    (failure,) = flight.monitor.departure_failures(flight.now_s)
    assert "GPS fix lost" in failure
    flight.run(2.0)
    assert flight.monitor.departure_failures(flight.now_s) == []


@pytest.mark.parametrize(
    ("heard", "departs"),
    [
        ((), False),
        (("estimator",), True),
        (("gps",), False),
        (("health",), False),
        (("gps", "health"), True),
        (("no fix", "health"), False),
        (("no fix", "health", "estimator"), True),
    ],
)
def test_departure_needs_a_source_that_vouches_for_the_position(
    heard: tuple[str, ...], *, departs: bool
) -> None:
    flight = Flight(OTHER)
    if "estimator" not in heard:
        flight.flags = None
    flight.fix_type = 3 if "gps" in heard else 0 if "no fix" in heard else None
    if "health" not in heard:
        flight.health = None
    flight.run(15.0)
    failures = flight.monitor.departure_failures(flight.now_s)
    assert (not failures) is departs
    if not departs:
        assert any("position quality unknown" in failure for failure in failures)


def test_nothing_is_judged_but_a_departed_flight() -> None:
    flight = Flight(PX4)
    flight.flags = 0x3FF  # at rest on the ground PX4 holds its position constant
    assert flight.run(5.0) == []
    flight.flags = 0x37F
    flight.depart()
    flight.monitor.forget_flight()
    flight.flags = 0x3FF
    assert flight.run(5.0) == []


@given(
    flags=st.integers(0, 0xFFFF),
    ratios=st.lists(st.floats(allow_nan=True, allow_infinity=True), min_size=3, max_size=3),
    accuracy_m=st.floats(allow_nan=True, allow_infinity=True),
    fix_type=st.integers(0, 255),
    facts=st.sampled_from([PX4, ARDUPILOT, OTHER]),
    by_gps=st.booleans(),
)
def test_whatever_is_reported_has_a_verdict(
    flags: int,
    ratios: list[float],
    accuracy_m: float,
    fix_type: int,
    facts: EstimatorFacts,
    *,
    by_gps: bool,
) -> None:
    """No input raises; a position that is not vouched for by its flags is never taken for good."""
    flight = Flight(facts, by_gps).depart()
    flight.flags, flight.ratios, flight.accuracy_m = flags, ratios, accuracy_m
    flight.fix_type = fix_type
    seen = flight.run(1.0)
    lost = not flags & 0x18 or not flags & 0x02 or bool(flags & 0x80)
    assert not lost or (bool(seen) and seen[-1].worth is MADE_UP)
    if by_gps and fix_type < 3:
        assert seen
