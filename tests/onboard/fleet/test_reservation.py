"""Reservation by acknowledgement, message by message."""

from __future__ import annotations

import math

import numpy as np
import pytest

from onboard.fleet.area import meet
from onboard.fleet.messages import Ack, Commit, Head, Heartbeat, Message, Propose, Tube
from onboard.fleet.peer import Peer
from onboard.fleet.reservation import Reservation
from tests.onboard.fleet.pair import BOOTS, REACH_M, said, talk, tell, vehicle, way

FAR = (0.0, 60.0)
KNOWN_S = (0.0, 0.5, 1.0, 1.5)


def acquainted(
    second_m: tuple[float, float] = FAR, make: type[Reservation] = Reservation
) -> tuple[Reservation, Reservation]:
    """Return two vehicles that know of each other, at 1.5 s; the first is at the origin."""
    first, second = vehicle("a", (0.0, 0.0), make), vehicle("b", second_m, make)
    talk(first, second, KNOWN_S)
    assert first.peers["b"].is_known
    assert second.peers["a"].is_known
    return first, second


# ------------------------------------------------------------------------ who is asked


def test_a_peer_that_was_never_heard_is_asked_however_far_the_way() -> None:
    first = vehicle("a", (0.0, 0.0))
    assert first.propose(way((0.0, 0.0), (5.0, 0.0)), 4.0, 0.0)
    assert first.outstanding is not None
    assert first.outstanding.need == {"b"}
    assert first.outstanding.expires_s == math.inf


def test_a_peer_that_cannot_come_in_time_is_not_asked_and_the_tube_expires() -> None:
    first, _ = acquainted()
    assert first.propose(way((0.0, 0.0), (5.0, 0.0)), 4.0, 1.5)
    assert first.outstanding is None
    assert first.expires_s == 5.5
    assert meet(first.active.boxes_m, way((5.0, 0.0), (5.0, 0.0)))


def test_who_might_come_while_the_tube_lasts_is_asked() -> None:
    """60 m away, less both reaches, is 12.7 s of the fleet's speed, from when it was heard."""
    for duration_s, asked in ((11.0, False), (14.0, True)):
        first, _ = acquainted()
        first.propose(way((0.0, 0.0), (5.0, 0.0)), duration_s, 1.5)
        assert (first.outstanding is not None) == asked


def test_the_age_of_a_position_counts_from_what_its_heartbeat_answers() -> None:
    """Not from its arrival, nor by the peer's clock, which is an hour ahead here."""
    first, second = vehicle("a", (0.0, 0.0)), vehicle("b", FAR)
    ahead_s = 3600.0
    for now_s in KNOWN_S:
        tell(second, said(first, now_s), now_s + ahead_s)
        second.report(FAR, now_s + ahead_s)
        tell(first, said(second, now_s + ahead_s), now_s)
    answer = said(second, 2.0 + ahead_s)
    tell(first, answer, 9.0)
    disc = first.peers["b"].disc(9.0, 4.5)
    assert disc is not None
    assert disc[0] == FAR
    # What came at 1.5 s answered our heartbeat of that time, and the last answers no later one.
    assert disc[1] == pytest.approx(REACH_M + 4.5 * (9.0 - 1.5))


def test_silence_lets_a_peer_be_anywhere_near() -> None:
    first, _ = acquainted()
    assert first.propose(way((0.0, 0.0), (5.0, 0.0)), 4.0, 30.0)
    assert first.outstanding is not None


@pytest.mark.parametrize("duration_s", [0.0, -1.0, math.nan])
def test_a_tube_lasts_for_some_time(duration_s: float) -> None:
    with pytest.raises(ValueError, match="duration_s = "):
        vehicle("a", (0.0, 0.0)).propose(way((0.0, 0.0), (5.0, 0.0)), duration_s, 0.0)


# ------------------------------------------------------------------------ leave


