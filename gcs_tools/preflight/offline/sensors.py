"""Checks what the sensors of a daemon's file declare against the contract.

In flight every frame is checked against it: a sensor that declares less violates the contract.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final

from gcs_tools.preflight.finding import NOT_SEEN, VIRTUAL, Finding, Verdict
from onboard.contract.assessment import Assessment, Terms
from onboard.files.mission_file import Mission
from onboard.files.sensor_sources import (
    AnySource,
    DetectionsSource,
    FieldFileSource,
    LaserScanSource,
    MavlinkSource,
    ObstacleDistanceSource,
    OccupancyGridSource,
    PointCloudSource,
    only_adds_movers,
)
from onboard.monitoring.assumptions import ALL_ROUND_DEG
from onboard.perception.scan.levelling import band_above_ground_m

# By how much the heights that are looked at have to reach below the sensor.
_SENSOR_ABOVE_M: Final = 0.1
_ROUND_OFF_M: Final = 1e-9


def check_sources(
    sources: Sequence[AnySource], assessment: Assessment, mission: Mission | None
) -> tuple[Finding, ...]:
    """Check each sensor; a finding for each thing that is wrong, or one that all is well.

    Args:
        sources: of the daemon's file.
        assessment: the contract.
        mission: what is to be flown.
    """
    findings = list(_all_round(sources, assessment))
    for source in sources:
        if only_adds_movers(source):
            text = f"{source.kind}, {source.range_m:g} m: adds movers, and shows nothing free"
            findings.append(Finding("sensor", f"{source.name} declares", Verdict.HOLDS, text))
            continue
        wrong = [
            *_against_contract(source, assessment),
            *_against_tilt(source, assessment, mission),
            *_against_ground(source, mission),
        ]
        text = f"{source.kind}, {source.range_m:g} m, ±{source.uncertainty_m:g} m: as the contract"
        if not wrong:
            findings.append(Finding("sensor", f"{source.name} declares", Verdict.HOLDS, text))
        if isinstance(source, FieldFileSource):
            findings.append(virtual_finding(source.name))
        for key, reason in wrong:
            findings.append(Finding("sensor", f"{source.name} {key}", Verdict.BROKEN, reason))
    return tuple(findings)


def virtual_finding(name: str) -> Finding:
    """Return what has to be known of a flight among virtual obstacles."""
    return Finding("sensor", f"{name} {VIRTUAL}", Verdict.HOLDS, NOT_SEEN)


def is_ring(source: AnySource, terms: Terms[float]) -> bool:
    """Tell whether a sensor is the contract's all-round one, and not the one ahead as well."""
    return (terms.all_round_range_m or 0.0) > 0.0 and _view_deg(source) >= ALL_ROUND_DEG


def rings_of(sources: Sequence[AnySource]) -> tuple[str, ...]:
    """Return the names of the sensors that see all round."""
    seeing = (each for each in sources if not only_adds_movers(each))
    return tuple(each.name for each in seeing if _view_deg(each) >= ALL_ROUND_DEG)


def _needed_range(source: AnySource, terms: Terms[float]) -> tuple[float, str]:
    """Return how far the contract has a sensor see, and the key that says so."""
    ring_m = terms.all_round_range_m or 0.0
    if is_ring(source, terms) and ring_m < terms.detection_range_m:
        return ring_m, f"all_round_range_m {ring_m:g} m"
    return terms.detection_range_m, f"detection_range_m {terms.detection_range_m:g} m"


def _all_round(sources: Sequence[AnySource], assessment: Assessment) -> Iterator[Finding]:
    """Say which sensor covers all round where movers are required; JSON may bring another."""
    terms = assessment.terms
    if not terms.movers_meet:
        return
    for source in sources:
        if only_adds_movers(source) or _view_deg(source) < ALL_ROUND_DEG:
            continue
        need_m, key = _needed_range(source, terms)
        text = f"{source.range_m:g} m of 360°, the contract's {key}; clearway sensor check measures"
        holds = source.range_m >= need_m
        yield Finding("sensor", f"{source.name} all_round", Verdict.of(holds=holds), text)
        free_m = source.no_return_is_free_to_m or 0.0
        if free_m < need_m:
            text = f"{free_m:g} m, the contract's {key}: what returns nothing shows no place free"
            name = f"{source.name} no_return_is_free_to_m"
            yield Finding("sensor", name, Verdict.BROKEN, text)


