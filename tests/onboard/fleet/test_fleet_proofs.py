"""Machine proofs about several vehicles (THEORY.md, N)."""

from __future__ import annotations

from typing import Any

import pytest
import z3

from tests.onboard.contract.prover import assert_refuted, assert_theorem

# Of tube p of vehicle i, and of tube q of vehicle j.
asked_p, acked_p, used_p, left_p, released_p = z3.Reals("asked_p acked_p used_p left_p released_p")
asked_q, used_q, left_q = z3.Reals("asked_q used_q left_q")
overlap = z3.Bool("overlap")
both_used = z3.And(used_p < left_q, used_q < left_p)

RULES: dict[str, list[Any]] = {
    "in order": [asked_p <= acked_p, acked_p <= used_p, used_p < left_p,
                 asked_q <= used_q, used_q < left_q],
    # j compares with what it uses or has proposed; what it takes back it never uses.
    "ack compares": [z3.Implies(z3.And(asked_q <= acked_p, acked_p < left_q), z3.Not(overlap))],
    # j compares what it proposes with what it has recorded.
    "proposal compares": [
        z3.Implies(z3.And(acked_p < asked_q, asked_q < released_p), z3.Not(overlap))
    ],
    "record stands": [released_p >= left_p],
}  # fmt: skip


def test_tubes_with_leave_are_disjoint_while_both_are_used() -> None:
    """j has given leave for p; that i needed j for p is enough, whatever q needed."""
    rules = [each for rule in RULES.values() for each in rule]
    assert_theorem(z3.Implies(both_used, z3.Not(overlap)), *rules)


@pytest.mark.parametrize("left_out", ["ack compares", "proposal compares", "record stands"])
def test_no_rule_can_be_left_out(left_out: str) -> None:
    rules = [each for name, rule in RULES.items() if name != left_out for each in rule]
    assert_refuted(z3.Implies(both_used, z3.Not(overlap)), *rules)


def test_a_record_that_an_earlier_heartbeat_releases_does_not_stand() -> None:
    """Sent before p was proposed, it lists p neither as used nor as proposed."""
    sent, arrived = z3.Reals("sent arrived")
    rules = [*RULES["in order"], *RULES["ack compares"], *RULES["proposal compares"]]
    heartbeat = [sent <= arrived, released_p == arrived]
    assert_refuted(z3.Implies(both_used, z3.Not(overlap)), *rules, *heartbeat, sent < asked_p)
    # One of the same run that was sent after p was proposed says so only once p is left.
    assert_theorem(
        z3.Implies(both_used, z3.Not(overlap)),
        *rules, *heartbeat, sent >= asked_p, sent >= left_p,
    )  # fmt: skip


# ------------------------------------------------------------------------ who is not asked

place, then, speed, reach, wait = z3.Reals("place then speed reach wait")
echoed, measured, sent, now, until, at = z3.Reals("echoed measured sent now until at")
TIMES = [speed >= 0, reach >= 0, wait >= 0, measured <= sent, sent <= now, now <= until]


def disc_holds(age_from: Any) -> Any:
    """Return "the body of the peer, on a line, is in the disc at any time until then"."""
    body = then + z3.Real("part")
    return z3.And(
        body <= place + reach + speed * (until - age_from),
        body >= place - reach - speed * (until - age_from),
    )


MOVES = [
    at >= measured,
    at <= until,
    then <= place + speed * (at - measured),
    then >= place - speed * (at - measured),
    z3.Real("part") <= reach,
    z3.Real("part") >= -reach,
]


def test_a_peer_that_is_not_asked_is_nowhere_in_the_tube() -> None:
    """The position is no older than what its heartbeat answers, less its age at sending."""
    known = [echoed <= sent, wait >= sent - measured]
    assert_theorem(disc_holds(echoed - wait), *TIMES, *MOVES, *known)


def test_counted_from_its_arrival_it_may_be_there() -> None:
    known = [echoed <= sent, wait >= sent - measured, speed > 0]
    assert_refuted(disc_holds(now), *TIMES, *MOVES, *known)


def test_a_tube_may_be_used_up_to_its_end_of_time_only() -> None:
    late = [each for each in MOVES if each is not MOVES[1]]
    known = [echoed <= sent, wait >= sent - measured, speed > 0, at > until]
    assert_refuted(disc_holds(echoed - wait), *TIMES, *late, *known)


# ------------------------------------------------------------------------ whose run counts


def test_a_run_that_answers_what_was_sent_after_both_were_seen_is_the_newer() -> None:
    """Runs of one vehicle follow one another."""
    one_begins, one_ends, other_begins, other_ends, seen_other, challenge, answer = z3.Reals(
        "one_begins one_ends other_begins other_ends seen_other challenge answer"
    )
    known = [
        one_begins <= one_ends,
        other_begins <= other_ends,
        z3.Or(one_ends <= other_begins, other_ends <= one_begins),
        # The other had said something before it was seen; the answer is the one's.
        other_begins <= seen_other,
        seen_other < challenge,
        challenge <= answer,
        one_begins <= answer,
        answer <= one_ends,
    ]
    assert_theorem(other_ends <= one_begins, *known)
    assert_refuted(other_ends <= one_begins, *[each for each in known if each is not known[4]])
