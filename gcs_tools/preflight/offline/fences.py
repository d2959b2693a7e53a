"""What geofence and fleet ask of a mission; Shapely, of the extra ``ground``, loads on use."""

from __future__ import annotations

from gcs_tools.console.errors import CommandError
from gcs_tools.preflight.files import PreflightFiles
from gcs_tools.preflight.rule import Rule
from onboard.contract.assessment import Assessment
from onboard.files.geofence_file import Geofence
from onboard.files.mission_file import Mission
from onboard.files.yaml_file import load_yaml
from onboard.mission_items.fence_items import FenceError


def fence_rules(
    assessment: Assessment, mission: Mission | None, files: PreflightFiles
) -> tuple[Rule, ...]:
    """Return the rules of the geofence, and of the fleet, as far as they are given.

    Raises:
        CommandError: there is no mission for the geofence, or edges of an area cross each other.
        FileError: a file cannot be used.
    """
    rules: tuple[Rule, ...] = ()
    fence = None
    if files.geofence is not None:
        fence = load_yaml(files.geofence, Geofence)
        if mission is None:
            raise CommandError("--geofence needs --mission: its legs are checked against the areas")
        from gcs_tools.preflight.offline.geofence import check_geofence  # noqa: PLC0415  loads Shapely

        try:
            rules += (check_geofence(assessment, mission, fence),)
        except FenceError as error:
            raise CommandError(f"{files.geofence}: {error}") from error
    if files.fleet is not None:
        from gcs_tools.preflight.offline.corridors import corridor_rule  # noqa: PLC0415  likewise

        try:
            rules += (corridor_rule(files.fleet, assessment.contract, mission, fence),)
        except FenceError as error:
            raise CommandError(f"{files.fleet}: {error}") from error
    return rules
