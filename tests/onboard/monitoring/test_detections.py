import math
from dataclasses import dataclass, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.monitoring.assumptions import Assumption, Violation
from onboard.monitoring.detections import CLOCK_TOLERANCE_S, DetectionMonitor
from tests.onboard.contract.example_terms import TERMS

FRAME_S = 0.05


@dataclass
class Sensor:
    """Sends a frame every 50 ms: with stamps that are ahead by an offset, late by a latency."""

    monitor: DetectionMonitor
    source: str = "front"
    ahead_s: float = 0.0
    latency_s: float = 0.03
    sequence: int = 0

    def send(self, now_s: float) -> Violation | None:
        stamp_s = now_s - self.latency_s + self.ahead_s
        self.sequence += 1
        fault = self.monitor.on_arrival(self.source, self.sequence, stamp_s, now_s)
        if stamp_s > now_s + CLOCK_TOLERANCE_S:
            return fault
        return fault or self.monitor.on_frame(self.source, stamp_s, now_s, TERMS)

    def run(self, begin_s: float, end_s: float) -> list[Violation]:
        steps = range(round((end_s - begin_s) / FRAME_S))
        found = [self.send(begin_s + step * FRAME_S) for step in steps]
        return [violation for violation in found if violation is not None]


@pytest.fixture
def sensor() -> Sensor:
    return Sensor(DetectionMonitor())


def blind(sensor: Sensor, now_s: float) -> Violation:
    violation = sensor.monitor.check(now_s, TERMS)
    assert violation is not None
    return violation


def test_sensor_that_was_never_heard_is_blind(sensor: Sensor) -> None:
    violation = blind(sensor, 0.0)
    assert violation.assumption is Assumption.DETECTION_AGE
    assert violation.event(0.0).data["measured"] is None
    assert "no detection frame was ever received" in str(violation)


def test_honest_frames_violate_nothing(sensor: Sensor) -> None:
    assert sensor.run(0.0, 5.0) == []
    assert sensor.monitor.check(5.0, TERMS) is None
    assert sensor.monitor.age_s(5.0) == pytest.approx(0.05 + 0.03)


def test_silence_is_noticed_as_soon_as_it_exceeds_the_frame_age(sensor: Sensor) -> None:
    sensor.latency_s = 0.05
    sensor.send(10.05)
    assert sensor.monitor.check(10.29, TERMS) is None
    violation = blind(sensor, 10.31)
    assert violation.assumption is Assumption.DETECTION_AGE
    assert violation.subject == "front"
    assert violation.note == "source 'front' silent"


def test_silence_of_one_of_two_sensors_is_silence(sensor: Sensor) -> None:
    sensor.send(9.5)
    Sensor(sensor.monitor, "left").send(9.5)
    Sensor(sensor.monitor, "left").run(9.55, 10.5)
    violation = blind(sensor, 10.5)
    assert violation.subject == "front"
    assert "left" not in violation.note


def test_a_sensor_that_renames_itself_is_silent_and_its_new_name_is_said(sensor: Sensor) -> None:
    sensor.run(0.0, 2.0)
    sensor.source = "front2"
    sensor.run(2.0, 2.5)
    violation = blind(sensor, 2.5)
    assert violation.assumption is Assumption.DETECTION_AGE
    assert violation.subject == "front"
    assert violation.note == "source 'front' silent; 'front2' is new"


@pytest.mark.parametrize("ahead_s", [-3600.0, -20.0, -1.5])
def test_stamps_that_are_behind_while_frames_arrive_are_a_clock_fault(
    sensor: Sensor, ahead_s: float
) -> None:
    sensor.ahead_s, sensor.latency_s = ahead_s, 0.0
    assert sensor.run(0.0, 1.0) == []
    violation = blind(sensor, 1.0)
    assert violation.assumption is Assumption.SENSOR_CLOCK
    assert violation.measured == pytest.approx(-ahead_s)
    assert f"stamps are {-ahead_s:.1f} s behind" in str(violation)


@pytest.mark.parametrize("ahead_s", [0.2, 20.0, 3600.0])
def test_stamps_that_are_ahead_are_a_clock_fault_and_no_sight(
    sensor: Sensor, ahead_s: float
) -> None:
    sensor.ahead_s, sensor.latency_s = ahead_s, 0.0
    found = sensor.run(0.0, 1.0)
    assert {violation.assumption for violation in found} == {Assumption.SENSOR_CLOCK}
    violation = blind(sensor, 1.0)
    assert violation.assumption is Assumption.SENSOR_CLOCK
    assert f"stamps are {ahead_s:.1f} s ahead" in str(violation)


def test_frames_that_arrive_late_are_not_called_a_clock_fault(sensor: Sensor) -> None:
    sensor.latency_s = 0.4
    sensor.run(0.0, 2.0)
    violation = blind(sensor, 2.0)
    assert violation.assumption is Assumption.DETECTION_AGE
    assert violation.note == "frames of 'front' arrive 0.40 s late"


def test_a_clock_fault_that_went_silent_is_silence(sensor: Sensor) -> None:
    sensor.ahead_s = -20.0
    sensor.run(0.0, 1.0)
    violation = blind(sensor, 3.0)
    assert violation.assumption is Assumption.DETECTION_AGE
    assert violation.note == "source 'front' silent"


