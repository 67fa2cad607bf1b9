"""The synchronous protocol as an agent keeps it: which weights act, what is sent again."""

from __future__ import annotations

import weakref
from dataclasses import replace

import numpy as np
import pytest

from helpers.learners import LEARNER, ME, again, published
from helpers.worlds import random_trajectory
from pa_ros.acting.account import KEPT, RESENT, Account, FreeAccount, Newest
from pa_ros.acting.answer import Wait
from pa_ros.core.published import NO_LAG, LearnerInfo, PublishedPolicy
from pa_ros.world import Trajectory


def account(learner: LearnerInfo = LEARNER, begins: int = 0) -> Account:
    return Account(ME, begins, learner)


def trajectory(sequence: int) -> Trajectory:
    rng = np.random.default_rng(sequence)
    return random_trajectory(rng, agent_id="me", incarnation=5, sequence=sequence)


def version(account: Account, sequence: int) -> int | None:
    """That must act on a trajectory; None: it is waited for."""
    required = account.required(sequence)
    return None if isinstance(required, Wait) else required.snapshot.version


def held(account: Account) -> list[tuple[int, int]]:
    """(sequence, held from) of what may be sent again."""
    return [(one.sequence, one.held_from) for one in account.unaccounted]


@pytest.mark.parametrize("lag", [0, 1, 3])
def test_of_one_agent_trajectory_m_is_acted_by_version_m_minus_lag(lag) -> None:
    books = account(replace(LEARNER, policy_lag=lag))
    books.receive(published(0))
    for m in range(10):
        assert version(books, m) == max(0, m - lag)
        books.send(trajectory(m))
        books.receive(published(m + 1, mine=m + 1))


def test_weights_that_do_not_account_for_enough_are_waited_past() -> None:
    books = account()
    books.receive(published(0))
    assert [version(books, m) for m in range(4)] == [0, 0, None, None]
    waits = books.required(3)
    assert waits == Wait("weights that account for trajectories before 2, of version 0 or later")
    assert books.required(3) == waits  # asking changes nothing
    assert version(books, 0) == 0


def test_with_other_agents_versions_grow_faster_and_nobody_waits_for_ever() -> None:
    books = account()
    for number, yours, mine in ((0, 0, 0), (1, 1, 0), (2, 2, 0), (3, 2, 1)):
        books.receive(published(number, mine, yours))
    assert [version(books, m) for m in (1, 2, 3)] == [0, 3, None]


