"""The replay: what is stored is what comes back, once; what does not fit is refused."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.worlds import WORLD, random_trajectory
from pa_ros.core.experience import AgentKey, Float32, TrajectoryKey
from pa_ros.learning.errors import LearningError
from pa_ros.learning.relabeling.all_goals import Marks
from pa_ros.learning.replay_buffer.buffer import ReplayBuffer, hand_first
from pa_ros.learning.replay_buffer.ledger import UNTAKEN, Ledger


def test_memory_at_full_capacity() -> None:
    """1M frames of five objects take less than 1.5 GB."""
    assert ReplayBuffer(1_000_000, WORLD, n_objects=5).nbytes < 1.5e9


def test_a_transition_comes_back_as_it_was() -> None:
    rng = np.random.default_rng(0)
    replay = ReplayBuffer(100, WORLD)
    trajectory = random_trajectory(rng, 5, terminated=True)
    report = replay.insert(trajectory, program=3)
    assert (report.accepted, report.transitions, replay.transitions) == (True, 5, 5)
    index = np.sort(np.unique(replay.sample(rng, 200)))
    np.testing.assert_array_equal(index, np.arange(5))
    following = replay.following(index)
    np.testing.assert_array_equal(replay.arrays["objects"][index], trajectory.objects[:-1])
    np.testing.assert_array_equal(replay.arrays["objects"][following], trajectory.objects[1:])
    np.testing.assert_array_equal(replay.arrays["arm"][following], trajectory.arm[1:])
    np.testing.assert_array_equal(replay.arrays["action"][index], trajectory.actions)
    np.testing.assert_array_equal(replay.arrays["reward"][index], trajectory.rewards)
    np.testing.assert_array_equal(replay.arrays["terminal"][index], [0, 0, 0, 0, 1])
    assert (replay.arrays["program"][index] == 3).all()


@settings(deadline=None, max_examples=40)
@given(lengths=st.lists(st.integers(1, 9), min_size=1, max_size=30), capacity=st.integers(10, 40))
def test_samples_are_the_newest_whole_transitions(lengths, capacity) -> None:
    """Each value is unique: whatever is sampled joins two consecutive rows of one trajectory."""
    replay = ReplayBuffer(capacity, WORLD)
    inserted: list[float] = []
    rng = np.random.default_rng(0)
    for sequence, steps in enumerate(lengths):
        numbers = 100.0 * sequence + np.arange(steps + 1, dtype=np.float32)
        trajectory = random_trajectory(rng, steps, sequence=sequence)
        arm = np.broadcast_to(numbers[:, None], (steps + 1, 18)).astype(np.float32)
        replay.insert(replace(trajectory, arm=arm), 0)
        inserted += numbers.tolist()
    index = replay.sample(rng, 2000)
    now, after = replay.arrays["arm"][index, 0], replay.arrays["arm"][replay.following(index), 0]
    np.testing.assert_array_equal(after, now + 1)
    kept = inserted[-capacity:]
    starts = {x for x in kept if x + 1 in kept}
    assert set(now.tolist()) == starts
    assert replay.transitions == len(starts)


def test_nothing_of_what_was_overwritten_is_left_behind() -> None:
    """Rows whose transition ended the task, was the last or had marks get others' in their turn."""
    rng = np.random.default_rng(0)
    replay = ReplayBuffer(7, WORLD)
    ones = np.ones(6, np.uint64)
    for sequence in range(4):  # each row once the last, and once terminal
        ended = random_trajectory(rng, 1 + sequence % 2, sequence=sequence, terminated=True)
        rows = len(ended) + 1
        replay.insert(ended, 1, Marks(ones[:rows], ones[:rows]))
    later = random_trajectory(rng, 5, sequence=9)
    replay.insert(later, 2)
    index = np.flatnonzero(replay.arrays["program"] == 2)
    assert len(index) == 6 and np.count_nonzero(replay.arrays["last"][index]) == 1
    for name in ("terminal", "satisfied", "present"):
        assert not replay.arrays[name][index].any(), name
    assert replay.rows == 7


def test_inserting_twice_is_inserting_once() -> None:
    rng = np.random.default_rng(0)
    once, twice = ReplayBuffer(50, WORLD), ReplayBuffer(50, WORLD)
    trajectories = [random_trajectory(rng, 4, sequence=i) for i in range(4)]
    for trajectory in trajectories:
        once.insert(trajectory, 0)
    for trajectory in trajectories + trajectories[::-1]:
        report = twice.insert(trajectory, 0)
    assert not report.accepted and report.transitions == 0 and report.duplicates == 4
    assert (once.rows, once.head) == (twice.rows, twice.head)
    for name, array in once.filled().items():
        np.testing.assert_array_equal(array, twice.filled()[name])


