"""A ring of OBSTACLE_DISTANCE as the view all round: its returns may move, and have no identity."""

from __future__ import annotations

import math
from random import Random
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from onboard.contract.assessment import assess
from onboard.files.contract_file import Contract
from onboard.files.sensor_sources import ObstacleDistanceSource
from onboard.mavlink.endpoint import TELEMETRY_RATE_HZ
from onboard.monitoring.assumptions import Assumption, Violation
from onboard.perception.movers.mover_free import MoverFree
from onboard.perception.movers.moving_detection import ReportsFrame, ReturnsFrame
from onboard.perception.sources.json_v1 import parse_frame
from onboard.perception.sources.mavlink_ranges import ObstacleDistanceInput
from onboard.perception.sources.sensor_input import PosesByStamp
from tests.onboard.monitoring.fake_flight import FakeFlight
from tests.onboard.monitoring.movers.test_mover_space import Scene, _json, against_movers, tree

PERIOD_S, LATENCY_S, SECTORS = 0.06, 0.04, 72  # three poses apart
NOTHING_CM, UNKNOWN_CM = 1401, 65535
SPEED_MPS = 1.5  # of `against_movers`


class Ring(Scene):
    """A vehicle at rest with a ring of sectors."""

    def __init__(self, flight: FakeFlight, **keys: Any) -> None:
        super().__init__(flight)
        stated: dict[str, Any] = {
            "kind": "obstacle_distance", "name": "ring", "range_m": 12.0, "uncertainty_m": 0.05,
            "height_band_m": (3.5, 3.5), "latency_s": LATENCY_S, "no_return_is_free_to_m": 12.0,
            "box_max_m": 2.0,
        }  # fmt: skip
        config = ObstacleDistanceSource.model_validate(stated | keys)
        self.input = ObstacleDistanceInput(config, PosesByStamp(self.poses, lambda: 0.0))

    def measure(self, centimetres: dict[int, int], others: int = NOTHING_CM) -> list[Violation]:
        """Take one message after a frame's time; return what it violates."""
        for _ in range(round(PERIOD_S * TELEMETRY_RATE_HZ)):
            self.now_s += 1.0 / TELEMETRY_RATE_HZ
            self.poses.add(self.pose)
        distances = [centimetres.get(index, others) for index in range(SECTORS)]
        message = mavlink.MAVLink_obstacle_distance_message(
            0, 0, distances, 5, 20, 1400, frame=mavlink.MAV_FRAME_BODY_FRD
        )
        payload = bytes(message.pack(mavlink.MAVLink(None, 1, 1)))
        found: list[Violation] = []
        for frame in self.input.read(payload, self.now_s):
            assert isinstance(frame, ReturnsFrame)
            stamp_s = frame.stamp_unix_s
            found += self.evaluator.evaluate(frame, stamp_s, self.now_s, self.heading)
        self.evaluator.seen.advance(self.pose, trusted=True)
        return found

    def claim(self, *obstacles: dict[str, Any]) -> None:
        """See what another sensor claims to stand still, which shows nothing free."""
        self.sequence += 1
        message = {
            "version": 2, "source": "front", "sequence": self.sequence, "frame": "local_ned",
            "stamp_unix_s": self.now_s, "range_m": 12.0, "field_of_view_deg": 120.0,
            "frame_complete": False, "obstacles": list(obstacles),
        }  # fmt: skip
        frame = parse_frame(_json(message))
        assert not list(self.evaluator.evaluate(frame, self.now_s, self.now_s, self.heading))
        self.evaluator.seen.advance(self.pose, trusted=True)

    @property
    def places(self) -> MoverFree:
        free = self.movers._free
        assert free is not None
        return free


def ring(contract: Contract, **keys: Any) -> Ring:
    return Ring(FakeFlight.under(against_movers(contract)), **keys)


def test_who_walks_up_from_behind_is_a_mover_of_class_unknown(contract: Contract) -> None:
    scene = ring(contract)
    for step in range(12):
        assert scene.measure({35: 600 - 7 * step, 36: 600 - 7 * step}) == []
    (track,) = scene.movers.tracks
    assert (track.kind, track.speed_max_mps) == ("unknown", SPEED_MPS)
    assert track.box.x_max_m == pytest.approx(-5.2, abs=0.2)
    assert len(scene.flight.obstacles) == 0
    # Between the vehicle and the person no other one can be, until the person may come.
    assert scene.is_free(-2.0, 0.0)
    assert scene.is_free(-2.0, 0.0, in_s=1.0)
    assert not scene.is_free(-2.0, 0.0, in_s=2.5)
    # Who is behind the person is unseen.
    assert not scene.is_free(-6.5, 0.0)
    assert scene.is_free(4.0, 0.0, in_s=1.5)
    assert scene.movers.check_ring(scene.now_s) is None


