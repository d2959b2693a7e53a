"""Stem maps, as surveyors and their spreadsheets write them."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.files.stem_map import DIAMETER_MAX_CM, DISTANCE_MAX_M, Stem, read_stems
from onboard.files.yaml_file import FileError


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("stems") / "stems.csv"


def stems(path: Path, text: str) -> list[Stem]:
    path.write_text(text, encoding="utf-8")
    return read_stems(path)


def problem_of(path: Path, text: str) -> str:
    with pytest.raises(FileError) as caught:
        stems(path, text)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    return message.removeprefix(f"{path}: ")


def test_rows_become_stems_named_after_their_row(path: Path) -> None:
    assert stems(path, "x_m,y_m,dbh_cm\n1,2,30\n-4.5,0,12.5\n") == [
        Stem("2", 1.0, 2.0, 0.3),
        Stem("3", -4.5, 0.0, 0.125),
    ]


def test_columns_may_come_in_any_order_among_others(path: Path) -> None:
    text = "species,dbh_cm, y_m ,x_m,note\noak,30,2,1,\nfir,20,4,3,dead\n"
    assert stems(path, text) == [Stem("2", 1.0, 2.0, 0.3), Stem("3", 3.0, 4.0, 0.2)]


@pytest.mark.parametrize("delimiter", [";", "\t"])
def test_other_delimiters_allow_decimal_commas(path: Path, delimiter: str) -> None:
    text = "x_m,y_m,dbh_cm\n1.5,2,30\n".replace(",", delimiter).replace(".", ",")
    assert stems(path, text) == [Stem("2", 1.5, 2.0, 0.3)]


def test_quotes_crlf_and_empty_rows(path: Path) -> None:
    text = '"x_m","y_m","dbh_cm"\r\n\r\n"1","2","30"\r\n,,\r\n  ,,\r\n'
    assert stems(path, text) == [Stem("3", 1.0, 2.0, 0.3)]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "header is ''"),
        ("x_m,y_m\n1,2\n", "header is 'x_m,y_m', which has 0 columns dbh_cm"),
        ("x_m,x_m,y_m,dbh_cm\n1,1,2,3\n", "which has 2 columns x_m"),
        ("x_m,y_m,dbh_cm\n", "a field needs at least one obstacle"),
        ("x_m,y_m,dbh_cm\n,,\n", "a field needs at least one obstacle"),
        ("x_m,y_m,dbh_cm\n1,2\n", "row 2: has 2 cells, the header 3"),
        ("x_m,y_m,dbh_cm\n1,5,2,0,30\n", "(for decimal commas, separate cells by semicolons)"),
        ("x_m,y_m,dbh_cm\n1,2,\n", "row 2: dbh_cm [cm] = '' is not a finite number"),
        ("x_m,y_m,dbh_cm\n1,2,thick\n", "dbh_cm [cm] = 'thick' is not a finite number"),
        ("x_m,y_m,dbh_cm\n1,2,nan\n", "dbh_cm [cm] = 'nan' is not a finite number"),
        ("x_m,y_m,dbh_cm\n1,2,1_0\n", "dbh_cm [cm] = '1_0' is not a finite number"),
        ("x_m,y_m,dbh_cm\n1,٢,10\n", "y_m [m] = '٢' is not a finite number"),
        ("x_m,y_m,dbh_cm\n1,2,0\n", "dbh_cm [cm] = 0 must be greater than 0 and at most 2000"),
        ("x_m,y_m,dbh_cm\n1,2,-3\n", "dbh_cm [cm] = -3 must be greater than 0"),
        ("x_m,y_m,dbh_cm\n1,2,2001\n", "dbh_cm [cm] = 2001 must be greater than 0 and at most"),
        ("x_m,y_m,dbh_cm\n1,5800000,30\n", "row 2: y_m [m] = 5800000 is 5,800 km from the"),
        ('x_m,y_m,dbh_cm\n1,2,"3\n', "is not CSV"),
        ("x_m,y_m,dbh_cm\n1,2,3\n4,5,six\n", "row 3: dbh_cm"),
    ],
)
def test_a_problem_names_row_column_and_value(path: Path, text: str, problem: str) -> None:
    assert problem in problem_of(path, text)


def test_a_long_header_is_shortened(path: Path) -> None:
    message = problem_of(path, ",".join(f"column{n}" for n in range(100)) + "\n")
    assert "..." in message
    assert len(message) < 280


def test_a_comma_is_not_decimal_beside_a_point(path: Path) -> None:
    assert "x_m [m] = '1,234.5'" in problem_of(path, "x_m;y_m;dbh_cm\n1,234.5;0;30\n")


@given(
    st.lists(
        st.tuples(
            st.floats(-DISTANCE_MAX_M, DISTANCE_MAX_M),
            st.floats(-DISTANCE_MAX_M, DISTANCE_MAX_M),
            st.floats(0.1, DIAMETER_MAX_CM),
        ),
        min_size=1,
        max_size=8,
    )
)
def test_every_number_in_bounds_is_read_exactly(
    path: Path, rows: list[tuple[float, float, float]]
) -> None:
    text = "x_m,y_m,dbh_cm\n" + "".join(f"{x!r},{y!r},{d!r}\n" for x, y, d in rows)
    found = stems(path, text)
    assert [(s.north_m, s.east_m) for s in found] == [(x, y) for x, y, _ in rows]
    assert [s.diameter_m for s in found] == [d / 100.0 for _, _, d in rows]
    assert [s.name for s in found] == [str(n) for n in range(2, len(rows) + 2)]
