"""A flight that was left goes on by the operator's word, and only where nothing has changed."""

from __future__ import annotations

import pytest

from onboard.autonomy import Autonomy
from onboard.files.contract_file import Contract
from onboard.files.daemon_config import VehicleMission
from onboard.files.geofence_file import Geofence
from onboard.files.mission_file import Mission
from onboard.guidance.departure import Refusal, RefusalKind
from onboard.guidance.phases import Phase
from onboard.missions.from_vehicle import PLACEHOLDER
from onboard.missions.progress import ORIGIN_MOVED_MAX_M, SavedProgress, mission_sha256
from onboard.recording.state import state_of
from tests.onboard.missions.board import HOME_E7, M_DEG, Board
from tests.onboard.test_autonomy import EPOCH_UNIX_S, OFFBOARD, ON_GROUND, POSCTL

MISSION = Mission.model_validate(
    {
        "altitude_m": 4.0,
        "start_clear_m": 2.0,
        "start_clear_of_movers_m": 5.0,
        "legs": [
            {"end_ned_m": [8.0, 0.0], "target_half_width_m": 8.0},
            {"end_ned_m": [22.0, 0.0], "target_half_width_m": 3.0},
            {"end_ned_m": [22.0, 8.0], "target_half_width_m": 3.0},
        ],
    }
)


def left(contract: Contract, **changes: object) -> SavedProgress:
    """Return what a flight leaves that ends in the middle of the second leg."""
    saved = SavedProgress(
        mission=mission_sha256(MISSION),
        contract_sha256=contract.sha256,
        origin_e7=HOME_E7,
        leg=2,
        legs=3,
        place_ned_m=(16.0, 1.0),
        time_unix_s=EPOCH_UNIX_S,
    )
    return saved.model_copy(update=changes)


def restarted(contract: Contract, saved: SavedProgress, mission: Mission = MISSION) -> Board:
    autonomy = Autonomy(contract, mission, epoch_unix_s=EPOCH_UNIX_S)
    autonomy.progress.restore(saved)
    return Board(autonomy, armed=False, landed_state=ON_GROUND)


def fly(rig: Board) -> None:
    rig.armed, rig.landed_state, rig.mode = True, 2, OFFBOARD


def resumed(rig: Board) -> list[Refusal]:
    answers: list[list[Refusal]] = []
    rig.autonomy.receive_resume(answers.append)
    rig.tick()
    (answer,) = answers
    return answer


def route(rig: Board) -> list[tuple[float, float]]:
    mission = rig.autonomy.navigator.situation.route.mission
    return [mission.start_ned_m, *(leg.end_ned_m for leg in mission.legs)]


def test_leg_and_place_are_noted_and_forgotten_at_the_end(contract: Contract) -> None:
    rig = restarted(contract, SavedProgress())
    rig.run(1.0)
    fly(rig)
    rig.run(30.0, until=lambda: rig.position_ned_m[0] > 11.0)
    saved = rig.autonomy.progress.saved
    assert (saved.leg, saved.legs, saved.mission) == (2, 3, mission_sha256(MISSION))
    assert saved.place_ned_m[0] == pytest.approx(11.0, abs=2.0)
    assert saved.origin_e7 == HOME_E7
    assert saved.contract_sha256 == contract.sha256
    assert SavedProgress.model_validate_json(saved.model_dump_json()) == saved
    rig.run(60.0, until=lambda: rig.phase is Phase.ARRIVED)
    rig.tick()
    assert rig.autonomy.progress.saved == SavedProgress()


def test_without_the_word_the_mission_begins_at_its_start(contract: Contract) -> None:
    rig = restarted(contract, left(contract))
    rig.run(1.0)
    assert rig.texts("flight_left") == [
        "a flight was left at leg 2 of 3, 16 m north, 1 m east: clearway resume goes on there"
    ]
    assert state_of(rig.autonomy, rig.now_s).resumable == "leg 2 of 3, 16 m north, 1 m east"
    fly(rig)
    rig.run(5.0, until=lambda: rig.phase is Phase.CRUISE)
    assert rig.phase is Phase.CRUISE
    assert route(rig) == [(0.0, 0.0), (8.0, 0.0), (22.0, 0.0), (22.0, 8.0)]
    assert state_of(rig.autonomy, rig.now_s).resumable is None


