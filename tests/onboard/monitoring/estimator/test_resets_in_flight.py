"""The service when the autopilot's estimate jumps: on every axis, in every phase."""

from typing import Any

import pytest

from onboard.autonomy import Autonomy
from onboard.files.contract_file import Contract
from onboard.files.mission_file import Mission
from onboard.guidance.clear_check import ClearCheck
from onboard.guidance.phases import Phase
from onboard.planning.planner import NoPlan, Planner
from tests.onboard.test_autonomy import EPOCH_UNIX_S, OFFBOARD, POSCTL, Rig, box

Vector = tuple[float, float, float]

LARGE = [(0.0, 0.0, 3.5), (0.0, 0.0, -5.5), (0.0, 3.0, 0.0), (-2.0, 0.0, 1.0)]
SMALL = [(0.5, 0.0, 0.0), (-0.5, 0.0, 0.0), (0.0, 0.6, 0.0), (0.0, 0.0, 0.6), (-0.3, -0.3, -0.4)]


def jump(rig: Rig, shift_ned_m: Vector) -> None:
    """Move the estimate; a sensor that reports in the local frame moves its boxes along."""
    north_m, east_m, down_m = (p + s for p, s in zip(rig.position_ned_m, shift_ned_m, strict=True))
    rig.position_ned_m = (north_m, east_m, down_m)
    rig.obstacles = [
        seen | {"center_m": [c + s for c, s in zip(seen["center_m"], shift_ned_m[:2], strict=True)]}
        for seen in rig.obstacles
    ]


def flying(contract: Contract, mission: Mission, bound_m: float, obstacles: list[Any]) -> Rig:
    vehicle = contract.vehicle.model_copy(update={"estimator_reset_max_m": bound_m})
    contract = contract.model_copy(update={"vehicle": vehicle})
    rig = Rig(Autonomy(contract, mission, epoch_unix_s=EPOCH_UNIX_S), mode=OFFBOARD)
    rig.obstacles = obstacles
    return rig


def in_phase(rig: Rig, phase: str) -> None:
    """Fly until the phase, and well into it."""
    if phase.startswith("avoid"):
        rig.run(20.0, until=lambda: rig.phase is Phase.AVOID)
        # At first the plan has been made, and is flown from the next tick on.
        rig.run(0.0 if phase == "avoid begins" else 1.2)
        assert rig.phase is Phase.AVOID
        return
    rig.run(6.0)
    assert rig.phase is Phase.CRUISE
    if phase == "hold":
        rig.now_s += 0.2  # a late tick
        rig.run(3.0)
        assert rig.phase.value == "hold"


@pytest.mark.parametrize("phase", ["cruise", "avoid", "hold"])
@pytest.mark.parametrize("shift_ned_m", LARGE)
def test_undeclared_jump_on_any_axis_ends_in_a_hover_where_the_vehicle_is(
    contract: Contract, mission: Mission, shift_ned_m: Vector, phase: str
) -> None:
    rig = flying(contract, mission, 0.0, [box((24.0, 0.2))])
    in_phase(rig, phase)
    north_m, east_m, _ = rig.position_ned_m
    jump(rig, shift_ned_m)
    height_m = rig.position_ned_m[2]
    lowest_m = highest_m = height_m
    for _ in range(250):
        rig.tick()
        lowest_m = max(lowest_m, rig.position_ned_m[2])
        highest_m = min(highest_m, rig.position_ned_m[2])
    assert rig.phase is Phase.HOLD
    assert any("estimator_reset" in text for text in rig.texts("violation"))
    # It neither climbs nor sinks in the world, nor goes back to where it was said to be.
    assert lowest_m - highest_m < 0.02
    flown_east_m = rig.position_ned_m[1] - east_m - shift_ned_m[1]
    assert abs(flown_east_m) < 3.0
    flown_north_m = rig.position_ned_m[0] - north_m - shift_ned_m[0]
    assert -0.05 < flown_north_m < 8.0
    if phase == "hold":
        assert (flown_north_m, flown_east_m) == pytest.approx((0.0, 0.0), abs=0.01)