@pytest.mark.parametrize("step_s", [-3600.0, -20.0, -0.1, -0.06, 0.2, 20.0, 3600.0])
def test_a_step_of_the_clock_in_flight_is_named_at_the_next_frame(
    sensor: Sensor, step_s: float
) -> None:
    assert sensor.run(0.0, 2.0) == []
    sensor.ahead_s = step_s
    violation = sensor.send(2.0)
    assert violation is not None
    assert violation.assumption is Assumption.SENSOR_CLOCK
    # From one frame to the next, the stamps would have gone on by 0.05 s.
    offset = f"{step_s - 0.03:.1f} s ahead" if step_s > 0.0 else f"back by {-step_s - 0.05:.2f} s"
    assert offset in violation.note


@pytest.mark.parametrize("sequence", [0, 7])
def test_frames_that_overtake_each_other_are_no_step_of_the_clock(sequence: int) -> None:
    monitor = DetectionMonitor()
    monitor.on_arrival("front", 8, 1.00, 1.05)
    assert monitor.on_arrival("front", sequence, 0.95, 1.06) is None
    assert monitor.on_arrival("front", 8, 1.00, 1.07) is None


def test_a_burst_of_old_frames_after_an_outage_is_no_clock_fault(sensor: Sensor) -> None:
    sensor.run(0.0, 1.0)
    for step in range(40):
        sensor.latency_s = 2.0 - step * FRAME_S
        fault = sensor.send(3.0)
        assert fault is None or fault.assumption is Assumption.REACTION_TIME
    assert sensor.monitor.check(3.0, TERMS) is None


def test_after_the_clock_was_set_only_new_frames_count(sensor: Sensor) -> None:
    sensor.ahead_s = -20.0
    sensor.run(0.0, 1.0)
    sensor.monitor.forget_stamps()
    assert blind(sensor, 1.0).subject == "front"  # it is relied upon all the same
    sensor.ahead_s = 0.0
    assert sensor.run(1.0, 1.5) == []
    assert sensor.monitor.check(1.5, TERMS) is None


def test_frames_that_arrive_but_cannot_be_used_are_no_sight(sensor: Sensor) -> None:
    for step in range(20):
        sensor.monitor.on_arrival("front", step, step * FRAME_S, step * FRAME_S)
    violation = blind(sensor, 1.0)
    assert violation.assumption is Assumption.DETECTION_AGE
    assert violation.note == "frames of 'front' arrive, but no pose of their time is known"


@pytest.mark.parametrize(
    ("interval_s", "latency_s", "in_time"), [(0.05, 0.05, True), (0.1, 0.06, False)]
)
def test_reaction_takes_an_interval_and_a_latency(
    interval_s: float, latency_s: float, *, in_time: bool
) -> None:
    monitor, seen = DetectionMonitor(), []
    for step in range(4):
        stamp_s = step * interval_s
        monitor.on_arrival("front", step, stamp_s, stamp_s + latency_s)
        seen.append(monitor.on_frame("front", stamp_s, stamp_s + latency_s, TERMS))
    assert seen[0] is None
    for later in seen[1:]:
        assert (later is None) is in_time
        assert later is None or later.assumption is Assumption.REACTION_TIME


@given(st.lists(st.floats(0.0, 10.0), min_size=1))
def test_age_is_that_of_the_newest_frame(stamps_s: list[float]) -> None:
    monitor = DetectionMonitor()
    assert math.isinf(monitor.age_s(10.0))
    for stamp_s in stamps_s:
        monitor.on_arrival("front", 0, stamp_s, 10.0)
        monitor.on_frame("front", stamp_s, 10.0, TERMS)
    assert monitor.age_s(10.0) == pytest.approx(10.0 - max(stamps_s))


@given(st.floats(0.05, 5.0), st.floats(0.0, 6.0))
def test_a_frame_later_than_a_reaction_may_be_is_noticed_whatever_age_is_allowed(
    frame_age_max_s: float, latency_s: float
) -> None:
    terms = replace(TERMS, frame_age_max_s=frame_age_max_s)
    monitor, found = DetectionMonitor(), []
    for sequence in range(3):
        now_s = latency_s + sequence * FRAME_S
        monitor.on_arrival("front", sequence, now_s - latency_s, now_s)
        found.append(monitor.on_frame("front", now_s - latency_s, now_s, terms))
        found.append(monitor.check(now_s, terms))
    late = latency_s + FRAME_S > terms.reaction_time_s + 1e-9
    assert any(violation is not None for violation in found) or not late


def test_a_sensor_that_is_expected_is_blind_until_it_is_heard(sensor: Sensor) -> None:
    sensor.monitor.expected = frozenset({"front", "rear"})
    sensor.run(0.0, 5.0)
    violation = sensor.monitor.check(5.0, TERMS)
    assert violation is not None
    assert (violation.assumption, violation.subject) == (Assumption.DETECTION_AGE, "rear")
    assert violation.note == "rear never sent anything that can be used"
    assert math.isinf(sensor.monitor.age_s(5.0))
    Sensor(sensor.monitor, source="rear").run(4.9, 5.0)
    assert sensor.monitor.check(5.0, TERMS) is None
