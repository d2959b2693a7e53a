"""sensor_msgs/PointCloud2: points packed in any layout of fields, as one array."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from onboard.perception.ros2.cdr import CdrReader, DecodeError
from onboard.perception.ros2.messages import Header, read_header

POINTS_MAX: Final = 1_000_000
_FIELDS_MAX: Final = 64
_FIELD_BYTES: Final = 13
_STEP_MAX: Final = 1024
# sensor_msgs/PointField: coordinates are FLOAT32 or FLOAT64.
_FLOATS: Final = {7: ("f4", 4), 8: ("f8", 8)}
_AXES: Final = ("x", "y", "z")


class PointCloud(NamedTuple):
    """Points in the sensor's frame.

    Attributes:
        header: stamp and frame.
        points_m: (3, points) in single precision, x, y and z one after another; NaN where the
            sensor measured nothing.
    """

    header: Header
    points_m: NDArray[np.float32]


class _Field(NamedTuple):
    name: str
    offset: int
    datatype: int
    elements: int


def decode_point_cloud(payload: bytes) -> PointCloud:
    """Decode sensor_msgs/PointCloud2.

    Raises:
        DecodeError: it is not one, or has no coordinates.
    """
    reader = CdrReader(payload)
    header = read_header(reader)
    height, width = reader.u32(), reader.u32()
    count = reader.count(_FIELD_BYTES, _FIELDS_MAX, "fields")
    fields = [_Field(reader.text(), reader.u32(), reader.u8(), reader.u32()) for _ in range(count)]
    order = ">" if reader.flag() else "<"
    step, row_step = reader.u32(), reader.u32()
    data = reader.blob()
    reader.flag()  # whether all points are finite: they are checked in any case
    reader.end()
    if height * width > POINTS_MAX:
        raise DecodeError("number of points")
    if not 0 < step <= _STEP_MAX or row_step < width * step or row_step * height != len(data):
        raise DecodeError("steps do not fit the data")
    layout = _layout(fields, order, step)
    points_m = np.empty((3, height * width), np.float32)
    rows = points_m.reshape(3, height, width)
    if rows.size:
        packed = np.ndarray((height, width), layout, data, strides=(row_step, step))
        # What single precision cannot hold is far away; NaN may be a signalling one.
        with np.errstate(over="ignore", invalid="ignore"):
            for axis, name in enumerate(_AXES):
                rows[axis] = packed[name]
    return PointCloud(header, points_m)


def _layout(fields: list[_Field], order: str, step: int) -> np.dtype[np.void]:
    formats, offsets = [], []
    for name in _AXES:
        found = [field for field in fields if field.name == name]
        if len(found) != 1:
            raise DecodeError("no coordinates")
        (field,) = found
        if field.datatype not in _FLOATS or field.elements != 1:
            raise DecodeError("type of the coordinates")
        kind, size = _FLOATS[field.datatype]
        if field.offset + size > step:
            raise DecodeError("coordinates beyond their point")
        formats.append(f"{order}{kind}")
        offsets.append(field.offset)
    return np.dtype(
        {"names": list(_AXES), "formats": formats, "offsets": offsets, "itemsize": step}
    )
