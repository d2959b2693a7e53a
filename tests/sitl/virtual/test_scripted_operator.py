"""The scripted operator against autopilots that are written here, one message at a time."""

from __future__ import annotations

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.virtual.scripted_operator import (
    HEALTH,
    OFF_THE_GROUND_M,
    PATIENCE_S,
    STREAMS,
    TAKE_OFF_STREAMS,
    Operator,
    Step,
)

ARM, SET_MODE, TAKE_OFF, LAND = 400, 176, 22, 21
PX4, ARDUPILOT = mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
OFFBOARD, GUIDED = 6 << 16, 4


class Rig:
    """An operator, and what its vehicle sends and receives."""

    def __init__(self, autopilot: int, altitude_m: float = 4.0) -> None:
        self.operator = Operator(system_id=1, altitude_m=altitude_m)
        self.now_s = 0.0
        self._autopilot = autopilot
        self._mavlink = mavlink.MAVLink(None, 1, 1)

    def says(
        self,
        *,
        mode: int = 0,
        armed: bool = False,
        ready: bool = True,
        height_m: float = 0.0,
        component: int = 1,
    ) -> Rig:
        """Have the vehicle state how it is."""
        self._mavlink.srcComponent = component
        base_mode = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0
        health = HEALTH if ready else 0
        for message in (
            self._mavlink.heartbeat_encode(2, self._autopilot, base_mode, mode, 4),
            self._mavlink.sys_status_encode(health, health, health, *(0,) * 10),
            self._mavlink.local_position_ned_encode(
                round(self.now_s * 1e3), 0.0, 0.0, -height_m, 0.0, 0.0, 0.0
            ),
        ):
            self.operator.receive(message.pack(self._mavlink))
        return self

    def commands(self, seconds: float = 0.0) -> list[Any]:
        """Let time go on; return what the operator commands, without its stream requests."""
        end_s = self.now_s + seconds
        found = []
        while True:
            self.operator.advance(self.now_s)
            parsed = mavlink.MAVLink(None).parse_buffer(self.operator.bytes_to_send()) or []
            found += [m for m in parsed if m.get_type() == "COMMAND_LONG"]
            if self.now_s >= end_s:
                break
            self.now_s += 0.1
        return [m for m in found if m.command != mavlink.MAV_CMD_SET_MESSAGE_INTERVAL]

    def climbs(self, mode: int, altitude_m: float = 4.0) -> Rig:
        """Fly up, and stand still there for two seconds."""
        for height_m in (OFF_THE_GROUND_M + 0.1, *(altitude_m,) * 20):
            self.now_s += 0.1
            self.says(mode=mode, armed=True, height_m=height_m)
            self.operator.advance(self.now_s)
        self.operator.bytes_to_send()
        return self


def parameters(message: Any) -> tuple[float, ...]:
    return tuple(getattr(message, f"param{n}") for n in range(1, 8))


def test_nothing_is_armed_before_the_vehicle_is_ready() -> None:
    rig = Rig(PX4).says(ready=False)
    assert rig.commands(2.0) == []
    assert {m.command for m in rig.says().commands(0.5)} == {ARM}


def test_px4_is_armed_and_takes_off_to_the_height_of_its_parameter() -> None:
    rig = Rig(PX4).says()
    arm, *_ = rig.commands(0.5)
    assert (arm.command, arm.param1) == (ARM, 1.0)
    (take_off,) = rig.says(armed=True).commands()
    assert take_off.command == TAKE_OFF
    assert math.isnan(take_off.param7)


def test_ardupilot_is_switched_to_guided_armed_and_told_the_height() -> None:
    rig = Rig(ARDUPILOT).says()
    mode, *_ = rig.commands(0.5)
    assert (mode.command, parameters(mode)[:3]) == (SET_MODE, (1.0, 4.0, 0.0))
    arm, *_ = rig.says(mode=GUIDED).commands(0.5)
    assert arm.command == ARM
    (take_off,) = rig.says(mode=GUIDED, armed=True).commands()
    assert (take_off.command, take_off.param7) == (TAKE_OFF, 4.0)


