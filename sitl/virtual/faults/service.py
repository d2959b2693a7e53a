"""Faults of the onboard service's process, and of the operator who commands it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

from onboard.autonomy import Autonomy
from onboard.files.mission_file import Mission
from onboard.planning.plan import Plan
from onboard.planning.problem import AvoidanceProblem
from onboard.planning.qp.search import QpPlanner
from onboard.recording.writer_thread import StopOnFirstError
from sitl.virtual.faults.schedule import FaultSchedule
from sitl.virtual.faults.schema import FaultKind
from sitl.virtual.scripted_operator import Operator

# A file that Linux always finds full; where it does not exist, writing to it fails as well.
FULL_DISK: Final = Path("/dev/full")
KINDS: Final[frozenset[FaultKind]] = frozenset(
    (
        "tick_stall",
        "solver_limited",
        "daemon_dead",
        "disk_full",
        "operator_takes_over",
        "mission_changed",
        "operator_resumes",
    )
)


class LimitedQp(QpPlanner):
    """Find no optimum within its iterations while it is limited."""

    limited = False

    def plan(
        self,
        problem: AvoidanceProblem,
        current: Plan | None,
        incumbent: Plan | None,
        reasons: list[str],
    ) -> Plan | None:
        """Return what is flown already; see `QpPlanner.plan`."""
        if self.limited:
            reasons.append("no QP was solved within its iterations")
            return incumbent
        return super().plan(problem, current, incumbent, reasons)


class ServiceFaults:
    """Apply the faults of the service's process and of the operator.

    Args:
        schedule: what is present.
        mission: the one that the service flies.

    Attributes:
        solver: the planner's, which `apply` limits.
    """

    def __init__(self, schedule: FaultSchedule, mission: Mission) -> None:
        self.solver = LimitedQp()
        self._schedule = schedule
        self._mission = mission
        self._mission_changed = self._resumed = False
        self._log = StopOnFirstError()

    @property
    def dead(self) -> bool:
        """Whether the service's process does not run."""
        return self._schedule.present("daemon_dead")

    @property
    def stalled(self) -> bool:
        """Whether the service misses its ticks."""
        return self._schedule.present("tick_stall")

    @property
    def waits_to_resume(self) -> bool:
        """Whether the operator means to end a hold, and has not tried yet."""
        planned = any(fault.kind == "operator_resumes" for fault in self._schedule.faults)
        return planned and not self._resumed

    def apply(self) -> None:
        """Limit the solver, or release it."""
        self.solver.limited = self._schedule.present("solver_limited")

    def command(self, operator: Operator) -> None:
        """Have the operator take the vehicle over, or hand it back."""
        if self._schedule.present("operator_takes_over"):
            operator.take_over()
        else:
            operator.hand_back()

    def before_tick(
        self, autonomy: Autonomy, position_ned_m: tuple[float, float, float], now_s: float
    ) -> None:
        """Fill the disk, end a hold and change the mission, where these faults are present.

        Args:
            autonomy: the service.
            position_ned_m: of the vehicle.
            now_s: time.
        """
        self._fill_disk(autonomy, now_s)
        if self._schedule.present("operator_resumes") and not self._resumed:
            self._resumed = True
            # The events of the flight say whether it was accepted.
            autonomy.receive_resume(lambda _: None)
        turn_deg = self._schedule.amount("mission_changed")
        if turn_deg is None or self._mission_changed:
            return
        self._mission_changed = True
        mission = turned(self._mission, position_ned_m[:2], math.radians(turn_deg))
        autonomy.receive_mission(mission.model_dump_json().encode(), now_s)

    def _fill_disk(self, autonomy: Autonomy, now_s: float) -> None:
        """End the log when the disk is full; simulation shortcut: until then no log is written."""
        if self._schedule.present("disk_full"):
            self._log.run(_write_to_full_disk)
        if self._log.failure is not None:
            autonomy.report_log_end(self._log.failure, now_s)


def _write_to_full_disk() -> None:
    FULL_DISK.write_text("a line", encoding="ascii")


def turned(mission: Mission, here_ned_m: tuple[float, float], turn_rad: float) -> Mission:
    """Return a mission of one leg: what is left of the last one, turned to the right about here."""
    last = mission.legs[-1]
    (north_m, east_m), (end_north_m, end_east_m) = here_ned_m, last.end_ned_m
    left_m = math.dist(here_ned_m, last.end_ned_m)
    heading_rad = math.atan2(end_east_m - east_m, end_north_m - north_m) + turn_rad
    end_ned_m = (north_m + left_m * math.cos(heading_rad), east_m + left_m * math.sin(heading_rad))
    leg = last.model_copy(update={"end_ned_m": end_ned_m})
    return mission.model_copy(update={"start_ned_m": here_ned_m, "legs": (leg,)})
