"""Missions on board the autopilot: read, followed on the ground, refused with their items named."""

import json
import math

import pytest

from onboard.autonomy import Autonomy
from onboard.files.contract_file import Contract
from onboard.files.daemon_config import VehicleMission
from onboard.files.mission_file import EnergyBudget
from onboard.guidance.phases import Phase
from onboard.mavlink.list_download import ITEMS_MAX, TRIES
from onboard.missions.from_vehicle import PLACEHOLDER
from onboard.recording.messages import as_json
from onboard.recording.state import state_of
from tests.onboard.missions.board import (
    FENCE,
    HOME_E7,
    JUMP,
    MISSION,
    STANDARD,
    TAKE_OFF,
    WAYPOINT,
    Board,
    item,
)
from tests.onboard.test_autonomy import EPOCH_UNIX_S, OFFBOARD, ON_GROUND, POSCTL

WIDE = VehicleMission(target_half_width_m=8.0)


def board(contract: Contract, stated: VehicleMission = WIDE, **changes: object) -> Board:
    autonomy = Autonomy(contract, PLACEHOLDER, epoch_unix_s=EPOCH_UNIX_S)
    autonomy.fly_mission_on_board(stated)
    rig = Board(autonomy, armed=False, landed_state=ON_GROUND)
    for name, value in changes.items():
        setattr(rig, name, value)
    return rig


def take_off(rig: Board) -> None:
    rig.armed, rig.landed_state, rig.mode = True, 2, OFFBOARD


def said_mission(rig: Board) -> list[float]:
    """Return how far north the ends of the legs are, to the decimetre; they lie due north."""
    legs = rig.autonomy.navigator.situation.route.mission.legs
    assert all(abs(leg.end_ned_m[1]) < 0.01 for leg in legs)
    return [round(leg.end_ned_m[0], 1) for leg in legs]


def test_the_mission_on_board_is_read_and_flown(contract: Contract) -> None:
    rig = board(contract)
    rig.run(2.0)
    (said,) = rig.texts("mission_read")
    assert said == ("mission read from the vehicle: 2 legs, 24 m, at 4.0 m above the local origin")
    state = json.loads(as_json(state_of(rig.autonomy, rig.now_s)))
    assert state["mission"] == said.partition(": ")[2]
    assert state["mission_doubt"] is None
    take_off(rig)
    rig.run(60.0, until=lambda: rig.phase is Phase.ARRIVED)
    assert rig.phase is Phase.ARRIVED
    assert rig.position_ned_m == pytest.approx((24.0, 0.0, -4.0), abs=0.1)
    done = [each for each in rig.asked if each.get_type() == "MISSION_ACK"]
    # Read at the start, and once more over the arming.
    assert [each.mission_type for each in done] == [MISSION, FENCE] * 2


def test_nothing_departs_before_it_is_read(contract: Contract) -> None:
    rig = board(contract, deaf=10**6)
    rig.run(1.0)
    take_off(rig)
    rig.run(2.0)
    assert rig.phase.value == "standby"
    (said,) = rig.texts("refused")
    assert said == "not leaving standby: the vehicle's mission is being read"
    rig.run(TRIES * 1.5)
    (said,) = rig.texts("mission_refused")
    assert said.endswith(f"cannot be read: its list was asked for {TRIES} times and did not come")
    rig.deaf = 0
    rig.run(15.0, until=lambda: rig.phase is Phase.CRUISE)
    assert rig.phase is Phase.CRUISE, "it is tried again and again"


def test_lost_requests_are_repeated(contract: Contract) -> None:
    rig = board(contract)
    for _ in range(6):
        rig.deaf = 1
        rig.run(1.6)
    assert said_mission(rig) == [12.0, 24.0]


@pytest.mark.parametrize(
    ("items", "words"),
    [
        ((), "the vehicle has no mission on board"),
        ((*STANDARD, item(JUMP, 0.0)), "item 3: legs are flown once: repeat the waypoints"),
        ((*STANDARD, item(WAYPOINT, 60.0, 9.0)), "item 3: its height is 9.0 m"),
        ((item(TAKE_OFF, 0.0),), "no leg"),
        ((*STANDARD, item(9999, 0.0)), "item 3: not known to Clearway"),
    ],
)
def test_what_cannot_be_flown_is_named_item_by_item(
    contract: Contract, items: tuple[tuple[object, ...], ...], words: str
) -> None:
    rig = board(contract, lists={MISSION: items, FENCE: ()})
    rig.run(2.0)
    take_off(rig)
    rig.run(3.0)
    assert rig.phase.value == "standby"
    (said,) = rig.texts("mission_refused")
    assert said.startswith("mission refused: the vehicle's mission cannot be flown: ")
    assert words in said
    assert words in rig.texts("refused")[-1]
    # Another one is read as soon as it is there.
    rig.be_uploaded(MISSION, *STANDARD)
    rig.run(10.0, until=lambda: rig.phase is Phase.CRUISE)
    assert rig.phase is Phase.CRUISE


def test_a_mission_without_its_place_is_refused(contract: Contract) -> None:
    rig = board(contract, origin_e7=None)
    rig.run(15.0)
    (said,) = rig.texts("mission_refused")
    assert "has not sent HOME_POSITION, by which its items are placed" in said


def test_a_refusal_of_the_autopilot_is_said_with_its_name(contract: Contract) -> None:
    rig = board(contract, refusal=14)
    rig.run(2.0)
    (said,) = rig.texts("mission_refused")
    assert said.endswith("cannot be read: refused: MAV_MISSION_DENIED")


