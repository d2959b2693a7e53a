"""Motion on one axis in two phases, as a cubic B-spline with few degrees of freedom.

A phase of `PIECES` pieces leads up to the *crossing*, where the vehicle gets clear of the
obstacle, another one to the end.  The crossing is a knot, so that what holds before it and what
holds after it never share a piece.  Everything is dimensionless: time in mean pieces of the first
phase, h; acceleration in units of the largest limit, A; hence velocity in A h, length in A h²,
jerk in A / h.  The matrices depend only on the ratio of the durations of the two phases and on
the growth of their pieces, and are computed once.

The start (position 0, velocity, acceleration) and the end (velocity, at rest in acceleration,
position free) are built into the control points and need no equality rows.

Notation:

====  ======================================================================
N     pieces in all
c     control points, N + 3: c = F z + G p
z     free variables, N - 2: control points 3 to N - 1, and the end position
p     parameters: velocity and acceleration at the start, velocity at the end
P     z^T P z / 2 + (K p)^T z + ... = integral of the squared acceleration / 2
R     rows: accelerations at nodes, jerks, velocity control points, crossing
====  ======================================================================
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from onboard.geometry.frames import FloatArray

PIECES = 12
TOTAL_PIECES = 2 * PIECES
FREE = TOTAL_PIECES - 2
END_POSITION = FREE - 1

# Rows: accelerations at inner nodes; jerks; velocity control points that are not fixed by start
# and end, those before the crossing and those that govern what follows it; position at the
# crossing and at the end.
ROW_COUNTS = (TOTAL_PIECES - 1, TOTAL_PIECES, PIECES - 2, PIECES, 1, 1)
ROWS = sum(ROW_COUNTS)
END_ROW = ROWS - 1
CROSSING_ROW = END_ROW - 1


@dataclass(frozen=True, eq=False)
class TwoPhaseSpline:
    """The matrices for one ratio of durations.

    Attributes:
        hessian: P, (FREE, FREE).
        gradient_from_parameters: K, (FREE, 3).
        energy_of_parameters: what the parameters cost with z = 0, (3, 3).
        rows: R F, (ROWS, FREE).
        rows_from_parameters: R G, (ROWS, 3).
        node_accelerations: accelerations at all N + 1 nodes from z, (N + 1, FREE).
        node_accelerations_from_parameters: and from p, (N + 1, 3).
        durations: length of each piece, (N,).
    """

    hessian: FloatArray
    gradient_from_parameters: FloatArray
    energy_of_parameters: FloatArray
    rows: FloatArray
    rows_from_parameters: FloatArray
    node_accelerations: FloatArray
    node_accelerations_from_parameters: FloatArray
    durations: FloatArray

    @classmethod
    def with_ratio(cls, ratio: float, growth: float = 1.0) -> TwoPhaseSpline:
        """Compute the matrices.

        Args:
            ratio: duration of the second phase over that of the first.
            growth: length of each piece over that of the one before, in either phase; above 1
                where the action is at the beginning of a phase, and long waits follow.
        """
        lengths = growth ** np.arange(PIECES)
        lengths *= PIECES / lengths.sum()
        durations = np.concatenate((lengths, ratio * lengths))
        # Three more knots at either end, which only shape the basis.
        steps = np.concatenate((np.full(3, durations[0]), durations, np.full(3, durations[-1])))
        knots = np.concatenate(([0.0], np.cumsum(steps))) - 3.0 * durations[0]
        velocity = _difference_matrix(knots, degree=3)
        acceleration = _difference_matrix(knots[1:-1], degree=2) @ velocity
        jerk = _difference_matrix(knots[2:-2], degree=1) @ acceleration
        points_from_free, points_from_parameters = _control_points(knots)
        rows = np.vstack(
            (
                acceleration[1:-1],
                jerk,
                velocity[2:-2],
                _basis_at_knot(knots, PIECES),
                _basis_at_knot(knots, TOTAL_PIECES),
            )
        )
        gram = _gram_matrix(durations)
        nodes_from_free = acceleration @ points_from_free
        nodes_from_parameters = acceleration @ points_from_parameters
        hessian = nodes_from_free.T @ gram @ nodes_from_free
        free_rows = rows @ points_from_free
        return cls(
            hessian=hessian,
            gradient_from_parameters=nodes_from_free.T @ gram @ nodes_from_parameters,
            energy_of_parameters=nodes_from_parameters.T @ gram @ nodes_from_parameters,
            rows=free_rows,
            rows_from_parameters=rows @ points_from_parameters,
            node_accelerations=nodes_from_free,
            node_accelerations_from_parameters=nodes_from_parameters,
            durations=durations,
        )

    def accelerations(self, free: FloatArray, parameters: FloatArray) -> FloatArray:
        """Accelerations at the N + 1 nodes, linear in between."""
        nodes: FloatArray = (
            self.node_accelerations @ free + self.node_accelerations_from_parameters @ parameters
        )
        return nodes


def _difference_matrix(knots: FloatArray, degree: int) -> FloatArray:
    """Control points of a B-spline's derivative from those of the spline."""
    count = len(knots) - degree - 1
    weights = degree / (knots[1 + degree : count + degree] - knots[1:count])
    matrix: FloatArray = weights[:, None] * (np.eye(count - 1, count, 1) - np.eye(count - 1, count))
    return matrix


def _basis_at_knot(knots: FloatArray, piece: int) -> FloatArray:
    """Values of the cubic basis functions at the start of a piece (Cox-de Boor)."""
    at = knots[piece + 3]
    basis = np.zeros(len(knots) - 1)
    basis[piece + 3] = 1.0
    for degree in (1, 2, 3):
        count = len(knots) - degree - 1
        rising = (at - knots[:count]) / (knots[degree : degree + count] - knots[:count])
        falling = (knots[degree + 1 :] - at) / (knots[degree + 1 :] - knots[1 : count + 1])
        basis = rising * basis[:count] + falling * basis[1 : count + 1]
    return basis


def _control_points(knots: FloatArray) -> tuple[FloatArray, FloatArray]:
    """F and G: control points from the free variables and from the parameters.

    The control points of a polynomial are its blossom at three neighbouring knots: their mean
    for the time t itself, the mean of their products for its square.
    """
    count = TOTAL_PIECES + 3
    from_free, from_parameters = np.zeros((count, FREE)), np.zeros((count, 3))
    from_free[3 : count - 3, :END_POSITION] = np.eye(count - 6)
    from_free[-3:, END_POSITION] = 1.0
    t1, t2, t3 = knots[1:4], knots[2:5], knots[3:6]
    from_parameters[:3, 0] = (t1 + t2 + t3) / 3.0
    from_parameters[:3, 1] = (t1 * t2 + t1 * t3 + t2 * t3) / 6.0
    t1, t2, t3 = knots[-6:-3], knots[-5:-2], knots[-4:-1]
    from_parameters[-3:, 2] = (t1 + t2 + t3) / 3.0 - knots[-4]
    return from_free, from_parameters


def _gram_matrix(durations: FloatArray) -> FloatArray:
    """Integral of the product of two piecewise-linear functions, from their nodes."""
    diagonal = (np.append(durations, 0.0) + np.insert(durations, 0, 0.0)) / 3.0
    gram: FloatArray = (
        np.diag(diagonal) + np.diag(durations / 6.0, 1) + np.diag(durations / 6.0, -1)
    )
    return gram