@pytest.mark.parametrize("holes", [range(30, 42), (36,)])
def test_a_hole_is_not_free_and_no_view_all_round(contract: Contract, holes: range) -> None:
    scene = ring(contract)
    for _ in range(8):
        scene.measure(dict.fromkeys(holes, UNKNOWN_CM))
    assert scene.is_free(3.0, 0.0)
    assert not scene.is_free(-3.0, 0.0)
    assert math.isinf(scene.movers.all_round_s)
    assert scene.movers.check_ring(scene.now_s) is not None


def test_what_returns_nothing_is_free_only_as_far_as_it_is_declared(contract: Contract) -> None:
    silent, declared = ring(contract, no_return_is_free_to_m=None), ring(contract)
    for scene in (silent, declared):
        for _ in range(6):
            scene.measure({})
    assert silent.places.free_cells(silent.now_s) == 0
    assert declared.is_free(5.0, 0.0)
    # The contract counts on 8 m of it.
    assert not declared.is_free(8.2, 0.0)


def test_a_sector_that_measured_nothing_leaves_open_who_is_near(contract: Contract) -> None:
    scene = ring(contract)
    for _ in range(6):
        scene.measure({36: 10})  # below the least distance: something is there, or not
    assert not scene.is_free(-0.4, 0.0)
    for _ in range(6):
        scene.measure({})
    assert scene.is_free(-0.4, 0.0)


def test_a_return_of_what_is_claimed_to_stand_still_is_no_mover(contract: Contract) -> None:
    scene = ring(contract)
    wall = tree(0.0, -4.0, size_m=[3.0, 0.6])  # to the left, 3.7 m away
    for _ in range(6):
        scene.claim(wall)
        assert scene.measure({54: 372}) == []
    assert len(scene.movers.tracks) == 0
    for _ in range(2):
        scene.claim(wall)
        scene.measure({54: 372, 36: 400, 63: 372})
    tracks = [track.box for track in scene.movers.tracks]
    # Behind, and beside the wall.
    assert len(tracks) == 2
    assert min(box.x_max_m for box in tracks) < -3.5


def test_returns_have_no_identity_that_could_break_an_assumption(contract: Contract) -> None:
    scene = ring(contract)
    noise = Random(1)
    sectors = [30, 36, 42]
    for _ in range(30):
        # Three who stand still, of whom any two are seen, or merge into one return.
        seen = dict.fromkeys(noise.sample(sectors, 2), 500) | {36: noise.choice((500, 505))}
        assert scene.measure(seen) == []
    assert 2 <= len(scene.movers.tracks) <= 3


def test_a_return_where_no_mover_can_be_is_a_late_first_sight(contract: Contract) -> None:
    scene = ring(contract)
    for _ in range(8):
        assert scene.measure({}) == []
    (late,) = scene.measure({36: 300})
    assert late.assumption is Assumption.MOVER_FIRST_SIGHT


def test_the_age_of_a_ring_counts_from_the_earliest_measurement(contract: Contract) -> None:
    """A sector may have been measured at any time from the stamp to the arrival."""
    slow, quick = ring(contract, latency_s=0.2), ring(contract, latency_s=0.0)
    for scene in (slow, quick):
        for _ in range(12):
            scene.measure({36: 600})
    left_s = [
        next(s for s in np.arange(0.0, 6.0, 0.01) if not scene.is_free(2.0, 0.0, in_s=float(s)))
        for scene in (slow, quick)
    ]
    # Cells have to be shown over several frames, which takes a little more.
    assert 0.2 <= left_s[1] - left_s[0] < 0.5


