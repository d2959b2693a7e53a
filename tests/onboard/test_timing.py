"""The daemon's clock against a system clock that is set."""

from __future__ import annotations

import asyncio
import os
import threading
import time
from pathlib import Path
from typing import Any

import pytest

from onboard import timing
from onboard.autonomy import Autonomy
from onboard.daemon import _follow_clock
from onboard.events import Severity
from onboard.files.contract_file import load_contract
from onboard.files.mission_file import Mission
from onboard.files.yaml_file import load_yaml
from onboard.monitoring.detections import DetectionMonitor
from onboard.recording.state import state_of
from onboard.timing import (
    REALTIME_PRIORITY,
    STEP_MIN_S,
    Clock,
    ProcessorTimes,
    request_realtime_priority,
)

CONFIG = Path(__file__).parents[2] / "config"
EPOCH_UNIX_S = 1.7e9


class Computer:
    """A computer whose clocks a test sets.

    Attributes:
        elapsed_s: never set.
        unix_s: set by `step`.
    """

    def __init__(self) -> None:
        self.elapsed_s = 1000.0
        self.unix_s = EPOCH_UNIX_S
        self.reading_s = 0.0

    def clock(self) -> Clock:
        return Clock(self.read_elapsed_s, lambda: self.unix_s)

    def read_elapsed_s(self) -> float:
        self.elapsed_s += self.reading_s
        return self.elapsed_s

    def pass_time(self, seconds: float) -> None:
        self.elapsed_s += seconds
        self.unix_s += seconds


def disarmed(_: float) -> bool:
    return True


def in_flight(_: float) -> bool:
    return False


@pytest.fixture
def computer() -> Computer:
    return Computer()


@pytest.mark.parametrize("step_s", [20.0, -20.0, 1e9, -1e9, 0.02, -0.02])
def test_a_step_is_followed_while_disarmed(computer: Computer, step_s: float) -> None:
    clock = computer.clock()
    computer.pass_time(5.0)
    computer.unix_s += step_s
    step = clock.follow(disarmed)
    assert step is not None
    assert step.followed
    assert step.step_s == pytest.approx(step_s, abs=1e-5)
    assert clock.now_s() == pytest.approx(5.0)  # never jumps
    assert clock.epoch_unix_s + clock.now_s() == pytest.approx(computer.unix_s, abs=1e-5)
    assert clock.follow(disarmed) is None


def test_a_step_in_flight_is_said_once_and_followed_after_it(computer: Computer) -> None:
    clock = computer.clock()
    computer.unix_s += 20.0
    step = clock.follow(in_flight)
    assert step is not None
    assert not step.followed
    assert clock.epoch_unix_s == EPOCH_UNIX_S
    for _ in range(10):
        computer.pass_time(1.0)
        assert clock.follow(in_flight) is None
    computer.unix_s -= 5.0  # set again
    again = clock.follow(in_flight)
    assert again is not None
    assert again.step_s == pytest.approx(15.0, abs=1e-5)
    landed = clock.follow(disarmed)
    assert landed is not None
    assert landed.followed
    assert clock.epoch_unix_s == pytest.approx(EPOCH_UNIX_S + 15.0, abs=1e-5)


def test_a_clock_set_back_in_flight_to_what_it_was_leaves_nothing(computer: Computer) -> None:
    clock = computer.clock()
    computer.unix_s += 20.0
    assert clock.follow(in_flight) is not None
    computer.unix_s -= 20.0
    assert clock.follow(in_flight) is None
    computer.unix_s += 20.0
    assert clock.follow(in_flight) is not None


def test_jitter_and_interrupted_readings_are_no_steps(computer: Computer) -> None:
    clock = computer.clock()
    computer.unix_s += 0.5 * STEP_MIN_S
    assert clock.follow(disarmed) is None
    computer.reading_s = 0.05  # descheduled between two readings
    assert clock.follow(disarmed) is None
    assert clock.epoch_unix_s == EPOCH_UNIX_S


