"""Geofence files as the fences that flights keep to."""

from __future__ import annotations

from onboard.files.geofence_file import FenceAreaFile, Geofence
from onboard.geometry.fence import Fence, FenceArea


def fence_of(geofence: Geofence) -> Fence:
    """Return what a geofence file describes."""
    return Fence(tuple(map(fence_area, geofence.areas)))


def fence_area(written: FenceAreaFile) -> FenceArea:
    """Return one area of a geofence."""
    keeps_in = written.keep == "inside"
    if written.center_ned_m is not None:
        return FenceArea((written.center_ned_m,), written.radius_m, keeps_in)
    return FenceArea(written.corners_ned_m, None, keeps_in)