def test_with_leave_it_flies_without_an_end_of_time() -> None:
    first, second = acquainted((20.0, 0.0))
    first.propose(way((0.0, 0.0), (8.0, 0.0)), 10.0, 1.5)
    assert not meet(first.active.boxes_m, way((8.0, 0.0), (8.0, 0.0)))
    talk(first, second, [2.0])
    assert first.counts["committed"] == 1
    assert first.expires_s == math.inf
    assert meet(first.active.boxes_m, way((8.0, 0.0), (8.0, 0.0)))
    # And the other keeps out.
    assert not second.propose(way((20.0, 0.0), (5.0, 0.0)), 30.0, 2.5)
    assert second.free_of_records(way((20.0, 0.0), (5.0, 0.0), pieces=15)) == 8


def test_no_leave_is_given_for_where_a_vehicle_rests_or_flies() -> None:
    first, second = acquainted((20.0, 0.0))
    proposal = Propose(Head("b", BOOTS["b"], 90), Tube(89, way((20.0, 0.0), (0.0, 0.0))), 0.0)
    first.receive(proposal, 2.0)
    assert not any(isinstance(message, Ack) for message in said(first))
    assert second.peers["a"].is_known


@pytest.mark.parametrize(("stamp_s", "wins"), [(1.0, "b"), (1.5, "a"), (2.0, "a")])
def test_of_two_proposals_the_earlier_goes_first(stamp_s: float, wins: str) -> None:
    """And of two of one time, the first name."""
    first, _ = acquainted((20.0, 0.0))
    first.propose(way((0.0, 0.0), (12.0, 0.0)), 30.0, 1.5)
    other = Propose(Head("b", BOOTS["b"], 90), Tube(89, way((20.0, 0.0), (8.0, 0.0))), stamp_s)
    first.receive(other, 2.0)
    answered = [type(message) for message in said(first)]
    if wins == "b":
        assert first.outstanding is None
        assert answered == [Commit, Ack]
        assert not first.propose(way((0.0, 0.0), (12.0, 0.0)), 30.0, 2.5)
    else:
        assert first.outstanding is not None
        assert answered == []


def test_a_proposal_without_answer_is_withdrawn_and_its_late_leave_is_worthless() -> None:
    first, second = acquainted((20.0, 0.0))
    first.propose(way((0.0, 0.0), (8.0, 0.0)), 30.0, 1.5)
    tell(second, said(first, 2.0), 2.0)
    late = said(second)
    assert any(isinstance(message, Ack) for message in late)
    first.tick(6.0)
    assert first.counts["withdrawn"] == 1
    tell(first, late, 6.0)
    assert first.counts["committed"] == 0
    # Once told so, the other is free of it.
    tell(second, said(first), 6.0)
    assert second.peers["a"].records.keys() == {0}


def test_leave_that_comes_after_the_tube_has_expired_is_worthless() -> None:
    first = vehicle("a", (0.0, 0.0), roster=("a", "b", "c"))
    for name in "bc":
        peer, place = first.peers[name], (20.0, 0.0) if name == "b" else (0.0, 60.0)
        peer.boot, peer._seen = name * 16, {name * 16}
        peer._place = (place, REACH_M, 0.0)
    first.propose(way((0.0, 0.0), (8.0, 0.0)), 3.0, 0.0)
    assert first.outstanding is not None
    assert first.outstanding.need == frozenset("b")
    assert first.outstanding.expires_s == 3.0
    number = first.outstanding.tube.number
    first.receive(Ack(Head("b", "b" * 16, 5), "a", BOOTS["a"], number), 3.1)
    assert first.counts["committed"] == 0


def test_a_long_way_asks_whom_a_short_one_need_not() -> None:
    """What is used without being asked for is out of the other's reach while it lasts."""
    first, second = acquainted((0.0, 70.0))
    middle = way((0.0, 0.0), (0.0, 12.0)), way((0.0, 70.0), (0.0, 9.0))
    assert first.propose(middle[0], 8.0, 1.5)
    assert first.counts["committed"] == 1
    assert second.propose(middle[1], 20.0, 1.5)
    assert second.outstanding is not None
    assert second.outstanding.need == frozenset("a")
    # Of two short ways that begin far apart, no place is common.
    short = way((0.0, 70.0), (0.0, 58.0))
    third = acquainted((0.0, 70.0))[1]
    assert third.propose(short, 8.0, 1.5)
    assert third.expires_s == 9.5
    assert not meet(third.active.boxes_m, first.active.boxes_m)


