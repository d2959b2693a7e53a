"""A small CDR writer for tests: messages as a sensor's driver publishes them."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

STAMP = (1_790_000_000, 250_000_000)
FIELDS = (("x", 0, 7, 1), ("y", 4, 7, 1), ("z", 8, 7, 1))


class CdrWriter:
    """Appends values, aligned from behind the header."""

    def __init__(self, order: str = "<") -> None:
        self._order, self._data = order, bytearray()

    def add(self, kinds: str, *values: Any) -> CdrWriter:
        for kind, value in zip(kinds, values, strict=True):
            size = struct.calcsize(f"={kind}")
            self._data += bytes(-len(self._data) % size)
            self._data += struct.pack(f"{self._order}{kind}", value)
        return self

    def text(self, value: str) -> CdrWriter:
        data = value.encode() + b"\x00"
        self.add("I", len(data))
        self._data += data
        return self

    def raw(self, data: bytes) -> CdrWriter:
        self._data += data
        return self

    def header(self, stamp: tuple[int, int] = STAMP, frame_id: str = "laser") -> CdrWriter:
        return self.add("iI", *stamp).text(frame_id)

    def payload(self) -> bytes:
        return (b"\x00\x01" if self._order == "<" else b"\x00\x00") + b"\x00\x00" + self._data


def stamp_of(unix_s: float) -> tuple[int, int]:
    whole = int(unix_s)
    return whole, round((unix_s - whole) * 1e9)


def laser_scan(
    ranges_m: Sequence[float] | NDArray[np.float64] = (5.0, 5.0, 5.0),
    *,
    stamp_unix_s: float | None = None,
    nanoseconds: int = STAMP[1],
    frame_id: str = "laser",
    angle_min_rad: float = -0.5,
    angle_increment_rad: float = 0.5,
    angle_max_rad: float = 0.5,
    time_increment_s: float = 0.0,
    range_min_m: float = 0.1,
    range_max_m: float = 30.0,
    order: str = "<",
) -> bytes:
    stamp = (STAMP[0], nanoseconds) if stamp_unix_s is None else stamp_of(stamp_unix_s)
    writer = CdrWriter(order).header(stamp, frame_id)
    writer.add("ffffff", angle_min_rad, angle_max_rad, angle_increment_rad, time_increment_s, 0.1,
               range_min_m)  # fmt: skip
    writer.add("fI", range_max_m, len(ranges_m))
    writer.raw(np.asarray(ranges_m, f"{order}f4").tobytes())
    return writer.add("I", 0).payload()


def scan_all_round(ranges_m: Sequence[float] | NDArray[np.float64], **changes: Any) -> bytes:
    """Return a scan of a full turn, counter-clockwise, that begins behind."""
    step_rad = 2.0 * np.pi / len(ranges_m)
    angles = {
        "angle_min_rad": -np.pi + step_rad / 2.0,
        "angle_increment_rad": step_rad,
        "angle_max_rad": np.pi - step_rad / 2.0,
    }
    return laser_scan(ranges_m, **(angles | changes))


def point_cloud(
    points_m: NDArray[Any],
    *,
    stamp_unix_s: float | None = None,
    frame_id: str = "laser",
    fields: Sequence[tuple[str, int, int, int]] = FIELDS,
    step: int = 16,
    row_step: int | None = None,
    height: int = 1,
    width: int | None = None,
    data: bytes | None = None,
) -> bytes:
    if data is None:
        packed = np.zeros((len(points_m), 4), "<f4")
        packed[:, :3] = points_m
        data = packed.tobytes()
    width = len(points_m) if width is None else width
    stamp = STAMP if stamp_unix_s is None else stamp_of(stamp_unix_s)
    writer = CdrWriter().header(stamp, frame_id).add("III", height, width, len(fields))
    for name, offset, datatype, count in fields:
        writer.text(name).add("IBI", offset, datatype, count)
    row_step = width * step if row_step is None else row_step
    writer.add("BIII", 0, step, row_step, len(data)).raw(data)
    return writer.add("B", 1).payload()


def occupancy_grid(
    cells: NDArray[np.int8],
    *,
    cell_m: float = 0.5,
    origin_m: tuple[float, float] = (0.0, 0.0),
    frame_id: str = "odom",
    stamp_unix_s: float | None = None,
) -> bytes:
    stamp = STAMP if stamp_unix_s is None else stamp_of(stamp_unix_s)
    writer = CdrWriter().header(stamp, frame_id).add("iI", 0, 0)
    writer.add("fII", cell_m, cells.shape[1], cells.shape[0])
    writer.add("ddddddd", *origin_m, 0.0, 0.0, 0.0, 0.0, 1.0)
    return writer.add("I", cells.size).raw(cells.tobytes()).payload()


def attachment(publisher: bytes = bytes(16), sequence: int = 1, sent_ns: int = 5) -> bytes:
    """Return what rmw_zenoh attaches since 0.2.4."""
    return struct.pack("<qqB", sequence, sent_ns, 16) + publisher


# Parent, child, position, rotation as (x, y, z, w).
Link = tuple[str, str, tuple[float, float, float], tuple[float, float, float, float]]


def transforms(*links: Link, order: str = "<") -> bytes:
    """Return a tf2_msgs/TFMessage."""
    writer = CdrWriter(order).add("I", len(links))
    for parent, child, position_m, rotation in links:
        writer.header(STAMP, parent).text(child).add("ddddddd", *position_m, *rotation)
    return writer.payload()


def odometry(
    position_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    rotation: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0),
    *,
    stamp_unix_s: float,
    velocity_mps: tuple[float, float, float] = (0.0, 0.0, 0.0),
    frame_id: str = "odom",
) -> bytes:
    """Return a nav_msgs/Odometry."""
    writer = CdrWriter().header(stamp_of(stamp_unix_s), frame_id).text("base_link")
    writer.add("ddddddd", *position_m, *rotation).add("d" * 36, *[0.0] * 36)
    return writer.add("dddddd", *velocity_mps, 0.0, 0.0, 0.0).add("d" * 36, *[0.0] * 36).payload()