@pytest.mark.parametrize(
    ("autopilot", "before", "external_control", "hold"),
    [(PX4, 4 << 16 | 2 << 24, OFFBOARD, (4.0, 3.0)), (ARDUPILOT, GUIDED, GUIDED, (17.0, 0.0))],
)
def test_hand_over_take_over_and_hand_back_use_the_modes_of_the_profile(
    autopilot: int, before: int, external_control: int, hold: tuple[float, float]
) -> None:
    rig = Rig(autopilot).says(mode=before)
    rig.commands(0.5)
    rig.says(mode=before, armed=True).commands()
    rig.climbs(before)
    rig.now_s += 1.0
    rig.commands()
    rig.says(mode=external_control, armed=True, height_m=4.0).commands()
    assert rig.operator.step is Step.WATCH
    rig.operator.take_over()
    (held,) = rig.commands()
    assert (held.command, parameters(held)[1:3]) == (SET_MODE, hold)
    rig.says(mode=0, armed=True, height_m=4.0)
    rig.operator.hand_back()
    (given,) = rig.commands()
    main = external_control >> 16 if autopilot == PX4 else external_control
    assert (given.command, parameters(given)[:3]) == (SET_MODE, (129.0, float(main), 0.0))


def test_px4_comes_to_rest_before_it_is_handed_over_and_guided_does_not_wait() -> None:
    for autopilot, mode, step in (
        (PX4, 4 << 16 | 2 << 24, Step.CLIMB),
        (ARDUPILOT, GUIDED, Step.WATCH),
    ):
        rig = Rig(autopilot).says(mode=mode)
        rig.commands(0.5)
        rig.says(mode=mode, armed=True).commands()
        for height_m in (1.0, 4.0, 4.2, 4.4):  # still rising
            rig.now_s += 0.1
            rig.says(mode=mode, armed=True, height_m=height_m).commands()
        assert rig.operator.step is step


def test_an_autopilot_without_a_profile_is_never_handed_over() -> None:
    mode = OFFBOARD  # means nothing to an unknown autopilot
    rig = Rig(mavlink.MAV_AUTOPILOT_GENERIC).says(mode=mode)
    rig.commands(0.5)
    rig.says(mode=mode, armed=True).commands()
    rig.climbs(mode)
    assert rig.operator.step is Step.HAND_OVER
    assert rig.commands(2.0) == []


def test_what_other_components_say_is_ignored() -> None:
    rig = Rig(PX4).says(component=196)
    assert rig.commands(1.0) == []


@pytest.mark.parametrize("ready", [True, False])
def test_a_vehicle_that_cannot_be_armed_is_given_up(*, ready: bool) -> None:
    rig = Rig(PX4).says(ready=ready)
    rig.commands(PATIENCE_S + 0.2)
    assert rig.operator.step is Step.DONE
    assert rig.operator.gave_up == "the vehicle cannot be armed"


def test_a_vehicle_that_does_not_climb_is_landed() -> None:
    rig = Rig(PX4).says()
    rig.commands(0.5)
    rig.says(armed=True)
    commands = rig.commands(PATIENCE_S + 4.0 / 0.2 + 1.0)
    assert rig.operator.gave_up == "the vehicle does not climb"
    assert [m.command for m in commands[-2:]] == [LAND, LAND]
    rig.says(armed=False).commands()
    assert rig.operator.step is Step.DONE


@pytest.mark.parametrize("call", ["land", "take_over", "hand_back"])
def test_no_call_has_an_effect_before_the_hand_over(call: str) -> None:
    rig = Rig(PX4).says()
    getattr(rig.operator, call)()
    assert rig.operator.step is Step.ARM


def test_streams_are_asked_for_once_and_those_of_the_take_off_are_ended_with_it() -> None:
    rig = Rig(ARDUPILOT).says(mode=GUIDED)

    def requests() -> dict[int, float]:
        rig.operator.advance(rig.now_s)
        parsed = mavlink.MAVLink(None).parse_buffer(rig.operator.bytes_to_send()) or []
        interval = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
        return {
            int(m.param1): m.param2
            for m in parsed
            if m.get_type() == "COMMAND_LONG" and m.command == interval
        }

    assert requests() == STREAMS
    rig.now_s = 0.5
    assert requests() == {}
    rig.says(mode=GUIDED, armed=True)
    requests()
    for height_m in (1.0, 4.0):
        rig.now_s += 0.1
        rig.says(mode=GUIDED, armed=True, height_m=height_m)
        last = requests()
    assert last == dict.fromkeys(TAKE_OFF_STREAMS, -1)
