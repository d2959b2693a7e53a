"""The true obstacles of a simulated flight, from the metadata of its ground truth."""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np

from gcs_tools.logs.flight_log import Log
from onboard.geometry.frames import FloatArray
from onboard.recording.messages import StateRecord

# Obstacles farther from the flight than this are not drawn.
_AROUND_M = 20.0
_SIGNS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


def true_outlines_ned_m(truth: Log, states: Sequence[StateRecord]) -> list[list[list[float]]]:
    """Return the corners of each true obstacle near a flight; none of a real flight.

    Args:
        truth: the simulation's log.
        states: of the flight.
    """
    try:
        arrays = {name: json.loads(text) for name, text in truth.metadata["field"].items()}
        centers_m = np.array(arrays["center_ned_m"], np.float64).reshape(-1, 2)
        halves_m = np.array(arrays["half_size_m"], np.float64).reshape(len(centers_m), 2)
        yaws_rad = np.array(arrays["yaw_rad"], np.float64).reshape(len(centers_m))
        outlines_m = _corners(centers_m, halves_m, yaws_rad)
    except (KeyError, ValueError, TypeError):
        return []  # of another version
    known = [state.position_ned_m[:2] for state in states if state.position_ned_m]
    flown_m = np.array(known or [(0.0, 0.0)])
    low_m, high_m = flown_m.min(axis=0) - _AROUND_M, flown_m.max(axis=0) + _AROUND_M
    near = ((centers_m >= low_m) & (centers_m <= high_m)).all(axis=1)
    near &= np.isfinite(outlines_m).all(axis=(1, 2))
    outlines: list[list[list[float]]] = outlines_m[near].round(3).tolist()
    return outlines


def _corners(centers_m: FloatArray, halves_m: FloatArray, yaws_rad: FloatArray) -> FloatArray:
    """Return the corners of N boxes; (N, 2), (N, 2), (N,) -> (N, 4, 2)."""
    cosine, sine = np.cos(yaws_rad), np.sin(yaws_rad)
    turn = np.stack([np.stack([cosine, -sine], axis=1), np.stack([sine, cosine], axis=1)], axis=1)
    corners: FloatArray = centers_m[:, None] + np.einsum(
        "nij,nkj->nki", turn, halves_m[:, None] * _SIGNS
    )
    return corners
