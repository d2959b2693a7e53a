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
        begins_within_m: stands at the start until the vehicle is so near; null: goes at once.
    """

    kind: Literal["waypoints"]
    begins_within_m: Positive | None = None
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


class Knot(FileModel):
    """Along the shadow of a trefoil knot, in time: slower than ``speed_mps`` where the knot is.

    North ``n + a/6 (sin s + 2 sin 2s)``, east ``e + b/5 (cos s - 2 cos 2s)``, as moving boxes of
    public scenes go (mit-acl/sando).

    Attributes:
        center_ned_m: (n, e), its middle.
        scale_m: (a, b), along north and east.
        period_s: once round, ``s`` from 0 to 2 pi.
        phase_deg: where it begins.
    """

    kind: Literal["knot"]
    center_ned_m: Place
    scale_m: Place
    period_s: Positive
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


class Dash(FileModel):
    """Stands beside the way of the vehicle, then goes straight across to meet it there.

    It sets off when the vehicle, at the speed that it has, comes to that place as soon as it does.

    Attributes:
        start_ned_m: where it stands.
        meets_ned_m: through which place it goes, and straight on.
    """

    kind: Literal["dash"]
    start_ned_m: Place
    meets_ned_m: Place


MoverPath = Annotated[
    Waypoints | Trefoil | Knot | Pursuit | Hostile | Dash, Field(discriminator="kind")
]


class MoverConfig(FileModel):
    """One mover: square, from the ground up.

    Attributes:
        id: unique name.
        kind: its class, as sensors state it.
        size_m: edge.
        top_m: how high it is, above the local origin; null: a pillar of any height.
        speed_mps: as fast as it goes, all the time; the most that it may go along a knot.
        path: where.
    """

    model_config = ConfigDict(populate_by_name=True, serialize_by_alias=True)

    id: Annotated[str, Field(min_length=1)]
    kind: Annotated[str, Field(alias="class", pattern=r"^[a-z0-9_]+$")] = "person"
    size_m: Positive = 0.6
    top_m: Positive | None = None
    speed_mps: Annotated[float, Field(ge=0.0)] = 1.5
    path: MoverPath