def test_after_a_battery_swap_at_home_it_goes_on_by_way_of_the_place(contract: Contract) -> None:
    rig = restarted(contract, left(contract))
    rig.run(1.0)
    assert resumed(rig) == []
    assert rig.texts("flight_resumed") == [
        "going on at leg 2 of 3 by way of the place where it was left, once control is granted"
    ]
    assert route(rig) == [(0.0, 0.0), (16.0, 1.0), (22.0, 0.0), (22.0, 8.0)]
    # Confirmed was another start, if at another time: here the vehicle has to look for itself.
    mission = rig.autonomy.navigator.situation.route.mission
    assert (mission.start_clear_m, mission.start_clear_of_movers_m) == (None, None)
    fly(rig)
    rig.run(20.0, until=lambda: rig.position_ned_m[0] > 10.0)
    # On the way there nothing new has been flown.
    assert rig.autonomy.progress.saved == left(contract)
    rig.run(20.0, until=lambda: rig.position_ned_m[0] > 19.0)
    assert rig.autonomy.progress.saved.leg == 2
    assert rig.autonomy.progress.saved.mission == mission_sha256(MISSION)
    rig.run(30.0, until=lambda: rig.position_ned_m[1] > 2.0)
    saved = rig.autonomy.progress.saved
    assert (saved.leg, saved.legs) == (3, 3)
    # Left once more, in this process: it goes on from where the pilot has put the vehicle.
    rig.mode = POSCTL
    rig.run(0.5)
    assert resumed(rig) == []
    assert route(rig)[-1] == (22.0, 8.0)
    assert len(route(rig)) == 2
    rig.mode = OFFBOARD
    rig.run(30.0, until=lambda: rig.phase is Phase.ARRIVED)
    assert rig.phase is Phase.ARRIVED
    rig.tick()
    assert not rig.autonomy.progress.saved.unfinished


def test_beside_the_place_the_leg_goes_on_at_once(contract: Contract) -> None:
    rig = restarted(contract, left(contract))
    rig.position_ned_m = (17.0, -1.5, -4.0)
    rig.run(1.0)
    assert resumed(rig) == []
    assert route(rig) == [(17.0, -1.5), (22.0, 0.0), (22.0, 8.0)]


def test_a_leg_that_was_flown_to_its_end_is_not_flown_again(contract: Contract) -> None:
    rig = restarted(contract, left(contract, place_ned_m=(22.0, 0.05)))
    rig.run(1.0)
    assert resumed(rig) == []
    assert route(rig) == [(0.0, 0.0), (22.0, 0.05), (22.0, 8.0)]
    rig = restarted(contract, left(contract, leg=3, place_ned_m=(22.0, 8.0)))
    rig.position_ned_m = (22.0, 8.0, -4.0)
    rig.run(1.0)
    assert [each.kind for each in resumed(rig)] == [RefusalKind.LEG_FLOWN]


def test_a_restart_in_flight_waits_for_the_word(contract: Contract) -> None:
    rig = restarted(contract, left(contract))
    rig.position_ned_m = (4.0, 0.0, -4.0)  # on the first leg, too
    fly(rig)
    rig.run(6.0)
    assert rig.phase.value == "standby"
    said = rig.texts("refused")[-1]
    assert said.startswith("not leaving standby: a flight was left at leg 2 of 3")
    assert resumed(rig) == []
    rig.run(3.0, until=lambda: rig.phase is Phase.CRUISE)
    assert rig.phase is Phase.CRUISE


def test_a_failsafe_that_ends_hands_nothing_back(contract: Contract) -> None:
    """PX4 holds while no daemon runs, and takes up the mode of setpoints again by itself."""
    rig = restarted(contract, left(contract))
    rig.position_ned_m = (4.0, 0.0, -4.0)
    fly(rig)
    rig.mode, rig.system_status = POSCTL, 5
    rig.run(1.0)
    rig.mode, rig.system_status = OFFBOARD, 4
    rig.run(6.0)
    assert rig.phase.value == "standby"
    assert "a flight was left at leg 2 of 3" in rig.texts("refused")[-1]


