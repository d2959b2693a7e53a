"""Draws a flight for viewers: messages in Foxglove's schemas from the records of the daemon.

Positions stay in NED.  The frame ``local_ned`` hangs below ``map``, whose z axis points up as
viewers expect.  Fields: https://docs.foxglove.dev/docs/sdk/schemas.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from typing import Final

from foxglove import messages as fg

from onboard.recording.messages import (
    KnownObstacle,
    Obstacles,
    PlanRecord,
    Record,
    SeenSpace,
    StateRecord,
)
from onboard.recording.mover_record import KnownMover, MoversRecord, box_at

MAP_FRAME: Final = "map"
NED_FRAME: Final = "local_ned"
BODY_FRAME: Final = "body_frd"
# Each message of the flown path repeats its last minute, for a viewer that jumps there.
TRAIL_POINTS: Final = 120
TRAIL_PERIOD_S: Final = 0.5
# Obstacles are known from above only; they are drawn this much higher than the leg is flown.
HEADROOM_M: Final = 1.0

Vector = Sequence[float]
SceneMessage = fg.FrameTransforms | fg.PoseInFrame | fg.PosesInFrame | fg.SceneUpdate

_OBSTACLE: Final = fg.Color(r=0.36, g=0.50, b=0.31, a=0.8)
_KEEP_OUT: Final = fg.Color(r=0.88, g=0.48, b=0.0, a=0.9)
_REGION: Final = fg.Color(r=0.69, g=0.23, b=0.28, a=0.9)
_LANE: Final = fg.Color(r=0.35, g=0.55, b=0.85, a=0.6)
_BOUNDARY: Final = fg.Color(r=0.85, g=0.10, b=0.10, a=1.0)
_PLAN: Final = fg.Color(r=0.88, g=0.48, b=0.0, a=1.0)
_FREE: Final = fg.Color(r=0.40, g=0.75, b=0.45, a=0.25)
_WAY_TO_REST: Final = fg.Color(r=0.10, g=0.60, b=0.20, a=1.0)
_GUIDE: Final = fg.Color(r=0.55, g=0.55, b=0.60, a=0.8)
_MOVER: Final = fg.Color(r=0.85, g=0.15, b=0.55, a=0.8)
_REACH: Final = fg.Color(r=0.85, g=0.15, b=0.55, a=1.0)
_NAME: Final = fg.Color(r=0.9, g=0.9, b=0.9, a=1.0)
# Half a turn about the axis between x and y swaps those two and reverses z.
_MAP_FROM_NED: Final = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)

# Topic, with its leading slash, by what is drawn there.
TOPICS: Final[dict[str, type[SceneMessage]]] = {
    "/tf": fg.FrameTransforms,
    "/pose": fg.PoseInFrame,
    "/path/flown": fg.PosesInFrame,
    "/path/planned": fg.PosesInFrame,
    "/scene/obstacles": fg.SceneUpdate,
    "/scene/plan": fg.SceneUpdate,
    "/scene/seen_space": fg.SceneUpdate,
    "/scene/movers": fg.SceneUpdate,
}


class Scene:
    """Draws a flight record by record.

    Args:
        height_m: at which the legs are flown, for logs whose obstacles do not state it; None to use
            the vehicle's own height.
    """

    def __init__(self, height_m: float | None = None) -> None:
        self._height_m = height_m
        self._vehicle_height_m = 0.0
        self._trail: deque[Vector] = deque(maxlen=TRAIL_POINTS)
        self._trail_due_s = -math.inf

    def draw(self, record: Record) -> Iterator[tuple[str, SceneMessage]]:
        """Yield topic and message of everything that the record changes."""
        if isinstance(record, StateRecord):
            yield from self._vehicle(record)
        elif isinstance(record, Obstacles):
            yield "/scene/obstacles", self._obstacles(record)
        elif isinstance(record, PlanRecord):
            yield "/path/planned", _path(record.time_s, record.path_ned_m)
            line = _line(record.path_ned_m, _PLAN, 4.0)
            entity = _entity(record.time_s, "plan", lines=[line])
            yield "/scene/plan", _scene_update(record.time_s, [entity])
        elif isinstance(record, SeenSpace):
            height_m = self._vehicle_height_m if record.height_m is None else record.height_m
            entity = _seen_space(record, height_m)
            yield "/scene/seen_space", _scene_update(record.time_s, [entity])
        elif isinstance(record, MoversRecord):
            yield "/scene/movers", self._movers(record)

    def _movers(self, known: MoversRecord) -> fg.SceneUpdate:
        height_m = self._vehicle_height_m if known.height_m is None else known.height_m
        drawn = [each for each in known.movers if each.box_ned_m]
        entities = [_mover(known, each, height_m) for each in drawn]
        return _scene_update(known.time_s, entities)

    def _vehicle(self, state: StateRecord) -> Iterator[tuple[str, SceneMessage]]:
        if state.position_ned_m is None:
            return
        self._vehicle_height_m = -state.position_ned_m[2]
        turn = quaternion(state.roll_rad or 0.0, state.pitch_rad or 0.0, state.yaw_rad or 0.0)
        position = _vector(state.position_ned_m)
        yield "/tf", _transforms(state.time_s, position, turn)
        pose = fg.Pose(position=position, orientation=turn)
        yield (
            "/pose",
            fg.PoseInFrame(timestamp=timestamp(state.time_s), frame_id=NED_FRAME, pose=pose),
        )
        if state.time_s >= self._trail_due_s:
            self._trail_due_s = state.time_s + TRAIL_PERIOD_S
            self._trail.append(state.position_ned_m)
            yield "/path/flown", _path(state.time_s, self._trail)

    def _obstacles(self, known: Obstacles) -> fg.SceneUpdate:
        stated_m = known.height_m if known.height_m is not None else self._height_m
        height_m = self._vehicle_height_m if stated_m is None else stated_m
        # An obstacle without its outline, in a log of another version, cannot be drawn.
        drawn = [each for each in known.obstacles if len(each.measured_ned_m) == 4]
        return _scene_update(
            known.time_s, [_obstacle(known.time_s, each, height_m) for each in drawn]
        )


def _obstacle(time_s: float, obstacle: KnownObstacle, height_m: float) -> fg.SceneEntity:
    name = fg.TextPrimitive(
        pose=_point((*obstacle.measured_ned_m[0], -height_m - HEADROOM_M)),
        billboard=True,
        font_size=14.0,
        scale_invariant=True,
        color=_NAME,
        text=obstacle.id,
    )
    outlines = (
        (obstacle.keep_out_ned_m, _KEEP_OUT),
        (obstacle.region_ned_m, _REGION),
        (obstacle.lane_ned_m, _LANE),
    )
    lines = [
        _line(_at_height([*corners, *corners[:1]], height_m), colour)
        for corners, colour in outlines
    ]
    lines.append(_line(_at_height(obstacle.boundary_ned_m, height_m), _BOUNDARY, 3.0))
    column = _column(obstacle.measured_ned_m, height_m + HEADROOM_M)
    return _entity(time_s, obstacle.id, cubes=[column], lines=lines, texts=[name])


def _mover(known: MoversRecord, mover: KnownMover, height_m: float) -> fg.SceneEntity:
    """Return a mover as a column where it may be by now, and what it may reach as a line."""
    now_ned_m = box_at(mover, known.time_s, known.stamp_error_s)
    waits = ", yielding for it" if mover.yields_for else ""
    name = fg.TextPrimitive(
        pose=_point((*now_ned_m[0], -height_m - HEADROOM_M)),
        billboard=True,
        font_size=14.0,
        scale_invariant=True,
        color=_NAME,
        text=f"{mover.id} ({mover.kind}){waits}",
    )
    column = _column(now_ned_m, height_m + HEADROOM_M, _MOVER)
    reach = _line(_at_height([*mover.reach_ned_m, *mover.reach_ned_m[:1]], height_m), _REACH)
    return _entity(known.time_s, mover.id, cubes=[column], lines=[reach], texts=[name])


def _column(
    corners_ned_m: Sequence[Vector], height_m: float, colour: fg.Color = _OBSTACLE
) -> fg.CubePrimitive:
    """Return a box that stands on the ground, from its corners in order."""
    (north_m, east_m), (ahead_north_m, ahead_east_m), across, (aside_north_m, aside_east_m) = (
        corners_ned_m
    )
    along_m = (ahead_north_m - north_m, ahead_east_m - east_m)
    aside_m = (aside_north_m - north_m, aside_east_m - east_m)
    center_m = ((north_m + across[0]) / 2.0, (east_m + across[1]) / 2.0, -height_m / 2.0)
    turn = quaternion(0.0, 0.0, math.atan2(along_m[1], along_m[0]))
    return fg.CubePrimitive(
        pose=fg.Pose(position=_vector(center_m), orientation=turn),
        size=_vector((math.hypot(*along_m), math.hypot(*aside_m), height_m)),
        color=colour,
    )


def _seen_space(seen: SeenSpace, height_m: float) -> fg.SceneEntity:
    """Return the free runs as flat boxes, the way to rest and the guide as lines."""
    cosine, sine = math.cos(seen.heading_rad), math.sin(seen.heading_rad)
    north_m, east_m = seen.corner_ned_m
    cubes = []
    for row, first, after in zip(seen.row, seen.column_from, seen.column_to, strict=True):
        x_m, y_m = (row + 0.5) * seen.cell_m, (first + after) / 2.0 * seen.cell_m
        center_m = (north_m + cosine * x_m - sine * y_m, east_m + sine * x_m + cosine * y_m)
        cubes.append(
            fg.CubePrimitive(
                pose=fg.Pose(
                    position=_vector((*center_m, -height_m)),
                    orientation=quaternion(0.0, 0.0, seen.heading_rad),
                ),
                size=_vector((seen.cell_m, (after - first) * seen.cell_m, 0.02)),
                color=_FREE,
            )
        )
    lines = [
        _line(_at_height(seen.guide_ned_m, height_m), _GUIDE, 2.0),
        _line(_at_height(seen.way_to_rest_ned_m, height_m), _WAY_TO_REST, 4.0),
    ]
    return _entity(seen.time_s, "seen_space", cubes=cubes, lines=lines)


def _at_height(points_ned_m: Iterable[Vector], height_m: float) -> list[Vector]:
    return [(north_m, east_m, -height_m) for north_m, east_m in points_ned_m]


# ---------------------------------------------------------------------------- building blocks


def timestamp(time_unix_s: float) -> fg.Timestamp:
    """Return a Unix time to the microsecond, like the rest of the log."""
    seconds, microseconds = divmod(round(time_unix_s * 1e6), 1_000_000)
    return fg.Timestamp(seconds, microseconds * 1000)


def quaternion(roll_rad: float, pitch_rad: float, yaw_rad: float) -> fg.Quaternion:
    """Return the rotation of an attitude: yaw, then pitch, then roll."""
    x, y, z, w = quaternion_xyzw(roll_rad, pitch_rad, yaw_rad)
    return fg.Quaternion(x=x, y=y, z=z, w=w)


def quaternion_xyzw(
    roll_rad: float, pitch_rad: float, yaw_rad: float
) -> tuple[float, float, float, float]:
    """Return the components of `quaternion`."""
    cr, sr = math.cos(roll_rad / 2.0), math.sin(roll_rad / 2.0)
    cp, sp = math.cos(pitch_rad / 2.0), math.sin(pitch_rad / 2.0)
    cy, sy = math.cos(yaw_rad / 2.0), math.sin(yaw_rad / 2.0)
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


def _transforms(time_s: float, position: fg.Vector3, turn: fg.Quaternion) -> fg.FrameTransforms:
    """Return the transforms from the map to NED, and from NED to the vehicle's body."""
    x, y, z, w = _MAP_FROM_NED
    map_from_ned = fg.FrameTransform(
        timestamp=timestamp(time_s),
        parent_frame_id=MAP_FRAME,
        child_frame_id=NED_FRAME,
        translation=fg.Vector3(),
        rotation=fg.Quaternion(x=x, y=y, z=z, w=w),
    )
    ned_from_body = fg.FrameTransform(
        timestamp=timestamp(time_s),
        parent_frame_id=NED_FRAME,
        child_frame_id=BODY_FRAME,
        translation=position,
        rotation=turn,
    )
    return fg.FrameTransforms(transforms=[map_from_ned, ned_from_body])


