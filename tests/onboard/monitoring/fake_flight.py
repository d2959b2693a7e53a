"""A flight that records what the monitors have it do."""

from __future__ import annotations

from dataclasses import dataclass, field

from onboard.contract.assessment import Assessment, assess
from onboard.files.contract_file import Contract
from onboard.geometry.frames import LegFrame, Vector
from onboard.monitoring.assumptions import Assumption, Violation
from onboard.motion.trajectory import State
from onboard.perception.obstacle_map import Obstacle, ObstacleMap
from onboard.vehicle_state import Pose

NORTH_LEG = LegFrame((0.0, 0.0, -4.0), 0.0)
AT_START = State((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


@dataclass
class FakeFlight:
    """Implements `SupervisedFlight`; by default it cruises at rest at the start of a leg north.

    Attributes:
        stops: whether the first response ends the flight, as braking does.
        answers, shifts, hovers, rechecks, flown_on: what it was told.
    """

    assessment: Assessment
    obstacles: ObstacleMap
    leg: LegFrame = NORTH_LEG
    flying: bool = True
    moving: bool = True
    cruising_freely: bool = True
    in_seen_space: bool = False
    state: State | None = AT_START
    stops: bool = False
    to_meet: list[str] = field(default_factory=list)
    answers: list[tuple[Violation, Pose | None]] = field(default_factory=list)
    shifts: list[Vector] = field(default_factory=list)
    hovers: list[Pose] = field(default_factory=list)
    rechecks: list[str] = field(default_factory=list)
    flown_on: list[Violation] = field(default_factory=list)

    @classmethod
    def under(cls, contract: Contract, *, merged_size_max_m: float = 0.0) -> FakeFlight:
        """Return a flight under a contract, nothing seen yet."""
        assessment = assess(contract, "inner", mission_altitude_m=4.0)
        return cls(assessment, ObstacleMap(NORTH_LEG, assessment.region_around, merged_size_max_m))

    def hover(self) -> None:
        self.flying = self.moving = self.cruising_freely = False

    def stand_by(self) -> None:
        self.hover()
        self.state = None

    @property
    def pointing_rad(self) -> float | None:
        return self.leg.heading_rad if self.moving else None

    @property
    def answered(self) -> list[Assumption]:
        return [violation.assumption for violation, _ in self.answers]

    def reference(self, time_s: float) -> State | None:  # noqa: ARG002
        return self.state

    def obstacles_to_meet(self, now_s: float) -> list[Obstacle]:  # noqa: ARG002
        met = [self.obstacles.of_track(track_id) for track_id in self.to_meet]
        return [obstacle for obstacle in met if obstacle is not None]

    def respond_to(
        self,
        violation: Violation,
        now_s: float,  # noqa: ARG002
        measured: Pose | None = None,
    ) -> None:
        self.answers.append((violation, measured))
        if self.stops:
            self.hover()

    def recheck_plan(self, obstacle: Obstacle, now_s: float) -> None:  # noqa: ARG002
        self.rechecks.append(obstacle.id)

    def shift(self, shift_ned_m: Vector) -> None:
        self.shifts.append(shift_ned_m)

    def fly_on_after_shift(self, violation: Violation, now_s: float) -> None:  # noqa: ARG002
        self.flown_on.append(violation)

    def hover_at(self, pose: Pose, now_s: float) -> None:  # noqa: ARG002
        self.hovers.append(pose)
