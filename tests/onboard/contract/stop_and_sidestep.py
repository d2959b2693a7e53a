"""A slow simulator of stopping and sidestepping: it integrates, and knows none of the formulas.

A reference flies along x, stops in front of a region's obstacle, moves beside it and goes on.  The
vehicle is anywhere within its tracking error of the reference; wherever the stream of setpoints
stops, the autopilot flies on by a loop of its own.  Leg frame; speeds along x are never negative.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from onboard.contract.region import RegionOfInfluence
from onboard.geometry.box import Box
from onboard.geometry.frames import FloatArray

STEP_S = 0.01
LONGEST_S = 400.0


@dataclass(frozen=True)
class FliesOn:
    """A loop that goes on to the last setpoint: its gains, and the lag of the vehicle."""

    gain_per_s: float
    velocity_gain_per_s: float
    lag_s: float

    def places_m(self, states: FloatArray) -> Iterator[FloatArray]:
        """Command the last speed, what its acceleration is worth, and what the place is off."""
        places_m, speeds_mps = states[:, 0:2].copy(), states[:, 2:4].copy()
        forward_mps = states[:, 2:4] + states[:, 4:6] / self.velocity_gain_per_s
        for _ in range(round(8.0 / STEP_S)):
            commanded_mps = forward_mps + self.gain_per_s * (states[:, 0:2] - places_m)
            speeds_mps += (commanded_mps - speeds_mps) / self.lag_s * STEP_S
            places_m += speeds_mps * STEP_S
            yield places_m


@dataclass(frozen=True)
class Coasts:
    """Goes on with the last acceleration, does nothing for the lag, then brakes."""

    held_s: float
    lag_s: float
    brake_mps2: float

    def places_m(self, states: FloatArray) -> Iterator[FloatArray]:
        """Integrate the last setpoint, then bring the speed to nothing where it points."""
        places_m, speeds_mps = states[:, 0:2].copy(), states[:, 2:4].copy()
        held, braking = round(self.held_s / STEP_S), round((self.held_s + self.lag_s) / STEP_S)
        number = 0
        while number < braking or float(np.abs(speeds_mps).max()) > 0.0:
            number += 1
            before_mps = speeds_mps.copy()
            if number <= held:
                speeds_mps += states[:, 4:6] * STEP_S
            elif number > braking:
                length_mps = np.hypot(*speeds_mps.T)[:, np.newaxis]
                less_mps = np.maximum(length_mps - self.brake_mps2 * STEP_S, 0.0)
                speeds_mps *= less_mps / np.maximum(length_mps, 1e-9)
            places_m += (before_mps + speeds_mps) / 2.0 * STEP_S
            yield places_m


@dataclass(frozen=True)
class Vehicle:
    """What is flown.

    Attributes:
        speed_mps, brake_mps2, forward_mps2, lateral_mps2: limits of the reference.
        dead_s: from a command to an acceleration of the reference, as late as the contract allows.
        reaction_s: from the front of a region to the command.
        kappa_s, c_s2: a sidestep keeps to these for its run, speed and acceleration; 0 without.
        loss: the autopilot that flies on; None holds still: there is no passive safety.
    """

    speed_mps: float
    brake_mps2: float
    forward_mps2: float
    lateral_mps2: float
    dead_s: float
    reaction_s: float
    kappa_s: float
    c_s2: float
    loss: FliesOn | Coasts | None


@dataclass
class Reference:
    """A point along and across the leg, with its speeds and the accelerations that act on it."""

    x_m: float = 0.0
    y_m: float = 0.0
    along_mps: float = 0.0
    across_mps: float = 0.0
    along_mps2: float = 0.0
    across_mps2: float = 0.0

    def row(self) -> tuple[float, ...]:
        return (
            *(self.x_m, self.y_m, self.along_mps, self.across_mps),
            *(self.along_mps2, self.across_mps2),
        )

    def integrate(self) -> None:
        """Move on by one step; a reference that brakes does not turn back."""
        self.x_m += self.along_mps * STEP_S + self.along_mps2 * STEP_S**2 / 2.0
        self.y_m += self.across_mps * STEP_S + self.across_mps2 * STEP_S**2 / 2.0
        self.along_mps = max(0.0, self.along_mps + self.along_mps2 * STEP_S)
        self.across_mps += self.across_mps2 * STEP_S


def flown(
    vehicle: Vehicle, regions: list[RegionOfInfluence], end_x_m: float, *, shorter_m: float = 0.0
) -> FloatArray | None:
    """Fly past every obstacle; return each state of the reference, (N, 6), or None if stuck.

    Args:
        vehicle: what is flown.
        regions: of the obstacles as they were measured.
        end_x_m: where the flight ends.
        shorter_m: by how much later than at the front of a region it reacts.
    """
    reference, rows = Reference(along_mps=vehicle.speed_mps), []
    for states in _phases(vehicle, reference, regions, end_x_m, shorter_m):
        rows.append(states)
        if len(rows) * STEP_S > LONGEST_S:
            return None
    return np.array(rows)


def _phases(
    vehicle: Vehicle,
    reference: Reference,
    regions: list[RegionOfInfluence],
    end_x_m: float,
    shorter_m: float,
) -> Iterator[tuple[float, ...]]:
    passed: set[int] = set()
    while reference.x_m < end_x_m:
        ahead = [
            (region.obstacle.x_min_m, number)
            for number, region in enumerate(regions)
            if number not in passed and region.on_collision_course(reference.x_m, reference.y_m)
        ]
        number = min(ahead)[1] if ahead else None
        front_m = regions[number].extent.x_min_m + shorter_m if number is not None else np.inf
        if reference.x_m < front_m:
            slow = reference.along_mps < vehicle.speed_mps
            reference.along_mps2 = vehicle.forward_mps2 if slow else 0.0
            reference.integrate()
            reference.along_mps = min(reference.along_mps, vehicle.speed_mps)
            yield reference.row()
            continue
        assert number is not None
        yield from _stop(vehicle, reference)
        yield from _sidestep(vehicle, reference, regions[number].obstacle)
        passed.add(number)


def _stop(vehicle: Vehicle, reference: Reference) -> Iterator[tuple[float, ...]]:
    """React and brake as late as the contract allows."""
    late_s = vehicle.reaction_s + vehicle.dead_s
    reference.along_mps2 = 0.0
    for _ in range(round(late_s / STEP_S)):
        reference.integrate()
        yield reference.row()
    reference.along_mps2 = -vehicle.brake_mps2
    while reference.along_mps > 0.0:
        reference.integrate()
        yield reference.row()
    reference.along_mps2 = 0.0


def _sidestep(vehicle: Vehicle, reference: Reference, obstacle: Box) -> Iterator[tuple[float, ...]]:
    """Move beside the nearer face; wherever the stream stops, end within the overhang."""
    right = obstacle.y_max_m - reference.y_m < reference.y_m - obstacle.y_min_m
    sign, face_m = (1.0, obstacle.y_max_m) if right else (-1.0, -obstacle.y_min_m)
    beside_m, room_m = 0.15, 0.5
    limit_mps2 = vehicle.lateral_mps2
    while True:
        to_go_m = face_m + beside_m - sign * reference.y_m
        speed_mps = sign * reference.across_mps
        if abs(to_go_m) < 0.01 and abs(speed_mps) < 0.02:
            break
        wanted_mps = np.sign(to_go_m) * np.sqrt(1.2 * limit_mps2 * abs(to_go_m))
        allowed_mps2 = limit_mps2
        if vehicle.loss is not None:
            reach_m = face_m - sign * reference.y_m + room_m
            wanted_mps = min(wanted_mps, 0.95 * reach_m / vehicle.kappa_s)
            allowed_mps2 = (reach_m - vehicle.kappa_s * speed_mps) / vehicle.c_s2
        acceleration_mps2 = (wanted_mps - speed_mps) / 0.1
        reference.across_mps2 = sign * float(
            np.clip(acceleration_mps2, -limit_mps2, max(-limit_mps2, min(limit_mps2, allowed_mps2)))
        )
        reference.integrate()
        yield reference.row()
    reference.across_mps = reference.across_mps2 = 0.0


def runs_on(vehicle: Vehicle, states: FloatArray) -> FloatArray:
    """Return where the vehicle would be after a loss of the stream at each state, (M, N, 2)."""
    found = [states[:, 0:2]]
    if vehicle.loss is not None:
        found += [places_m.copy() for places_m in vehicle.loss.places_m(states)][::5]
    return np.array(found)


def clearance_m(places_m: FloatArray, boxes: list[Box], away_m: float) -> float:
    """Return the least distance of places (..., 2) from boxes, less what lies between."""
    least_m = np.inf
    for box in boxes:
        x_m, y_m = places_m[..., 0], places_m[..., 1]
        along_m = np.maximum(np.maximum(box.x_min_m - x_m, x_m - box.x_max_m), 0.0)
        across_m = np.maximum(np.maximum(box.y_min_m - y_m, y_m - box.y_max_m), 0.0)
        least_m = min(least_m, float(np.hypot(along_m, across_m).min()))
    return least_m - away_m


def off_by(box: Box, error_m: float, random: np.random.Generator) -> Box:
    """Return a box as a sensor may report it: each face off by the error, either way."""
    off_m = (random.choice((-1.0, 1.0), 4) * error_m).tolist()
    return Box(
        box.x_min_m + off_m[0],
        box.x_max_m + off_m[1],
        box.y_min_m + off_m[2],
        box.y_max_m + off_m[3],
    )
