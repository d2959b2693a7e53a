"""A vehicle of a fleet departs only where the file says, near its lane, and goes on by leave."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from onboard.autonomy import Autonomy
from onboard.files.contract_file import load_contract
from onboard.files.geofence_file import Geofence
from onboard.files.mission_file import Mission
from onboard.files.yaml_file import load_yaml
from onboard.fleet.membership import FlownFiles, read_membership
from onboard.guidance.phases import Phase
from tests.onboard.test_autonomy import EPOCH_UNIX_S, OFFBOARD, Rig

CONFIG = Path(__file__).parents[3] / "config"
FLEET = CONFIG / "fleet" / "crossing.yaml"
ORIGIN_E7 = (473981467, 85455010)
CONTRACTS = {"southbound": "px4_contract.yaml", "northbound": "default_contract.yaml"}


@dataclass
class Member(Rig):
    """A PX4 of a fleet, which says where its local frame is."""

    origin_e7: tuple[int, int] | None = ORIGIN_E7

    def say_what_the_position_is_worth(self) -> None:
        super().say_what_the_position_is_worth()
        if self.origin_e7 is not None:
            self._mav.gps_global_origin_send(*self.origin_e7, 0)


def member(name: str = "southbound", **said: Any) -> Member:
    """Return a member that has said for a second what it says, to hear nothing of the others."""
    mission = load_yaml(FLEET.parent / f"{name}_mission.yaml", Mission)
    fence = load_yaml(FLEET.parent / f"{name}_geofence.yaml", Geofence)
    contract = load_contract(CONFIG / CONTRACTS[name])
    membership = read_membership(FLEET, name, FlownFiles(contract, mission, fence))
    autonomy = Autonomy(contract, mission, epoch_unix_s=EPOCH_UNIX_S)
    autonomy.join_fleet(membership, "0" * 16)
    rig = Member(autonomy, mode=OFFBOARD, **said)
    rig.run(1.0)
    return rig


def objection(rig: Member) -> str:
    return rig.autonomy.navigator.situation.fleet_objection or "none"


def test_without_leave_it_takes_control_and_stays_where_it_is() -> None:
    rig = member()
    assert (rig.phase, objection(rig)) == (Phase.CRUISE, "none")
    rig.run(8.0)
    assert rig.position_ned_m[:2] == pytest.approx((0.0, 0.0), abs=0.01)


@pytest.mark.parametrize(
    ("said", "expected"),
    [
        ({"speaking": False}, "no telemetry"),
        ({"origin_e7": None}, "has not said its GPS_GLOBAL_ORIGIN"),
        ({"origin_e7": (473981567, 85455010)}, "GPS_GLOBAL_ORIGIN is 1.1 m from the origin"),
        ({"origin_e7": (0, 0)}, "from the origin in the fleet's file"),
        ({"name": "northbound"}, "autopilot: ardupilot, the vehicle is px4"),
        ({"position_ned_m": (0.0, 4.0, -4.0)}, "4.0 m beside the leg"),
    ],
    ids=str,
)
def test_what_is_otherwise_keeps_it_from_departing(said: dict[str, Any], expected: str) -> None:
    rig = member(**said)
    assert rig.phase is Phase.STANDBY
    assert expected in objection(rig)
