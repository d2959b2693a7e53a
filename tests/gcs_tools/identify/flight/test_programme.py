"""What is flown keeps to the contract's limits and to the box, or is refused with its cure."""

from __future__ import annotations

import argparse
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_tools.console.errors import CommandError
from gcs_tools.identify.flight.free_air import FreeAir, PlacedBox, free_air
from gcs_tools.identify.flight.programme import braking, programme
from onboard.contract.assessment import assess
from onboard.files.contract_file import load_contract
from onboard.geometry.fence import Fence, FenceArea
from onboard.geometry.frames import LegFrame
from tests.gcs_tools.running import CONFIG

ASSESSMENT = assess(load_contract(CONFIG / "ardupilot_contract.yaml"))


@pytest.mark.parametrize("run_on", [False, True])
@pytest.mark.parametrize("speed_mps", [None, 1.5])
def test_every_pass_keeps_to_the_limits_and_to_the_box(
    speed_mps: float | None, *, run_on: bool
) -> None:
    flown = programme(ASSESSMENT, FreeAir(80.0, 20.0), speed_mps, run_on=run_on)
    assert len(flown.passes) == (5 if run_on else 4)
    limits, place_m, turned = flown.envelope.limits, np.zeros(2), 1.0
    for each in flown.passes:
        turned = -1.0 if each.back else 1.0
        states = [each.trajectory.sample(t) for t in np.arange(0.0, each.trajectory.end_s, 0.02)]
        for state in states:
            x_mps2, y_mps2, _ = state.acceleration_leg_mps2
            assert -limits.brake_mps2 - 1e-6 <= x_mps2 <= limits.forward_mps2 + 1e-6
            assert -limits.left_mps2 - 1e-6 <= y_mps2 <= limits.right_mps2 + 1e-6
            assert state.velocity_leg_mps[0] <= flown.speed_mps + 1e-6
            x_m, y_m = place_m + turned * np.array(state.position_leg_m[:2])
            assert -1e-6 <= x_m <= flown.air.length_m - 2.0 * flown.margin_m
            assert abs(y_m) <= flown.air.width_m / 2.0 - flown.margin_m + 1e-6
        end = each.trajectory.sample(each.trajectory.end_s)
        assert math.hypot(*end.velocity_leg_mps) < 1e-6
        place_m = place_m + turned * np.array(end.position_leg_m[:2])
    # What leads there leads back, but for the last run.
    home_m = np.zeros(2) if not run_on else np.array(end.position_leg_m[:2])
    assert place_m == pytest.approx(home_m, abs=1e-6)


def test_the_limits_are_reached() -> None:
    flown = programme(ASSESSMENT, FreeAir(80.0, 20.0), None, run_on=False)
    asked = np.array(
        [
            each.trajectory.sample(t).acceleration_leg_mps2
            for each in flown.passes
            for t in np.arange(0.0, each.trajectory.end_s, 0.01)
        ]
    )
    limits = flown.envelope.limits
    assert asked[:, 1].max() == pytest.approx(limits.right_mps2, rel=0.02)
    assert asked[:, 1].min() == pytest.approx(-limits.left_mps2, rel=0.02)
    assert asked[:, 0].min() == pytest.approx(-limits.brake_mps2, rel=0.02)


def test_a_box_that_is_too_short_says_how_long_and_how_slow() -> None:
    with pytest.raises(CommandError, match=r"--free-air 30x20: .* m of length are needed") as said:
        programme(ASSESSMENT, FreeAir(30.0, 20.0), None, run_on=False)
    words = str(said.value)
    (slower,) = re.findall(r"--speed ([\d.]+)", words)
    (length,) = re.findall(r": ([\d.]+) m of length", words)
    programme(ASSESSMENT, FreeAir(30.0, 20.0), float(slower), run_on=False)
    programme(ASSESSMENT, FreeAir(float(length) + 0.1, 20.0), None, run_on=False)


def test_a_narrow_box_and_a_fast_pass_are_refused() -> None:
    with pytest.raises(CommandError, match=r"m of width are needed"):
        programme(ASSESSMENT, FreeAir(80.0, 4.0), None, run_on=False)
    with pytest.raises(CommandError, match=r"--speed 9 m/s: the contract's .* expected no more"):
        programme(ASSESSMENT, FreeAir(80.0, 20.0), 9.0, run_on=False)


def test_the_run_on_takes_its_own_length() -> None:
    slow = replace(ASSESSMENT.terms, setpoint_loss_run_on_m=60.0)
    slow = replace(slow, setpoint_loss_run_on_speed_mps=slow.cruise_speed_mps, passive_safety=True)
    assessment = replace(ASSESSMENT, terms=slow)
    programme(assessment, FreeAir(60.0, 20.0), None, run_on=False)
    with pytest.raises(CommandError, match="m of length are needed"):
        programme(assessment, FreeAir(60.0, 20.0), None, run_on=True)


@given(st.floats(0.0, 1.0))
def test_braking_leads_to_rest_within_the_limits(share: float) -> None:
    flown = programme(ASSESSMENT, FreeAir(80.0, 20.0), None, run_on=False)
    for each in flown.passes:
        state = each.trajectory.sample(share * each.trajectory.end_s)
        stop = braking(state, flown.envelope)
        begin, end = stop.sample(0.0), stop.sample(stop.end_s)
        assert begin.position_leg_m == pytest.approx(state.position_leg_m)
        assert begin.velocity_leg_mps == pytest.approx(state.velocity_leg_mps)
        assert end.velocity_leg_mps == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)


# ------------------------------------------------------------------ the box


def test_a_box_is_read_as_it_is_written() -> None:
    assert free_air("60x20.5") == FreeAir(60.0, 20.5)
    assert str(FreeAir(60.0, 20.5)) == "60x20.5"


@pytest.mark.parametrize(
    "text", ["60", "60x", "x20", "60X20", "60x20x5", "-60x20", "3x20", "60x2e3"]
)
def test_what_is_no_box_is_refused(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match=re.escape(repr(text))):
        free_air(text)


def test_a_vehicle_that_leaves_the_box_is_noticed() -> None:
    # The nose points east: ahead is east, to the right is south.
    box = PlacedBox(LegFrame((10.0, 20.0, -5.0), math.pi / 2.0), FreeAir(60.0, 20.0), 2.0)
    assert box.leaves((10.0, 70.0, -5.0)) is None
    assert "by its end" in (box.leaves((10.0, 79.0, -5.0)) or "")
    assert "by its end" in (box.leaves((10.0, 17.0, -5.0)) or "")
    assert "by its side" in (box.leaves((-1.0, 40.0, -5.0)) or "")
    assert "off its height" in (box.leaves((10.0, 40.0, -8.0)) or "")


def test_a_small_area_to_keep_out_of_is_found_in_the_box() -> None:
    box = PlacedBox(LegFrame((0.0, 0.0, -5.0), 0.3), FreeAir(60.0, 20.0), 2.0)
    inside = box.frame.position_ned((31.3, 4.2, 0.0))[:2]
    beside = box.frame.position_ned((31.3, 14.2, 0.0))[:2]
    assert box.leaves_fence(Fence((FenceArea((inside,), 0.2, keeps_in=False),)))
    assert not box.leaves_fence(Fence((FenceArea((beside,), 0.2, keeps_in=False),)))
