"""The synchronous protocol as an agent keeps it: which weights act, what is sent again."""

import weakref
from dataclasses import replace

import numpy as np

from helpers.learners import LEARNER, ME, again, published
from helpers.worlds import random_trajectory
from pa_ros.acting.send_window import FREE_WINDOW, RESENT_AT_ONCE, FreeSendWindow, SendWindow, Wait
from pa_ros.core.experience import NO_LAG, LearnerInfo, PublishedPolicy
from pa_ros.world import Trajectory


def window_of(learner: LearnerInfo = LEARNER, first_sequence: int = 0) -> SendWindow:
    return SendWindow(ME, first_sequence, learner)


def trajectory(sequence: int) -> Trajectory:
    rng = np.random.default_rng(sequence)
    return random_trajectory(rng, agent_id="me", incarnation=5, sequence=sequence)


def version(window: SendWindow, sequence: int) -> int | None:
    """That must act on a trajectory; None: it is waited for."""
    required = window.required(sequence)
    return None if isinstance(required, Wait) else required.snapshot.version


def held(window: SendWindow) -> list[tuple[int, int]]:
    """(sequence, held from) of what may be sent again."""
    return [(one.sequence, one.held_from) for one in window.unaccounted]


def test_an_agent_waits_for_weights_that_account_for_enough() -> None:
    window = window_of()
    window.receive(published(0))
    assert [version(window, m) for m in range(4)] == [0, 0, None, None]
    waits = window.required(3)
    assert waits == Wait("weights that account for trajectories before 2, of version 0 or later")
    assert window.required(3) == waits  # asking changes nothing
    assert version(window, 0) == 0


def test_with_other_agents_versions_grow_faster() -> None:
    window = window_of()
    for number, yours, mine in ((0, 0, 0), (1, 1, 0), (2, 2, 0), (3, 2, 1)):
        window.receive(published(number, mine, yours))
    assert [version(window, m) for m in (1, 2, 3)] == [0, 3, None]