@pytest.mark.parametrize(
    ("step_s", "armed", "severity", "words"),
    [
        (20.0, False, Severity.NOTICE, "set forward by 20.00 s; stamps are read by the new time"),
        (-20.0, False, Severity.NOTICE, "set back by 20.00 s; stamps are read by the new time"),
        (20.0, True, Severity.WARNING, "in flight: stamps are read by the old time"),
    ],
)
def test_what_is_said_of_it(
    computer: Computer, step_s: float, severity: Severity, words: str, *, armed: bool
) -> None:
    clock = computer.clock()
    computer.unix_s += step_s
    step = clock.follow(in_flight if armed else disarmed)
    assert step is not None
    event = step.event(7.0)
    assert (event.name, event.time_s, event.severity) == ("clock_step", 7.0, severity)
    assert words in event.text
    assert event.data == {"step_s": pytest.approx(step_s, abs=1e-5), "followed": not armed}


def test_suspension_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def read(clock_id: int) -> float:
        asked.append(clock_id)
        return 1.0

    monkeypatch.setattr(time, "clock_gettime", read)
    assert timing.elapsed_s() == 1.0
    assert asked == [time.CLOCK_BOOTTIME]


@pytest.mark.parametrize("armed", [False, True])
def test_the_service_reads_stamps_by_the_clock_that_was_set(
    computer: Computer, *, armed: bool
) -> None:
    clock = computer.clock()
    autonomy = Autonomy(
        load_contract(CONFIG / "default_contract.yaml"),
        load_yaml(CONFIG / "paper_mission.yaml", Mission),
        epoch_unix_s=clock.epoch_unix_s,
    )
    object.__setattr__(autonomy.link.status, "armed", armed)
    computer.unix_s += 3600.0
    _follow_clock(autonomy, clock, clock.now_s())
    autonomy.tick(clock.now_s())
    assert autonomy.epoch_unix_s == pytest.approx(EPOCH_UNIX_S + (0.0 if armed else 3600.0))
    (event,) = (event for event in autonomy.events() if event.name == "clock_step")
    assert event.data["followed"] is not armed


def frame(stamp_unix_s: float, source: str = "front") -> bytes:
    return (
        f'{{"version": 1, "source": "{source}", "sequence": 0, "stamp_unix_s": {stamp_unix_s!r}, '
        '"frame": "local_ned", "range_m": 30.0, "field_of_view_deg": 120.0, "obstacles": []}'
    ).encode()


def test_sensors_count_as_unseen_until_they_stamp_by_the_new_clock(computer: Computer) -> None:
    clock = computer.clock()
    autonomy = Autonomy(
        load_contract(CONFIG / "default_contract.yaml"),
        load_yaml(CONFIG / "paper_mission.yaml", Mission),
        epoch_unix_s=clock.epoch_unix_s,
    )

    def see(*sources: str) -> Any:
        for source in sources:
            autonomy.receive_detection(frame(computer.unix_s, source), clock.now_s())
        autonomy.tick(clock.now_s())
        return state_of(autonomy, clock.now_s()).detection_age_s

    assert see("front", "left") == pytest.approx(0.0, abs=1e-5)
    computer.unix_s -= 3600.0  # stamps of before now lie an hour ahead, and would look fresh
    _follow_clock(autonomy, clock, clock.now_s())
    assert see() is None
    assert see("front") is None  # the other one has not been seen by this clock
    assert see("left") == pytest.approx(0.0, abs=1e-5)
    names = {event.name for event in autonomy.events()}
    assert names == {"clock_step"}  # and none of the old ages was held against the sensors


def test_forgotten_stamps_are_no_lateness() -> None:
    contract = load_contract(CONFIG / "default_contract.yaml")
    autonomy = Autonomy(
        contract, load_yaml(CONFIG / "paper_mission.yaml", Mission), epoch_unix_s=EPOCH_UNIX_S
    )
    monitor, terms = DetectionMonitor(), autonomy.assessment.terms

    def see(now_s: float) -> None:
        assert monitor.on_arrival("front", round(now_s), now_s, now_s) is None
        assert monitor.on_frame("front", now_s, now_s, terms) is None

    see(0.0)
    monitor.forget_stamps()
    silent = monitor.check(0.01, terms)
    assert silent is not None
    see(3600.0)
    assert monitor.check(3600.01, terms) is None


