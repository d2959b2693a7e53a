"""`clearway contract show` against the formulas of the paper, written down once more."""

from __future__ import annotations

import csv
import io
import json
import math
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.gcs_tools.running import Clearway

G = 9.80665
PUBLISHED = {
    "collision_set_depth_m",
    "csb_shape",
    "lane_overhang_m",
    "pob_depth_m",
    "roi_length_m",
    "roi_width_m",
    "required_detection_range_m",
    "required_separation_m",
    "required_separation_box_m",
    "stopping_distance_m",
}


def depth_m(
    speed_mps: float, size_m: float, accel_mps2: float, across_mps2: float | None = None
) -> tuple[float, float]:
    """D and t_m for equal limits on both sides; across as along unless stated."""
    t_m = min(speed_mps / accel_mps2, math.sqrt(size_m / (across_mps2 or accel_mps2)))
    return speed_mps * t_m - accel_mps2 * t_m**2 / 2.0, t_m


class Case(NamedTuple):
    tilt_deg: float
    speed_mps: float
    size_m: float
    shape: str


@pytest.mark.parametrize(
    "case",
    [Case(15.0, 2.8, 4.0, "flat"), Case(5.0, 2.8, 1.2, "pointed"), Case(20.0, 9.0, 1.0, "pointed")],
)
def test_nominal_quantities(clearway: Clearway, config: Path, case: Case) -> None:
    tilt_deg, speed_mps, size_m, shape = case
    ran = clearway(
        "contract", "show", "--contract", config / "default_contract.yaml", "--format", "json",
        "--set", f"vehicle.roll_max_deg={tilt_deg}", f"vehicle.pitch_max_deg={tilt_deg}",
        "--set", f"vehicle.cruise_speed_mps={speed_mps}",
        f"environment.obstacle_size_max_m={size_m}",
    )  # fmt: skip
    assert ran.code == 0
    document = json.loads(ran.out)
    nominal = document["nominal"]
    a = G * math.tan(math.radians(tilt_deg))
    d, t_m = depth_m(speed_mps, size_m, a)
    overhang_m = (a * t_m) ** 2 / (2.0 * a)
    recovery_m = speed_mps**2 / (2.0 * a)
    length_m = d + size_m / 2.0 + max(recovery_m, size_m / 2.0)
    width_m = size_m + 2.0 * overhang_m

    assert set(nominal) == set(document["inflated"]) == PUBLISHED
    assert document["accel_mps2"] == pytest.approx(
        {"brake": a, "forward": a, "left": a, "right": a}
    )
    assert nominal["csb_shape"] == shape
    assert nominal["collision_set_depth_m"] == pytest.approx(d)
    assert nominal["lane_overhang_m"] == pytest.approx({"left": overhang_m, "right": overhang_m})
    assert nominal["pob_depth_m"] == pytest.approx(max(size_m, recovery_m))
    assert nominal["roi_length_m"] == pytest.approx(length_m)
    assert nominal["roi_width_m"] == pytest.approx(width_m)
    assert nominal["required_detection_range_m"] == pytest.approx(d)
    assert nominal["required_separation_m"] == pytest.approx(math.hypot(length_m, width_m))
    assert nominal["required_separation_box_m"] == pytest.approx([length_m, width_m])
    assert nominal["stopping_distance_m"] == pytest.approx(recovery_m)


@pytest.mark.parametrize(("input_set", "stops"), [("inner", True), ("paper", False)])
def test_inflated_reading(clearway: Clearway, config: Path, input_set: str, *, stops: bool) -> None:
    """It stops and sidesteps; on the paper's box, by the reference and the errors of before."""
    ran = clearway(
        "contract", "show", "--contract", config / "default_contract.yaml", "--format", "json",
        "--input-set", input_set,
    )  # fmt: skip
    inflated = json.loads(ran.out)["inflated"]
    a = G * math.tan(math.radians(15.0))
    radius_m, tracking_m, face_m = 0.30, 0.35, 0.05 * math.sqrt(2.0)
    face_m += 2.0 * (12.0 + math.sqrt(2.0) * 4.0) * math.sin(math.radians(2.0 / 2.0))
    late_s, timeout_s, lag_s = 0.20 + 0.27, 0.5, 0.27
    margin_m = radius_m + tracking_m + 2.0 * face_m
    size_m = 4.0 + 2.0 * margin_m
    if stops:
        speed_mps = 2.8
        coasted_mps = speed_mps + math.sqrt(2.0) * a * (timeout_s - lag_s / 2.0)
        run_on_m = speed_mps * (timeout_s + lag_s + coasted_mps / (2.0 * a))
        front_m = run_on_m + speed_mps * late_s + 0.15
        along_m, across_m = front_m + size_m, 0.5 + size_m
        assert inflated["required_separation_box_m"] == pytest.approx([along_m, across_m])
        assert inflated["required_separation_m"] == pytest.approx(math.hypot(along_m, across_m))
    else:
        speed_mps = 2.8 + 0.45
        d, _ = depth_m(speed_mps, size_m, a, a / math.cos(math.radians(15.0)))
        front_m = d + speed_mps * late_s + speed_mps * timeout_s + speed_mps**2 / (2.0 * a)
        assert inflated["required_separation_box_m"] == [
            inflated["roi_length_m"],
            inflated["roi_width_m"],
        ]
    assert inflated["required_detection_range_m"] == pytest.approx(margin_m + front_m + tracking_m)
    assert inflated["stopping_distance_m"] == pytest.approx(
        speed_mps * late_s + speed_mps**2 / (2.0 * a)
    )


