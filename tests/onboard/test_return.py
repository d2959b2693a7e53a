"""The way back: at the end of the mission, by the operator's command, in flight and from rest."""

import pytest

from onboard.autonomy import Autonomy
from onboard.files.contract_file import Contract
from onboard.files.mission_file import Mission
from onboard.guidance.departure import Refusal, RefusalKind
from onboard.guidance.phases import Phase
from onboard.monitoring.resumption import QUIET_S
from tests.onboard.test_autonomy import EPOCH_UNIX_S, OFFBOARD, POSCTL, Rig
from tests.onboard.test_resume import SeeingAllRound, blinded

LEGS = [{"end_ned_m": [14.0, 0.0], "target_half_width_m": 8.0}]
MISSION = Mission.model_validate({"altitude_m": 4.0, "legs": LEGS})
THERE_AND_BACK = Mission.model_validate({"altitude_m": 4.0, "legs": LEGS, "on_end": "return"})


def cruising(contract: Contract) -> Rig:
    rig = Rig(Autonomy(contract, MISSION, epoch_unix_s=EPOCH_UNIX_S), mode=OFFBOARD)
    rig.run(7.0, until=lambda: rig.position_ned_m[0] > 4.0)
    assert rig.phase is Phase.CRUISE
    return rig


def returned(rig: Rig) -> list[Refusal]:
    """Send the command; return the answer, which the next tick gives."""
    answers: list[list[Refusal]] = []
    rig.autonomy.receive_resume(answers.append, "return")
    rig.tick()
    (answer,) = answers
    return answer


def fly_home(rig: Rig, seconds: float = 60.0) -> None:
    rig.run(seconds, until=lambda: rig.phase in (Phase.ARRIVED, Phase.HOLD))
    assert rig.phase is Phase.ARRIVED, rig.texts("phase")
    assert rig.position_ned_m[:2] == pytest.approx((0.0, 0.0), abs=0.3)


def test_a_mission_may_end_where_it_began(contract: Contract) -> None:
    rig = Rig(Autonomy(contract, THERE_AND_BACK, epoch_unix_s=EPOCH_UNIX_S), mode=OFFBOARD)
    rig.run(60.0, until=lambda: bool(rig.texts("mission_changed")))
    assert rig.position_ned_m[0] == pytest.approx(14.0, abs=0.05)
    fly_home(rig)
    assert rig.texts("mission_changed") == [
        "returning along the way flown, 1 legs, 14 m: the mission has been flown"
    ]


def test_in_flight_it_stops_turns_round_and_returns(contract: Contract) -> None:
    rig = cruising(contract)
    turned_m = rig.position_ned_m[0]
    assert returned(rig) == []
    assert {each.kind for each in returned(rig)} == {RefusalKind.NO_WAY_BACK}
    rig.run(20.0, until=lambda: rig.position_ned_m[0] < turned_m - 0.5)
    # The vehicle looks where it flies.
    assert abs(rig.autonomy.navigator.leg.heading_rad) == pytest.approx(3.1416, abs=1e-3)
    fly_home(rig)


def test_from_a_hold_it_returns_once_all_that_failed_holds_again(contract: Contract) -> None:
    rig = blinded(cruising(contract))
    assert "failed" in {each.kind.value for each in returned(rig)}
    assert rig.phase is Phase.HOLD
    rig.run(QUIET_S + 0.2)
    assert returned(rig) == []
    fly_home(rig)


def test_from_the_end_of_the_mission_it_returns(contract: Contract) -> None:
    rig = cruising(contract)
    rig.run(30.0, until=lambda: rig.phase is Phase.ARRIVED)
    rig.seeing = False
    rig.run(2.0)
    assert {each.kind for each in returned(rig)} == {RefusalKind.DETECTIONS}
    rig.seeing = True
    rig.run(1.0)
    assert returned(rig) == []
    fly_home(rig)
    assert [each.text for each in returned(rig)] == ["the vehicle returns already"]


def test_before_the_flight_nothing_leads_back(contract: Contract) -> None:
    rig = Rig(Autonomy(contract, MISSION, epoch_unix_s=EPOCH_UNIX_S), mode=POSCTL)
    rig.run(1.0)
    assert [each.text for each in returned(rig)] == ["not flying (phase standby)"]
    assert rig.texts("refused")[-1] == "not returning: not flying (phase standby)"


def test_where_it_began_it_says_so(contract: Contract) -> None:
    rig = Rig(Autonomy(contract, MISSION, epoch_unix_s=EPOCH_UNIX_S), mode=OFFBOARD)
    rig.run(1.0, until=lambda: rig.phase is Phase.CRUISE)
    assert [each.text for each in returned(rig)] == ["the vehicle is where it began"]
    assert rig.phase is Phase.CRUISE