def test_undeclared_jump_in_an_avoidance_stops_along_what_is_certified(
    contract: Contract, mission: Mission
) -> None:
    """The map jumps with the vehicle, so that what was certified before still is."""
    rig = flying(contract, mission, 0.0, [box((24.0, 0.2))])
    in_phase(rig, "avoid")
    jump(rig, (0.0, 2.0, 2.0))
    rig.run(5.0)
    (seen,) = rig.obstacles
    (known,) = rig.autonomy.navigator.obstacles
    assert known.measured.size_m == pytest.approx((1.0, 1.0))
    assert known.measured.x_min_m == pytest.approx(seen["center_m"][0] - 0.5)
    assert "no way to stop" not in rig.texts("phase")[-1]
    radius_m = 0.3
    north_m, east_m, _ = rig.position_ned_m
    beside_m = abs(east_m - seen["center_m"][1]) - 0.5 - radius_m
    before_m = seen["center_m"][0] - 0.5 - radius_m - north_m
    assert max(beside_m, before_m) > 0.0


@pytest.mark.parametrize("airborne", [True, False])
def test_jump_in_standby_moves_the_hold(
    contract: Contract, mission: Mission, *, airborne: bool
) -> None:
    rig = flying(contract, mission, 0.0, [])
    rig.seeing = False  # control is granted, the departure refused
    rig.landed_state = 2 if airborne else 1
    rig.run(1.0)
    assert rig.phase is Phase.STANDBY
    jump(rig, (0.0, 0.0, 3.5))
    rig.run(1.0)
    assert rig.phase is Phase.STANDBY
    assert rig.position_ned_m[2] == pytest.approx(-0.5)
    assert bool(rig.setpoints) is airborne


@pytest.mark.parametrize("phase", ["cruise", "avoid begins", "avoid"])
@pytest.mark.parametrize("shift_ned_m", SMALL)
def test_declared_reset_moves_what_is_remembered_and_the_flight_goes_on(
    contract: Contract, mission: Mission, shift_ned_m: Vector, phase: str
) -> None:
    rig = flying(contract, mission, 1.0, [box((24.0, 0.2)), box((40.0, -9.0), name="2")])
    in_phase(rig, phase)
    jump(rig, shift_ned_m)
    clearances_m = []

    def done() -> bool:
        north_m, east_m, _ = rig.position_ned_m
        center_m = rig.obstacles[0]["center_m"]
        clearances_m.append(max(abs(north_m - center_m[0]), abs(east_m - center_m[1])) - 0.5)
        return rig.phase in (Phase.ARRIVED, Phase.HOLD)

    rig.run(60.0, until=done)
    assert rig.phase is Phase.ARRIVED
    assert rig.texts("violation") == rig.texts("post_condition") == rig.texts("certificate") == []
    (said,) = rig.texts("estimator_reset")
    assert "2 obstacles" in said
    assert min(clearances_m) >= 0.3 + 0.05
    # The mission is what the frame of now says, in height too.
    assert rig.position_ned_m[0] == pytest.approx(46.0, abs=0.01)
    assert rig.position_ned_m[2] == pytest.approx(-4.0, abs=0.01)


@pytest.mark.parametrize("shift_ned_m", SMALL)
def test_after_a_declared_reset_the_mission_is_what_the_frame_of_now_says(
    contract: Contract, mission: Mission, shift_ned_m: Vector
) -> None:
    rig = flying(contract, mission, 1.0, [])
    in_phase(rig, "cruise")
    jump(rig, shift_ned_m)
    rig.run(3.0)
    assert rig.position_ned_m[2] == pytest.approx(-4.0, abs=0.01)
    rig.run(60.0, until=lambda: rig.phase in (Phase.ARRIVED, Phase.HOLD))
    assert rig.phase is Phase.ARRIVED
    assert rig.position_ned_m[0] == pytest.approx(46.0, abs=0.01)
    assert rig.texts("violation") == []


