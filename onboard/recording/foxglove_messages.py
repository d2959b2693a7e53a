"""Messages in Foxglove's published schemas, as JSON: poses, frames and scenes that viewers draw.

Foxglove, Lichtblick and Rerun know these messages by the names of their schemas; the fields are
those of https://docs.foxglove.dev/docs/sdk/schemas.  Vectors stay in NED: the frame ``local_ned``
hangs below ``map``, which has its z axis up as viewers expect.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any, Final

MAP_FRAME: Final = "map"
NED_FRAME: Final = "local_ned"
BODY_FRAME: Final = "body_frd"

Vector = Sequence[float]
Colour = tuple[float, float, float, float]
Message = dict[str, Any]

# Half a turn about the axis between x and y swaps those two and points z the other way.
_MAP_FROM_NED: Final = {"x": math.sqrt(0.5), "y": math.sqrt(0.5), "z": 0.0, "w": 0.0}
_UNTURNED: Final = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
_LINE_STRIP: Final = 0


def timestamp(time_unix_s: float) -> Message:
    """Return a Unix time as Foxglove writes it; microseconds, as in the rest of the log."""
    seconds, microseconds = divmod(round(time_unix_s * 1e6), 1_000_000)
    return {"sec": seconds, "nsec": microseconds * 1000}


def pose(position_m: Vector, attitude_rad: tuple[float, float, float] | None = None) -> Message:
    """Return a Pose; ``attitude_rad`` is roll, pitch, yaw, none for a mere point."""
    turn = _UNTURNED if attitude_rad is None else quaternion(*attitude_rad)
    return {"position": vector(position_m), "orientation": turn}


def pose_in_frame(time_unix_s: float, vehicle: Message) -> Message:
    """Return a PoseInFrame of a pose in NED."""
    return {"timestamp": timestamp(time_unix_s), "frame_id": NED_FRAME, "pose": vehicle}


def poses_in_frame(time_unix_s: float, positions_ned_m: Iterable[Vector]) -> Message:
    """Return a PosesInFrame: a path in NED."""
    poses = [pose(position_m) for position_m in positions_ned_m]
    return {"timestamp": timestamp(time_unix_s), "frame_id": NED_FRAME, "poses": poses}


def frame_transforms(time_unix_s: float, vehicle: Message) -> Message:
    """Return the FrameTransforms from the map to NED, and from there to a vehicle's body."""
    return {
        "transforms": [
            _transform(time_unix_s, MAP_FRAME, NED_FRAME, vector((0.0, 0.0, 0.0)), _MAP_FROM_NED),
            _transform(
                time_unix_s, NED_FRAME, BODY_FRAME, vehicle["position"], vehicle["orientation"]
            ),
        ]
    }


def _transform(
    time_unix_s: float, parent: str, child: str, translation: Message, rotation: Message
) -> Message:
    return {
        "timestamp": timestamp(time_unix_s),
        "parent_frame_id": parent,
        "child_frame_id": child,
        "translation": translation,
        "rotation": rotation,
    }


def scene_update(time_unix_s: float, entities: Sequence[Message]) -> Message:
    """Return a SceneUpdate that replaces everything on its topic with ``entities``."""
    everything = {"timestamp": timestamp(time_unix_s), "type": 1, "id": ""}
    return {"deletions": [everything], "entities": list(entities)}


def entity(time_unix_s: float, name: str, **primitives: list[Message]) -> Message:
    """Return a SceneEntity in NED that stays until it is replaced.

    Args:
        time_unix_s: when it is so.
        name: its id.
        primitives: ``cubes``, ``lines`` and ``texts``.
    """
    kinds = ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")
    return {
        "timestamp": timestamp(time_unix_s),
        "frame_id": NED_FRAME,
        "id": name,
        "lifetime": {"sec": 0, "nsec": 0},
        "frame_locked": False,
        "metadata": [],
        **{kind: primitives.get(kind, []) for kind in kinds},
    }


def cube(center_m: Vector, size_m: Vector, yaw_rad: float, colour: Colour) -> Message:
    """Return a CubePrimitive."""
    return {
        "pose": pose(center_m, (0.0, 0.0, yaw_rad)),
        "size": vector(size_m),
        "color": _colour(colour),
    }


def line(points_m: Iterable[Vector], colour: Colour, thickness_px: float = 2.0) -> Message:
    """Return a LinePrimitive through points."""
    return {
        "type": _LINE_STRIP,
        "pose": pose((0.0, 0.0, 0.0)),
        "thickness": thickness_px,
        "scale_invariant": True,
        "points": [vector(point_m) for point_m in points_m],
        "color": _colour(colour),
        "colors": [],
        "indices": [],
    }


