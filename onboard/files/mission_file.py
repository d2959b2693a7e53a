"""The mission as an operator states it (mission.yaml): frozen and validated."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Annotated, Final, Literal, Self

from pydantic import Field, model_validator

from onboard.files.contract_file import NonNegative, Positive
from onboard.files.yaml_file import FileModel

# A leg whose end lies nearer to its start than this has no direction.
LEG_LENGTH_MIN_M: Final = 0.1
# Missions stay within this distance of the origin: larger numbers are map coordinates.
Horizontal = Annotated[float, Field(ge=-1e5, le=1e5)]
# YAML has lists only; the numbers inside stay strict.
Point = Annotated[tuple[Horizontal, Horizontal], Field(strict=False)]


class Leg(FileModel):
    """One straight leg of a mission; avoidance leaves the vehicle beside it (erratum 16)."""

    end_ned_m: Point = Field(description="north and east of the end of the leg")
    target_half_width_m: Positive = Field(
        5.0, description="how far beside the end the vehicle may arrive (P_D)"
    )
    corridor_half_width_m: Positive | None = Field(
        None,
        description="how far beside the leg line the vehicle may fly; null: as far as it has to, or"
        " target_half_width_m where passing is not guaranteed",
    )

    @property
    def threading_half_width_m(self) -> float:
        """How far beside its line the leg may be flown with best effort."""
        return self.corridor_half_width_m or self.target_half_width_m


class EnergyBudget(FileModel):
    """What of the battery is kept, and how long it lasts."""

    reserve_fraction: Annotated[float, Field(ge=0.05, le=0.9)] = Field(
        0.25,
        description="share of a full battery that is left when the vehicle is back; above where the"
        " autopilot's own failsafe acts",
    )
    endurance_s: Positive = Field(description="how long a full battery hovers")


class Mission(FileModel):
    """Where to fly (mission.yaml)."""

    start_ned_m: Point = Field((0.0, 0.0), description="north and east of the first leg's start")
    altitude_m: Positive = Field(description="cruise height above the local origin")
    climb_max_m: NonNegative = Field(
        0.0, description="how far avoidance may climb above that to gain agility; 0: planar"
    )
    heading: Literal["leg", "path"] = Field(
        "leg",
        description="where the nose points with best effort: along the leg, or where it flies",
    )
    start_clear_m: Positive | None = Field(
        None,
        description="radius around start_ned_m, at altitude_m, in which the operator has confirmed"
        " that nothing stands; null: not confirmed, so that the vehicle looks all round first",
    )
    start_clear_of_movers_m: Positive | None = Field(
        None,
        description="radius around the vehicle in which nothing that moves is, as the operator"
        " confirms whenever control is granted or a hold ended; needed by passive_in_view",
    )
    on_end: Literal["hover", "return"] = Field(
        "hover",
        description="at the end of the last leg: hover there, or return along the way that was"
        " flown to where control was taken",
    )
    energy: EnergyBudget | None = Field(
        None,
        description="return along the way flown before the reserve of the battery is reached;"
        " null: the battery is the pilot's and the autopilot's",
    )
    legs: Annotated[tuple[Leg, ...], Field(strict=False, min_length=1)]

    @model_validator(mode="after")
    def _legs_have_length(self) -> Self:
        points_ned_m = [self.start_ned_m, *(leg.end_ned_m for leg in self.legs)]
        for number, (start_m, end_m) in enumerate(pairwise(points_ned_m)):
            if math.dist(start_m, end_m) < LEG_LENGTH_MIN_M:
                raise ValueError(
                    f"legs.{number}.end_ned_m = {list(end_m)} m is less than "
                    f"{LEG_LENGTH_MIN_M:g} m from the start of the leg"
                )
        return self
