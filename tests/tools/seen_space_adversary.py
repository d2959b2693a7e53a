"""Attack the seen-free set: no cell that holds a point of an obstacle may ever be called free.

Random fields are seen by a hostile sensor that stays within its contract: it knows the true field,
casts its own lines of sight, and then makes every error as large as it may be: faces pushed in,
boxes turned, of the visible part or of the whole, the pose and the heading off, the clock off.  It
shares no code with the service but the message; one frame suffices to free a cell here.

    python -m tests.tools.seen_space_adversary [FRAMES] [SEED]
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from onboard.files.contract_file import load_contract
from onboard.geometry.frames import FloatArray, IntArray, LegFrame
from onboard.monitoring.seen.seen_space import SeenSpace
from onboard.perception.detection import Detection, DetectionFrame
from onboard.perception.placement import POSE_TIMING_S
from onboard.perception.pose_history import PoseHistory
from onboard.vehicle_state import Pose
from tests.onboard.monitoring.fake_flight import FakeFlight

CONTRACT: Final = Path(__file__).parents[1] / "contracts" / "precise_vehicle.yaml"
BoolArray = NDArray[np.bool_]

# Between points of an obstacle's boundary that are cast to.
SPACING_M: Final = 0.02
# Nothing is nearer to the sensor: there is the vehicle.
DEAD_ZONE_M: Final = 0.12
ALTITUDE_M: Final = 4.0
IN_PLACE: Final = ((0.0, 0.0),)
VIEWS_DEG: Final = (40.0, 90.0, 120.0, 180.0, 270.0, 350.0, 356.0, 359.9, 360.0)


@dataclass(frozen=True)
class Field:
    """Obstacles as convex polygons around the true place of the sensor.

    Attributes:
        points_m: (n, 2), points of boundaries, local frame.
        owners: (n,), which obstacle each belongs to.
        edges_m: (m, 2, 2), all edges.
        polygons_m: corners of each.
    """

    points_m: FloatArray
    owners: IntArray
    edges_m: FloatArray
    polygons_m: list[FloatArray]


class Sight(NamedTuple):
    """Which points of a field are seen, and where each is from the sensor."""

    seen: BoolArray
    distance_m: FloatArray
    bearing_rad: FloatArray


def random_field(
    random: np.random.Generator, here_m: FloatArray, reach_m: float, edges_rad: tuple[float, float]
) -> Field:
    """Return a field of stems, boxes, walls and thin poles; the sensor stands outside of all.

    Half of them stand near the edges of the view.
    """
    polygons = []
    for _ in range(random.integers(1, 9)):
        kind = random.integers(4)
        if kind == 0:
            count, radius_m = 12, random.uniform(0.02, 0.4)
            turns = np.arange(count) * (2.0 * math.pi / count)
            shape = radius_m * np.stack((np.cos(turns), np.sin(turns)), axis=1)
        else:
            longest_m = (3.0, 6.0, 0.05)[kind - 1]
            x_m = random.uniform(0.01, longest_m) / 2.0
            y_m = (random.uniform(0.01, longest_m) if kind == 1 else 0.02) / 2.0
            shape = np.array([(-x_m, -y_m), (x_m, -y_m), (x_m, y_m), (-x_m, y_m)])
        distance_m = reach_m * math.sqrt(random.uniform(0.0, 1.1))
        bearing, turn = random.uniform(-math.pi, math.pi, 2)
        if random.integers(2):
            bearing = float(random.choice(edges_rad)) + random.normal(0.0, 0.05)
        center_m = here_m + distance_m * np.array((math.cos(bearing), math.sin(bearing)))
        polygon = shape @ _turn(turn) + center_m
        if _distance_m(polygon, here_m) > DEAD_ZONE_M:
            polygons.append(polygon)
    points, owners, edges = [np.zeros((0, 2))], [np.zeros(0, int)], [np.zeros((0, 2, 2))]
    for index, polygon in enumerate(polygons):
        sides = np.stack((polygon, np.roll(polygon, -1, axis=0)), axis=1)
        for begin, end in sides:
            count = max(math.ceil(math.dist(begin, end) / SPACING_M), 1) + 1
            points.append(np.linspace(begin, end, count))
            owners.append(np.full(count, index))
        edges.append(sides)
    return Field(np.concatenate(points), np.concatenate(owners), np.concatenate(edges), polygons)


def _turn(angle_rad: float) -> FloatArray:
    """Rows times this are turned by an angle."""
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[cosine, sine], [-sine, cosine]])


def _distance_m(polygon: FloatArray, here_m: FloatArray) -> float:
    """Return how far a polygon is; 0 from within."""
    if _inside(polygon, here_m[None])[0]:
        return 0.0
    along = np.roll(polygon, -1, axis=0) - polygon
    share = ((here_m - polygon) * along).sum(axis=1) / (along * along).sum(axis=1)
    nearest = polygon + np.clip(share, 0.0, 1.0)[:, None] * along
    return float(np.hypot(*(nearest - here_m).T).min())


def _inside(polygon: FloatArray, points: FloatArray) -> BoolArray:
    """Tell which points lie in a convex polygon that turns left."""
    begin, along = polygon, np.roll(polygon, -1, axis=0) - polygon
    to = points[:, None] - begin
    left: BoolArray = along[:, 0] * to[..., 1] - along[:, 1] * to[..., 0] >= 0.0
    return np.asarray(left.all(axis=1))


def visible(
    field: Field, here_m: FloatArray, axis_rad: float, view_rad: float, range_m: float
) -> Sight:
    """Tell which points a sensor sees: within range and view, no edge before them."""
    to = field.points_m - here_m
    distance_m = np.hypot(to[:, 0], to[:, 1])
    bearing = (np.arctan2(to[:, 1], to[:, 0]) - axis_rad + math.pi) % (2.0 * math.pi) - math.pi
    seen = (distance_m <= range_m) & (np.abs(bearing) <= view_rad / 2.0)
    candidates = np.flatnonzero(seen)
    ray = to[candidates][:, None]
    begin = field.edges_m[:, 0] - here_m
    edge = field.edges_m[:, 1] - field.edges_m[:, 0]
    cross = ray[..., 0] * edge[:, 1] - ray[..., 1] * edge[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        along_ray = (begin[:, 0] * edge[:, 1] - begin[:, 1] * edge[:, 0]) / cross
        along_edge = (begin[:, 0] * ray[..., 1] - begin[:, 1] * ray[..., 0]) / cross
    # A point may hide behind what lies more than a hair before it.
    hidden = (
        (along_ray > 0.0)
        & (along_ray * distance_m[candidates][:, None] < (distance_m[candidates][:, None] - 1e-6))
        & (along_edge >= 0.0)
        & (along_edge <= 1.0)
    )
    seen[candidates] = ~hidden.any(axis=1)
    return Sight(seen, distance_m, bearing)


class Adversary:
    """Plays one frame after another against a new set each."""

    def __init__(self, seed: int) -> None:
        self.random = np.random.default_rng(seed)
        self.flight = FakeFlight.under(load_contract(CONTRACT))
        self.freed = 0
        self.contradictions = 0

    def false_cells(self) -> int:
        """Play a frame; return how many points of obstacles lie in free cells."""
        random = self.random
        range_m, view_rad = random.uniform(3.0, 12.0), math.radians(self._one_of(*VIEWS_DEG))
        e, heading_error_rad = self._one_of(0.0, 0.05, 0.2), self._one_of(0.0, 0.004, 0.035)
        here, axis = random.uniform(-50.0, 50.0, 2), random.uniform(-math.pi, math.pi)
        edges = (axis - view_rad / 2.0, axis + view_rad / 2.0)
        field = random_field(random, here, range_m, edges)
        astray_m = e * self._one_of(0.0, random.uniform(), 1.0) * (1.0 - 1e-9)
        pose = self._pose(here, axis, edges, astray_m, heading_error_rad)
        self._declare(e, heading_error_rad)
        leg_at = (here + random.uniform(-20.0, 20.0, 2)).tolist()
        self.flight.leg = LegFrame((*leg_at, -ALTITUDE_M), random.uniform(-math.pi, math.pi))
        # What is left for the faces; what lies between two points of the field goes the other way.
        push_m = e - astray_m - SPACING_M
        poses = PoseHistory()
        for time_s in (0.98, 1.0, 1.02):
            poses.add(pose._replace(time_s=time_s, position_ned_m=_moved(pose, time_s - 1.0)))
        space = SeenSpace(self.flight, poses, frames_needed=1)
        space.take(self._frame(field, here, axis, view_rad, range_m, push_m), 1.0, 1.05, IN_PLACE)
        if space.advance(pose, trusted=True) is not None:
            self.contradictions += 1
        self.freed += space.size
        return self._hit(space, field)

    def _one_of(self, *values: float) -> float:
        return float(self.random.choice(values))

    def _pose(
        self,
        here: FloatArray,
        axis: float,
        edges: tuple[float, float],
        astray_m: float,
        heading_error_rad: float,
    ) -> Pose:
        """Return where the vehicle believes to be, as wrong as it may be."""
        random = self.random
        way, towards = random.uniform(-math.pi, math.pi, 2)
        if random.integers(2):  # away from an edge of the view, by which more would be in view
            towards = self._one_of(*edges) + self._one_of(-math.pi, math.pi) / 2.0
        velocity = self._one_of(0.0, 3.0) * np.array((math.cos(way), math.sin(way)))
        offset = astray_m * np.array((math.cos(towards), math.sin(towards)))
        offset += velocity * self._one_of(-POSE_TIMING_S, POSE_TIMING_S)
        yaw_rad = axis + self._one_of(-heading_error_rad, heading_error_rad)
        (north_m, east_m), (vn, ve) = (here + offset).tolist(), velocity.tolist()
        return Pose(1.0, (north_m, east_m, -ALTITUDE_M), (vn, ve, 0.0), 0.0, 0.0, yaw_rad)

    def _declare(self, e: float, heading_error_rad: float) -> None:
        """Let the contract state the errors."""
        assessment = self.flight.assessment
        terms = replace(
            assessment.terms,
            detection_range_m=12.0,
            field_of_view_rad=2.0 * math.pi,
            position_error_m=e,
            heading_error_rad=heading_error_rad,
            frame_age_max_s=1.0,
        )
        self.flight.assessment = replace(assessment, terms=terms)

    def _frame(
        self, field: Field, here: FloatArray, axis: float, view: float, range_m: float, push: float
    ) -> DetectionFrame:
        sight = visible(field, here, axis, view, range_m)
        scan: tuple[float, ...] | None = None
        boxes: list[Detection] = []
        if self.random.integers(3) == 0:
            scan = self._scan(sight, view, range_m, push)
        if scan is None or self.random.integers(2):
            for index, polygon in enumerate(field.polygons_m):
                mine = sight.seen & (field.owners == index)
                if mine.any():
                    part = field.points_m[mine] if self.random.integers(2) else polygon
                    boxes.append(self._box(str(index), (part - here) @ _turn(-axis), push))
        return DetectionFrame(
            version=1,
            source="front",
            sequence=1,
            stamp_unix_s=1.0,
            frame="body_frd",
            range_m=range_m,
            field_of_view_deg=min(math.degrees(view), 360.0),
            obstacles=tuple(boxes),
            free_range_m=scan,
        )

    def _box(self, name: str, points: FloatArray, push: float) -> Detection:
        """Enclose points of the body's frame in a box that is turned anyhow, faces pushed in."""
        turn = self.random.uniform(-math.pi, math.pi)
        own = points @ _turn(-turn)
        low, high = own.min(axis=0) + push, own.max(axis=0) - push
        middle = (low + high) / 2.0
        if self.random.integers(2):  # one face out instead
            high = own.max(axis=0) + max(push, 0.0)
            middle = (low + high) / 2.0
        size = np.maximum(high - low, 0.0)
        center = middle @ _turn(turn)
        return Detection(
            id=name,
            center_m=(float(center[0]), float(center[1])),
            size_m=(float(size[0]), float(size[1])),
            yaw_deg=math.degrees(turn),
            uncertainty_m=0.0,
        )

    def _scan(self, sight: Sight, view: float, range_m: float, push: float) -> tuple[float, ...]:
        count = int(self.random.choice((1, 7, 72, 360)))
        free = np.full(count, range_m)
        # What lies between two points may be in the bin beside theirs, and nearer by as much.
        for shift in np.linspace(-SPACING_M, SPACING_M, 33).tolist():
            moved = sight.bearing_rad + shift / np.maximum(sight.distance_m, SPACING_M)
            bins = np.floor((moved + view / 2.0) / view * count).astype(int)
            inside = sight.seen & (bins >= 0) & (bins < count)
            np.minimum.at(free, bins[inside], sight.distance_m[inside])
        return tuple(np.maximum(free + push, 0.0).tolist())

    def _hit(self, space: SeenSpace, field: Field) -> int:
        leg = self.flight.leg
        to = np.concatenate((field.points_m, self._interior(field)))
        points = np.concatenate((to, np.full((len(to), 1), -ALTITUDE_M)), axis=1)
        x_m, y_m, _ = leg.position_leg_from_ned(points).T
        return int(space.grid().are_free(x_m, x_m, y_m, y_m).sum())

    def _interior(self, field: Field) -> FloatArray:
        inner = [np.zeros((0, 2))]
        for polygon in field.polygons_m:
            weights = self.random.dirichlet(np.ones(len(polygon)), 20)
            inner.append(weights @ polygon)
        return np.concatenate(inner)


def _moved(pose: Pose, later_s: float) -> tuple[float, float, float]:
    (north, east, down), (vn, ve, vd) = pose.position_ned_m, pose.velocity_ned_mps
    return north + vn * later_s, east + ve * later_s, down + vd * later_s


def main(frames: int = 100_000, seed: int = 1) -> int:
    """Play frames and print what was found; the exit code tells whether the set was ever wrong."""
    adversary, wrong = Adversary(seed), 0
    for number in range(1, frames + 1):
        points = adversary.false_cells()
        if points:
            wrong += 1
            print(f"frame {number} of seed {seed}: {points} points of obstacles in free cells")
        if number % 5000 == 0 or number == frames:
            print(
                f"{number} frames, {adversary.freed / number:.0f} free cells a frame,"
                f" {adversary.contradictions} contradictions, {wrong} frames wrong",
                flush=True,
            )
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(*(int(argument) for argument in sys.argv[1:])))
