"""Rehearses the legs of a mission, one after another."""

from __future__ import annotations

import math

from gcs_tools.preflight.field_check import leg_boxes
from gcs_tools.preflight.rehearsal.leg_flight import LegFlight
from gcs_tools.preflight.rehearsal.prediction import LegRehearsal, Rehearsal
from onboard.contract.assessment import Assessment
from onboard.files.mission_file import Mission
from onboard.files.obstacle_field import ObstacleField
from onboard.geometry.frames import LegFrame


def rehearse(
    assessment: Assessment, obstacles: ObstacleField, mission: Mission, *, confined: bool
) -> Rehearsal:
    """Fly a mission through a known field at reference level.

    Args:
        assessment: the contract.
        obstacles: the whole field, as far as it is known.
        mission: what to fly.
        confined: whether the vehicle stays within each leg's half width, as where arrival is not
            guaranteed.
    """
    found: list[LegRehearsal] = []
    begin_ned_m = mission.start_ned_m
    for number, leg in enumerate(mission.legs, start=1):
        frame = LegFrame.between((*begin_ned_m, 0.0), (*leg.end_ned_m, 0.0))
        half_width_m = leg.target_half_width_m if confined else math.inf
        length_m = math.dist(begin_ned_m, leg.end_ned_m)
        flight = LegFlight(assessment, leg_boxes(frame, obstacles), length_m, half_width_m)
        found.append(flight.flown(f"leg {number}", frame))
        if not found[-1].passes:
            break
        begin_ned_m = leg.end_ned_m
    return Rehearsal(tuple(found), len(mission.legs))