def text(position_m: Vector, words: str, colour: Colour, size_px: float = 14.0) -> Message:
    """Return a TextPrimitive that faces whoever looks at it."""
    return {
        "pose": pose(position_m),
        "billboard": True,
        "font_size": size_px,
        "scale_invariant": True,
        "color": _colour(colour),
        "text": words,
    }


def vector(values: Vector) -> Message:
    """Return a Vector3 or Point3."""
    x, y, z = values
    return {"x": x, "y": y, "z": z}


def quaternion(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Message:
    """Return the Quaternion of an attitude: yaw, then pitch, then roll."""
    cr, sr = math.cos(roll_rad / 2.0), math.sin(roll_rad / 2.0)
    cp, sp = math.cos(pitch_rad / 2.0), math.sin(pitch_rad / 2.0)
    cy, sy = math.cos(yaw_rad / 2.0), math.sin(yaw_rad / 2.0)
    return {
        "x": sr * cp * cy - cr * sp * sy,
        "y": cr * sp * cy + sr * cp * sy,
        "z": cr * cp * sy - sr * sp * cy,
        "w": cr * cp * cy + sr * sp * sy,
    }


def _colour(rgba: Colour) -> Message:
    return dict(zip("rgba", rgba, strict=True))


# ---------------------------------------------------------------------------- JSON Schemas


def _object(**properties: Message) -> Message:
    return {"type": "object", "properties": properties, "required": list(properties)}


def _array(items: Message) -> Message:
    return {"type": "array", "items": items}


_NUMBER: Final[Message] = {"type": "number"}
_INTEGER: Final[Message] = {"type": "integer"}
_STRING: Final[Message] = {"type": "string"}
_BOOLEAN: Final[Message] = {"type": "boolean"}
_TIME: Final = {**_object(sec=_INTEGER, nsec=_INTEGER), "title": "time"}
_DURATION: Final = {**_object(sec=_INTEGER, nsec=_INTEGER), "title": "duration"}
_VECTOR: Final = _object(x=_NUMBER, y=_NUMBER, z=_NUMBER)
_QUATERNION: Final = _object(x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER)
_POSE: Final = _object(position=_VECTOR, orientation=_QUATERNION)
_COLOUR: Final = _object(r=_NUMBER, g=_NUMBER, b=_NUMBER, a=_NUMBER)
_CUBE: Final = _object(pose=_POSE, size=_VECTOR, color=_COLOUR)
_LINE: Final = _object(
    type=_INTEGER,
    pose=_POSE,
    thickness=_NUMBER,
    scale_invariant=_BOOLEAN,
    points=_array(_VECTOR),
    color=_COLOUR,
    colors=_array(_COLOUR),
    indices=_array(_INTEGER),
)
_TEXT: Final = _object(
    pose=_POSE,
    billboard=_BOOLEAN,
    font_size=_NUMBER,
    scale_invariant=_BOOLEAN,
    color=_COLOUR,
    text=_STRING,
)
# Kinds of primitives that we never draw are empty arrays.  Viewers refuse a topic with an array
# that does not say of what.
_UNUSED: Final[Message] = {"type": "array", "maxItems": 0, "items": {"type": "object"}}
_ENTITY: Final = _object(
    timestamp=_TIME,
    frame_id=_STRING,
    id=_STRING,
    lifetime=_DURATION,
    frame_locked=_BOOLEAN,
    metadata=_UNUSED,
    arrows=_UNUSED,
    cubes=_array(_CUBE),
    spheres=_UNUSED,
    cylinders=_UNUSED,
    lines=_array(_LINE),
    triangles=_UNUSED,
    texts=_array(_TEXT),
    models=_UNUSED,
)
_TRANSFORM: Final = _object(
    timestamp=_TIME,
    parent_frame_id=_STRING,
    child_frame_id=_STRING,
    translation=_VECTOR,
    rotation=_QUATERNION,
)
_DELETION: Final = _object(timestamp=_TIME, type=_INTEGER, id=_STRING)

# By the name under which a log announces them.
SCHEMAS: Final[dict[str, Message]] = {
    name: {"title": name, **schema}
    for name, schema in {
        "foxglove.PoseInFrame": _object(timestamp=_TIME, frame_id=_STRING, pose=_POSE),
        "foxglove.PosesInFrame": _object(timestamp=_TIME, frame_id=_STRING, poses=_array(_POSE)),
        "foxglove.FrameTransforms": _object(transforms=_array(_TRANSFORM)),
        "foxglove.SceneUpdate": _object(deletions=_array(_DELETION), entities=_array(_ENTITY)),
    }.items()
}