def test_a_paused_agent_beside_others_keeps_few_of_their_versions() -> None:
    window, seen = window_of(), list[weakref.ref[PublishedPolicy]]()
    for number in range(50):
        policy = published(number, mine=number // 25, yours=number)
        seen.append(weakref.ref(policy))
        window.receive(policy)
    del policy
    assert [number for number, one in enumerate(seen) if one() is not None] == [0, 25]
    assert [version(window, m) for m in (1, 2, 3)] == [0, 25, None]


def test_a_refused_trajectory_is_accounted_for_without_another_version() -> None:
    window = window_of(replace(LEARNER, policy_lag=0))
    window.add(trajectory(0))
    window.receive(published(0))
    assert version(window, 1) is None and held(window) == [(0, 0)]
    window.receive(published(0, mine=1))
    assert version(window, 1) == 0 and held(window) == []


def test_older_weights_never_act_again() -> None:
    window = window_of(replace(LEARNER, policy_lag=5))
    for number in range(3):
        window.receive(published(number))
    required = window.required(0)
    assert not isinstance(required, Wait) and required.snapshot.version == 0
    window.use(published(2))
    window.receive(published(1))
    assert version(window, 0) == 2


def test_trajectories_are_kept_until_accounted_for_and_say_from_where_on() -> None:
    window = window_of(replace(LEARNER, policy_lag=3))
    sent = [window.add(trajectory(m)) for m in range(3)]
    assert [(one.sequence, one.held_from) for one in sent] == [(0, 0), (1, 0), (2, 0)]
    window.receive(published(1, mine=1))
    assert held(window) == [(1, 1), (2, 1)]
    assert window.overdue(False) == [] and len(window.overdue(True)) == 2
    assert window.lost == 0 and not window.stalled


def test_after_a_clean_stop_trajectories_in_flight_are_sent_again() -> None:
    """The resumed learner publishes the version before its newest, too: it has not gone back."""
    window = window_of()
    for m in range(8):
        window.receive(published(m, mine=m))
        window.add(trajectory(m))
    window.use(published(7, mine=7))
    window.receive(published(7, mine=7))
    window.add(trajectory(8))
    resumed = again(LEARNER, version=7)
    window.resume(resumed)
    window.receive(published(6, learner=resumed))
    assert held(window) == [(7, 7), (8, 7)] and version(window, 9) is None
    window.receive(published(7, mine=7, learner=resumed))
    assert held(window) == [(7, 7), (8, 7)] and version(window, 9) is None
    window.receive(published(8, mine=8, learner=resumed))
    assert held(window) == [(8, 8)] and version(window, 9) == 8
    assert window.lost == 0


def test_trajectories_that_a_killed_learner_lost_are_given_up() -> None:
    window = window_of()
    for m in range(9):
        window.receive(published(m, mine=m))
        window.add(trajectory(m))
    resumed = again(LEARNER, version=4)  # of an old checkpoint: 4 to 7 are gone
    window.resume(resumed)
    assert version(window, 9) is None
    window.receive(published(3, learner=resumed))
    window.receive(published(4, mine=4, learner=resumed))
    assert window.lost == 4 and held(window) == [(8, 8)]
    assert version(window, 9) == 4  # it accounts for all that will ever come before 8
    window.receive(published(5, mine=9, learner=resumed))
    assert version(window, 10) == 5 and window.lost == 4


def test_a_new_agent_in_a_resumed_run_waits_as_in_an_unbroken_one() -> None:
    for lag, expected in ((0, [7, None]), (1, [6, 7, None]), (2, [5, 6, 7, None])):
        window = window_of(replace(LEARNER, policy_lag=lag, first_version=7))
        for number in range(7 - lag, 8):
            window.receive(published(number))
        assert [version(window, m) for m in range(lag + 2)] == expected


def free(version: int = 0) -> FreeSendWindow:
    window = FreeSendWindow(ME, 0, replace(LEARNER, policy_lag=NO_LAG))
    window.receive(published(version))
    return window


def test_a_free_agent_acts_with_the_newest_weights_and_never_waits_for_its_learner() -> None:
    assert isinstance(FreeSendWindow(ME, 0, LEARNER).required(0), Wait)  # before any have come
    window = free()
    for m in range(10):  # nothing of it is taken in
        assert version(window, m) == 0
        window.add(trajectory(m))
    window.receive(published(7, mine=3))
    window.receive(published(6, mine=2))  # late: newer ones are here
    assert version(window, 10) == 7 and held(window)[0] == (3, 3)


def test_a_free_agent_follows_a_resumed_learner() -> None:
    window, resumed = free(version=9), again(LEARNER, version=4)
    window.resume(resumed)
    assert version(window, 0) == 9  # it acts on meanwhile
    window.receive(published(4, learner=resumed))
    assert version(window, 0) == 4


def test_trajectories_that_a_free_agents_learner_ignores_are_sent_again_then_lost() -> None:
    window = free()
    for m in range(FREE_WINDOW):
        window.add(trajectory(m))
    assert window.overdue(False) == [] and not window.stalled  # not for a period yet
    again = [one.sequence for one in window.overdue(False)]
    assert again == list(range(RESENT_AT_ONCE)) and window.stalled
    window.receive(published(1, mine=1))
    assert window.overdue(False) == [] and not window.stalled  # it goes on
    for m in range(FREE_WINDOW, FREE_WINDOW + 5):
        sent = window.add(trajectory(m))
    assert sent.held_from == 5 and sent.sequence == FREE_WINDOW + 4
    assert window.lost == 4 and held(window)[0] == (5, 5) and len(held(window)) == FREE_WINDOW
    window.receive(published(2, mine=2))  # an account from before the loss
    assert window.lost == 4 and held(window)[0] == (5, 5)
