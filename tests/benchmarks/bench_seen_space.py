"""Cost of a frame for the seen-free set, and of its snapshot for the planner."""

from __future__ import annotations

import math
import random
import time
from dataclasses import replace
from statistics import median

from onboard.geometry.box import Box
from onboard.perception.line_of_sight import View
from onboard.perception.seen_free import SeenFree
from tests.benchmarks.measurement import Measurement, sized

FRAMES = 400
SPEED_M_PER_FRAME = 0.14
STEMS_PER_M2 = 0.07
FRAME_TIME_MAX_MS = 1.5


def bench_seen_free_frame() -> Measurement:
    """A frame of a forest of 700 stems/ha, 120 degrees to 12 m."""
    return Measurement(_frame_ms(math.radians(60.0)), "ms", limit=FRAME_TIME_MAX_MS)


def bench_seen_free_frame_all_round() -> Measurement:
    """The same all round; the peer is a frame of 120 degrees."""
    ahead_ms, round_ms = _frame_ms(math.radians(60.0)), _frame_ms(math.pi)
    return Measurement(round_ms, "ms", ahead_ms, "120 degrees")


def _frame_ms(half_view_rad: float) -> float:
    """Return the median time of a frame in flight through a forest, snapshot not included."""
    draw = random.Random(1)
    length_m = sized(FRAMES, 20) * SPEED_M_PER_FRAME + 24.0
    stems = []
    for _ in range(round(length_m * 24.0 * STEMS_PER_M2)):
        x_m, y_m = draw.uniform(-12.0, length_m - 12.0), draw.uniform(-12.0, 12.0)
        half_m = draw.uniform(0.1, 0.25)
        if abs(y_m) > 1.0:
            stems.append(Box(x_m - half_m, x_m + half_m, y_m - half_m, y_m + half_m))
    view = View(
        (0.0, 0.0), 0.0, half_view_rad, 12.0, (), 0.05, pose_error_m=0.03, heading_error_rad=0.01
    )
    space, spent_s = SeenFree(), []
    for number in range(sized(FRAMES, 20)):
        x_m = SPEED_M_PER_FRAME * number
        near = [stem for stem in stems if abs(stem.x_min_m - x_m) < 13.0]
        seen = replace(view, position_leg_m=(x_m, 0.0), boxes=near)
        began_s = time.process_time()
        space.centre_on(x_m, 0.0)
        space.see(seen)
        spent_s.append(time.process_time() - began_s)
    return median(spent_s) * 1e3
