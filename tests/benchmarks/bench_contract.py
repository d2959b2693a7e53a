"""Speed of the contract: the verdict, a surface of verdicts, and the boundary against a grid."""

from __future__ import annotations

import numpy as np

from gcs_tools.contract.surface_grid import Axis, evaluate
from onboard.contract.agility import AccelerationLimits
from onboard.contract.assessment import assess
from onboard.contract.region import boundary_depth_at
from onboard.files.contract_file import load_contract
from onboard.geometry.box import Box
from tests.benchmarks.measurement import Measurement, Scale, seconds_of, sized
from tests.gcs_tools.running import CONFIG
from tests.onboard.contract.grid_reachability import GridProblem

ASSESS_TIME_MAX_US = 60.0
EXAMPLE = load_contract(CONFIG / "default_contract.yaml")


def bench_contract_assess() -> Measurement:
    """The whole contract, once: both readings, every clause."""
    count = sized(2000, 20)

    def many() -> None:
        for _ in range(count):
            assess(EXAMPLE)

    duration_s = seconds_of(many)
    return Measurement(duration_s / count * 1e6, "us", limit=ASSESS_TIME_MAX_US)


def bench_contract_surface() -> Measurement:
    """Every clause at every point of a grid of a million, on one core."""
    side = sized(1000, 10)
    speeds = Axis.parse(f"vehicle.cruise_speed_mps=0.5:10:{side}")
    angles = Axis.parse(f"vehicle.roll_max_deg+vehicle.pitch_max_deg=5:30:{side}")
    duration_s = seconds_of(lambda: evaluate(EXAMPLE, speeds, angles, "margin"))
    return Measurement(side**2 / 1e6 / duration_s, "million points/s", more_is_better=True)


def bench_collision_set_boundary() -> Measurement:
    """The boundary of one obstacle, sampled so that both are off by at most one cell.

    The peer's grid is off by up to a cell, its compilation is not counted; the closed form is
    exact, so the spacing of its samples is the only error.
    """
    limits = AccelerationLimits(2.6286, 2.6286, 2.7213, 2.7213)
    problem = GridProblem(limits, speed_mps=2.8, width_m=4.0)
    face = Box(0.0, 1.0, -2.0, 2.0)
    y_m = np.linspace(-2.0, 2.0, problem.cells + 1)

    def closed_form() -> list[float]:
        return [boundary_depth_at(each_m, face, limits, 2.8) for each_m in y_m.tolist()]

    if Scale.small:  # the peer's compilation takes ten times all else; its own tests run it
        return Measurement(seconds_of(closed_form) * 1e3, "ms")
    numerical_s = seconds_of(lambda: problem.depths(y_m), repeat=1)
    return Measurement(
        seconds_of(closed_form) * 1e3, "ms", peer=numerical_s * 1e3, peer_name="hj_reachability"
    )