def test_gaps_are_counted_and_late_arrivals_fill_them() -> None:
    rng = np.random.default_rng(0)
    replay = ReplayBuffer(100, WORLD)
    missing = []
    for sequence in (0, 3, 2, 7, 1, 1):
        report = replay.insert(random_trajectory(rng, 1, sequence=sequence), 0)
        missing.append(report.missing)
    assert missing == [0, 2, 1, 4, 3, 3]
    assert report.duplicates == 1
    other = replay.insert(random_trajectory(rng, 1, agent_id="other", sequence=2), 0)
    assert other.accepted and other.missing == 5


@settings(max_examples=200)
@given(st.lists(st.tuples(st.sampled_from("ab"), st.integers(0, 30)), max_size=60))
def test_ledger_agrees_with_a_set(arrivals) -> None:
    ledger, seen = Ledger(), set()
    for agent, sequence in arrivals:
        key = TrajectoryKey(agent, 7, sequence)
        assert ledger.is_new(key) == (key not in seen)
        if key not in seen:
            ledger.record(key)
            seen.add(key)
    sequences = {key.agent_id: {k.sequence for k in seen if k[0] == key[0]} for key in seen}
    first_absent = {
        AgentKey(agent, 7): min(set(range(len(there) + 1)) - there)
        for agent, there in sequences.items()
    }
    assert ledger.accounted() == first_absent
    assert ledger.missing == sum(max(there) + 1 for there in sequences.values()) - len(seen)
    assert Ledger.from_metadata(json.loads(json.dumps(ledger.to_metadata()))) == ledger


def test_of_an_agent_that_only_sent_what_was_refused_nothing_is_missed_or_lost() -> None:
    ledger, stranger = Ledger(), TrajectoryKey("stranger", 1, 90)
    ledger.record(stranger, 80, taken=False)
    ledger.record(stranger._replace(sequence=180), 170, taken=False)
    assert not ledger.is_new(stranger)
    assert ledger.missing == ledger.lost == 0 and "stranger" in ledger.accounts
    ledger.record(stranger._replace(sequence=200), 190)  # it can be learned from after all
    assert ledger.missing == 10 and ledger.lost == 0
    ledger.record(stranger._replace(sequence=210), 210)
    assert ledger.missing == 0 and ledger.lost == 19
    for number in range(2 * UNTAKEN):
        ledger.record(TrajectoryKey(f"stranger {number}", 1, 0), taken=False)
    assert len(ledger.accounts) == UNTAKEN + 1 and ledger.accounts["stranger"].next == 211


def test_a_huge_gap_costs_nothing() -> None:
    ledger = Ledger()
    key = TrajectoryKey("agent", 0, 10**15)
    ledger.record(key)
    assert ledger.missing == 10**15 and not ledger.is_new(key)


def test_what_an_agent_no_longer_holds_is_lost_and_not_missing() -> None:
    ledger = Ledger()
    for sequence, held_from, missing, lost in (
        (0, 0, 0, 0),
        (5, 0, 4, 0),  # 1 to 4 may still come
        (2, 2, 2, 1),  # 1 will not
        (6, 5, 0, 3),  # nor will 3 and 4
        (9, 8, 1, 4),  # 7 neither; 8 may
    ):
        ledger.record(TrajectoryKey("agent", 0, sequence), held_from)
        assert (ledger.missing, ledger.lost) == (missing, lost)
    assert ledger.accounted() == {AgentKey("agent", 0): 8}
    assert ledger.is_new(TrajectoryKey("agent", 0, 8))
    assert not ledger.is_new(TrajectoryKey("agent", 0, 4))  # given up


def test_an_account_begins_where_the_agent_says_so() -> None:
    """An agent that has served another run begins at its own number; nothing before is missing."""
    ledger = Ledger()
    ledger.record(TrajectoryKey("agent", 0, 400), held_from=399)
    assert (ledger.missing, ledger.lost) == (1, 0)
    assert ledger.accounted() == {AgentKey("agent", 0): 399}
    ledger.record(TrajectoryKey("agent", 0, 399), held_from=399)
    assert (ledger.missing, ledger.lost) == (0, 0)
    assert ledger.accounted() == {AgentKey("agent", 0): 401}


def test_an_agent_that_starts_again_under_its_name_is_another() -> None:
    rng = np.random.default_rng(0)
    replay = ReplayBuffer(100, WORLD)
    for sequence in (0, 1, 3):
        replay.insert(random_trajectory(rng, 1, sequence=sequence, incarnation=10), 0)
    assert replay.ledger.missing == 1
    report = replay.insert(random_trajectory(rng, 1, sequence=0, incarnation=11), 0)
    assert report.accepted and report.duplicates == 0
    assert (replay.ledger.missing, replay.ledger.lost) == (0, 1)  # nobody holds 2 any more
    assert replay.ledger.accounted() == {AgentKey("agent", 11): 1}
    before = replay.to_metadata()
    with pytest.raises(LearningError, match="called 'agent'.* 11, got .* 10"):
        replay.insert(random_trajectory(rng, 1, sequence=2, incarnation=10), 0)
    assert replay.to_metadata() == before


