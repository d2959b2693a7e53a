"""Several vehicles that fly at one site (fleet.yaml): who they are, what bounds each of them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from onboard.files.contract_file import NonNegative, Positive
from onboard.files.yaml_file import FileModel
from onboard.geometry.local_frame import GeographicPoint, LocalFrame

# As in the keys of Zenoh that begin with it.
VehicleName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,31}$")]
FleetPath = Annotated[Path, Field(strict=False)]
_VEHICLES_MIN, _VEHICLES_MAX = 2, 32


class FrameOrigin(FileModel):
    """Where the origin of a vehicle's local frame lies; near a pole such a frame is no plane."""

    latitude_deg: float = Field(ge=-80.0, le=80.0)
    longitude_deg: float = Field(ge=-180.0, le=180.0)


class FleetVehicle(FileModel):
    """One vehicle of a fleet; paths are relative to the fleet's file."""

    name: VehicleName = Field(description="of the vehicle in the fleet")
    contract: FleetPath = Field(description="contract file that it flies by")
    mission: FleetPath = Field(description="mission file")
    geofence: FleetPath | None = Field(
        None, description="geofence file that its daemon keeps to; null: nothing bounds the flight"
    )
    autopilot: Literal["px4", "ardupilot"] = Field(
        "px4", description="whose arithmetic its local frame follows"
    )
    origin: FrameOrigin = Field(
        description="of its local frame (GPS_GLOBAL_ORIGIN), WGS84; an autopilot by itself takes "
        "where it first had a position, so that vehicles have different ones"
    )
    absolute_position_error_m: NonNegative = Field(
        description="A: how far its position on the Earth may be off; 1.5 to 3 m by satellites, "
        "0.05 m by RTK"
    )

    @property
    def frame(self) -> LocalFrame:
        """Its local frame, as the file states it."""
        place = GeographicPoint(self.origin.latitude_deg, self.origin.longitude_deg)
        return LocalFrame(place, self.autopilot)


class Fleet(FileModel):
    """Vehicles that fly at one site at a time (fleet.yaml)."""

    speed_max_mps: Positive = Field(
        description="no vehicle of the fleet is ever faster over ground, with or without a link"
    )
    lane_half_width_m: NonNegative = Field(
        3.0,
        description="a vehicle asks for leave for so much on each side of its legs, body and "
        "errors besides: an obstacle is passed within that",
    )
    vehicles: Annotated[
        tuple[FleetVehicle, ...],
        Field(strict=False, min_length=_VEHICLES_MIN, max_length=_VEHICLES_MAX),
    ]

    @model_validator(mode="after")
    def _can_be_told_apart(self) -> Self:
        names = [each.name for each in self.vehicles]
        for number, name in enumerate(names):
            if name in names[:number]:
                raise ValueError(f"vehicles.{number}.name = {name!r}: another vehicle has it")
        return self
