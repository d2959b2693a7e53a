"""Movers of the simulated world, as a file states them."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import ConfigDict, Field

from onboard.files.yaml_file import FileModel

Positive = Annotated[float, Field(gt=0.0)]
Place = Annotated[tuple[float, float], Field(strict=False)]


class Waypoints(FileModel):
    """From place to place, and round again.

    Attributes:
        places_ned_m: north and east of each, the start first.
    """

    kind: Literal["waypoints"]
    places_ned_m: Annotated[tuple[Place, ...], Field(strict=False, min_length=1)]


class Trefoil(FileModel):
    """Along a clover leaf of three lobes.

    Attributes:
        center_ned_m: its middle.
        radius_m: how far its lobes reach.
        phase_deg: where it begins.
    """

    kind: Literal["trefoil"]
    center_ned_m: Place
    radius_m: Positive
    phase_deg: float = 0.0


class Pursuit(FileModel):
    """Towards the vehicle, straight on; retreats for a while after each contact.

    Attributes:
        start_ned_m: where it begins.
        lead_s: heads for where the vehicle will be after this.
        begins_s: stands still before.
    """

    kind: Literal["pursuit"]
    start_ned_m: Place
    lead_s: Annotated[float, Field(ge=0.0, le=10.0)] = 0.0
    begins_s: Annotated[float, Field(ge=0.0)] = 0.0


class Hostile(FileModel):
    """Towards the vehicle by whatever may touch it: straight, leading, from behind, or in ambush.

    It changes its way every few seconds, waits beside the way of the vehicle, and comes out when
    the vehicle is near; it retreats for a while after each contact.

    Attributes:
        start_ned_m: where it begins.
    """

    kind: Literal["hostile"]
    start_ned_m: Place


MoverPath = Annotated[Waypoints | Trefoil | Pursuit | Hostile, Field(discriminator="kind")]


class MoverConfig(FileModel):
    """One mover: a square pillar.

    Attributes:
        id: unique name.
        kind: its class, as sensors state it.
        size_m: edge.
        speed_mps: as fast as it goes, all the time.
        path: where.
    """

    model_config = ConfigDict(populate_by_name=True, serialize_by_alias=True)

    id: Annotated[str, Field(min_length=1)]
    kind: Annotated[str, Field(alias="class", pattern=r"^[a-z0-9_]+$")] = "person"
    size_m: Positive = 0.6
    speed_mps: Annotated[float, Field(ge=0.0)] = 1.5
    path: MoverPath