def test_an_agent_that_stands_beside_others_that_learn_keeps_few_of_their_versions() -> None:
    books, seen = account(), list[weakref.ref[PublishedPolicy]]()
    for number in range(50):
        policy = published(number, mine=number // 25, yours=number)
        seen.append(weakref.ref(policy))
        books.receive(policy)
    del policy
    assert [number for number, one in enumerate(seen) if one() is not None] == [0, 25]
    assert [version(books, m) for m in (1, 2, 3)] == [0, 25, None]


def test_a_refused_trajectory_is_accounted_for_without_another_version() -> None:
    books = account(replace(LEARNER, policy_lag=0))
    books.send(trajectory(0))
    books.receive(published(0))
    assert version(books, 1) is None and held(books) == [(0, 0)]
    books.receive(published(0, mine=1))
    assert version(books, 1) == 0 and held(books) == []


def test_older_weights_never_act_again() -> None:
    books = account(replace(LEARNER, policy_lag=5))
    for number in range(3):
        books.receive(published(number))
    required = books.required(0)
    assert not isinstance(required, Wait) and required.snapshot.version == 0
    books.use(published(2))
    books.receive(published(1))
    assert version(books, 0) == 2


def test_what_is_not_accounted_for_is_kept_and_says_from_where_on() -> None:
    books = account(replace(LEARNER, policy_lag=3))
    sent = [books.send(trajectory(m)) for m in range(3)]
    assert [(one.sequence, one.held_from) for one in sent] == [(0, 0), (1, 0), (2, 0)]
    books.receive(published(1, mine=1))
    assert held(books) == [(1, 1), (2, 1)]
    assert books.lost == 0


def test_after_a_clean_stop_what_was_in_flight_is_sent_again() -> None:
    """The resumed learner publishes the version before its newest, too: it has not gone back."""
    books = account()
    for m in range(8):
        books.receive(published(m, mine=m))
        books.send(trajectory(m))
    books.use(published(7, mine=7))
    books.receive(published(7, mine=7))
    books.send(trajectory(8))
    resumed = again(LEARNER, version=7)
    books.resume(resumed)
    books.receive(published(6, learner=resumed))
    assert held(books) == [(7, 7), (8, 7)] and version(books, 9) is None
    books.receive(published(7, mine=7, learner=resumed))
    assert held(books) == [(7, 7), (8, 7)] and version(books, 9) is None
    books.receive(published(8, mine=8, learner=resumed))
    assert held(books) == [(8, 8)] and version(books, 9) == 8
    assert books.lost == 0


def test_what_a_killed_learner_lost_is_given_up_and_the_rest_sent_again() -> None:
    books = account()
    for m in range(9):
        books.receive(published(m, mine=m))
        books.send(trajectory(m))
    resumed = again(LEARNER, version=4)  # of an old checkpoint: 4 to 7 are gone
    books.resume(resumed)
    assert version(books, 9) is None
    books.receive(published(3, learner=resumed))
    books.receive(published(4, mine=4, learner=resumed))
    assert books.lost == 4 and held(books) == [(8, 8)]
    assert version(books, 9) == 4  # it accounts for all that will ever come before 8
    books.receive(published(5, mine=9, learner=resumed))
    assert version(books, 10) == 5 and books.lost == 4


def test_a_resumed_run_goes_on_for_a_new_agent_as_if_unbroken() -> None:
    for lag, expected in ((0, [7, None]), (1, [6, 7, None]), (2, [5, 6, 7, None])):
        books = account(replace(LEARNER, policy_lag=lag, first_version=7))
        for number in range(7 - lag, 8):
            books.receive(published(number))
        assert [version(books, m) for m in range(lag + 2)] == expected


def test_another_run_begins_at_the_agents_own_number() -> None:
    books = account(replace(LEARNER, run_id="another"), begins=399)
    books.receive(published(0))
    assert [version(books, m) for m in (399, 400, 401)] == [0, 0, None]
    assert [books.send(trajectory(m)).held_from for m in (399, 400)] == [399, 399]
    books.receive(published(1, mine=400))
    assert version(books, 401) == 1 and books.lost == 0


def test_a_greedy_agents_rule_is_the_newest() -> None:
    rule = Newest()
    assert isinstance(rule.required(0), Wait)
    for number in (4, 9, 2):
        rule.receive(published(number))
        required = rule.required(0)
        assert not isinstance(required, Wait) and required.snapshot.version == number


def free(version: int = 0) -> FreeAccount:
    books = FreeAccount(ME, 0, replace(LEARNER, policy_lag=NO_LAG))
    books.receive(published(version))
    return books


def test_a_free_agent_acts_with_the_newest_weights_and_never_waits_for_its_learner() -> None:
    assert isinstance(FreeAccount(ME, 0, LEARNER).required(0), Wait)  # before any have come
    books = free()
    for m in range(10):  # nothing of it is taken in
        assert version(books, m) == 0
        books.send(trajectory(m))
    books.receive(published(7, mine=3))
    books.receive(published(6, mine=2))  # late: newer ones are here
    assert version(books, 10) == 7 and held(books)[0] == (3, 3)


def test_a_free_agent_follows_a_learner_that_goes_on_from_before() -> None:
    books, resumed = free(version=9), again(LEARNER, version=4)
    books.resume(resumed)
    assert version(books, 0) == 9  # it acts on meanwhile
    books.receive(published(4, learner=resumed))
    assert version(books, 0) == 4


def test_what_a_free_agents_learner_does_not_take_in_is_sent_again_and_in_the_end_lost() -> None:
    books = free()
    for m in range(KEPT):
        books.send(trajectory(m))
    assert books.overdue(False) == [] and not books.stalled  # not for a period yet
    assert [one.sequence for one in books.overdue(False)] == list(range(RESENT)) and books.stalled
    books.receive(published(1, mine=1))
    assert books.overdue(False) == [] and not books.stalled  # it goes on
    for m in range(KEPT, KEPT + 5):
        books.send(trajectory(m))
    assert books.lost == 4 and held(books)[0] == (5, 5) and len(held(books)) == KEPT
    books.receive(published(2, mine=2))  # an account from before the loss
    assert books.lost == 4 and held(books)[0] == (5, 5)
