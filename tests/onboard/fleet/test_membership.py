"""A vehicle is of a fleet only if it flies what the fleet's file says of it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from onboard.files.contract_file import load_contract
from onboard.files.geofence_file import Geofence
from onboard.files.mission_file import Mission
from onboard.files.yaml_file import FileError, dump_document, load_yaml
from onboard.fleet.membership import FleetMembership, FlownFiles, read_membership

CONFIG = Path(__file__).parents[3] / "config"
Read = Callable[..., FleetMembership]
MISSION: dict[str, Any] = {
    "altitude_m": 3.0,
    "start_clear_m": 4.0,
    "legs": [{"end_ned_m": [20.0, 0.0], "target_half_width_m": 4.0}],
}
FENCE: dict[str, Any] = {
    "areas": [{"keep": "inside", "corners_ned_m": [[-9, -9], [-9, 9], [29, 9], [29, -9]]}]
}


@pytest.fixture
def read(tmp_path: Path) -> Read:
    """Return what reads one of two vehicles, of files in which something may be otherwise."""

    def reading(
        name: str = "one",
        *,
        overrides: tuple[str, ...] = (),
        mission: dict[str, Any] = MISSION,
        fence: dict[str, Any] | None = FENCE,
        **fleet: Any,
    ) -> FleetMembership:
        (tmp_path / "mission.yaml").write_text(dump_document(MISSION), "utf-8")
        (tmp_path / "fence.yaml").write_text(dump_document(FENCE), "utf-8")
        (tmp_path / "flown.yaml").write_text(dump_document(mission), "utf-8")
        contract = CONFIG / "default_contract.yaml"
        vehicle = {
            "contract": str(contract),
            "mission": "mission.yaml",
            "geofence": "fence.yaml",
            "origin": {"latitude_deg": 47.4, "longitude_deg": 8.5},
            "absolute_position_error_m": 0.5,
        }
        document = {
            "speed_max_mps": 6.0,
            "vehicles": [vehicle | {"name": each} for each in ("one", "two")],
        }
        path = tmp_path / "fleet.yaml"
        path.write_text(dump_document(document | fleet), "utf-8")
        flown = FlownFiles(
            load_contract(contract, overrides),
            load_yaml(tmp_path / "flown.yaml", Mission),
            None if fence is None else Geofence.model_validate(fence),
        )
        return read_membership(path, name, flown)

    return reading


def test_who_flies_as_the_file_says_is_a_member(read: Read) -> None:
    membership = read()
    assert membership.name == "one"
    assert set(membership.contracts) == {"one", "two"}
    assert (membership.error_m, membership.speed_max_mps) == (0.5, 6.0)
    assert membership.lane_half_width_m == 3.0


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"name": "three"}, "no vehicle is called 'three', expected one of one, two"),
        ({"overrides": ("requirements.stop=false",)}, "requirements.stop = false in its contract"),
        (
            {"overrides": ("requirements.passive_safety=false",)},
            "requirements.passive_safety = false in its contract, expected true",
        ),
        ({"overrides": ("vehicle.tracking_error_m=0.3",)}, "contract of one = .*its hash is "),
        ({"mission": MISSION | {"altitude_m": 4.0}}, "the daemon flies another one"),
        ({"fence": None}, "the daemon keeps to another one"),
        ({"speed_max_mps": 1.0}, r"speed_max_mps \[m/s\] = 1: one may fly "),
        ({"vehicles": []}, "vehicles"),
    ],
)
def test_who_flies_otherwise_is_refused_by_one_error(
    read: Read, changes: dict[str, Any], complaint: str
) -> None:
    with pytest.raises(FileError, match=f"fleet.yaml: .*{complaint}"):
        read(**changes)