def test_clauses_and_verdict(clearway: Clearway, config: Path) -> None:
    contract = config / "default_contract.yaml"
    ran = clearway("contract", "show", "--contract", contract, "--format", "json")
    document = json.loads(ran.out)
    assert document["compliant"] is True
    assert document["input_set"] == "inner"
    clauses = {clause["name"]: clause for clause in document["clauses"]}
    for clause in clauses.values():
        assert clause["margin"] == pytest.approx(clause["declared"] - clause["required"])
        assert clause["holds"] is (clause["margin"] > 0.0)
        assert set(clause) == {
            "name", "required", "declared", "margin", "unit", "holds", "concerns", "reason",
        }  # fmt: skip
    assert document["binding"] == "separation"
    assert clauses["separation"]["declared"] == 16.5


def test_a_contract_that_does_not_comply_is_shown(clearway: Clearway, config: Path) -> None:
    contract = config / "default_contract.yaml"
    broken = "environment.obstacle_separation_min_m=16.0"
    arguments = ("contract", "show", "--contract", contract, "--set", broken)
    ran = clearway(*arguments, "--format", "json")
    assert ran.code == 0
    assert json.loads(ran.out)["compliant"] is False
    table = clearway(*arguments)
    assert table.code == 0
    assert table.out.startswith("NOT COMPLIANT")
    assert "most violated: separation" in table.out


def test_paper_input_set_is_wider_sideways(clearway: Clearway, config: Path) -> None:
    contract = config / "default_contract.yaml"
    ran = clearway(
        "contract", "show", "--contract", contract, "--input-set", "paper", "--format", "json"
    )
    document = json.loads(ran.out)
    assert document["input_set"] == "paper"
    tilt_rad = math.radians(15.0)
    assert document["accel_mps2"]["right"] == pytest.approx(
        G * math.tan(tilt_rad) / math.cos(tilt_rad)
    )


def test_csv_and_json_say_the_same(clearway: Clearway, config: Path, tmp_path: Path) -> None:
    contract = config / "paper_contract.yaml"
    output = tmp_path / "contract.csv"
    shown = clearway("contract", "show", "--contract", contract, "--format", "json")
    written = clearway("contract", "show", "--contract", contract, "--format", "csv", "-o", output)
    assert (written.code, written.out) == (0, "")
    rows = dict(csv.reader(io.StringIO(output.read_text(encoding="utf-8"))))
    document = json.loads(shown.out)
    range_m = document["inflated"]["required_detection_range_m"]
    assert float(rows["inflated.required_detection_range_m"]) == range_m
    assert rows["nominal.csb_shape"] == document["nominal"]["csb_shape"]
    assert json.loads(rows["clauses.stop.holds"]) is True
    assert rows["contract_sha256"] == document["contract_sha256"]


def test_the_table_names_every_clause(clearway: Clearway, config: Path) -> None:
    ran = clearway("contract", "show", "--contract", config / "default_contract.yaml")
    assert ran.out.startswith("COMPLIANT")
    for name in ("thrust", "detection_range", "stop", "passive_safety", "separation"):
        assert name in ran.out


def test_what_is_promised_against_each_class_of_movers(clearway: Clearway, config: Path) -> None:
    drone = "[{class: drone, speed_max_mps: 15.0, size_max_m: 1.0}]"
    path = config / "movers_contract.yaml"
    covered = clearway("contract", "show", "--contract", path).out
    assert "person 1.2 m/s: passive, if none hides behind an obstacle" in covered
    found = clearway("contract", "show", "--contract", path, "--set", f"environment.movers={drone}")
    assert "drone 15 m/s: NOT COVERED, needs" in found.out
    plain = clearway("contract", "show", "--contract", config / "default_contract.yaml").out
    assert "movers (required" not in plain
