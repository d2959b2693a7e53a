"""Reads the upright cylinders of a Gazebo world, as SANDO publishes its forests.

The format: http://sdformat.org/spec.  Poses are metres and radians: x y z roll pitch yaw.  A world
with another collision shape than cylinders, but for the ground, is refused: what is not read would
be taken for free.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Final
from xml.etree import ElementTree as ET

import numpy as np

from gcs_tools.benchmark.obstacles import Obstacles
from onboard.files.yaml_file import FileError, read_text

_FROM_ORIGIN_MAX_M, _RADIUS_MAX_M = 10_000.0, 200.0
_UPRIGHT_RAD: Final = 1e-3
_GROUND: Final = "plane"


def read_world(path: Path) -> Obstacles:
    """Read a world's cylinders; x is taken for north and y for east.

    Raises:
        FileError: names the file, the model and what is wrong with it.
    """
    try:
        root = ET.fromstring(read_text(path))  # noqa: S314  expat bounds what entities expand to
    except (ET.ParseError, ValueError) as error:
        raise FileError(f"{path}: is not XML: {error}") from error
    found = [
        pillar
        for model in root.findall("./world/model")
        for pillar in _pillars(model, f"{path}: model {model.get('name', '')[:40]!r}")
    ]
    if not found:
        raise FileError(f"{path}: has no model with a cylinder")
    table = np.array(found)
    return Obstacles.stems(table[:, :2], table[:, 2])


def _pillars(model: ET.Element, source: str) -> Iterator[tuple[float, float, float]]:
    for link in model.findall("link"):
        for collision in link.findall("collision"):
            shape = collision.find("geometry/*")
            if shape is None or shape.tag == _GROUND:
                continue
            if shape.tag != "cylinder":
                raise FileError(f"{source}: collides as <{shape.tag}>; expected cylinders")
            (radius_m,) = _numbers(shape, "radius", 1, source)
            if not 0.0 < radius_m <= _RADIUS_MAX_M:
                raise FileError(
                    f"{source}: radius [m] = {radius_m:g} must be greater than 0 and at most "
                    f"{_RADIUS_MAX_M:g}"
                )
            x_m, y_m = _place(model, link, collision, source)
            yield x_m, y_m, radius_m


def _place(
    model: ET.Element, link: ET.Element, collision: ET.Element, source: str
) -> tuple[float, float]:
    """Return where the cylinder stands: poses of collision and link are in their parent's frame."""
    x_m = y_m = 0.0
    for part in (collision, link, model):
        away_x_m, away_y_m, _, roll, pitch, yaw = _numbers(part, "pose", 6, source)
        if max(abs(roll), abs(pitch)) > _UPRIGHT_RAD:
            raise FileError(f"{source}: pose [rad] = {roll:g} {pitch:g} is not upright")
        c, s = math.cos(yaw), math.sin(yaw)
        x_m, y_m = away_x_m + c * x_m - s * y_m, away_y_m + s * x_m + c * y_m
    if max(abs(x_m), abs(y_m)) > _FROM_ORIGIN_MAX_M:
        raise FileError(
            f"{source}: pose [m] = {x_m:.10g} {y_m:.10g} is more than {_FROM_ORIGIN_MAX_M:g} m "
            "from the origin"
        )
    return x_m, y_m


def _numbers(part: ET.Element, key: str, count: int, source: str) -> tuple[float, ...]:
    """Return the numbers of a key; a pose that is not stated is zero."""
    text = part.findtext(key)
    if text is None and key == "pose":
        return (0.0,) * count
    try:
        numbers = tuple(float(word) for word in (text or "").split())
    except ValueError:
        numbers = ()
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise FileError(f"{source}: {key} = {(text or '')[:40]!r}; expected {count} numbers")
    return numbers