def test_another_mission_ends_the_way_back_and_the_rest_of_it_stays_known(
    contract: Contract,
) -> None:
    rig = cruising(contract)
    assert returned(rig) == []
    rig.run(20.0, until=lambda: rig.position_ned_m[0] < 2.0)
    beside = Mission.model_validate(
        {"altitude_m": 4.0, "start_ned_m": [2.0, 0.0], "legs": [{"end_ned_m": [2.0, 4.0]}]}
    )
    rig.autonomy.receive_mission(beside.model_dump_json().encode(), rig.now_s)
    rig.run(30.0, until=lambda: rig.phase is Phase.ARRIVED)
    assert rig.position_ned_m[1] == pytest.approx(4.0, abs=0.1)
    assert returned(rig) == []
    assert rig.texts("mission_changed")[-1].startswith("returning along the way flown, 2 legs, 5 m")
    fly_home(rig)


def test_with_best_effort_it_returns_in_the_space_that_it_sees_free(contract: Contract) -> None:
    requirements = contract.requirements.model_copy(
        update={"stop": True, "progress": "best_effort"}
    )
    sensor = contract.sensor.model_copy(update={"field_of_view_deg": 360.0})
    contract = contract.model_copy(update={"requirements": requirements, "sensor": sensor})
    rig = SeeingAllRound(Autonomy(contract, MISSION, epoch_unix_s=EPOCH_UNIX_S), mode=OFFBOARD)
    rig.run(20.0, until=lambda: rig.position_ned_m[0] > 3.0)
    assert rig.phase is Phase.THREAD
    assert returned(rig) == []
    fly_home(rig)
    way = rig.autonomy.navigator.thread
    assert way is not None
    assert way.way.certified is True


# ------------------------------------------------------------------ the battery


class Powered(Rig):
    """A rig that reports its battery; None reports nothing."""

    percent: int | None = 90

    def say_what_the_position_is_worth(self) -> None:
        super().say_what_the_position_is_worth()
        if self.percent is not None:
            cells = [15000, *(0xFFFF,) * 9]
            self._mav.battery_status_send(0, 0, 0, 2500, cells, 1200, 300, -1, self.percent)


def powered(contract: Contract, percent: int | None = 90, endurance_s: float = 900.0) -> Powered:
    budget = {"reserve_fraction": 0.25, "endurance_s": endurance_s}
    mission = Mission.model_validate({"altitude_m": 4.0, "legs": LEGS, "energy": budget})
    rig = Powered(Autonomy(contract, mission, epoch_unix_s=EPOCH_UNIX_S), mode=OFFBOARD)
    rig.percent = percent
    rig.run(7.0, until=lambda: rig.position_ned_m[0] > 3.0)
    return rig


def test_it_returns_in_time_for_the_battery_and_has_the_pilot_land_at_its_reserve(
    contract: Contract,
) -> None:
    rig = powered(contract)
    assert rig.texts("mission_changed") == []
    rig.percent = 57
    fly_home(rig)
    (said,) = rig.texts("mission_changed")
    assert said.endswith("battery at 57 %, the way back may take 34 %, reserve 25 %")
    rig.percent = 25
    rig.run(1.0)
    assert rig.texts("battery") == ["battery at 25 %, reserve 25 %: land now"]


def test_a_battery_that_falls_silent_counts_as_failing(contract: Contract) -> None:
    rig = powered(contract)
    rig.percent = None
    fly_home(rig)
    assert "has not been reported for 5 s" in rig.texts("mission_changed")[0]


def test_at_the_end_of_the_mission_it_returns_by_itself_in_time(contract: Contract) -> None:
    rig = powered(contract)
    rig.run(20.0, until=lambda: rig.phase is Phase.ARRIVED)
    rig.percent = 50
    rig.tick()
    fly_home(rig)


def test_a_hold_is_left_to_the_pilot_who_is_told(contract: Contract) -> None:
    rig = powered(contract)
    blinded(rig)
    rig.percent = 50
    rig.run(1.0)
    assert rig.phase is Phase.HOLD
    assert rig.texts("battery")[0].endswith("reserve 25 %: the pilot has to take over")


@pytest.mark.parametrize(
    ("percent", "endurance_s", "words"),
    [(None, 900.0, "charge is unknown"), (27, 900.0, "there and back"), (90, 40.0, "there and")],
)
def test_without_enough_it_does_not_depart(
    contract: Contract, percent: int | None, endurance_s: float, words: str
) -> None:
    rig = powered(contract, percent, endurance_s)
    assert rig.phase is Phase.STANDBY
    assert words in rig.texts("refused")[-1]
