"""What geofence and fleet ask of a mission; Shapely, of the extra ``ground``, loads on use."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from gcs_tools.console.errors import CommandError
from gcs_tools.preflight.files import PreflightFiles
from gcs_tools.preflight.rule import Rule
from onboard.contract.assessment import Assessment
from onboard.files.daemon_config import load_daemon_config
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
            rule = corridor_rule(files.fleet, assessment.contract, mission, fence)
        except FenceError as error:
            raise CommandError(f"{files.fleet}: {error}") from error
        unheld = () if files.daemon is None else _unheld(files.daemon, fence)
        offenders = (*rule.offenders, *unheld)
        rules += (replace(rule, required=float(len(offenders)), offenders=offenders),)
    return rules


def _unheld(daemon: Path, fence: Geofence | None) -> tuple[str, ...]:
    """Return why a daemon would not keep to a geofence; empty if it would."""
    written = load_daemon_config(daemon).geofence
    if written is not None and load_yaml(daemon.parent / written, Geofence) == fence:
        return ()
    return (f"geofence of {daemon.name} is not the one that is checked: no corridor is held",)