def test_another_departure_counts_anew(contract: Contract, mission: Mission) -> None:
    rig = flying(contract, mission, 1.0, [])
    for _ in range(2):
        rig.mode = OFFBOARD
        rig.run(6.0)
        jump(rig, (0.0, 0.6, 0.0))
        rig.run(1.0)
        assert rig.phase is Phase.CRUISE
        rig.mode = POSCTL
        rig.run(0.1)
        rig.velocity_ned_mps = rig.acceleration_ned_mps2 = (0.0, 0.0, 0.0)


def test_setpoints_do_not_step_in_the_world_at_a_declared_reset(
    contract: Contract, mission: Mission
) -> None:
    rig = flying(contract, mission, 1.0, [box((24.0, 0.2))])
    in_phase(rig, "avoid")
    before_ned_m = rig.position_ned_m
    shift_ned_m = (0.3, -0.5, 0.4)
    jump(rig, shift_ned_m)
    rig.tick()
    step_ned_m = [
        now - before - shift
        for now, before, shift in zip(rig.position_ned_m, before_ned_m, shift_ned_m, strict=True)
    ]
    speed_mps = rig.velocity_ned_mps
    assert step_ned_m == pytest.approx([0.02 * v for v in speed_mps], abs=0.005)


def test_resets_add_up(contract: Contract, mission: Mission) -> None:
    rig = flying(contract, mission, 1.0, [])
    in_phase(rig, "cruise")
    jump(rig, (0.0, 0.6, 0.0))
    rig.run(1.0)
    assert rig.phase is Phase.CRUISE
    jump(rig, (0.0, -0.6, 0.0))
    rig.run(0.1)
    assert rig.phase.value == "hold"
    assert "estimator_reset (horizontal): 1.20, limit 1.00 m" in rig.texts("violation")[0]


def test_plan_that_no_longer_certifies_after_a_reset_is_stopped(
    monkeypatch: pytest.MonkeyPatch, contract: Contract, mission: Mission
) -> None:
    rig = flying(contract, mission, 1.0, [box((24.0, 0.2))])
    in_phase(rig, "avoid")
    clear, verdicts = ClearCheck.is_clear, [False]
    monkeypatch.setattr(
        ClearCheck, "is_clear", lambda *args: verdicts.pop() if verdicts else clear(*args)
    )
    monkeypatch.setattr(Planner, "plan", lambda *_: NoPlan(()))
    jump(rig, (0.0, 0.5, 0.0))
    rig.tick()
    assert rig.phase is Phase.HOLD
    assert "estimator_reset" in rig.texts("phase")[-1]


def placed(rig: Rig, name: str) -> tuple[float, float, float, float]:
    obstacle = rig.autonomy.navigator.obstacles.of_track(f"front/{name}")
    assert obstacle is not None
    measured = obstacle.measured
    return measured.x_min_m, measured.x_max_m, measured.y_min_m, measured.y_max_m


@pytest.mark.parametrize(
    ("age_s", "east_m"),
    [
        (0.25, (0.5, 1.5)),  # certainly placed before the jump: moved
        (0.09, (0.0, 1.5)),  # perhaps: known at both places
    ],
)
def test_late_frame_in_the_local_frame_is_moved_with_the_estimate(
    contract: Contract, mission: Mission, age_s: float, east_m: tuple[float, float]
) -> None:
    rig = flying(contract, mission, 1.0, [])
    in_phase(rig, "cruise")
    jump(rig, (0.0, 0.5, 0.0))
    rig.tick()
    seen = box((40.0, 0.5))
    stamp_unix_s = EPOCH_UNIX_S + rig.now_s - age_s
    rig.autonomy.receive_detection(
        rig.frame(stamp_unix_s=stamp_unix_s, obstacles=[seen]), rig.now_s
    )
    rig.tick()
    assert placed(rig, "1") == pytest.approx((39.5, 40.5, *east_m))


