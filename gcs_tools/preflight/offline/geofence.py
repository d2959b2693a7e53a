"""Checks on paper that a mission stays within a geofence, avoidances included."""

from __future__ import annotations

import math

from shapely import LineString

from gcs_tools.preflight.live.parameters import corridor_m
from gcs_tools.preflight.rule import Rule
from gcs_tools.vehicle.geofence import FenceArea
from onboard.contract.assessment import Assessment
from onboard.files.geofence_file import FenceAreaFile, Geofence
from onboard.files.mission_file import Mission


def check_geofence(assessment: Assessment, mission: Mission, fence: Geofence) -> Rule:
    """Return the rule that the corridor of all legs keeps within every area.

    Args:
        assessment: says how far avoidances lead aside.
        mission: whose legs count.
        fence: in the same local frame.

    Raises:
        FenceError: the edges of a polygon cross each other.
    """
    path = LineString([mission.start_ned_m, *(leg.end_ned_m for leg in mission.legs)])
    required_m = corridor_m(assessment, mission)
    margins_m = [(area.margin_m(path), str(area)) for area in map(_area, fence.areas)]
    offenders = tuple(
        f"the legs cross area {number}, {name}"
        if margin_m == -math.inf
        else f"area {number}, {name}: {margin_m:.1f} m beside the legs"
        for number, (margin_m, name) in enumerate(margins_m, start=1)
        if margin_m < required_m
    )
    return Rule(
        "geofence",
        required_m,
        min(margin_m for margin_m, _ in margins_m),
        "m",
        f"{required_m:.1f} m on each side of the legs must be within the geofence",
        offenders,
        concerns="safety",
    )


def _area(written: FenceAreaFile) -> FenceArea:
    keeps_in = written.keep == "inside"
    if written.center_ned_m is not None:
        return FenceArea((written.center_ned_m,), written.radius_m, keeps_in)
    return FenceArea(written.corners_ned_m, None, keeps_in)