def test_a_pilot_who_takes_over_and_hands_back_begins_at_the_first_leg(
    contract: Contract,
) -> None:
    rig = restarted(contract, left(contract))
    fly(rig)
    rig.run(2.0)
    assert rig.phase.value == "standby"
    rig.mode = POSCTL
    rig.run(0.5)
    rig.mode = OFFBOARD
    rig.run(3.0, until=lambda: rig.phase is Phase.CRUISE)
    assert rig.phase is Phase.CRUISE
    assert len(route(rig)) == 4


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"mission": "0" * 64}, "the mission is another one"),
        ({"contract_sha256": "0" * 64}, "the contract is another one"),
        ({"origin_e7": None}, "home is not known"),
        ({"origin_e7": (HOME_E7[0] + 900, HOME_E7[1])}, "home has moved by 10.0 m"),
        ({"origin_e7": (HOME_E7[0], -HOME_E7[1])}, "home has moved by"),
    ],
)
def test_what_has_changed_is_one_sentence(
    contract: Contract, changes: dict[str, object], words: str
) -> None:
    rig = restarted(contract, left(contract, **changes))
    rig.run(1.0)
    (refusal,) = resumed(rig)
    assert refusal.kind is RefusalKind.PROGRESS_VOID
    assert refusal.text.startswith(words)
    assert rig.texts("refused")[-1].startswith(f"not resuming: {words}")
    assert route(rig)[0] == (0.0, 0.0), "the mission stays as it is"


def test_a_home_that_receivers_find_again_is_the_same(contract: Contract) -> None:
    near = HOME_E7[0] + round((ORIGIN_MOVED_MAX_M - 0.1) * M_DEG * 1e7), HOME_E7[1]
    rig = restarted(contract, left(contract, origin_e7=near))
    rig.run(1.0)
    assert resumed(rig) == []


def test_an_origin_that_the_vehicle_does_not_state_is_not_known(contract: Contract) -> None:
    rig = restarted(contract, left(contract))
    rig.origin_e7 = None
    rig.run(1.0)
    (refusal,) = resumed(rig)
    assert refusal.text.startswith("home is not known (GPS_GLOBAL_ORIGIN)")


def test_a_way_that_leaves_the_fence_is_refused(contract: Contract) -> None:
    rig = restarted(contract, left(contract))
    hole = {"keep": "outside", "center_ned_m": [8.0, 0.5], "radius_m": 3.0}
    rig.autonomy.keep_in(Geofence.model_validate({"areas": [hole]}))
    rig.run(1.0)
    assert [each.kind for each in resumed(rig)] == [RefusalKind.GEOFENCE]


def test_without_a_flight_that_was_left_there_is_nothing_to_resume(contract: Contract) -> None:
    rig = restarted(contract, SavedProgress())
    rig.run(1.0)
    assert [each.kind for each in resumed(rig)] == [RefusalKind.NO_PROGRESS]


def test_a_mission_on_board_is_the_same_where_the_origin_has_moved_a_little(
    contract: Contract,
) -> None:
    """Its places in local NED are others then: what counts are the items."""

    def flown_from(origin_e7: tuple[int, int], saved: SavedProgress) -> Board:
        autonomy = Autonomy(contract, PLACEHOLDER, epoch_unix_s=EPOCH_UNIX_S)
        autonomy.fly_mission_on_board(VehicleMission(target_half_width_m=8.0))
        autonomy.progress.restore(saved)
        rig = Board(autonomy, armed=False, landed_state=ON_GROUND, origin_e7=origin_e7)
        rig.run(2.0)
        return rig

    first = flown_from(HOME_E7, SavedProgress())
    fly(first)
    first.run(20.0, until=lambda: first.position_ned_m[0] > 16.0)
    saved = first.autonomy.progress.saved
    assert saved.leg == 2
    again = flown_from((HOME_E7[0] + 90, HOME_E7[1]), saved)
    assert resumed(again) == []
    # The place of the take-off, and the leg that was left.
    assert route(again)[-1][0] == pytest.approx(23.0, abs=0.1)
    assert len(again.autonomy.progress._stated.legs) == 3