# ------------------------------------------------------------------------ what is released


class ReleasedByAny(Peer):
    """The rule without its condition."""

    def _releases(self, _heartbeat: Heartbeat, _number: int) -> bool:
        return True


class ForgetsEarly(Reservation):
    """A vehicle whose records any heartbeat releases."""

    def _peer(self) -> Peer:
        return ReleasedByAny()


@pytest.mark.parametrize("make", [Reservation, ForgetsEarly])
def test_a_heartbeat_from_before_a_proposal_does_not_release_it(make: type[Reservation]) -> None:
    """Else the other comes to rest in the way of one that has its leave, and flies at it."""
    first, second = acquainted((5.0, 75.0), make)
    earlier = said(first, 2.0)
    assert [type(message) for message in earlier] == [Heartbeat]
    first.propose(way((0.0, 0.0), (0.0, 150.0), pieces=50), 60.0, 2.1)
    talk(first, second, [2.2])
    assert first.counts["committed"] == 1
    tell(second, earlier, 2.3)
    hop = way((5.0, 75.0), (0.0, 75.0))
    assert second.propose(hop, 5.0, 2.3) == (make is ForgetsEarly)
    assert meet(first.active.boxes_m, second.active.boxes_m) == (make is ForgetsEarly)


def test_what_was_passed_is_free_for_others() -> None:
    first, second = acquainted((20.0, 10.0))
    first.propose(way((0.0, 0.0), (40.0, 0.0), pieces=20), 60.0, 1.5)
    talk(first, second, [2.0])
    across = way((20.0, 10.0), (20.0, -10.0))
    assert not second.propose(across, 10.0, 2.5)
    assert first.report((19.0, 0.0), 8.0)
    assert meet(first.active.boxes_m, across)
    assert first.report((28.0, 0.0), 9.5)
    assert not meet(first.active.boxes_m, across)
    talk(first, second, [10.0, 10.5])
    assert second.propose(across, 10.0, 10.5)
    talk(first, second, [11.0])
    assert second.counts["committed"] == 1


def test_a_proposal_holds_all_that_may_still_be_occupied() -> None:
    """In flight, too: until leave comes, and if it never does, the old tube is flown out."""
    first, second = acquainted((20.0, 30.0))
    first.propose(way((0.0, 0.0), (10.0, 0.0), pieces=5), 60.0, 1.5)
    talk(first, second, [2.0])
    first.report((4.0, 0.0), 4.0)
    first.propose(way((10.0, 0.0), (20.0, 0.0)), 60.0, 4.0)
    assert first.outstanding is not None
    for place in ((4.0, 0.0), (8.0, 0.0), (20.0, 0.0)):
        assert meet(first.outstanding.tube.boxes_m, way(place, place))


def test_at_rest_it_gives_up_all_but_its_place() -> None:
    first, _ = acquainted()
    first.propose(way((0.0, 0.0), (8.0, 0.0)), 4.0, 1.5)
    first.report((3.0, 0.0), 3.0)
    first.settle()
    assert first.expires_s == math.inf
    np.testing.assert_allclose(first.active.boxes_m, [[1.5, 4.5, -1.5, 1.5]])


def test_leaving_the_tube_is_noticed() -> None:
    first, _ = acquainted()
    first.propose(way((0.0, 0.0), (5.0, 0.0)), 4.0, 1.5)
    assert first.report((1.0, 0.0), 2.0)
    assert not first.report((9.0, 0.0), 3.0)
    assert first.counts["outside"] == 1


@pytest.mark.parametrize("place_m", [(1.0, 0.1), (5.1, 0.0), (math.nan, 0.0), (0.0, math.inf)])
def test_a_body_that_may_reach_out_of_its_tube_has_left_it(place_m: tuple[float, float]) -> None:
    first, _ = acquainted()
    first.propose(way((0.0, 0.0), (5.0, 0.0)), 4.0, 1.5)
    held_m = first.active.boxes_m
    assert not first.report(place_m, 2.0)
    np.testing.assert_array_equal(first.active.boxes_m, held_m)
    assert first.report((5.0, 0.0), 3.0)


