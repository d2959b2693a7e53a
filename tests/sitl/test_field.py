from __future__ import annotations

from pathlib import Path

import pytest

from onboard.yaml_file import FileError
from sitl.field import ObstacleList, load_field


def written(directory: Path, name: str, text: str) -> Path:
    path = directory / name
    path.write_text(text, encoding="utf-8")
    return path


def test_yaml_boxes(tmp_path: Path) -> None:
    field = load_field(
        written(
            tmp_path,
            "field.yaml",
            "- {id: oak, center_ned_m: [10, -2.5], size_m: [1, 2], yaw_deg: 90}\n"
            "- {id: 7, center_ned_m: [30.0, 0.0], size_m: [4.0, 4.0]}\n",
        )
    )
    assert field.ids == ("oak", "7")
    assert field.center_ned_m.tolist() == [[10.0, -2.5], [30.0, 0.0]]
    assert field.half_size_m.tolist() == [[0.5, 1.0], [2.0, 2.0]]
    assert field.yaw_rad == pytest.approx([1.5707963, 0.0])


def test_csv_stems_become_square_boxes(tmp_path: Path) -> None:
    field = load_field(written(tmp_path, "stems.csv", "x_m,y_m,dbh_cm\n200.0,8.8,32.9\n-1,2,50\n"))
    assert len(field) == 2
    assert field.center_ned_m.tolist() == [[200.0, 8.8], [-1.0, 2.0]]
    assert field.half_size_m[1].tolist() == [0.25, 0.25]
    assert len(set(field.ids)) == 2


BOX = "{id: a, center_ned_m: [1, 2], size_m: [1, 1]}"


@pytest.mark.parametrize(
    ("name", "text", "expected"),
    [
        ("f.yaml", "[]", "at least one obstacle"),
        ("f.yaml", "a: 1", "list"),
        ("f.yaml", f"[{BOX}, {BOX}]", "id 'a'"),
        ("f.yaml", "[{id: a, center_ned_m: [1, 2], size_m: [-1, 1]}]", "size_m.0 [m] = -1"),
        (
            "f.yaml",
            "[{id: a, center_ned_m: [.nan, 2], size_m: [1, 1]}]",
            "center_ned_m.0 [m] = nan",
        ),
        ("f.yaml", "[{id: a, center_ned_m: [1, 2], size_m: [1]}]", "size_m"),
        ("f.yaml", "[{id: a, center_ned_m: [1, 2], size_m: [1, 1], height: 3}]", "height"),
        ("f.yaml", "[{id: a, center_ned_m: [1, '2'], size_m: [1, 1]}]", "center_ned_m.1 [m] = '2'"),
        ("f.yaml", "[", "not valid YAML"),
        ("f.csv", "", "header"),
        ("f.csv", "x,y,d\n1,2,3\n", "header is 'x,y,d'"),
        ("f.csv", "x_m,y_m,dbh_cm\n", "at least one obstacle"),
        ("f.csv", "x_m,y_m,dbh_cm\n1,2,30\n1,nan,30\n", "row 3: y_m [m] = 'nan'"),
        ("f.csv", "x_m,y_m,dbh_cm\n1,2,-30\n", "row 2: dbh_cm [cm] = -30"),
        ("f.csv", "x_m,y_m,dbh_cm\n1,2\n", "row 2: dbh_cm [cm] = None"),
        ("f.csv", "x_m,y_m,dbh_cm\n1,2,3,4\n", "row 2"),
        ("f.csv", "x_m,y_m,dbh_cm\none,2,3\n", "row 2: x_m [m] = 'one'"),
    ],
)
def test_bad_fields_are_named(tmp_path: Path, name: str, text: str, expected: str) -> None:
    path = written(tmp_path, name, text)
    with pytest.raises(FileError) as caught:
        load_field(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert expected in message
    assert "\n" not in message


@pytest.mark.parametrize("name", ["missing.yaml", "missing.csv"])
def test_missing_file(tmp_path: Path, name: str) -> None:
    with pytest.raises(FileError, match=r"missing.*cannot be read"):
        load_field(tmp_path / name)


def test_schema_describes_the_keys() -> None:
    schema = ObstacleList.model_json_schema()
    assert set(schema["$defs"]["Obstacle"]["properties"]) == {
        "id",
        "center_ned_m",
        "size_m",
        "yaw_deg",
    }