@pytest.mark.parametrize(("seed", "faster"), [(2, 1.0), (1, 2.0)])
def test_no_mover_of_declared_speed_is_ever_where_none_can_be(
    contract: Contract, seed: int, faster: float
) -> None:
    """Random walkers; each sector is measured at a time of its own within the latency.

    Those that are faster than declared show that it can fail.
    """
    scene, noise = ring(contract), Random(seed)
    places = [(noise.uniform(3.0, 11.0), noise.uniform(-math.pi, math.pi)) for _ in range(3)]
    walkers = [np.array((r * math.cos(a), r * math.sin(a))) for r, a in places]
    courses = [noise.uniform(-math.pi, math.pi) for _ in walkers]
    wrong = checked = 0
    for _ in range(36):
        before = [walker.copy() for walker in walkers]
        for index, walker in enumerate(before):
            courses[index] += noise.gauss(0.0, 0.6)
            if np.hypot(*walker) < 1.0:  # away from the vehicle
                courses[index] = math.atan2(walker[1], walker[0])
            turned = np.array((math.cos(courses[index]), math.sin(courses[index])))
            walkers[index] = walker + faster * SPEED_MPS * PERIOD_S * turned
        scene.measure(_sectors_cm(before, walkers, noise))
        for walker in walkers:
            for ahead_s in (0.0, 0.4, 1.2):
                # Straight on towards the vehicle.
                away_m = max(float(np.hypot(*walker)), 1e-6)
                left = max(1.0 - faster * SPEED_MPS * ahead_s / away_m, 0.0)
                north_m, east_m = (left * walker).tolist()
                wrong += scene.is_free(north_m, east_m, in_s=ahead_s - 0.011)
        checked += scene.places.free_cells(scene.now_s) > 500
    assert checked > 25
    assert (wrong > 0) is (faster > 1.0)


def _sectors_cm(before: list[Any], after: list[Any], noise: Random) -> dict[int, int]:
    """Return what discs of 0.5 m return in each sector, measured within the latency."""
    found: dict[int, int] = {}
    for sector in range(SECTORS):
        # One period lies between both places; the latency is less.
        share = 1.0 - noise.random() * LATENCY_S / PERIOD_S
        rays_rad = math.radians(5.0 * sector) + np.radians(np.linspace(-2.5, 2.5, 11))
        for one, other in zip(before, after, strict=True):
            here = one + share * (other - one)
            along_m = here[0] * np.cos(rays_rad) + here[1] * np.sin(rays_rad)
            aside_m = here[1] * np.cos(rays_rad) - here[0] * np.sin(rays_rad)
            meets = (along_m > 0.0) & (np.abs(aside_m) < 0.25)
            if meets.any():
                at_m = (along_m[meets] - np.sqrt(0.0625 - aside_m[meets] ** 2)).min()
                if 0.2 <= at_m < 14.0:
                    found[sector] = min(found.get(sector, NOTHING_CM), int(100.0 * at_m))
    return found


def report(scene: Ring, north_m: float, age_s: float, error_m: float = 3.0) -> list[Violation]:
    """Have another vehicle report itself, by its own position."""
    frame = ReportsFrame.model_validate(
        {
            "version": 2, "source": "traffic", "sequence": 1, "stamp_unix_s": scene.now_s - age_s,
            "frame": "local_ned", "range_m": 200.0, "field_of_view_deg": 360.0,
            "obstacles": [
                {"id": "system-7", "center_m": (north_m, 0.0), "size_m": (0.0, 0.0),
                 "yaw_deg": 0.0, "uncertainty_m": error_m, "class": "person"}
            ],
        }
    )  # fmt: skip
    stamp_s = frame.stamp_unix_s
    return list(scene.evaluator.evaluate(frame, stamp_s, scene.now_s, scene.heading))


def test_a_report_adds_a_mover_that_shows_nothing_and_is_forgotten(contract: Contract) -> None:
    scene = ring(contract)
    for _ in range(4):
        assert scene.measure({}) == []
    free, sensors = scene.places.free_cells(scene.now_s), set(scene.evaluator.monitor.sensors)
    assert report(scene, 30.0, age_s=1.0) == []
    (track,) = scene.movers.tracks
    # Its size, its error whichever way it is turned, and how far it may have come since.
    box = track.predicted(scene.now_s)
    assert box.x_min_m == pytest.approx(30.0 - 4.0 * math.sqrt(2.0) - 1.5, abs=0.01)
    assert scene.places.free_cells(scene.now_s) == free
    assert scene.movers.all_round_s == pytest.approx(scene.now_s - LATENCY_S)
    # No flight relies on who reports: silence is no absence.
    assert set(scene.evaluator.monitor.sensors) == sensors
    assert len(scene.flight.obstacles) == 0
    scene.now_s += 3.8
    scene.measure({})
    assert len(scene.movers.tracks) == 1
    scene.now_s += 0.2
    scene.measure({})
    assert len(scene.movers.tracks) == 0


def test_reports_alone_are_no_view_all_round(contract: Contract) -> None:
    scene = ring(contract)
    for _ in range(5):
        report(scene, 30.0, age_s=0.0)
    assert math.isinf(scene.movers.all_round_s)
    assert scene.places.free_cells(scene.now_s) == 0
    assert report(scene, 30.0, age_s=-1.0) == []  # from the future
    assert len(scene.movers.tracks) == 1


def test_the_contract_of_these_tests_declares_a_ring(contract: Contract) -> None:
    assert assess(against_movers(contract)).terms.all_round_range_m == 8.0
