"""Flights through a real stem map: a leg anywhere in the forest, in any direction.

The pre-flight check knows the map for half of the flights, and refuses nearly all of those; in the
other half only the flight itself can show what does not comply.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np

from gcs_tools.campaign.generator.case import Extent, FlightCase
from gcs_tools.campaign.generator.generators import field_case
from onboard.files.obstacle_field import ObstacleField, load_field

# Short legs fit into gaps that the contract covers; long ones are refused nearly always.
_LENGTH_M: Final = (10.0, 40.0)
_SPEED_MPS: Final = (1.0, 2.5)
_OPEN_M: Final = 3.0
# Stems farther from the leg than this do not affect the flight and are left out.
_BESIDE_M: Final = 25.0


@dataclass(frozen=True)
class ForestSource:
    """A field file of stems, flown through on a new leg each time.

    Attributes:
        name: path of the CSV file.
    """

    name: str

    def case(self, campaign_seed: int, number: int) -> FlightCase:
        """Return a leg, with the stems around it and a contract for the largest of them.

        Raises:
            FileError: the stem map cannot be read.
        """
        draw = random.Random(f"forest {campaign_seed} {number}")
        stems = _stems(self.name)
        heading_rad, length_m = draw.uniform(-math.pi, math.pi), draw.uniform(*_LENGTH_M)
        low_m, high_m = stems.center_ned_m.min(axis=0), stems.center_ned_m.max(axis=0)
        while True:  # until the vehicle starts on open ground
            start_m = np.array([draw.uniform(low_m[axis], high_m[axis]) for axis in (0, 1)])
            if np.hypot(*(stems.center_ned_m - start_m).T).min() > _OPEN_M:
                break
        near = _near(stems, start_m, heading_rad, length_m)
        largest_m = float(near.half_size_m.max(initial=0.1)) * 2.0 * math.sqrt(2.0)
        extent = Extent((length_m, length_m), _SPEED_MPS, airborne=False)
        case = field_case(draw, near, heading_rad, extent, largest_m * 1.001)
        name = f"{Path(self.name).stem}-{campaign_seed}-{number}"
        known = draw.random() < 0.5
        scenario = replace(case.scenario, name=name, field_known=known)
        return replace(
            case,
            scenario=scenario,
            variant="mapped" if known else "unmapped",
            # Stems closer together than the contract assumes cause a hold, or no departure.
            outcomes=("arrived",) if known else ("arrived", "held", "aborted"),
        )


@cache
def _stems(name: str) -> ObstacleField:
    return load_field(Path(name))


def _near(
    stems: ObstacleField, start_m: np.ndarray, heading_rad: float, length_m: float
) -> ObstacleField:
    """Return the stems around a leg, in a frame whose origin is its start."""
    along = np.array([math.cos(heading_rad), math.sin(heading_rad)])
    offset_m = stems.center_ned_m - start_m
    nearest_m = offset_m - np.clip(offset_m @ along, 0.0, length_m)[:, None] * along
    kept = np.flatnonzero(np.hypot(nearest_m[:, 0], nearest_m[:, 1]) < _BESIDE_M)
    return ObstacleField(
        tuple(stems.ids[index] for index in kept),
        offset_m[kept],
        stems.half_size_m[kept],
        stems.yaw_rad[kept],
    )