@pytest.mark.parametrize(
    "box_m", [[math.nan, 1.0, 0.0, 1.0], [0.0, math.inf, 0.0, 1.0], [1.0, 0.0, 0.0, 1.0]]
)
def test_a_box_that_meets_nothing_is_not_proposed(box_m: list[float]) -> None:
    first, _ = acquainted()
    with pytest.raises(ValueError, match="onward_m: a box is not finite, or ends before it begins"):
        first.propose(np.array([box_m]), 4.0, 1.5)
    assert first.counts["committed"] == 0


def test_memory_of_what_a_peer_says_has_an_end() -> None:
    """However many tubes and runs it names; leave is given for what is recorded only."""
    first, _ = acquainted((20.0, 0.0))
    for number in range(100, 400, 2):
        tube = Tube(number, way((20.0, 0.0), (12.0, 0.0)))
        first.receive(Propose(Head("b", BOOTS["b"], number + 1), tube, 0.0), 2.0)
    leave = [each.tube_number for each in said(first) if isinstance(each, Ack)]
    peer = first.peers["b"]
    assert len(peer.records) == 16
    assert leave == [number for number in peer.records if number >= 100]
    for run in range(1000):
        first.receive(Commit(Head("b", f"{run:016x}", 1), 0, committed=True), 2.0)
    assert len(peer._seen) == 64


def test_a_run_beyond_what_is_remembered_is_confirmed_all_the_same() -> None:
    first, _ = acquainted((20.0, 0.0))
    for run in range(1000):
        first.receive(Commit(Head("b", f"{run:016x}", 1), 0, committed=True), 2.0)
    again = vehicle("b", (20.0, 0.0), boot="e" * 16)
    talk(first, again, [2.0, 2.5, 3.0, 3.5])
    assert first.peers["b"].boot == "e" * 16
    assert first.propose(way((0.0, 0.0), (8.0, 0.0)), 30.0, 4.0)
    talk(first, again, [4.0])
    assert first.counts["committed"] == 1


# ------------------------------------------------------------------------ runs


def test_after_a_restart_all_are_asked_until_they_have_answered_this_run() -> None:
    first, second = acquainted((20.0, 0.0))
    second.propose(way((20.0, 0.0), (10.0, 0.0)), 30.0, 1.5)
    talk(first, second, [2.0])
    before = said(second, 2.5)
    again = vehicle("a", (0.0, 0.0), boot="c" * 16)
    tell(again, before, 3.0)
    # It answered another run: neither where it is nor what it holds is known.
    assert not again.peers["b"].is_known
    assert not again.peers["b"].records
    talk(again, second, [3.5, 4.0, 4.5])
    assert again.peers["b"].is_known
    assert not again.propose(way((0.0, 0.0), (12.0, 0.0)), 30.0, 5.0)


def test_a_restart_gives_up_what_the_run_before_held() -> None:
    first, second = acquainted((20.0, 0.0))
    first.propose(way((0.0, 0.0), (8.0, 0.0)), 30.0, 1.5)
    talk(first, second, [2.0])
    delayed = said(first, 2.5)
    again = vehicle("a", (0.0, 0.0), boot="c" * 16)
    onto = way((20.0, 0.0), (6.0, 0.0))
    tell(second, said(again, 3.0), 3.0)
    assert not second.propose(onto, 30.0, 3.0), "no echo has confirmed the new run"
    talk(again, second, [3.5, 4.0, 4.5])
    assert second.peers["a"].boot == "c" * 16
    tell(second, delayed, 5.0)
    assert second.peers["a"].boot == "c" * 16, "a run that has ended does not come back"
    assert second.propose(onto, 30.0, 5.0)