def test_one_sighting_at_two_places_does_not_contradict_itself(
    contract: Contract, mission: Mission
) -> None:
    """It is new, in full view, and its frame was on its way while the estimate jumped."""
    rig = flying(contract, mission, 1.0, [])
    in_phase(rig, "cruise")
    jump(rig, (0.0, 0.8, 0.0))
    rig.tick()
    for later_s in (0.09, 0.0):
        ahead = box((rig.position_ned_m[0] + 20.0, 5.0))
        frame = rig.frame(
            stamp_unix_s=EPOCH_UNIX_S + rig.now_s - later_s, range_m=30.0, obstacles=[ahead]
        )
        rig.autonomy.receive_detection(frame, rig.now_s)
        rig.tick()
    rig.run(0.5)
    assert rig.texts("violation") == []
    assert rig.phase is Phase.CRUISE
    x_min_m, x_max_m, left_m, right_m = placed(rig, "1")
    assert right_m - left_m == pytest.approx(1.8)
    assert x_max_m - x_min_m == pytest.approx(1.0, abs=0.1)


def test_late_frame_from_the_body_is_placed_in_the_frame_of_now(
    contract: Contract, mission: Mission
) -> None:
    rig = flying(contract, mission, 1.0, [])
    in_phase(rig, "cruise")
    seen_from_m = rig.position_ned_m[0]
    stamp_unix_s = EPOCH_UNIX_S + rig.now_s
    jump(rig, (-0.4, 0.5, 0.0))
    rig.tick()
    frame = rig.frame(stamp_unix_s=stamp_unix_s, frame="body_frd", obstacles=[box((11.0, 0.0))])
    rig.autonomy.receive_detection(frame, rig.now_s)
    rig.tick()
    x_m = seen_from_m - 0.4 + 11.0
    assert placed(rig, "1") == pytest.approx((x_m - 0.5, x_m + 0.5, 0.0, 1.0), abs=0.06)


def test_jump_seen_only_after_a_silence_holds_where_the_vehicle_is_said_to_be(
    contract: Contract, mission: Mission
) -> None:
    """Its size cannot be told from motion, so that no bound covers it."""
    rig = flying(contract, mission, 2.0, [])
    in_phase(rig, "hold")
    rig.speaking = False
    rig.run(1.0)
    jump(rig, (0.0, 1.0, 1.0))
    x_m, y_m, z_m = rig.position_ned_m
    rig.speaking = True
    rig.run(1.0)
    assert rig.position_ned_m == pytest.approx((x_m, y_m, z_m), abs=0.01)
    rig.mode = POSCTL
    rig.run(0.1)
    assert rig.phase is Phase.STANDBY


def test_absurd_position_does_not_blur_the_map(contract: Contract, mission: Mission) -> None:
    """There and back by 1e6 m, a box would have lost digits of its place to rounding."""
    rig = flying(contract, mission, 0.0, [box((40.0, -9.0))])
    in_phase(rig, "hold")
    rig.seeing = False
    before_m, here_ned_m = placed(rig, "1"), rig.position_ned_m
    rig.position_ned_m = (9e5, 0.0, -4.0)
    rig.tick()
    rig.position_ned_m = here_ned_m
    rig.tick()
    assert placed(rig, "1") == before_m
    rig.run(1.0)
    assert rig.position_ned_m == pytest.approx(here_ned_m, abs=0.01)


@pytest.mark.parametrize("phase", ["cruise", "hold"])
def test_absurd_velocity_before_a_silence_is_not_flown(
    contract: Contract, mission: Mission, phase: str
) -> None:
    """Braking from it would lead to places that no message can carry."""
    rig = flying(contract, mission, 0.0, [])
    in_phase(rig, phase)
    flown_ned_m, rig.velocity_ned_mps = rig.position_ned_m, (3e38, 0.0, 0.0)
    rig.position_ned_m = (1e20, 0.0, -4.0)
    rig.mode, rig.speaking = POSCTL, True
    rig.told_mode = OFFBOARD
    rig.tick()
    rig.speaking = False
    rig.run(1.5)
    last = rig.setpoints[-1]
    assert abs(last.x - flown_ned_m[0]) < 8.0
