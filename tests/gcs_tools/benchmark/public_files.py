"""Small files in the formats of the public scenes, made for the tests."""

from __future__ import annotations

import json
from pathlib import Path

PILLARS = """\
x_m,y_m,radius_m,base_z_m,height_m
9.0,0.3,1.2,0.0,6.0
16.0,-2.5,1.0,0.0,6.0
"""
BOXES = """\
run,north1_m,east1_m,l1_north_m,w1_east_m,r1_deg,north2_m,east2_m,l2_north_m,w2_east_m,r2_deg,\
px4_avoidance_min_distance_m
ours,1.0,12.0,3.0,2.0,30.0,-9.0,14.0,4.0,4.0,0.0,1.2
ours,-30.0,12.0,3.0,2.0,0.0,30.0,14.0,4.0,4.0,0.0,3.1
"""
MISSIONS = {
    "frame": "local NED metres",
    "missions": {
        "mission1": [["takeoff", 0.0, 0.0, 10], ["land", 0.0, 24.0, 0]],
        "mission2": [["takeoff", 0.0, 0.0, 10], ["waypoint", 0.0, 24.0, 10], ["land", 0, 24.0, 0]],
    },
}


KNOT = {
    "name": "cube", "x0": 9.0, "y0": 1.0, "z0": 2.0, "scale_x": 2.5, "scale_y": 3.0, "scale_z": 2.8,
    "offset": 2.35, "slower": 4.6, "size_x": 0.8, "size_y": 0.8, "size_z": 0.8,
}  # fmt: skip
BEAM = {
    **KNOT, "name": "beam", "x0": 13.0, "y0": -4.0, "scale_x": 0.0, "scale_y": 0.0, "scale_z": 0.0,
    "slower": 0.0, "size_x": 0.4, "size_y": 4.0,
}  # fmt: skip
MOVING = {
    "start": [0, 0, 2], "goal": [16, 0, 2], "v_max": 5,
    "seeds": {"0": [KNOT, BEAM], "1": [BEAM]},
}  # fmt: skip


def stems(count: int = 12, side_m: float = 50.0) -> str:
    """Return a stem map: a grid of stems, each turned a little aside."""
    step_m = side_m / count
    rows = [
        f"{step_m * (k // count) + k % 3 * 0.7:.1f},{step_m * (k % count):.1f},25.0"
        for k in range(0, count * count, 2)
    ]
    return "\n".join(("x_m,y_m,dbh_cm", *rows)) + "\n"


def write_all(folder: Path) -> Path:
    """Write the files as a folder of data has them; return the folder."""
    competition = folder / "benchmarks" / "uav_testing_competition"
    sando = folder / "benchmarks" / "sando"
    for each in (competition, sando):
        each.mkdir(parents=True)
    (sando / "static_easy.csv").write_text(PILLARS, encoding="utf-8")
    (sando / "dynamic_easy.json").write_text(json.dumps(MOVING), encoding="utf-8")
    (sando / "dynamic_medium.json").write_text(json.dumps(MOVING), encoding="utf-8")
    (competition / "two_box_scenes.csv").write_text(BOXES, encoding="utf-8")
    (competition / "missions.json").write_text(json.dumps(MISSIONS), encoding="utf-8")
    (folder / "longleaf_pines.csv").write_text(stems(), encoding="utf-8")
    return folder
