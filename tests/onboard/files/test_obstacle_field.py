from __future__ import annotations

from pathlib import Path

import pytest

from onboard.files.obstacle_field import ObstacleList, load_field
from onboard.files.yaml_file import FileError


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
        ("f.csv", "x,y,d\n1,2,3\n", "header is 'x,y,d', which has 0 columns x_m; expected x_m ("),
        ("f.csv", "x_m,y_m\n1,2\n", "0 columns dbh_cm; expected x_m (metres north), y_m (metres e"),
        ("f.csv", "x_m,y_m,x_m,dbh_cm\n1,2,3,4\n", "has 2 columns x_m"),
        ("f.csv", "easting,northing,DBH\n1,2,3\n", "from the mission's origin"),
        ("f.csv", "1.0,2.0,30.0\n", "header is '1.0,2.0,30.0'"),
        ("f.csv", "x_m,y_m,dbh_cm\n", "at least one obstacle"),
        ("f.csv", "x_m,y_m,dbh_cm\n1,2,30\n1,nan,30\n", "row 3: y_m [m] = 'nan'"),
        ("f.csv", "x_m,y_m,dbh_cm\n1,2,-30\n", "row 2: dbh_cm [cm] = -30"),
        ("f.csv", "x_m,y_m,dbh_cm\n1,2\n", "row 2: has 2 cells, the header 3"),
        ("f.csv", "x_m,y_m,dbh_cm\n1,2,3,4\n", "row 2: has 4 cells, the header 3"),
        ("f.csv", "x_m,y_m,dbh_cm\n6,71,7,44,60,0\n", "separate cells by semicolons"),
        ("f.csv", "x_m,y_m,dbh_cm\n1,,30\n", "row 2: y_m [m] = ''"),
        ("f.csv", "x_m,y_m,dbh_cm\n1,2,0\n", "row 2: dbh_cm [cm] = 0 must be greater than 0"),
        ("f.csv", "x_m,y_m,dbh_cm\n1,2,3e4\n", "dbh_cm [cm] = 30000 must be greater than 0 and at"),
        ("f.csv", "x_m,y_m,dbh_cm\n1,inf,30\n", "row 2: y_m [m] = 'inf'"),
        ("f.csv", "x_m,y_m,dbh_cm\n1_0,2,30\n", "row 2: x_m [m] = '1_0'"),
        ("f.csv", "x_m;y_m;dbh_cm\n1.234,5;2;30\n", "row 2: x_m [m] = '1.234,5'"),
        ("f.csv", 'x_m,y_m,dbh_cm\n"1"x,2,30\n', "row 2: is not CSV"),
        ("f.csv", 'x_m,y_m,dbh_cm\n"1,2,30\n', "is not CSV"),
        ("f.csv", "x_m,y_m,dbh_cm\n1,2\0,30\n", "row 2"),
        (
            "f.csv",
            "x_m,y_m,dbh_cm\n4308505.04,747389.68,53.4\n",
            "4308505.04 is 4,309 km from",
        ),
        (
            "f.csv",
            "x_m,y_m,dbh_cm\n1,-747389.68,53.4\n",
            "clearway mission stems converts UTM",
        ),
        ("f.csv", b"\xff\xfex\x00", "is not UTF-8"),
        ("f.csv", b"PK\x03\x04\x14\x00\x00\x00", "header is"),
        ("f.yaml", "- {id: a, center_ned_m: [4308505.0, 1.0], size_m: [1, 1]}", "4308505.0"),
        ("f.csv", "x_m,y_m,dbh_cm\none,2,3\n", "row 2: x_m [m] = 'one'"),
    ],
)
def test_bad_fields_are_named(tmp_path: Path, name: str, text: str | bytes, expected: str) -> None:
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(FileError) as caught:
        load_field(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert expected in message
    assert "\n" not in message


@pytest.mark.parametrize(
    "text",
    [
        "x_m,y_m,dbh_cm\n6.71,7.44,60.0\n-1,2,50\n",
        "\ufeffx_m,y_m,dbh_cm\r\n6.71,7.44,60.0\r\n-1,2,50\r\n",
        "x_m;y_m;dbh_cm\n6,71;7,44;60,0\n-1;2;50\n",
        "x_m;y_m;dbh_cm\n6.71;7.44;60.0\n-1;2;50\n",
        "x_m\ty_m\tdbh_cm\n6,71\t7.44\t60\n-1\t2\t50\n",
        '"x_m","y_m","dbh_cm"\n"6.71","7.44","60.0"\n"-1","2","50"\n',
        '"x_m";"y_m";"dbh_cm"\n"6,71";"7,44";"60,0"\n"-1";"2";"50"\n',
        " x_m , y_m , dbh_cm\n 6.71 , 7.44 , 6e1\n-1,+2,50",
        "tree,dbh_cm,y_m,x_m,species\nA1,60,7.44,6.71,Picea\nA2,50,2,-1,\n",
    ],
)
def test_csv_as_spreadsheets_write_it(tmp_path: Path, text: str) -> None:
    path = tmp_path / "stems.csv"
    path.write_bytes(text.encode())
    field = load_field(path)
    assert field.ids == ("2", "3")
    assert field.center_ned_m.tolist() == [[6.71, 7.44], [-1.0, 2.0]]
    assert field.half_size_m.tolist() == [[0.3, 0.3], [0.25, 0.25]]


def test_empty_rows_count_but_are_no_trees(tmp_path: Path) -> None:
    path = written(tmp_path, "stems.csv", "x_m,y_m,dbh_cm\n1,2,30\n\n,,\n3,4,30\n,,\n")
    assert load_field(path).ids == ("2", "5")


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
        "down_m",
    }