def _against_contract(source: AnySource, assessment: Assessment) -> Iterator[tuple[str, str]]:
    terms = assessment.terms
    need_m, need = _needed_range(source, terms)
    if source.range_m < need_m:
        yield "range_m", f"{source.range_m:g} m, the contract's {need}"
    if source.uncertainty_m > terms.position_error_m:
        need = f"position_error_m {terms.position_error_m:g} m"
        yield "uncertainty_m", f"{source.uncertainty_m:g} m, the contract's {need}"
    if source.box_max_m > terms.obstacle_size_max_m:
        need = f"obstacle_size_max_m {terms.obstacle_size_max_m:g} m"
        yield "box_max_m", f"{source.box_max_m:g} m, the contract's {need}"
    need_deg = math.degrees(terms.field_of_view_rad)
    view_deg = _view_deg(source)
    if view_deg < need_deg - 1e-9:
        text = f"{view_deg:.0f}° around the nose, the contract's field_of_view_deg {need_deg:.0f}°"
        yield "field of view", text
    if (
        isinstance(source, MavlinkSource | FieldFileSource)
        and source.latency_s >= terms.reaction_time_s
    ):
        need = f"reaction_time_s {terms.reaction_time_s:g} s"
        yield "latency_s", f"{source.latency_s:g} s, the contract's {need}"


def _view_deg(source: AnySource) -> float:
    """Return the view around the nose, at most: what the file takes away from it is not seen."""
    half_deg = source.field_of_view_deg / 2.0
    if isinstance(source, PointCloudSource | DetectionsSource):
        half_deg = min(half_deg, source.view_deg[0] / 2.0 - abs(source.mounting.yaw_deg))
    for first_deg, last_deg in source.blind_sectors_deg:
        width_deg = (last_deg - first_deg) % 360.0
        begin_deg = (first_deg + 180.0) % 360.0 - 180.0
        if begin_deg <= 0.0 <= begin_deg + width_deg:
            half_deg = 0.0
        nearest_deg = min(abs(begin_deg), abs((begin_deg + width_deg + 180.0) % 360.0 - 180.0))
        half_deg = min(half_deg, nearest_deg)
    return max(2.0 * half_deg, 0.0)


def _against_tilt(
    source: AnySource, assessment: Assessment, mission: Mission | None
) -> Iterator[tuple[str, str]]:
    """Check that a plane that tilts with the body stays in the height band up to the range."""
    if not isinstance(source, LaserScanSource | ObstacleDistanceSource):
        return
    vehicle, (need_m, need) = assessment.contract.vehicle, _needed_range(source, assessment.terms)
    tilt_deg = max(vehicle.roll_max_deg, vehicle.pitch_max_deg)
    z_m = source.mounting.z_m
    above_m, below_m = source.height_band_m
    if mission is not None:
        above_m, below_m = band_above_ground_m(source, -mission.altitude_m, z_m)
    # From the sensor, which is not in the middle of the band.
    band_m = max(min(above_m + z_m, below_m - z_m), 0.0)
    seen_m = band_m / math.tan(math.radians(tilt_deg))
    if seen_m < need_m:
        leaves = f"the scan leaves {band_m:.4g} m after {seen_m:.1f} m, the contract's {need}"
        cure = "state the heights that every obstacle spans"
        if below_m < source.height_band_m[1] and below_m - z_m <= band_m:
            margin = f"ground_margin_m {source.ground_margin_m:g} m"
            cure = f"it ends {margin} above the ground: fly higher, or tilt less"
        yield "height_band_m", f"at a tilt of {tilt_deg:g}° {leaves}: {cure}"


def _against_ground(source: AnySource, mission: Mission | None) -> Iterator[tuple[str, str]]:
    """Check that the band ends above the ground and, by enough, below the sensor."""
    if mission is None or isinstance(source, OccupancyGridSource):
        return
    z_m, margin_m = source.mounting.z_m, source.ground_margin_m
    _, below_m = band_above_ground_m(source, -mission.altitude_m)
    altitude = f"the mission's altitude_m {mission.altitude_m:g} m"
    if below_m >= mission.altitude_m:
        text = f"{below_m:g} m below, {altitude}, ground_margin_m {margin_m:g} m: the ground"
        yield "height_band_m", f"{text} is seen as an obstacle"
    elif below_m < z_m + _SENSOR_ABOVE_M - _ROUND_OFF_M:
        text = f"{below_m:g} m below at {altitude} with ground_margin_m {margin_m:g} m"
        need = f"the sensor, {z_m:g} m below, needs {z_m + _SENSOR_ABOVE_M:g} m"
        yield "height_band_m", f"{text}: {need} to see what stands at its height"
