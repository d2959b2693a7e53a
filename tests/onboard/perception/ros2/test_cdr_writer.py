"""What is written is read again, with the alignment of the standard."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.perception.ros2.cdr import CdrReader
from onboard.perception.ros2.cdr_writer import CdrWriter


def test_values_are_aligned_from_behind_the_header() -> None:
    data = CdrWriter().u8(7).f64(1.5).u8(1).u32(9).text("ab").i32(-3).f32(0.5).payload()
    reader = CdrReader(data)
    assert (reader.u8(), reader.f64(), reader.u8(), reader.u32()) == (7, 1.5, 1, 9)
    assert (reader.text(), reader.i32(), reader.f32()) == ("ab", -3, 0.5)
    reader.end()
    assert len(data) == 4 + 8 + 8 + 1 + 3 + 4 + 4 + 3 + 1 + 4 + 4


@given(
    st.lists(st.floats(allow_nan=False)), st.text(max_size=40).filter(lambda text: "\0" not in text)
)
def test_anything_comes_back(numbers: list[float], text: str) -> None:
    reader = CdrReader(CdrWriter().text(text).u32(len(numbers)).f64(*numbers).payload())
    assert reader.text() == text
    assert reader.f64s(reader.u32()) == pytest.approx(tuple(numbers))
    reader.end()