def one_action(value: float) -> Float32:
    """Five actions, [5, 6], that are zero but for one number."""
    actions = np.zeros((5, 6), np.float32)
    actions[2, 3] = value
    return actions


@pytest.mark.parametrize(
    ("fields", "error", "message"),
    [
        ({"world_digest": "0" * 16}, LearningError, "0000000000000000"),
        ({"objects": np.zeros((6, 3, 15), np.float32)}, LearningError, r"\(6, 3, 15\)"),
        ({"objects": np.zeros((6, 16), np.float32)}, LearningError, r"\(6, 16\)"),
        ({"objects": np.zeros((5, 3, 16), np.float32)}, LearningError, r"\(5, 3, 16\)"),
        ({"arm": np.zeros((6, 17), np.float32)}, LearningError, r"\(6, 17\)"),
        ({"actions": np.zeros((5, 7), np.float32)}, LearningError, r"\(5, 7\)"),
        ({"rewards": np.zeros(4, np.float32)}, LearningError, r"\(4,\)"),
        ({"hand_index": 3}, LearningError, "got 3"),
        ({"hand_index": -1}, LearningError, "got -1"),
        ({"arm": np.full((6, 18), np.nan, np.float32)}, LearningError, "arm"),
        ({"arm": np.full((6, 18), -3e38, np.float32)}, LearningError, r"arm.*got ±3e\+38"),
        ({"rewards": np.full(5, 1e7, np.float32)}, LearningError, "rewards"),
        ({"rewards": np.full(5, np.inf, np.float32)}, LearningError, "rewards"),
        ({"actions": one_action(1.5)}, LearningError, "got ±1.5"),
        ({"actions": one_action(-1.5)}, LearningError, "got ±1.5"),
    ],
)
def test_what_does_not_fit_is_refused_and_changes_nothing(fields, error, message) -> None:
    rng = np.random.default_rng(0)
    replay = ReplayBuffer(100, WORLD)
    replay.insert(random_trajectory(rng), 0)
    before = replay.to_metadata()
    with pytest.raises(error, match=message):
        replay.insert(random_trajectory(rng, sequence=1, **fields), 0)
    assert replay.to_metadata() == before


def test_other_refusals() -> None:
    rng = np.random.default_rng(0)
    replay = ReplayBuffer(10, WORLD)
    with pytest.raises(LearningError):
        replay.sample(rng, 1)
    with pytest.raises(LearningError, match="got 10"):
        replay.insert(random_trajectory(rng, 10), 0)
    with pytest.raises(LearningError, match="got 0"):
        replay.insert(random_trajectory(rng, 0), 0)
    replay.insert(random_trajectory(rng, 2), 0)
    with pytest.raises(LearningError, match=r"expected \(3, 3, 16\), got \(3, 4, 16\)"):
        four = np.zeros((3, 4, 16), np.float32)
        replay.insert(random_trajectory(rng, 2, sequence=1, objects=four), 0)


def test_the_hand_is_stored_first() -> None:
    objects = np.arange(2 * 4 * 16, dtype=np.float32).reshape(2, 4, 16)
    np.testing.assert_array_equal(hand_first(objects, 2), objects[:, [2, 0, 1, 3]])
    replay = ReplayBuffer(10, WORLD)
    trajectory = random_trajectory(np.random.default_rng(0), 1, objects=objects, hand_index=2)
    replay.insert(trajectory, 0)
    np.testing.assert_array_equal(replay.filled()["objects"], objects[:, [2, 0, 1, 3]])


def test_restore_is_the_inverse() -> None:
    rng = np.random.default_rng(0)
    replay = ReplayBuffer(20, WORLD)
    for sequence in (0, 1, 3, 4, 5):
        replay.insert(random_trajectory(rng, 5, sequence=sequence), 0)
    again = ReplayBuffer(20, WORLD)
    again.restore({k: v.copy() for k, v in replay.filled().items()}, replay.to_metadata())
    one, other = (r.sample(np.random.default_rng(1), 50) for r in (replay, again))
    np.testing.assert_array_equal(one, other)
    for name, array in replay.arrays.items():
        np.testing.assert_array_equal(array, again.arrays[name])
    with pytest.raises(LearningError, match="expected 10 rows, got 20"):
        ReplayBuffer(10, WORLD).restore(replay.filled(), replay.to_metadata())