def test_a_delayed_message_of_an_older_run_takes_nothing_away() -> None:
    older = vehicle("a", (0.0, 0.0), boot="c" * 16)
    stale = said(older, 0.0)
    first, second = acquainted((20.0, 0.0))
    first.propose(way((0.0, 0.0), (8.0, 0.0)), 30.0, 1.5)
    talk(first, second, [2.0])
    tell(second, stale, 2.5)
    assert not second.propose(way((20.0, 0.0), (6.0, 0.0)), 30.0, 2.5)
    talk(first, second, [3.0, 3.5, 4.0])
    assert second.peers["a"].boot == BOOTS["a"]
    assert not second.propose(way((20.0, 0.0), (6.0, 0.0)), 30.0, 4.0)


def test_a_message_twice_changes_nothing() -> None:
    first, second = acquainted((20.0, 0.0))
    first.propose(way((0.0, 0.0), (8.0, 0.0)), 30.0, 1.5)
    asked = said(first, 2.0)
    tell(second, asked + asked, 2.0)
    answered = said(second)
    assert sum(isinstance(message, Ack) for message in answered) == 2
    tell(first, answered + answered, 2.0)
    assert first.counts["committed"] == 1


# ------------------------------------------------------------------------ strangers


def test_who_is_not_in_the_roster_is_ignored_and_counted() -> None:
    first, _ = acquainted()
    stranger = vehicle("b", (3.0, 0.0), roster=("a", "b"), boot="d" * 16)
    messages: list[Message] = [
        Heartbeat(Head("x", "d" * 16, 1), stranger.active, None, (3.0, 0.0), 0.0, 1.0),
        Propose(Head("x", "d" * 16, 2), Tube(3, way((3.0, 0.0), (9.0, 0.0))), 0.0),
        Heartbeat(Head("a", "d" * 16, 1), stranger.active, None, (3.0, 0.0), 0.0, 1.0),
    ]
    tell(first, messages, 2.0)
    assert (first.counts["not_in_roster"], first.counts["own"]) == (2, 1)
    assert not any(isinstance(message, Ack) for message in said(first))


@pytest.mark.parametrize(
    ("proposer", "boot", "more"), [("c", BOOTS["a"], 0), ("a", "c" * 16, 0), ("a", BOOTS["a"], 1)]
)
def test_leave_for_another_tube_is_none_for_this(proposer: str, boot: str, more: int) -> None:
    """Of another vehicle, of the run before, or for what was proposed before."""
    first, _ = acquainted((20.0, 0.0))
    first.propose(way((0.0, 0.0), (8.0, 0.0)), 30.0, 1.5)
    assert first.outstanding is not None
    number = first.outstanding.tube.number - more
    first.receive(Ack(Head("b", BOOTS["b"], 90), proposer, boot, number), 2.0)
    assert first.counts["committed"] == 0


def test_a_way_that_is_held_for_longer_than_the_leave_has_none() -> None:
    """Else it would fly on after its tube has ended, for who was not asked."""
    first, second = vehicle("a", (0.0, 0.0)), vehicle("b", FAR)
    talk(first, second, KNOWN_S)
    first.rests_s = 6.0
    assert first.propose(way((0.0, 0.0), (5.0, 0.0)), 4.0, 1.5)
    assert first.counts["committed"] == 0
    first.rests_s = 5.0
    assert first.outstanding is not None
    first.withdraw()
    assert first.propose(way((0.0, 0.0), (5.0, 0.0)), 4.0, 1.5)
    assert (first.counts["committed"], first.expires_s) == (1, 5.5)


def test_another_run_under_the_own_name_is_noted_while_it_speaks() -> None:
    first = vehicle("a", (0.0, 0.0))
    twin = vehicle("a", (40.0, 0.0), boot="c" * 16)
    tell(first, said(first, 1.0), 1.0)
    assert first.namesake_s == -math.inf, "what is its own says nothing"
    heard = said(twin, 2.0)
    tell(first, heard, 2.0)
    assert first.namesake_s == 2.0
    tell(first, heard, 9.0)
    assert first.namesake_s == 2.0, "nor does what is repeated"
    tell(first, said(twin, 9.5), 9.5)
    assert first.namesake_s == 9.5
