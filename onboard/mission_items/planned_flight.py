"""What a ground station's file holds, before anything of it is interpreted."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

from onboard.geometry.local_frame import Autopilot, GeographicPoint

# MAV_FRAME: by which zero an altitude counts.
SEA_LEVEL_FRAMES: Final = frozenset({0, 5})
HOME_FRAMES: Final = frozenset({3, 6})
TERRAIN_FRAMES: Final = frozenset({10, 11})

PARAMETERS: Final = 4


class FileItem(NamedTuple):
    """One item of a mission, as its file states it.

    Attributes:
        name: how messages name it, such as ``item 4``.
        command: MAV_CMD.
        frame: MAV_FRAME of its place.
        parameters: the first four; NaN where the file states none.
        place: latitude, longitude and altitude in the item's frame; NaN where none is stated.
    """

    name: str
    command: int
    frame: int
    parameters: tuple[float, float, float, float]
    place: GeographicPoint

    @property
    def states_place(self) -> bool:
        """Whether it says where; latitude and longitude of zero mean "here" in MAVLink."""
        latitude_deg, longitude_deg = self.place[:2]
        known = math.isfinite(latitude_deg) and math.isfinite(longitude_deg)
        return known and not latitude_deg == longitude_deg == 0.0


class GeographicArea(NamedTuple):
    """One area of a geofence.

    Attributes:
        corners: of a polygon; of a circle, its centre alone.
        radius_m: of a circle; None for a polygon.
        keeps_in: whether the vehicle must stay inside, rather than outside.
    """

    corners: tuple[GeographicPoint, ...]
    radius_m: float | None
    keeps_in: bool


@dataclass(frozen=True)
class PlannedFlight:
    """The content of a ground station's file.

    Attributes:
        home: where the file places home; None if it does not.
        autopilot: that it was made for; None if the file does not say.
        items: in order, without home.
        fence: areas of the geofence.
        notes: of what else the file holds, for the operator.
        origin: of the local frame, where a vehicle has said it; no file does.
    """

    home: GeographicPoint | None
    autopilot: Autopilot | None
    items: tuple[FileItem, ...]
    fence: tuple[GeographicArea, ...] = ()
    notes: tuple[str, ...] = ()
    origin: GeographicPoint | None = None
