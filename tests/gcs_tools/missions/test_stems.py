"""Stem maps of surveyors as obstacle fields."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from onboard.files.obstacle_field import load_field
from tests.gcs_tools.geodesy.test_utm import PLACES
from tests.gcs_tools.running import CONFIG, Clearway

GEOGRAPHIC = ("--latitude", "lat", "--longitude", "lon", "--origin", "47.397742,8.545594")
UTM = ("--north", "N", "--east", "E", "--utm", "32N", "--origin", "47.397742,8.545594")
STEP_M = math.radians(1e-3) * 6_371_000.0


def converted(
    clearway: Clearway, tmp_path: Path, text: str, *options: str
) -> list[tuple[float, float, float]]:
    """Convert a file and read the result as the pre-flight check does."""
    source, output = tmp_path / "trees.csv", tmp_path / "field.csv"
    source.write_text(text, encoding="utf-8")
    ran = clearway("mission", "stems", source, "-o", output, *options)
    assert ran.code == 0, ran
    assert "stems" in ran.out
    field = load_field(output)
    return [
        (*center, 2.0 * half)
        for center, half in zip(field.center_ned_m.tolist(), field.half_size_m[:, 0], strict=True)
    ]


def test_columns_are_renamed_and_delimiters_found(clearway: Clearway, tmp_path: Path) -> None:
    text = "species;Nord;Ost;BHD\noak;1,5;-2;30\n"
    options = ("--north", "Nord", "--east", "Ost", "--diameter", "BHD")
    ((*place_m, diameter_m),) = converted(clearway, tmp_path, text, *options)
    assert place_m == [1.5, -2.0]
    assert diameter_m == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("unit", "written", "diameter_m"),
    [
        ("cm", 30, 0.3),
        ("mm", 300, 0.3),
        ("m", 0.3, 0.3),
        ("in", 12, 0.3048),
        ("girth-cm", 100, 1 / math.pi),
    ],
)
def test_units_of_the_diameter(
    clearway: Clearway, tmp_path: Path, unit: str, written: float, diameter_m: float
) -> None:
    text = f"x_m,y_m,dbh_cm\n1,2,{written}\n"
    ((_, _, found_m),) = converted(clearway, tmp_path, text, "--diameter-unit", unit)
    assert diameter_m - 1e-9 <= found_m < diameter_m + 1.01e-4  # never rounded down


@pytest.mark.parametrize(("name", "character"), [("tab", "\t"), ("space", " "), ("comma", ",")])
def test_delimiters_by_name(clearway: Clearway, tmp_path: Path, name: str, character: str) -> None:
    text = "x_m,y_m,dbh_cm\n1,2,30\n".replace(",", character)
    assert converted(clearway, tmp_path, text, "--delimiter", name)[0][:2] == (1.0, 2.0)


def test_latitude_and_longitude(clearway: Clearway, tmp_path: Path) -> None:
    text = "lat,lon,dbh_cm\n47.398742,8.545594,30\n47.397742,8.546594,30\n"
    first, second = converted(clearway, tmp_path, text, *GEOGRAPHIC)
    east_m = STEP_M * math.cos(math.radians(47.397742))
    assert first[:2] == pytest.approx((STEP_M, 0.0), abs=2e-3)
    assert second[:2] == pytest.approx((0.0, east_m), abs=2e-3)
    first, _ = converted(clearway, tmp_path, text, *GEOGRAPHIC, "--vehicle", "ardupilot")
    assert first[0] == pytest.approx(STEP_M * 6_378_100.0 / 6_371_000.0, abs=2e-3)


def test_utm_is_turned_to_true_north_and_to_the_autopilots_metres(
    clearway: Clearway, tmp_path: Path
) -> None:
    """The first reference place is the origin itself; grid north is turned by 0.33° there."""
    zone, *_, easting_m, northing_m = PLACES[0]
    assert zone == "32N"
    text = f"E,N,dbh_cm\n{easting_m},{northing_m},30\n{easting_m},{northing_m + 1000.0},30\n"
    origin, north = converted(clearway, tmp_path, text, *UTM)
    assert origin[:2] == pytest.approx((0.0, 0.0), abs=1e-3)
    convergence_rad = math.atan2(north[1], north[0])
    meridian_deg = 8.545594 - 9.0
    expected_rad = math.radians(meridian_deg) * math.sin(math.radians(47.397742))
    assert convergence_rad == pytest.approx(expected_rad, abs=2e-5)
    assert math.hypot(*north[:2]) == pytest.approx(1000.0, abs=3.0)  # sphere, scale


@pytest.mark.parametrize("longitude_deg", [179.9999, -179.9999])
def test_a_forest_lies_on_both_sides_of_the_antimeridian(
    clearway: Clearway, tmp_path: Path, longitude_deg: float
) -> None:
    text = "lat;lon;dbh_cm\n-17,0;179,9999;30\n-17,0;-179,9999;42\n"
    options = ("--latitude", "lat", "--longitude", "lon", f"--origin=-17.0,{longitude_deg}")
    west, east = converted(clearway, tmp_path, text, *options)
    apart_m = math.radians(0.0002) * 6_371_000.0 * math.cos(math.radians(17.0))
    assert east[1] - west[1] == pytest.approx(apart_m, abs=0.02)
    assert min(abs(west[1]), abs(east[1])) == pytest.approx(0.0, abs=1e-3)


def test_the_field_goes_to_standard_output(clearway: Clearway, tmp_path: Path) -> None:
    source = tmp_path / "trees.csv"
    source.write_text("x_m,y_m,dbh_cm\n1,2,30\n", encoding="utf-8")
    ran = clearway("mission", "stems", source)
    assert (ran.code, ran.out) == (0, "x_m,y_m,dbh_cm\n1.000,2.000,30.00\n")
    assert ran.err.startswith("1 stems, 1.0 to 1.0 m north")


def test_a_converted_forest_passes_the_check_of_the_original(
    clearway: Clearway, tmp_path: Path
) -> None:
    original = CONFIG / "uniform_forest_field.csv"
    found = converted(clearway, tmp_path, original.read_text(encoding="utf-8"))
    field = load_field(original)
    assert [each[:2] for each in found] == [
        pytest.approx(center, abs=1e-3) for center in field.center_ned_m.tolist()
    ]


@pytest.mark.parametrize(
    ("text", "options", "words"),
    [
        ("a,b\n1,2\n", (), ("has 0 columns x_m", "expected x_m")),
        ("x_m,y_m,dbh_cm\n", (), ("at least one obstacle",)),
        ("x_m,y_m,dbh_cm\n1,2,0\n", (), ("row 2", "dbh_cm [cm] = 0")),
        ("x_m,y_m,dbh_cm\n1,2,30\n", ("--diameter-unit", "m"), ("[m] = 30 is 3000 cm",)),
        ("x_m,y_m,dbh_cm\n1,2,30\n", ("--origin", "47,8"), ("--origin needs --utm",)),
        ("x_m,y_m,dbh_cm\n5249465,465710,30\n", (), ("km from the mission's origin",)),
        ("x_m,y_m,dbh_cm\n1,2,30\n", ("--east", "x_m"), ("three different",)),
        ("x_m,y_m,dbh_cm\n1,2,30\n", ("--latitude", "x_m"), ("expected --north and --east",)),
        ("N,E,dbh_cm\n1,2,30\n", ("--utm", "32N"), ("expected --north and --east",)),
        ("N,E,dbh_cm\n1,2,30\n", UTM[:-2], ("need --origin",)),
        ("N,E,dbh_cm\n465710,5249465,30\n", UTM, ("row 2", "easting [m] = 5249465", "zone 32N")),
        ("N,E,dbh_cm\n5249465,465710,30\n", (*UTM[:5], "33N", *UTM[6:]), ("km from", "--utm")),
        ("lat,lon,dbh_cm\n97,8,30\n", GEOGRAPHIC, ("row 2", "latitude [°] = 97")),
        ("lat,lon,dbh_cm\n8.54,47.39,30\n", GEOGRAPHIC, ("km from", "--origin")),
        ("lat,lon,dbh_cm\n47,8,30\n", (*GEOGRAPHIC, "--utm", "32N"), ("--utm is for",)),
        ("x_m,y_m,dbh_cm\n1,2,30\n", ("--utm", "32T"), ("'32T' is not a UTM zone",)),
        ("x_m,y_m,dbh_cm\n1,2,30\n", ("--origin", "8.5"), ("'8.5' is not LAT,LON",)),
        ("x_m,y_m,dbh_cm\n1,2,30\n", ("--origin", "97,8"), ("latitude [°] = 97",)),
        ("x_m,y_m,dbh_cm\n1,2,30\n", ("--delimiter", "|"), ("--delimiter",)),
    ],
)
def test_a_mistake_is_one_line(
    clearway: Clearway, tmp_path: Path, text: str, options: tuple[str, ...], words: tuple[str, ...]
) -> None:
    source, output = tmp_path / "trees.csv", tmp_path / "field.csv"
    source.write_text(text, encoding="utf-8")
    ran = clearway("mission", "stems", source, "-o", output, *options)
    assert ran.code == 2, ran
    assert ran.err.count("\n") == 1
    for word in words:
        assert word in ran.err
    assert not output.exists()


def test_the_own_file_is_not_overwritten(clearway: Clearway, tmp_path: Path) -> None:
    source = tmp_path / "trees.csv"
    source.write_text("x_m,y_m,dbh_cm\n1,2,30\n", encoding="utf-8")
    ran = clearway("mission", "stems", source, "-o", source)
    assert ran.code == 2
    assert "would overwrite" in ran.err
