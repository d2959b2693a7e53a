"""Certifies a trajectory before it may be flown, independently of the planner.

Shares nothing with the planner but the trajectory itself, and is exact in continuous time:
piecewise-linear acceleration is extreme at the nodes, velocity and position at the roots of their
derivatives, and a piece enters a keep-out only between roots of the cubics of its motion relative
to the faces.  Nothing is sampled.

A failure is a sentence that names the clause, the amount, its unit and the time.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from onboard.contract.agility import GRAVITY_MPS2
from onboard.motion import polynomial
from onboard.motion.trajectory import X, Y, Z

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from onboard.geometry.box import Coefficients
    from onboard.geometry.frames import FloatArray
    from onboard.geometry.keep_out import KeepOut
    from onboard.motion.trajectory import State, Trajectory
    from onboard.planning.problem import AvoidanceProblem, Envelope

# Round-off, far below the margins of any contract.
POSITION_TOLERANCE_M = 1e-6
VELOCITY_TOLERANCE_MPS = 1e-6
ACCELERATION_TOLERANCE_MPS2 = 1e-6
JERK_TOLERANCE_MPS3 = 1e-5
TIME_TOLERANCE_S = 1e-6


@dataclass(frozen=True)
class Certificate:
    """The verdict on a trajectory.

    Attributes:
        failures: one sentence for each clause that does not hold; empty if the trajectory is safe.
    """

    failures: tuple[str, ...]

    @property
    def valid(self) -> bool:
        """Whether the trajectory may be flown."""
        return not self.failures


def certify_avoidance(trajectory: Trajectory, problem: AvoidanceProblem) -> Certificate:
    """Check a trajectory against everything that Eq. 17 and the contract ask of an avoidance."""
    findings = _Findings(trajectory)
    _check_start(findings, problem.start, problem.start_s, problem.envelope)
    _check_flyable(findings, problem.envelope)
    _check_region(findings, problem)
    _check_clear_of(findings, "keep-out box", problem.region.keep_out)
    for number, keep_out in enumerate(problem.further_keep_outs):
        _check_clear_of(findings, f"further keep-out {number}", keep_out)
    _check_exit(findings, problem)
    if problem.coast_time_s > 0.0:
        _check_coast(findings, problem)
    return findings.certificate()


def certify_clear(
    trajectory: Trajectory,
    start: State,
    start_s: float,
    envelope: Envelope,
    keep_out: Iterable[KeepOut] = (),
) -> Certificate:
    """Check a cruise or braking trajectory: it continues ``start``, can be flown, and hits nothing.

    The certificate ends with the last piece: the coast after it is not covered.  A braking
    trajectory ends at rest, where only what moves can still come.
    """
    findings = _Findings(trajectory)
    _check_start(findings, start, start_s, envelope)
    _check_flyable(findings, envelope)
    for number, each in enumerate(keep_out):
        _check_clear_of(findings, f"keep-out box {number}", each)
    return findings.certificate()


@dataclass
class _Findings:
    """Collects the failures of one trajectory."""

    trajectory: Trajectory
    failures: list[str] = field(default_factory=list)

    def certificate(self) -> Certificate:
        return Certificate(tuple(self.failures))

    def exceeds(self, clause: str, excess: float, tolerance: float, unit: str) -> None:
        """Record a clause whose excess is one number for the whole trajectory."""
        if not excess <= tolerance:
            self.failures.append(f"{clause} by {excess:.3g} {unit}")

    def exceeds_at(
        self, clause: str, excess: float, tolerance: float, unit: str, time_s: float
    ) -> None:
        """Record a clause whose excess happens at one time."""
        if not excess <= tolerance:
            self.failures.append(f"{clause} by {excess:.3g} {unit} at {time_s:.3f} s")

    def table_exceeds(
        self,
        clauses: Sequence[str],
        excess: FloatArray,
        tolerance: float,
        unit: str,
        times_s: Sequence[float],
    ) -> None:
        """Record the worst time of every clause of a table of excesses, (clauses, times)."""
        if (excess <= tolerance).all():
            return
        for clause, row in zip(clauses, excess, strict=True):
            worst = int(np.argmax(row))
            self.exceeds_at(clause, float(row[worst]), tolerance, unit, times_s[worst])


def _check_start(findings: _Findings, start: State, start_s: float, envelope: Envelope) -> None:
    """The plan continues what is being flown."""
    trajectory = findings.trajectory
    position_m, velocity_mps, acceleration_mps2, _ = (array[0] for array in trajectory.motion)
    offset_m = _largest(position_m - start.position_leg_m)
    offset_mps = _largest(velocity_mps - start.velocity_leg_mps)
    findings.exceeds(
        "start: late or early", abs(trajectory.start_s - start_s), TIME_TOLERANCE_S, "s"
    )
    findings.exceeds("start: position jumps", offset_m, POSITION_TOLERANCE_M, "m")
    findings.exceeds("start: velocity jumps", offset_mps, VELOCITY_TOLERANCE_MPS, "m/s")
    if envelope.jerk_is_limited:
        offset_mps2 = _largest(acceleration_mps2 - start.acceleration_leg_mps2)
        findings.exceeds(
            "start: acceleration jumps", offset_mps2, ACCELERATION_TOLERANCE_MPS2, "m/s²"
        )


def _check_flyable(findings: _Findings, envelope: Envelope) -> None:
    """Pieces join; jerk, tilt, thrust and speed stay within the envelope."""
    _check_joins(findings, envelope)
    trajectory = findings.trajectory
    jerk_excess = np.abs(trajectory.jerk_leg_mps3) - envelope.jerk_max_mps3
    clauses = [f"jerk limit on {axis} exceeded" for axis in "xyz"]
    starts_s = trajectory.knots_s[:-1]
    findings.table_exceeds(clauses, jerk_excess.T, JERK_TOLERANCE_MPS3, "m/s³", starts_s)
    _check_accelerations(findings, envelope)
    slowest_mps, fastest_mps = trajectory.velocity_range_mps(X)
    over_mps = fastest_mps - envelope.speed_max_mps
    findings.exceeds("reverses along the leg", -slowest_mps, VELOCITY_TOLERANCE_MPS, "m/s")
    findings.exceeds("speed limit exceeded", over_mps, VELOCITY_TOLERANCE_MPS, "m/s")


def _check_joins(findings: _Findings, envelope: Envelope) -> None:
    """Position and velocity are continuous, and acceleration too where jerk is limited."""
    quantities = [
        ("position", POSITION_TOLERANCE_M, "m"),
        ("velocity", VELOCITY_TOLERANCE_MPS, "m/s"),
    ]
    if envelope.jerk_is_limited:
        quantities.append(("acceleration", ACCELERATION_TOLERANCE_MPS2, "m/s²"))
    trajectory = findings.trajectory
    joins_s = trajectory.knots_s[1:-1]
    for (name, tolerance, unit), ends, starts in zip(
        quantities, trajectory.ends, trajectory.motion, strict=False
    ):
        gap = np.abs(ends[:-1] - starts[1:])
        clauses = [f"{name} jumps on {axis}" for axis in "xyz"]
        findings.table_exceeds(clauses, gap.T, tolerance, unit, joins_s)


def _check_accelerations(findings: _Findings, envelope: Envelope) -> None:
    """Tilt and thrust at both ends of every piece; in between they are less (convexity).

    |x| <= tan(theta) (g - z), inner |y| <= tan(phi) (g - z), |acceleration - g| <= T_max / m,
    each for the acceleration with the trim against the wind added (theory J).
    """
    trajectory = findings.trajectory
    x, y, z = np.concatenate((trajectory.acceleration_leg_mps2, trajectory.ends[2])).T
    w = envelope.limits
    lift = 1.0 - z / GRAVITY_MPS2
    thrust_mps2 = np.hypot(np.hypot(x, y) + envelope.trim_mps2, z - GRAVITY_MPS2)
    # W holds for level flight: what tilt gives shrinks with the lift, what wind takes does not.
    wind_mps2 = envelope.trim_mps2 * (1.0 - lift)
    clauses = {
        "braking limit exceeded": -x - w.brake_mps2 * lift + wind_mps2,
        "forward acceleration limit exceeded": x - w.forward_mps2 * lift + wind_mps2,
        "leftward acceleration limit exceeded": -y - w.left_mps2 * lift + wind_mps2,
        "rightward acceleration limit exceeded": y - w.right_mps2 * lift + wind_mps2,
        "thrust limit exceeded": thrust_mps2 - envelope.thrust_max_mps2,
    }
    findings.table_exceeds(
        list(clauses),
        np.array(list(clauses.values())),
        ACCELERATION_TOLERANCE_MPS2,
        "m/s²",
        trajectory.knots_s[:-1] + trajectory.knots_s[1:],
    )


def _check_region(findings: _Findings, problem: AvoidanceProblem) -> None:
    """The path stays in the lane, short of the post-obstacle border and in its height band."""
    region, trajectory = problem.region, findings.trajectory
    start_z_m = problem.start.position_leg_m[Z]
    ceiling_m = min(start_z_m, problem.cruise_z_m - problem.climb_m)
    floor_m = max(start_z_m, problem.cruise_z_m)
    hull_min_m = trajectory.control_points_m.min(axis=(0, 1)).tolist()
    hull_max_m = trajectory.control_points_m.max(axis=(0, 1)).tolist()
    for axis, low_clause, low_m, high_clause, high_m in (
        (X, "before the start", -math.inf, "beyond the post-obstacle border", region.x_pob_m),
        (Y, "left of the lane", region.lane_left_m, "right of the lane", region.lane_right_m),
        (Z, "above the height band", ceiling_m, "below the height band", floor_m),
    ):
        if low_m <= hull_min_m[axis] and hull_max_m[axis] <= high_m:
            continue
        min_m, max_m = trajectory.position_range_m(axis)
        findings.exceeds(low_clause, low_m - min_m, POSITION_TOLERANCE_M, "m")
        findings.exceeds(high_clause, max_m - high_m, POSITION_TOLERANCE_M, "m")


def _check_exit(findings: _Findings, problem: AvoidanceProblem) -> None:
    """The post-condition: at the border, at the exit speed, with nothing else going on."""
    final = findings.trajectory.final
    end_s = findings.trajectory.end_s
    speed_mps, lateral_mps, vertical_mps = final.velocity_leg_mps
    for clause, excess, tolerance, unit in (
        (
            "exit: away from the post-obstacle border",
            abs(final.position_leg_m[X] - problem.region.x_pob_m),
            POSITION_TOLERANCE_M,
            "m",
        ),
        (
            "exit: speed differs",
            abs(speed_mps - problem.exit_speed_mps),
            VELOCITY_TOLERANCE_MPS,
            "m/s",
        ),
        ("exit: lateral speed", abs(lateral_mps), VELOCITY_TOLERANCE_MPS, "m/s"),
        ("exit: vertical speed", abs(vertical_mps), VELOCITY_TOLERANCE_MPS, "m/s"),
    ):
        findings.exceeds_at(clause, excess, tolerance, unit, end_s)
    if problem.envelope.jerk_is_limited:
        still_accelerating_mps2 = max(abs(value) for value in final.acceleration_leg_mps2)
        findings.exceeds_at(
            "exit: still accelerating",
            still_accelerating_mps2,
            ACCELERATION_TOLERANCE_MPS2,
            "m/s²",
            end_s,
        )


def _check_coast(findings: _Findings, problem: AvoidanceProblem) -> None:
    """Passive safety (theory H): coast from any instant, then brake sideways inside the region."""
    w, room = problem.envelope.limits, problem.region.manoeuvre
    for name, sign, face_m, brake_mps2 in (
        ("right", 1.0, room.y_max_m, w.left_mps2),
        ("left", -1.0, -room.y_min_m, w.right_mps2),
    ):
        reach_m, time_s = _coast_reach(
            findings.trajectory, sign, problem.coast_time_s, brake_mps2, face_m
        )
        clause = f"coasting leaves the region to the {name}"
        findings.exceeds_at(clause, reach_m - face_m, POSITION_TOLERANCE_M, "m", time_s)


def _coast_reach(
    trajectory: Trajectory, sign: float, coast_time_s: float, brake_mps2: float, limit_m: float
) -> tuple[float, float]:
    """Farthest ``y + v c + v²/2d`` while v > 0 (all times ``sign``), and when.

    Pieces that cannot reach ``limit_m`` are passed over.
    """
    y_m, v_mps, a_mps2, j_mps3 = (sign * array[:, Y] for array in trajectory.motion)
    highest_m = (sign * trajectory.control_points_m[:, :, Y]).max(axis=1)
    t = trajectory.durations_s
    # Velocity is a quadratic: its Bernstein control points bound it.
    fastest_mps = np.maximum(
        np.maximum(v_mps, v_mps + a_mps2 * t / 2.0), sign * trajectory.ends[1][:, Y]
    ).clip(min=0.0)
    bound_m = highest_m + fastest_mps * (coast_time_s + fastest_mps / (2.0 * brake_mps2))
    reach_m, reach_s = -math.inf, trajectory.start_s
    for piece in np.flatnonzero(bound_m > limit_m).tolist():
        y, v, a, j = (float(array[piece]) for array in (y_m, v_mps, a_mps2, j_mps3))
        # Derivative of the reach: v + c a + v a / d.
        slope = (
            v + coast_time_s * a + v * a / brake_mps2,
            a + coast_time_s * j + (a * a + v * j) / brake_mps2,
            j / 2.0 + 1.5 * a * j / brake_mps2,
            j * j / (2.0 * brake_mps2),
        )
        duration_s = float(t[piece])
        for time_s in (0.0, *polynomial.roots(slope, duration_s), duration_s):
            speed_mps = polynomial.evaluate((v, a, j / 2.0), time_s)
            if speed_mps < 0.0:
                continue
            run_m = speed_mps * (coast_time_s + speed_mps / (2.0 * brake_mps2))
            here_m = polynomial.evaluate((y, v, a / 2.0, j / 6.0), time_s) + run_m
            if here_m > reach_m:
                reach_m, reach_s = here_m, trajectory.knots_s[piece] + time_s
    return reach_m, reach_s


def _check_clear_of(findings: _Findings, name: str, keep_out: KeepOut) -> None:
    """The path does not enter a keep-out; touching it is not entering."""
    trajectory = findings.trajectory
    # Where the keep-out may be at any time of the trajectory; exact if it does not move.
    swept = keep_out.swept(trajectory.start_s, trajectory.end_s)
    low_m = (swept.x_min_m + POSITION_TOLERANCE_M, swept.y_min_m + POSITION_TOLERANCE_M)
    high_m = (swept.x_max_m - POSITION_TOLERANCE_M, swept.y_max_m - POSITION_TOLERANCE_M)
    points_m = trajectory.control_points_m[:, :, :2]
    near = (points_m.min(axis=1) < high_m) & (points_m.max(axis=1) > low_m)
    for piece in np.flatnonzero(near.all(axis=1)).tolist():
        entry = _entry_of_piece(trajectory, piece, keep_out)
        if entry is not None:
            elapsed_s, depth_m = entry
            time_s = trajectory.knots_s[piece] + elapsed_s
            findings.failures.append(
                f"inside the {name} by at least {depth_m:.3g} m at {time_s:.3f} s"
            )
            return


def _entry_of_piece(
    trajectory: Trajectory, piece: int, keep_out: KeepOut
) -> tuple[float, float] | None:
    """When and how deep one piece is inside first: midway between two crossings of faces.

    Faces are polynomials of degree three or less, as positions are, so that a crossing is a root
    of their difference.
    """
    duration_s = float(trajectory.durations_s[piece])
    cubics = [trajectory.position_coefficients(piece, axis) for axis in (X, Y)]
    faces = keep_out.faces_from(trajectory.knots_s[piece])
    # Of each axis: the face that the inside is above, and the one that it is below.
    sides = (
        (X, 1.0, _moved(faces.x_min, POSITION_TOLERANCE_M)),
        (X, -1.0, _moved(faces.x_max, -POSITION_TOLERANCE_M)),
        (Y, 1.0, _moved(faces.y_min, POSITION_TOLERANCE_M)),
        (Y, -1.0, _moved(faces.y_max, -POSITION_TOLERANCE_M)),
    )
    crossings_s = {0.0, duration_s}
    for axis, _, face in sides:
        relative = [c - f for c, f in itertools.zip_longest(cubics[axis], face, fillvalue=0.0)]
        crossings_s.update(polynomial.roots(relative, duration_s))
    for before_s, after_s in itertools.pairwise(sorted(crossings_s)):
        middle_s = (before_s + after_s) / 2.0
        position_m = [polynomial.evaluate(coefficients, middle_s) for coefficients in cubics]
        depth_m = min(
            inwards * (position_m[axis] - polynomial.evaluate(face, middle_s))
            for axis, inwards, face in sides
        )
        if depth_m > 0.0:
            return middle_s, depth_m
    return None


def _moved(face: Coefficients, by_m: float) -> Coefficients:
    constant_m, *rates = face
    return (constant_m + by_m, *rates)


def _largest(difference: FloatArray) -> float:
    return float(np.abs(difference).max())
