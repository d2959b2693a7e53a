"""What the service does when the vehicle, its estimate or its autopilot's target goes astray."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import pytest
from pymavlink.dialects.v20 import common as mavlink

from onboard.autonomy import Autonomy
from onboard.contract.agility import GRAVITY_MPS2
from onboard.files.contract_file import Contract, load_contract
from onboard.files.mission_file import Mission
from onboard.geometry.frames import Vector
from onboard.guidance.phases import Phase
from onboard.mavlink.profiles.profile import TARGET_RATE_HZ
from onboard.monitoring.response.trim import LEARNING_TIME_S
from onboard.monitoring.response.wind import CONFIRMATION_S
from tests.onboard.conftest import CONFIG
from tests.onboard.test_autonomy import EPOCH_UNIX_S, IN_AIR, OFFBOARD, Rig, box

GUIDED = 4
ECHO_PERIOD_TICKS = 2


@dataclass
class FieldRig(Rig):
    """A rig whose vehicle is where its errors put it, in a wind, with an autopilot that echoes.

    Attributes:
        error_ned_m: of the position flown.
        drift_ned_mps: of the velocity that the estimate reads.
        nose_error_rad: of the heading flown.
        trim_ned_mps2: tilt against the wind, north and east.
        gain_per_s: velocity that the echo adds per position error; PX4's is 0.95.
        second_commander: position of another commander's setpoints, which every third echo shows.
        copter: it is ArduPilot.
    """

    error_ned_m: Vector = (0.0, 0.0, 0.0)
    drift_ned_mps: Vector = (0.0, 0.0, 0.0)
    nose_error_rad: float = 0.0
    trim_ned_mps2: tuple[float, float] = (0.0, 0.0)
    gain_per_s: float = 0.0
    second_commander: Callable[["FieldRig"], Vector] | None = None
    copter: bool = False
    echoes: bool = True

    def _say(self) -> None:
        base_mode = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if self.armed else 0
        autopilot, mode = (3, self.copter_mode) if self.copter else (12, self.mode)
        self._mav.heartbeat_send(mavlink.MAV_TYPE_QUADROTOR, autopilot, base_mode, mode, 4)
        self._mav.extended_sys_state_send(0, self.landed_state)
        yaw_rad = self.yaw_rad + self.nose_error_rad
        north_mps2, east_mps2 = (
            a + t for a, t in zip(self.acceleration_ned_mps2[:2], self.trim_ned_mps2, strict=True)
        )
        cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
        right_mps2 = cosine * east_mps2 - sine * north_mps2
        forward_mps2 = cosine * north_mps2 + sine * east_mps2
        roll_rad = math.atan(right_mps2 / GRAVITY_MPS2)
        pitch_rad = -math.atan(forward_mps2 / GRAVITY_MPS2)
        self._mav.attitude_send(0, roll_rad, pitch_rad, yaw_rad, 0.0, 0.0, 0.0)
        at_ned_m = _plus(self.position_ned_m, self.error_ned_m)
        going_ned_mps = _plus(self.velocity_ned_mps, self.drift_ned_mps)
        boot_ms = round(self.now_s * 1000.0)
        self._mav.local_position_ned_send(boot_ms, *at_ned_m, *going_ned_mps)
        self.say_what_the_position_is_worth()
        if self.echoes and self.setpoints and round(self.now_s / 0.02) % ECHO_PERIOD_TICKS == 0:
            self._echo()
        self.autonomy.receive_mavlink(bytes(self._bytes), self.now_s)
        self._bytes.clear()

    def be_off(self, error_ned_m: Vector, seconds: float = 1.0) -> None:
        """Drift off the reference: a motion, not a jump."""
        ticks = round(seconds / 0.02)
        vn_mps, ve_mps, vd_mps = (error / seconds for error in error_ned_m)
        self.drift_ned_mps = (vn_mps, ve_mps, vd_mps)
        for tick in range(ticks):
            north_m, east_m, down_m = (error * (tick + 1) / ticks for error in error_ned_m)
            self.error_ned_m = (north_m, east_m, down_m)
            self.tick()
        self.drift_ned_mps = (0.0, 0.0, 0.0)

    @property
    def copter_mode(self) -> int:
        return GUIDED if self.mode == OFFBOARD else 5

    def _echo(self) -> None:
        asked = self.setpoints[-1]
        position_ned_m = (asked.x, asked.y, asked.z)
        if (
            self.second_commander is not None
            and round(self.now_s / 0.02) % (3 * ECHO_PERIOD_TICKS) == 0
        ):
            position_ned_m = self.second_commander(self)
        added_mps = tuple(-self.gain_per_s * error for error in self.error_ned_m)
        velocity_mps = _plus((asked.vx, asked.vy, asked.vz), added_mps)
        self._mav.position_target_local_ned_send(
            0, 1, 0, *position_ned_m, *velocity_mps, *(0.0,) * 5
        )


def _plus(one: Vector, other: tuple[float, ...]) -> Vector:
    return one[0] + other[0], one[1] + other[1], one[2] + other[2]


def rig_of(contract: Contract, mission: Mission, **state: object) -> FieldRig:
    rig = FieldRig(Autonomy(contract, mission, epoch_unix_s=EPOCH_UNIX_S))
    for name, value in state.items():
        setattr(rig, name, value)
    return rig


@pytest.fixture
def field_rig(contract: Contract, mission: Mission) -> Iterator[FieldRig]:
    rig = rig_of(contract, mission.model_copy(update={"climb_max_m": 0.0}))
    rig.run(LEARNING_TIME_S + 0.5)
    rig.mode = OFFBOARD
    rig.run(6.0)
    assert rig.phase is Phase.CRUISE
    assert rig.velocity_ned_mps[0] == pytest.approx(2.8, abs=0.01)
    yield rig
    assert rig.landed_state == IN_AIR


def holds(rig: FieldRig, seconds: float) -> str | None:
    """Fly on; return the first violation if that ended in a hold."""
    rig.run(seconds, until=lambda: rig.phase is Phase.HOLD)
    return rig.texts("violation")[0] if rig.phase is Phase.HOLD else None


# ---------------------------------------------------------------------- height


@pytest.mark.parametrize("up_m", [2.2, -2.2])
@pytest.mark.parametrize("avoiding", [False, True])
def test_a_height_that_is_not_held_ends_in_a_stop_at_the_height_of_the_reference(
    field_rig: FieldRig, up_m: float, *, avoiding: bool
) -> None:
    if avoiding:
        field_rig.obstacles = [box((field_rig.position_ned_m[0] + 11.0, 0.2))]
        field_rig.run(6.0, until=lambda: field_rig.phase is Phase.AVOID)
        assert field_rig.phase is Phase.AVOID
    field_rig.be_off((0.0, 0.0, -up_m))
    violation = holds(field_rig, 0.2)
    assert violation is not None
    assert violation.startswith("tracking_error_z")
    field_rig.run(6.0)
    last = field_rig.setpoints[-1]
    assert (last.vx, last.vy, last.vz) == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
    assert last.z == pytest.approx(-4.0, abs=1e-6)


@pytest.mark.parametrize("up_m", [1.1, -1.1])
def test_a_height_that_is_missed_a_little_is_flown_on_if_the_ground_is_far(
    field_rig: FieldRig, up_m: float
) -> None:
    field_rig.be_off((0.0, 0.0, -up_m))
    assert holds(field_rig, 3.0) is None
    assert field_rig.texts("violation")[0].startswith("tracking_error_z")
    assert "contract solved again" in field_rig.texts("adapted")[0]


# ---------------------------------------------------------------------- heading


@pytest.mark.parametrize("error_deg", [8.0, -18.0])
def test_a_nose_off_its_command_ends_in_a_stop(field_rig: FieldRig, error_deg: float) -> None:
    field_rig.nose_error_rad = math.radians(error_deg)
    violation = holds(field_rig, 1.5)
    assert violation is not None
    assert violation.startswith("heading_error (pointing)")


@pytest.mark.parametrize("error_deg", [3.5, -3.5])
def test_a_nose_that_wanders_a_little_is_flown_on(field_rig: FieldRig, error_deg: float) -> None:
    field_rig.nose_error_rad = math.radians(error_deg)
    assert holds(field_rig, 4.0) is None
    assert field_rig.texts("violation") == []


def test_turning_to_a_leg_is_no_heading_error(contract: Contract) -> None:
    legs = ({"end_ned_m": [20.0, 0.0]}, {"end_ned_m": [20.0, 30.0]})
    mission = Mission.model_validate({"altitude_m": 4.0, "legs": legs}, strict=False)
    rig = rig_of(contract, mission, mode=OFFBOARD)
    rig.run(6.0)

    def late_nose() -> bool:
        """Turn at 30°/s, not at once."""
        heading_rad = rig.autonomy.navigator.leg.heading_rad
        behind_rad = heading_rad - turned[0]
        turned[0] += math.copysign(min(abs(behind_rad), math.radians(0.6)), behind_rad)
        rig.nose_error_rad = turned[0] - heading_rad
        return rig.phase is Phase.ARRIVED

    turned = [0.0]
    rig.run(40.0, until=late_nose)
    assert rig.phase is Phase.ARRIVED
    assert rig.texts("violation") == []


def test_a_magnetometer_that_the_estimator_rejects_ends_in_a_stop(field_rig: FieldRig) -> None:
    field_rig.mag_ratio = 0.9
    assert holds(field_rig, 3.0) is None
    field_rig.mag_ratio = 1.4
    violation = holds(field_rig, 2.5)
    assert violation is not None
    assert violation.startswith("heading_error (compass)")


def seen_from_the_body(rig: FieldRig, turned_rad: float) -> bytes:
    """A frame in FRD of pillars beside the leg, by a heading estimate that is off by an angle."""
    north_m, east_m, _ = rig.position_ned_m
    pillars = []
    for number, (at_north_m, at_east_m) in enumerate([(60.0, 9.0), (70.0, -10.0), (80.0, 8.0)]):
        bearing_rad = math.atan2(at_east_m - east_m, at_north_m - north_m) - turned_rad
        range_m = math.hypot(at_north_m - north_m, at_east_m - east_m)
        center_m = (range_m * math.cos(bearing_rad), range_m * math.sin(bearing_rad))
        pillars.append(box(center_m, name=str(number)))
    return rig.frame(frame="body_frd", obstacles=pillars)


@pytest.mark.parametrize(
    ("drifted_deg", "held"), [(3.5, False), (-3.5, False), (18.0, True), (-18.0, True)]
)
def test_a_heading_that_drifts_from_what_is_seen_ends_in_a_stop(
    field_rig: FieldRig, drifted_deg: float, *, held: bool
) -> None:
    """The nose points where it is told by the estimate; only what is seen tells otherwise."""
    field_rig.seeing = False
    for step in range(200):
        share = min(max(step - 50, 0) / 100.0, 1.0)  # known first; then drifting in 2 s
        if step % 3 == 0:
            payload = seen_from_the_body(field_rig, share * math.radians(drifted_deg))
            field_rig.autonomy.receive_detection(payload, field_rig.now_s)
        field_rig.tick()
        if field_rig.phase is Phase.HOLD:
            break
    headings = [text for text in field_rig.texts("violation") if text.startswith("heading_error")]
    assert bool(headings) is held
    assert (field_rig.phase is Phase.HOLD) is held


def test_a_heading_that_was_aligned_before_the_departure_is_no_error(
    contract: Contract, mission: Mission
) -> None:
    rig = rig_of(contract, mission, seeing=False)
    for step in range(400):
        rig.mode = OFFBOARD if step >= 100 else rig.mode
        turned_rad = math.radians(30.0) if step < 100 else 0.0
        if step % 3 == 0:
            rig.autonomy.receive_detection(seen_from_the_body(rig, turned_rad), rig.now_s)
        rig.tick()
    assert rig.phase is Phase.CRUISE
    assert not any(text.startswith("heading_error") for text in rig.texts("violation"))


# ---------------------------------------------------------------------- wind and tilt


@pytest.mark.parametrize("hover_s", [0.0, 3.0])
@pytest.mark.parametrize("trim_ned_mps2", [(-2.2, 0.0), (2.2, 0.0), (0.0, 3.5)])
def test_departing_in_a_steady_wind_is_no_violation(
    contract: Contract, mission: Mission, trim_ned_mps2: tuple[float, float], hover_s: float
) -> None:
    rig = rig_of(contract, mission, trim_ned_mps2=trim_ned_mps2)
    rig.run(hover_s)
    rig.mode = OFFBOARD
    rig.obstacles = [box((20.0, 0.3))]
    rig.run(60.0, until=lambda: rig.phase is Phase.ARRIVED)
    assert rig.phase is Phase.ARRIVED
    assert rig.texts("violation") == []


@pytest.mark.parametrize(
    ("wind_max_mps", "held"), [(None, False), (6.0, False), (2.0, True), (0.0, True)]
)
def test_a_wind_beyond_the_declared_one_ends_in_a_stop(
    contract: Contract, mission: Mission, wind_max_mps: float | None, *, held: bool
) -> None:
    drag_per_s = 0.45
    vehicle = contract.vehicle.model_copy(update={"drag_per_s": drag_per_s})
    # The trim leaves less to brake with, and regions grow.
    update = {"wind_max_mps": wind_max_mps, "obstacle_separation_min_m": 60.0}
    environment = contract.environment.model_copy(update=update)
    declared = contract.model_copy(update={"vehicle": vehicle, "environment": environment})
    rig = rig_of(declared, mission)
    rig.run(3.0)
    rig.mode = OFFBOARD
    rig.run(6.0)
    north_mps2 = drag_per_s * rig.velocity_ned_mps[0]
    rig.trim_ned_mps2 = (north_mps2, drag_per_s * 6.0)
    violation = holds(rig, CONFIRMATION_S + 4.0)
    assert (violation is not None) is held
    assert violation is None or violation.startswith("wind")


def test_it_does_not_depart_in_more_wind_than_declared(
    contract: Contract, mission: Mission
) -> None:
    update = {"wind_max_mps": 3.0, "obstacle_separation_min_m": 60.0}
    environment = contract.environment.model_copy(update=update)
    declared = contract.model_copy(update={"environment": environment})
    rig = rig_of(declared, mission, trim_ned_mps2=(-4.5, 0.0))
    rig.run(LEARNING_TIME_S + CONFIRMATION_S + 0.2)
    rig.mode = OFFBOARD
    rig.run(1.0)
    phases = [rig.phase]
    assert rig.texts("refused") == ["not leaving standby: more wind than 3 m/s"]
    rig.trim_ned_mps2 = (0.0, 0.0)
    rig.run(4.0)
    assert [*phases, rig.phase] == [Phase.STANDBY, Phase.CRUISE]


# ---------------------------------------------------------------------- second commander


@pytest.mark.parametrize("gain_per_s", [0.0, 0.95, 1.5])
def test_what_px4s_controller_adds_is_no_second_commander(
    field_rig: FieldRig, gain_per_s: float
) -> None:
    field_rig.gain_per_s = gain_per_s
    field_rig.be_off((-0.1, 0.1, 0.5), seconds=2.0)
    field_rig.obstacles = [box((field_rig.position_ned_m[0] + 12.0, 0.3))]
    field_rig.run(60.0, until=lambda: field_rig.phase is Phase.ARRIVED)
    assert field_rig.phase is Phase.ARRIVED
    assert field_rig.texts("violation") == []


@pytest.mark.parametrize("copter", [False, True])
@pytest.mark.parametrize(
    "second_commander",
    [
        lambda rig: (*rig.position_ned_m[:2], -7.0),  # another height only
        lambda rig: (*rig.position_ned_m[:2], rig.position_ned_m[2] + 0.3),
        lambda _: (0.0, 0.0, 0.0),
        lambda _: (math.nan, math.nan, math.nan),
    ],
)
def test_a_second_commander_that_a_third_of_the_echoes_show_ends_in_a_stop(
    contract: Contract,
    mission: Mission,
    second_commander: Callable[[FieldRig], Vector],
    *,
    copter: bool,
) -> None:
    rig = rig_of(contract, mission, copter=copter, mode=OFFBOARD)
    rig.run(6.0)
    assert rig.phase is Phase.CRUISE
    rig.second_commander = second_commander
    violation = holds(rig, 2.0)
    assert violation is not None
    assert violation.startswith("second_commander")


def test_ardupilots_echo_has_to_be_ours_as_it_is(contract: Contract, mission: Mission) -> None:
    rig = rig_of(contract, mission, copter=True, mode=OFFBOARD)
    rig.run(6.0)
    rig.error_ned_m, rig.gain_per_s = (-0.2, 0.0, 0.0), 0.95
    violation = holds(rig, 2.0)
    assert violation is not None
    assert violation.startswith("second_commander")


def test_echoes_are_asked_for_out_of_step_with_our_setpoints() -> None:
    interval_ms = 1000.0 / TARGET_RATE_HZ
    assert interval_ms == pytest.approx(round(interval_ms))
    assert math.gcd(round(interval_ms), 20) == 1


# ---------------------------------------------------------------------- at rest


@pytest.mark.parametrize(
    ("contract_name", "speed_mps", "departs"),
    [
        ("px4_contract", 0.9, True),  # as a real PX4 hovers, by its own estimate
        ("px4_contract", 1.1, False),
        ("ardupilot_contract", 0.5, True),
        ("ardupilot_contract", 1.1, False),
        ("paper_contract", 0.29, True),
    ],
)
@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)])
def test_it_departs_from_what_stops_within_the_tracking_error(
    mission: Mission, contract_name: str, speed_mps: float, direction: Vector, *, departs: bool
) -> None:
    contract = load_contract(CONFIG / f"{contract_name}.yaml")
    rig = rig_of(contract, mission, mode=OFFBOARD)
    rig.drift_ned_mps = (
        speed_mps * direction[0],
        speed_mps * direction[1],
        speed_mps * direction[2],
    )
    rig.run(0.2)
    assert (rig.phase is Phase.CRUISE) is departs
    assert any("not at rest" in text for text in rig.texts("refused")) is not departs


def test_a_leg_starts_although_the_estimate_wanders(mission: Mission) -> None:
    mission = mission.model_copy(update={"start_clear_m": 4.0})
    rig = rig_of(load_contract(CONFIG / "px4_contract.yaml"), mission)
    rig.drift_ned_mps = (0.0, 0.6, 0.0)
    rig.run(3.0)
    rig.mode = OFFBOARD
    rig.run(4.0)
    assert rig.velocity_ned_mps[0] > 1.0
