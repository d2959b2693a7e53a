"""A navigator without a service: its vehicle follows the setpoints exactly, obstacles are added."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Final

from onboard.contract.assessment import TICK_S, assess
from onboard.events import Event
from onboard.files.contract_file import Contract
from onboard.files.mission_file import Mission
from onboard.guidance.navigator import Navigator
from onboard.guidance.phases import FlightState
from onboard.monitoring.assumptions import Assumption, Violation
from onboard.motion.trajectory import State
from onboard.perception.obstacle_map import Obstacle
from onboard.planning.plan import NoPlan, Plan
from onboard.planning.planner import Planner
from onboard.planning.problem import AvoidanceProblem
from onboard.vehicle_state import Pose

ALTITUDE_M: Final = 4.0
# A failed assumption that no contract states in numbers: the response is to brake.
DEFECT: Final = Violation(Assumption.SELF_CHECK, 1.0, 0.0, "exceptions")


def mission_to(
    *ends_ned_m: tuple[float, float], altitude_m: float = ALTITUDE_M, half_width_m: float = 8.0
) -> Mission:
    legs = [{"end_ned_m": end_m, "target_half_width_m": half_width_m} for end_m in ends_ned_m]
    return Mission.model_validate({"altitude_m": altitude_m, "legs": legs})


def pose_at(
    north_m: float = 0.0,
    east_m: float = 0.0,
    down_m: float = -ALTITUDE_M,
    *,
    velocity_ned_mps: tuple[float, float, float] = (0.0, 0.0, 0.0),
    yaw_rad: float = 0.0,
) -> Pose:
    return Pose(0.0, (north_m, east_m, down_m), velocity_ned_mps, 0.0, 0.0, yaw_rad)


class CountingPlanner(Planner):
    """A planner that can be told to find nothing, and remembers what it was asked.

    Attributes:
        problems: in order.
        failing: find no plan.
        exit_max_mps: find no plan with a higher exit speed.
    """

    def __init__(self) -> None:
        super().__init__()
        self.problems: list[AvoidanceProblem] = []
        self.failing, self.exit_max_mps = False, math.inf

    def plan(self, problem: AvoidanceProblem, current: Plan | None = None) -> Plan | NoPlan:
        self.problems.append(problem)
        if self.failing or problem.exit_speed_mps > self.exit_max_mps:
            return NoPlan(("told to fail",))
        return super().plan(problem, current)


class PerfectFlight:
    """A navigator, and a vehicle that is where its setpoints are.

    Args:
        contract: to fly under.
        mission: to fly.
        adaptive: as for the navigator.
    """

    def __init__(self, contract: Contract, mission: Mission, *, adaptive: bool = True) -> None:
        self.planner = CountingPlanner()
        self.watch_s = 0.0
        self.navigator = Navigator(
            assess(contract, mission_altitude_m=mission.altitude_m),
            mission,
            self.planner,
            self._stopwatch,
            adaptive=adaptive,
        )
        self.situation = self.navigator.situation
        self.now_s = 0.0
        self.pose = pose_at(*mission.start_ned_m)
        self.states: list[FlightState] = []
        self.events: list[Event] = []

    def _stopwatch(self) -> float:
        self.watch_s += 0.25
        return self.watch_s

    @property
    def state(self) -> FlightState:
        return self.navigator.state

    @property
    def reference(self) -> State:
        state = self.navigator.reference(self.now_s)
        assert state is not None
        return state

    def depart(self) -> None:
        self.navigator.take_control(self.pose, self.now_s)
        self._note()

    def tick(self) -> None:
        self.now_s += TICK_S
        self.navigator.advance(self.pose, self.now_s)
        self._note()
        setpoint = self.navigator.setpoint(self.now_s)
        if setpoint is not None:
            self.pose = Pose(self.now_s, *setpoint[:2], 0.0, 0.0, setpoint.yaw_ned_rad)

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        for _ in range(round(seconds / TICK_S)):
            self.tick()
            if until():
                return

    def run_until(self, *states: FlightState, seconds: float = 60.0) -> None:
        """Fly until one of some states is reached.

        Raises:
            AssertionError: it is not, in that time.
        """
        self.run(seconds, until=lambda: self.state in states)
        assert self.state in states, self.states

    def states_to_arrival(self) -> Iterator[State]:
        """Fly on, and yield the reference of each tick until the mission is flown.

        Raises:
            AssertionError: it is not within two minutes.
        """
        while self.state is not FlightState.ARRIVED:
            assert self.now_s < 120.0, self.states
            self.tick()
            yield self.reference

    def cruise_at_full_speed(self) -> None:
        self.depart()
        speed_mps = self.navigator.assessment.terms.cruise_speed_mps
        self.run(12.0, until=lambda: self.reference.velocity_leg_mps[0] > speed_mps - 1e-6)
        assert self.state is FlightState.CRUISING

    def avoid(self, x_m: float = 25.0, y_m: float = 0.2) -> Obstacle:
        """Fly until the avoidance of a box of 1 m has begun and its plan is flown."""
        obstacle = self.see(x_m, y_m)
        self.cruise_at_full_speed()
        self.run_until(FlightState.AVOIDING)
        self.run(0.1)
        return obstacle

    def see(
        self,
        x_m: float,
        y_m: float,
        *,
        size_m: tuple[float, float] = (1.0, 1.0),
        name: str = "1",
        error_m: float = 0.05,
    ) -> Obstacle:
        """Add a measurement of a box with its centre in the leg frame, as the intake does."""
        half_x_m, half_y_m = size_m[0] / 2.0, size_m[1] / 2.0
        corners = [
            self.navigator.leg.position_ned((x_m + x * half_x_m, y_m + y * half_y_m, 0.0))[:2]
            for x, y in ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))
        ]
        changed = self.navigator.obstacles.add(f"front/{name}", corners, error_m)
        obstacle = self.navigator.obstacles.of_track(f"front/{name}")
        assert obstacle is not None
        if changed:
            self.navigator.recheck_plan(obstacle, self.now_s)
        return obstacle

    def texts(self, name: str) -> list[str]:
        return [
            event.text for event in (*self.events, *self.navigator.events) if event.name == name
        ]

    def _note(self) -> None:
        if not self.states or self.states[-1] is not self.state:
            self.states.append(self.state)
        self.events += self.navigator.events
        self.navigator.events.clear()
