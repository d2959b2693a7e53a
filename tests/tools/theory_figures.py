"""Draw the figures of docs/idea.md: ``python -m tests.tools.theory_figures``.

Everything in them is computed by the code that flies, from ``config/px4_contract.yaml``.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import matplotlib as mpl
import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

from onboard.contract.assessment import Assessment, assess
from onboard.contract.region import boundary_depth_at
from onboard.files.contract_file import load_contract
from onboard.geometry.box import Box

ROOT: Final = Path(__file__).parents[2]
ONE, MANY = ROOT / "docs" / "idea_one_obstacle.svg", ROOT / "docs" / "idea_many_obstacles.svg"
# Two metres across and along, to the right of the leg.
OBSTACLE: Final = Box(20.0, 22.0, -0.4, 1.6)


def draw_one(assessment: Assessment, path: Path) -> None:
    """Draw one obstacle and what surrounds it, in the leg frame."""
    region = assessment.region_around(OBSTACLE, 0.0)
    _, axes = plt.subplots(figsize=(9.0, 4.2), layout="constrained")
    _leg(axes, -2.0, 34.0)
    _box(axes, region.extent, "region of influence: where the vehicle leaves the leg", "#dbe7f5")
    _box(axes, region.keep_out, "kept out of: obstacle, body, errors, run-on", "#f3c9c2")
    _box(axes, OBSTACLE, "obstacle, as measured", "#5a7d4d")
    inflated, speed_mps = region.obstacle, assessment.inflated.manoeuvre_encounter.speed_mps
    across_m = np.linspace(inflated.y_min_m, inflated.y_max_m, 60)
    depths_m = [
        boundary_depth_at(y_m, inflated, assessment.limits, speed_mps) for y_m in across_m.tolist()
    ]
    ahead_m = inflated.x_min_m - np.array(depths_m)
    axes.plot(ahead_m, across_m, color="#b03a2e", lw=1.5, label="from here on no swerve helps")
    range_m = assessment.terms.detection_range_m
    seen_m = region.extent.x_min_m
    axes.annotate("", (seen_m, -6.2), (seen_m + range_m, -6.2), arrowprops={"arrowstyle": "<->"})
    axes.text(seen_m + 0.5 * range_m, -6.5, f"detection range {range_m:g} m", ha="center")
    _finish(axes, path, (-7.5, 7.5))


def draw_many(assessment: Assessment, path: Path) -> None:
    """Draw obstacles as near to each other as the contract permits."""
    apart_m = assessment.contract.environment.separation_any_way_m
    _, axes = plt.subplots(figsize=(9.0, 3.6), layout="constrained")
    _leg(axes, -2.0, 3.2 * apart_m)
    for number, offset_m in enumerate((0.8, -1.2, 0.3)):
        x_m = 12.0 + number * apart_m
        obstacle = Box(x_m - 1.0, x_m + 1.0, offset_m - 1.0, offset_m + 1.0)
        region = assessment.region_around(obstacle, 0.0)
        first = number == 0
        _box(axes, region.extent, "region of influence" if first else "", "#dbe7f5")
        _box(axes, region.keep_out, "kept out of" if first else "", "#f3c9c2")
        _box(axes, obstacle, "obstacle" if first else "", "#5a7d4d")
    axes.annotate("", (12.0, -6.0), (12.0 + apart_m, -6.0), arrowprops={"arrowstyle": "<->"})
    axes.text(12.0 + apart_m / 2.0, -6.3, f"separation {apart_m:g} m", ha="center")
    _finish(axes, path, (-7.5, 7.5))


def _leg(axes: Axes, from_m: float, to_m: float) -> None:
    axes.plot((from_m, to_m), (0.0, 0.0), color="#1f5fa8", lw=1.2, label="leg")


def _box(axes: Axes, box: Box, label: str, colour: str) -> None:
    x_m, y_m = box.x_max_m - box.x_min_m, box.y_max_m - box.y_min_m
    corner = (box.x_min_m, box.y_min_m)
    patch = Rectangle(corner, x_m, y_m, facecolor=colour, edgecolor="#555555", lw=0.6, label=label)
    axes.add_patch(patch)


def _finish(axes: Axes, path: Path, across_m: tuple[float, float]) -> None:
    axes.set(xlabel="along the leg [m]", ylabel="to the right [m]", ylim=across_m[::-1])
    axes.set_aspect("equal")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, 1.32), ncol=2, fontsize=8, frameon=False)
    plt.savefig(path, metadata={"Date": None})
    plt.close("all")


def main(one: Path = ONE, many: Path = MANY) -> None:
    """Draw both."""
    mpl.use("svg")
    mpl.rcParams["svg.hashsalt"] = "clearway"
    assessment = assess(load_contract(ROOT / "config" / "px4_contract.yaml"))
    draw_one(assessment, one)
    draw_many(assessment, many)


if __name__ == "__main__":
    main()
