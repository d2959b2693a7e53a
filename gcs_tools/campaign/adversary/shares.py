"""Which share of each allowance of its contract an adversary has used in a flight."""

from __future__ import annotations

import json
import math
import statistics
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from gcs_tools.campaign.adversary.contract import EMPTY_FRAMES
from gcs_tools.campaign.adversary.plant import timing_error_m
from gcs_tools.campaign.oracles.evidence import Evidence, given, in_leg
from sitl.virtual.simulation import Simulation


class ErrorMeter:
    """Follows the errors of detector and estimate in a flight, tick by tick.

    Attributes:
        face_m, pose_m, heading_rad: greatest error of a face, of the estimated position, and of the
            estimated heading.
        missed: longest row of frames that missed an obstacle in view.
    """

    def __init__(self) -> None:
        self.face_m = self.pose_m = self.heading_rad = 0.0
        self.missed = 0

    def observe(self, simulation: Simulation) -> None:
        """Take the errors of a tick."""
        error = simulation.scene.vehicle.autopilot.estimator.error
        self.pose_m = max(self.pose_m, math.hypot(error.north_m, error.east_m))
        self.heading_rad = max(self.heading_rad, abs(error.yaw_rad))
        for sensor in simulation.scene.detectors:
            self.face_m = max(self.face_m, sensor.face_error_max_m)
            self.missed = max(self.missed, sensor.confirmation.missed_max)


def used_shares(evidence: Evidence, meter: ErrorMeter) -> dict[str, float]:
    """Return the share of each allowance that the draw or the flight has used, by name.

    An allowance that a flight does not have, such as a heading error where none is declared, has no
    share.
    """
    case, vehicle = evidence.case, evidence.case.scenario.contract.vehicle
    (sensor,) = case.scenario.plant.sensors
    shares = dict(case.adversary.by_draw) if case.adversary is not None else {}
    shares["tracking"] = evidence.true_tracking_error_m / vehicle.tracking_error_m
    shares |= _velocity_shares(evidence)
    if sensor.scanner is None:
        faces_m = meter.face_m + _placing_m(evidence)
        shares["faces"] = faces_m / case.scenario.contract.sensor.position_error_m
    if sensor.errors.confirm_frames > 1 or sensor.errors.empty_every:
        shares["missed"] = meter.missed / EMPTY_FRAMES
    if vehicle.heading_error_deg > 0.0:
        shares["heading"] = meter.heading_rad / math.radians(vehicle.heading_error_deg)
    pose_m = case.scenario.plant.estimator.position_m or 0.0
    if pose_m > 0.0:
        shares["pose"] = meter.pose_m / (math.sqrt(2.0) * pose_m)
    if case.scenario.contract.requirements.passive_safety:
        shares["daemon_death"] = 1.0  # in every tick of the flight, see `margins`
    return shares


def _placing_m(evidence: Evidence) -> float:
    """Return what the placing of boxes takes of the error of their faces."""
    plant, contract = evidence.case.scenario.plant, evidence.case.scenario.contract
    pose_m = math.sqrt(2.0) * (plant.estimator.position_m or 0.0)
    by_pose = plant.sensors[0].frame == "body_frd"
    return pose_m + (timing_error_m(contract) if by_pose else 0.0)


def _velocity_shares(evidence: Evidence) -> dict[str, float]:
    along_max_mps, across_max_mps = evidence.case.scenario.contract.vehicle.velocity_error_mps
    along_mps = across_mps = 0.0
    cruised = False
    for state, truth in zip(evidence.states, evidence.truth.truths, strict=True):
        wanted = state.reference_velocity_ned_mps
        flown = truth.velocity_ned_mps
        # The bound holds in cruise, outside of every region (paper, "Velocity Tracking Error").
        if not state.cruising or None in (wanted, flown, state.leg_heading_rad):
            continue
        cruised = True
        error = [a - b for a, b in zip(given(flown), given(wanted), strict=True)]
        along, across = in_leg(error, given(state.leg_heading_rad))
        along_mps, across_mps = max(along_mps, abs(along)), max(across_mps, abs(across))
    if not cruised:
        return {}
    return {
        "velocity_along": along_mps / along_max_mps,
        "velocity_across": across_mps / across_max_mps,
    }


@dataclass(frozen=True)
class ShareSummary:
    """One allowance over a campaign: in how many flights it was given, and how much was used."""

    name: str
    flights: int
    median: float
    least: float


def shares_text(shares: Mapping[str, float]) -> str:
    """Return shares as a cell of the table: JSON."""
    return json.dumps({name: round(share, 4) for name, share in sorted(shares.items())})


def summarize_shares(cells: Iterable[str]) -> list[ShareSummary]:
    """Return each allowance of the flights whose cells these are, in alphabetical order."""
    by_name: dict[str, list[float]] = {}
    for cell in filter(None, cells):
        for name, share in json.loads(cell).items():
            by_name.setdefault(name, []).append(float(share))
    return [
        ShareSummary(name, len(shares), statistics.median(shares), min(shares))
        for name, shares in sorted(by_name.items())
    ]