def test_status_goes_on_when_the_clock_is_set_back(computer: Computer) -> None:
    from onboard.bus import Bus  # noqa: PLC0415  Zenoh, which the other tests do not need
    from onboard.recording.messages import PlanRecord, StateRecord  # noqa: PLC0415

    put: list[str] = []

    class Publisher:
        def __init__(self, key: str) -> None:
            self._key = key

        def put(self, _: bytes) -> None:
            put.append(self._key)

    class Session:
        def declare_publisher(self, key: str) -> Publisher:
            return Publisher(key)

        def declare_queryable(self, *_: object) -> None: ...

    async def publish() -> None:
        bus = Bus(Session(), "v1", load_contract(CONFIG / "default_contract.yaml"))  # type: ignore[arg-type]
        for now_s in (0.0, 1.0, 2.0):
            unix_s = EPOCH_UNIX_S - 1e6 * now_s
            bus.publish([StateRecord(time_s=unix_s), PlanRecord(time_s=unix_s)], now_s)

    asyncio.run(publish())
    assert put.count("clearway/v1/status") == 3
    assert put.count("clearway/v1/plan") == 6


# ---------------------------------------------------------------------------- the process


def test_real_time_priority_is_asked_for_and_its_refusal_is_survived(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    asked: list[tuple[int, int, int]] = []

    def grant(pid: int, policy: int, parameters: os.sched_param) -> None:
        asked.append((pid, policy, parameters.sched_priority))

    def refuse(*_: object) -> None:
        raise PermissionError

    caplog.set_level("INFO")
    monkeypatch.setattr(os, "sched_setscheduler", grant)
    request_realtime_priority()
    # The main thread, whose id is that of the process, and any other one that runs.
    assert (os.getpid(), os.SCHED_RR, REALTIME_PRIORITY) in asked
    assert {thread for thread, *_ in asked} == {each.native_id for each in threading.enumerate()}
    assert caplog.text == ""
    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    request_realtime_priority()
    assert "cannot set real-time priority (needs CAP_SYS_NICE)" in caplog.text
    monkeypatch.delattr(os, "sched_setscheduler")  # as on macOS
    request_realtime_priority()


def test_the_longest_wait_of_any_thread_counts_and_the_run_of_the_main_one(
    tmp_path: Path,
) -> None:
    def count(thread: int, ran_ns: int, waited_ns: int) -> None:
        (tmp_path / str(thread)).mkdir(exist_ok=True)
        (tmp_path / str(thread) / "schedstat").write_text(f"{ran_ns} {waited_ns} 3\n")

    main, other = os.getpid(), 7
    count(main, 10**9, 10**9)
    count(other, 10**9, 5 * 10**9)
    times = ProcessorTimes(tmp_path)
    assert times.since_last() == (0.0, 0.0)
    count(main, 1_020_000_000, 1_001_000_000)
    count(other, 1_500_000_000, 5_030_000_000)
    assert times.since_last() == (0.02, 0.03)
    assert times.since_last() == (0.0, 0.0)
    (tmp_path / "7" / "schedstat").write_text("")  # as of a thread that has ended
    count(main, 1_020_000_000, 1_002_000_000)
    assert times.since_last() == (0.0, 0.001)
    assert ProcessorTimes(tmp_path / "none").since_last() == (0.0, 0.0)


def test_the_kernel_counts_what_this_process_runs() -> None:
    times = ProcessorTimes()
    times.since_last()
    end_s = time.thread_time() + 0.02
    while time.thread_time() < end_s:
        pass
    ran_s, waited_s = times.since_last()
    assert ran_s >= 0.019
    assert waited_s >= 0.0