def _path(time_s: float, positions_ned_m: Iterable[Vector]) -> fg.PosesInFrame:
    poses = [_point(position_m) for position_m in positions_ned_m]
    return fg.PosesInFrame(timestamp=timestamp(time_s), frame_id=NED_FRAME, poses=poses)


def _scene_update(time_s: float, entities: list[fg.SceneEntity]) -> fg.SceneUpdate:
    """Return an update that replaces everything on its topic."""
    everything = fg.SceneEntityDeletion(
        timestamp=timestamp(time_s), type=fg.SceneEntityDeletionType.All
    )
    return fg.SceneUpdate(deletions=[everything], entities=entities)


def _entity(
    time_s: float,
    name: str,
    *,
    cubes: list[fg.CubePrimitive] | None = None,
    lines: list[fg.LinePrimitive] | None = None,
    texts: list[fg.TextPrimitive] | None = None,
) -> fg.SceneEntity:
    """Return an entity in NED that stays until it is replaced."""
    return fg.SceneEntity(
        timestamp=timestamp(time_s),
        frame_id=NED_FRAME,
        id=name,
        cubes=cubes,
        lines=lines,
        texts=texts,
    )


def _line(
    points_ned_m: Iterable[Vector], colour: fg.Color, thickness_px: float = 2.0
) -> fg.LinePrimitive:
    return fg.LinePrimitive(
        type=fg.LinePrimitiveLineType.LineStrip,
        pose=_point((0.0, 0.0, 0.0)),
        thickness=thickness_px,
        scale_invariant=True,
        points=[fg.Point3(x=x, y=y, z=z) for x, y, z in points_ned_m],
        color=colour,
    )


def _point(position_ned_m: Vector) -> fg.Pose:
    """Return a pose without a rotation."""
    return fg.Pose(position=_vector(position_ned_m), orientation=fg.Quaternion(w=1.0))


def _vector(values: Vector) -> fg.Vector3:
    x, y, z = values
    return fg.Vector3(x=x, y=y, z=z)
