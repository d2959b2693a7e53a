"""``clearway contract surface``: every point of a surface is the contract at that point."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread

from gcs_tools.console.errors import CommandError
from gcs_tools.contract.keys import contract_key
from gcs_tools.contract.solve import solve
from gcs_tools.contract.surface import FIGURES, FigureNumber, SurfaceRequest, request_surface
from gcs_tools.contract.surface_grid import Axis, Surface, evaluate
from onboard.contract.arithmetic import SCALAR
from onboard.contract.assessment import assess, clauses, derive
from onboard.files.contract_file import InputSet, load_contract
from tests.gcs_tools.running import CONFIG, CONTRACTS, Clearway

EXAMPLE_PATH = CONTRACTS / "precise_vehicle.yaml"
EXAMPLE = load_contract(EXAMPLE_PATH)
SPEEDS = "vehicle.cruise_speed_mps=0.5:6:23"
RANGES = "sensor.detection_range_m=3:20:18"
BLIND_AT_4_M = "sensor.detection_range_m=4"


def surface_of(x: str, y: str, quantity: str, **options: Any) -> Surface:
    return evaluate(EXAMPLE, Axis.parse(x), Axis.parse(y), quantity, **options)


@pytest.mark.parametrize("input_set", ["inner", "paper"])
@pytest.mark.parametrize(
    ("x", "y"),
    [
        (SPEEDS, RANGES),
        ("vehicle.roll_max_deg+vehicle.pitch_max_deg=3:40:12", SPEEDS),
        ("vehicle.velocity_error_mps.0=0:1:7", "vehicle.velocity_error_mps.1=0:4:9"),
        ("vehicle.setpoint_loss_run_on_m=0.1:8:8", "environment.obstacle_size_max_m=0.1:9:7"),
        ("sensor.field_of_view_deg=5:360:9", "vehicle.thrust_to_weight=1.01:3:5"),
    ],
)
def test_every_point_is_the_contract_there(x: str, y: str, input_set: InputSet) -> None:
    surfaces = [
        surface_of(x, y, quantity, input_set=input_set)
        for quantity in ("required_separation_m", "edge_visibility", "margin")
    ]
    for row, y_value in enumerate(surfaces[0].y.values):
        for column, x_value in enumerate(surfaces[0].x.values):
            contract = EXAMPLE
            for axis, value in ((surfaces[0].x, x_value), (surfaces[0].y, y_value)):
                for key in axis.keys:
                    contract = key.changed(contract, float(value))
            expected = assess(contract, input_set)
            required = {clause.name: clause for clause in expected.clauses}
            separation, edge, margin = (surface.values[row, column] for surface in surfaces)
            assert separation == pytest.approx(expected.inflated.required_separation_m)
            assert edge == pytest.approx(required["edge_visibility"].required)
            assert margin == pytest.approx(expected.binding.margin / expected.binding.declared)
            assert surfaces[1].safe[row, column] == required["edge_visibility"].holds
            for surface in surfaces:
                assert surface.compliant[row, column] == expected.compliant
            assert surfaces[0].safe[row, column] == expected.compliant


def test_many_blocks_are_one_surface() -> None:
    fine = surface_of("vehicle.cruise_speed_mps=1:5:801", "vehicle.radius_m=0:1:101", "separation")
    coarse = surface_of("vehicle.cruise_speed_mps=1:5:5", "vehicle.radius_m=0:1:11", "separation")
    np.testing.assert_array_equal(fine.values[::10, ::200], coarse.values)
    np.testing.assert_array_equal(fine.compliant[::10, ::200], coarse.compliant)


def test_a_surface_changes_side_where_solve_says() -> None:
    surface = surface_of(
        "vehicle.cruise_speed_mps=4.8:5.1:3001", "sensor.detection_range_m=12:13:2", "margin"
    )
    limit = solve(EXAMPLE, "vehicle.cruise_speed_mps").limit
    assert limit is not None
    fastest_mps = surface.x.values[surface.compliant[0]].max()
    assert fastest_mps <= limit.value < fastest_mps + 1.01e-4


def test_nominal_reading_is_the_ideal_vehicle() -> None:
    surface = surface_of(SPEEDS, RANGES, "collision_set_depth_m", reading="nominal")
    for column, speed_mps in enumerate(surface.x.values):
        contract = contract_key("vehicle.cruise_speed_mps").changed(EXAMPLE, float(speed_mps))
        nominal = assess(contract).nominal
        assert surface.values[3, column] == pytest.approx(nominal.region.collision_set_depth_m)


def test_declared_is_known_only_where_it_is_one_number() -> None:
    assert surface_of(SPEEDS, "vehicle.radius_m=0:1:3", "detection_range").declared == 12.0
    assert surface_of(SPEEDS, RANGES, "detection_range").declared is None
    assert surface_of(SPEEDS, RANGES, "margin").declared is None


# --- figures of the paper


@pytest.mark.parametrize("figure", FIGURES)
def test_figures_are_what_their_captions_say(figure: FigureNumber) -> None:
    surface = request_surface(
        EXAMPLE_PATH,
        SurfaceRequest(figure=figure, reading="nominal"),
        overrides=(),
        input_set="inner",
    )
    column, row = 60, 40
    speed_mps, y_value = float(surface.x.values[column]), float(surface.y.values[row])
    size_m, angle_deg = (y_value, 15.0) if figure == "12" else (4.0, y_value)
    overrides = (
        f"vehicle.cruise_speed_mps={speed_mps}",
        f"vehicle.roll_max_deg={angle_deg}",
        f"vehicle.pitch_max_deg={angle_deg}",
        f"environment.obstacle_size_max_m={size_m}",
        f"environment.obstacle_size_min_m={0.0 if figure == '12' else 4.0}",
    )
    assessment = assess(load_contract(EXAMPLE_PATH, overrides))
    terms = assessment.terms.idealised()
    required = {
        clause.name: clause.required for clause in clauses(terms, derive(terms, SCALAR), SCALAR)
    }
    name = "detection_range" if figure == "11" else "separation"
    assert surface.quantity.name == name
    assert surface.values[row, column] == pytest.approx(required[name])


def test_fig_11_falls_with_agility_and_rises_with_speed() -> None:
    surface = request_surface(EXAMPLE_PATH, SurfaceRequest(), overrides=(), input_set="paper")
    assert (np.diff(surface.values, axis=0) < 0.0).all()
    assert (np.diff(surface.values, axis=1) > 0.0).all()


@pytest.mark.parametrize("figure", FIGURES)
def test_a_figure_includes_all_errors_unless_it_is_asked_not_to(figure: FigureNumber) -> None:
    surface = request_surface(
        EXAMPLE_PATH, SurfaceRequest(figure=figure), overrides=(), input_set="inner"
    )
    assert surface.reading == "inflated"
    bare = request_surface(
        EXAMPLE_PATH,
        SurfaceRequest(figure=figure, reading="nominal"),
        overrides=(),
        input_set="inner",
    )
    assert (surface.values > bare.values).all()


def test_the_contract_s_own_point_is_marked() -> None:
    path = CONFIG / "paper_contract.yaml"
    request = SurfaceRequest(x=SPEEDS, y=RANGES)
    surface = request_surface(path, request, overrides=(), input_set="inner")
    stated = load_contract(path)
    assert surface.own == (stated.vehicle.cruise_speed_mps, stated.sensor.detection_range_m)
    assert surface.own_safe is assess(stated).compliant is True
    blind = request_surface(path, request, overrides=(BLIND_AT_4_M,), input_set="inner")
    assert blind.own == (stated.vehicle.cruise_speed_mps, 4.0)
    assert blind.own_safe is False
    far = request_surface(
        path, request, overrides=("sensor.detection_range_m=90",), input_set="inner"
    )
    assert far.own_safe is None
    # Roll and pitch that differ are no single point of an axis that drives both.
    both = request_surface(
        path, SurfaceRequest("11"), overrides=("vehicle.roll_max_deg=11",), input_set="inner"
    )
    assert both.own is None


def test_a_figure_ends_where_the_run_after_a_loss_was_measured() -> None:
    stated = ("vehicle.setpoint_loss_run_on_m=3.0", "vehicle.setpoint_loss_run_on_speed_mps=4.0")
    surface = request_surface(
        EXAMPLE_PATH, SurfaceRequest("13"), overrides=stated, input_set="inner"
    )
    assert surface.x.values[-1] == 4.0
    assert len(surface.x.values) == 151


@pytest.mark.parametrize("figure", ["12", "13"])
def test_fig_12_and_13_rise_with_speed(figure: FigureNumber) -> None:
    surface = request_surface(
        EXAMPLE_PATH, SurfaceRequest(figure=figure), overrides=(), input_set="inner"
    )
    assert (np.diff(surface.values, axis=1) > 0.0).all()


def test_what_is_set_outranks_the_figure() -> None:
    request = SurfaceRequest(figure="12", reading="inflated", quantity="roi_length_m")
    surface = request_surface(
        EXAMPLE_PATH, request, overrides=("vehicle.pitch_max_deg=25",), input_set="inner"
    )
    overrides = (
        "vehicle.pitch_max_deg=25",
        f"vehicle.cruise_speed_mps={surface.x.values[5]}",
        f"environment.obstacle_size_max_m={surface.y.values[7]}",
    )
    expected = assess(load_contract(EXAMPLE_PATH, overrides)).inflated
    assert surface.values[7, 5] == pytest.approx(expected.roi_length_m)


# --- command


@pytest.fixture
def draw(clearway: Clearway) -> Any:
    def run(*options: object) -> Any:
        return clearway("contract", "surface", "--contract", EXAMPLE_PATH, *options)

    return run


def test_json(draw: Any, tmp_path: Path) -> None:
    output = tmp_path / "surface.json"
    assert draw("--x", SPEEDS, "--y", RANGES, "--format", "json", "-o", output).code == 0
    document = json.loads(output.read_text(encoding="utf-8"))
    surface = surface_of(SPEEDS, RANGES, "margin")
    assert document["x"]["keys"] == ["vehicle.cruise_speed_mps"]
    assert document["x"]["unit"] == "m/s"
    np.testing.assert_array_equal(document["y"]["values"], surface.y.values)
    np.testing.assert_array_equal(document["z"]["values"], surface.values)
    np.testing.assert_array_equal(document["compliant"], surface.compliant)
    assert (document["reading"], document["input_set"]) == ("inflated", "inner")
    assert document["own"] == {
        "x": EXAMPLE.vehicle.cruise_speed_mps,
        "y": EXAMPLE.sensor.detection_range_m,
        "safe": assess(EXAMPLE).compliant,
    }


def test_csv(draw: Any) -> None:
    ran = draw("--x", SPEEDS, "--y", RANGES, "--z", "separation", "--format", "csv")
    rows = list(csv.DictReader(io.StringIO(ran.out)))
    surface = surface_of(SPEEDS, RANGES, "separation")
    assert len(rows) == surface.values.size
    row = rows[2 * len(surface.x.values) + 3]
    assert float(row["vehicle.cruise_speed_mps"]) == surface.x.values[3]
    assert float(row["sensor.detection_range_m"]) == surface.y.values[2]
    assert float(row["separation"]) == surface.values[2, 3]
    assert int(row["compliant"]) == surface.compliant[2, 3]


def test_table(draw: Any) -> None:
    ran = draw("--figure", "13")
    assert ran.code == 0
    for part in (
        "[m]",
        "[m/s]",
        "[°]",
        "inflated",
        "own point, vehicle.cruise_speed_mps",
        "separation holds",
        "comply with every clause",
    ):
        assert part in ran.out


SLOW, THIN = "vehicle.cruise_speed_mps=0.5:1:5", "vehicle.radius_m=0:0.1:5"
BLIND = "sensor.detection_range_m=1"


@pytest.mark.parametrize(
    ("options", "has_unsafe_side"),
    [
        (("--figure", "11"), True),
        (("--x", SPEEDS, "--y", RANGES), True),
        (("--x", SPEEDS, "--y", THIN, "--set", BLIND), True),
        (("--x", SLOW, "--y", THIN), False),
    ],
    ids=["figure", "margin", "nothing safe", "everything safe"],
)
def test_picture(
    draw: Any, tmp_path: Path, options: tuple[str, ...], has_unsafe_side: bool
) -> None:
    path = tmp_path / "surface.png"
    assert draw(*options, "--plot", path).code == 0
    pixels = imread(path)[..., :3]
    height, width = pixels.shape[:2]
    assert (height, width) > (700, 1500)
    # The unsafe side is hatched in red; the legend is in the upper half.
    panel = pixels[height // 2 :, : width // 2]
    red = (panel[..., 0] > 0.7) & (panel[..., 1] < 0.25) & (panel[..., 2] < 0.25)
    assert (red.sum() > 500) == has_unsafe_side


def test_figures_of_the_point_mass_do_not_ask_for_the_speed_of_a_run(draw: Any) -> None:
    options = ("--set", "vehicle.setpoint_loss_run_on_m=3.0", "--format", "json")
    bare, stated = (
        json.loads(draw("--figure", "13", "--reading", "nominal", *each).out)
        for each in (options[2:], options)
    )
    assert bare["z"] == stated["z"]


def test_wind_and_heading_are_axes_like_any_other() -> None:
    wind, heading = (
        Axis.parse(text)
        for text in ("environment.wind_max_mps=0.5:8:7", "vehicle.heading_error_deg=0:20:5")
    )
    contract = load_contract(EXAMPLE_PATH, ("environment.wind_max_mps=1.0",))
    surface = evaluate(contract, wind, heading, "wind")
    assert surface.quantity.unit == "m/s²"
    for row, heading_deg in enumerate(heading.values.tolist()):
        for column, wind_mps in enumerate(wind.values.tolist()):
            changed = contract_key("environment.wind_max_mps").changed(contract, wind_mps)
            changed = contract_key("vehicle.heading_error_deg").changed(changed, heading_deg)
            expected = assess(changed)
            assert surface.values[row, column] == pytest.approx(0.45 * wind_mps)
            assert bool(surface.compliant[row, column]) is expected.compliant


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        (("--x", SPEEDS), "give both --x and --y"),
        (
            ("--x", "vehicle.speed=1:2:3", "--y", RANGES),
            "unknown numeric contract key 'vehicle.speed'; did you mean vehicle.cru",
        ),
        (("--x", "vehicle.cruise_speed_mps=1:2", "--y", RANGES), "expected KEY=LO:HI:N"),
        (("--x", "vehicle.cruise_speed_mps=2:1:5", "--y", RANGES), "expected LO less than HI"),
        (("--x", "vehicle.cruise_speed_mps=1:2:1", "--y", RANGES), "N at least 2"),
        (("--x", "vehicle.cruise_speed_mps=1:nan:5", "--y", RANGES), "expected LO less"),
        (("--x", "vehicle.cruise_speed_mps=0:2:5", "--y", RANGES), "greater than 0"),
        (("--x", "vehicle.roll_max_deg=5:90:5", "--y", RANGES), "less than 90"),
        (("--x", SPEEDS, "--y", SPEEDS), "cannot be on both axes"),
        (("--x", "vehicle.roll_max_deg+vehicle.radius_m=1:2:3", "--y", RANGES), "same unit"),
        (
            ("--x", SPEEDS, "--y", RANGES, "--z", "speed"),
            "unknown quantity 'speed'; expected one of margin",
        ),
        (("--x", "vehicle.radius_m=0:1:9000", "--y", "sensor.detection_range_m=1:2:9000"), "25,0"),
        (
            ("--x", SPEEDS, "--y", RANGES, "--z", "stop", "--set", "requirements.stop=false"),
            "unknown quantity 'stop'",
        ),
        (
            (
                *("--x", SPEEDS, "--y", RANGES, "--set", "vehicle.setpoint_loss_run_on_m=3"),
                "vehicle.cruise_speed_mps=2.0",
            ),
            "exceeds vehicle.setpoint_loss_run_on_speed_mps = 2.8 m/s",
        ),
        (("--figure", "11", "--plot", "/nowhere/at/all.png"), "cannot be written"),
        (("--figure", "11", "--plot", "surface.tale"), "tale"),
        (("--figure", "11", "-o", "/nowhere/at/all.csv"), "cannot be written"),
    ],
)
def test_bad_requests_are_refused(draw: Any, options: tuple[str, ...], problem: str) -> None:
    ran = draw(*options)
    assert ran.code == 2
    assert problem in ran.err
    assert ran.err.count("\n") == 1


def test_an_unknown_axis_is_named() -> None:
    with pytest.raises(CommandError, match="unknown numeric contract key"):
        Axis.parse("requirements.stop=0:1:2")