def test_a_count_that_no_autopilot_keeps_is_refused(contract: Contract) -> None:
    rig = board(contract)
    rig.lists[MISSION] = (STANDARD[1],) * (ITEMS_MAX + 1)
    rig.run(2.0)
    (said,) = rig.texts("mission_refused")
    assert said.endswith(f"it has {ITEMS_MAX + 1} items (limit {ITEMS_MAX})")


def test_a_change_on_the_ground_is_followed(contract: Contract) -> None:
    rig = board(contract)
    rig.run(2.0)
    rig.be_uploaded(MISSION, item(TAKE_OFF, 0.0), item(WAYPOINT, 33.0))
    rig.run(0.5)
    assert rig.autonomy.navigator.situation.mission_doubt == "the vehicle's mission is being read"
    rig.run(2.0)
    assert said_mission(rig) == [33.0]
    assert rig.autonomy.navigator.situation.mission_doubt is None


def test_a_change_in_flight_waits_for_the_next_flight(contract: Contract) -> None:
    rig = board(contract)
    rig.run(2.0)
    take_off(rig)
    rig.run(8.0, until=lambda: rig.position_ned_m[0] > 3.0)
    rig.be_uploaded(MISSION, item(TAKE_OFF, 0.0), item(WAYPOINT, 33.0))
    rig.run(3.0)
    assert rig.texts("mission_read")[-1].startswith("the mission on the vehicle has changed")
    assert rig.phase is Phase.CRUISE
    assert len(said_mission(rig)) == 2
    rig.mode = POSCTL
    rig.run(0.5)
    assert said_mission(rig) == [33.0]


def test_the_geofence_on_board_limits_the_flight(contract: Contract) -> None:
    def fence(half_m: float) -> list[tuple[object, ...]]:
        corners = [(-30.0, 1), (60.0, 1), (60.0, -1), (-30.0, -1)]
        side = round(half_m * 0.00001331 * 1e7)
        return [
            (*item(5001, north_m, param1=4.0)[:9], 85_455_940 + sign * side, 0.0)
            for north_m, sign in corners
        ]

    rig = board(contract)
    rig.lists[FENCE] = tuple(fence(40.0))
    rig.run(3.0)
    assert "geofence of 1 area" in rig.texts("mission_read")[-1]
    assert rig.autonomy.navigator.situation.fence is not None
    rig.be_uploaded(FENCE, *fence(0.4))
    rig.run(3.0)
    assert "cannot be flown: legs.0 comes within" in rig.texts("mission_refused")[-1]
    rig.be_uploaded(FENCE)
    rig.run(3.0)
    assert rig.autonomy.navigator.situation.fence is None
    take_off(rig)
    rig.run(6.0, until=lambda: rig.phase is Phase.CRUISE)
    assert rig.phase is Phase.CRUISE


def test_what_the_geofence_forbids_stays_refused_over_the_arming(contract: Contract) -> None:
    rig = board(contract)
    rig.lists[FENCE] = ((3, 5003, 0, 1, 60.0, 0.0, 0.0, math.nan, *HOME_E7, 0.0),)
    rig.run(3.0)
    assert said_mission(rig) == [12.0, 24.0]
    rig.be_uploaded(MISSION, item(TAKE_OFF, 0.0), item(WAYPOINT, 90.0))
    rig.run(3.0)
    assert "cannot be flown: legs.0" in rig.texts("mission_refused")[-1]
    take_off(rig)  # all is read once more: neither this mission nor the last may be flown
    rig.run(8.0)
    assert rig.phase.value == "standby"
    assert rig.position_ned_m[:2] == (0.0, 0.0)
    rig.be_uploaded(MISSION, *STANDARD)
    rig.run(10.0, until=lambda: rig.phase is Phase.CRUISE)
    assert rig.phase is Phase.CRUISE


def test_what_no_item_states_comes_from_the_daemons_file(contract: Contract) -> None:
    energy = EnergyBudget(reserve_fraction=0.3, endurance_s=600.0)
    stated = VehicleMission(
        altitude_m=6.0,
        target_half_width_m=7.0,
        on_end="return",
        start_clear_m=2.0,
        energy=energy,
        start_clear_of_movers_m=9.0,
    )
    rig = board(contract, stated)
    rig.run(2.0)
    mission = rig.autonomy.navigator.situation.route.mission
    assert (mission.altitude_m, mission.on_end, mission.start_clear_m) == (6.0, "return", 2.0)
    assert mission.start_clear_of_movers_m == 9.0
    assert mission.legs[0].target_half_width_m == 7.0
    assert mission.energy == energy


def test_the_ids_of_newer_firmware_show_a_change(contract: Contract) -> None:
    """MISSION_CURRENT with mission_id, which pymavlink does not know yet."""
    rig = board(contract)
    rig.run(2.0)
    reader = rig.autonomy.link.missions
    for mission_id, changed in ((5, False), (5, False), (6, True)):
        payload = bytes((0, 0, 3, 0, 0, 0)) + mission_id.to_bytes(4, "little")
        header = bytes((0xFD, len(payload), 0, 0, 0, 1, 1, 42, 0, 0))
        current = _Current(header + payload)
        reader.hear(current, rig.now_s, for_us=False)
        assert (reader.doubt is not None) is changed


class _Current:
    """MISSION_CURRENT as received."""

    total = 3

    def __init__(self, frame: bytes) -> None:
        self._frame = frame

    def get_msgId(self) -> int:  # noqa: N802  as pymavlink names it
        return 42

    def get_msgbuf(self) -> bytes:
        return self._frame
