"""The replay buffer returns what was stored, once; the ledger knows what is missing."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.worlds import WORLD, random_trajectory
from pa_ros.core.experience import AgentKey, Float32, TrajectoryKey
from pa_ros.language import parse
from pa_ros.learning.errors import LearningError
from pa_ros.learning.replay_buffer.buffer import Column, ReplayBuffer, hand_first
from pa_ros.learning.replay_buffer.ledger import Ledger
from pa_ros.world.schema import ObjectSchema, PropertyGroup, Seen
from pa_ros.world.world import World


def test_memory_at_full_capacity() -> None:
    """1M frames of five objects take less than 1.5 GB."""
    arrays = ReplayBuffer(1_000_000, WORLD, n_objects=5).arrays.values()
    assert sum(array.nbytes for array in arrays) < 1.5e9


def test_a_transition_comes_back_as_it_was() -> None:
    rng = np.random.default_rng(0)
    replay = ReplayBuffer(100, WORLD)
    trajectory = random_trajectory(rng, 5, terminated=True)
    replay.insert(trajectory, program=3)
    assert np.count_nonzero(~replay.filled()["last"]) == 5
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


def test_the_reward_per_step_is_that_of_the_newest_transitions() -> None:
    """Rows that end a trajectory have no reward, and rows that are written over no longer count."""
    rng, replay, rewards = np.random.default_rng(0), ReplayBuffer(25, WORLD), []
    for sequence in range(4):
        trajectory = random_trajectory(rng, 9, sequence=sequence)
        replay.insert(trajectory, 0)
        rewards += trajectory.rewards.tolist()
    assert replay.reward_per_step() == pytest.approx(np.mean(rewards[-22:]))
    assert replay.reward_per_step(rows=5) == pytest.approx(np.mean(rewards[-4:]))


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
    assert np.count_nonzero(~replay.filled()["last"]) == len(starts)


def test_the_rings_last_row_is_drawn() -> None:
    replay = ReplayBuffer(8, WORLD)
    for sequence in range(2):  # rows 0 to 5, and 6, 7, 0 to 3: row 7 begins a transition
        replay.insert(random_trajectory(np.random.default_rng(0), 5, sequence=sequence), 0)
    drawn = replay.sample(np.random.default_rng(0), 500)
    assert sorted(set(drawn.tolist())) == [0, 1, 2, 4, 6, 7]
    assert replay.following(np.array([7])).tolist() == [0]


def test_an_overwritten_row_leaves_nothing_behind() -> None:
    rng = np.random.default_rng(0)
    columns = {"satisfied": Column(np.uint64), "present": Column(np.uint64)}
    replay, ones = ReplayBuffer(7, WORLD, columns=columns), np.ones(6, np.uint64)
    for sequence in range(4):  # each row is once the last of its trajectory, and once terminal
        ended = random_trajectory(rng, 1 + sequence % 2, sequence=sequence, terminated=True)
        rows = len(ended) + 1
        replay.insert(ended, 1, {"satisfied": ones[:rows], "present": 1})
    replay.insert(random_trajectory(rng, 5, sequence=9), 2, {"satisfied": 0 * ones, "present": 0})
    index = np.flatnonzero(replay.arrays["program"] == 2)
    assert len(index) == 6 and np.count_nonzero(replay.arrays["last"][index]) == 1
    for name in ("terminal", "satisfied", "present"):
        assert not replay.arrays[name][index].any(), name
    assert replay.rows == 7


@settings(max_examples=200)
@given(st.lists(st.tuples(st.sampled_from("ab"), st.integers(0, 30)), max_size=60))
def test_the_ledger_agrees_with_a_set(arrivals) -> None:
    ledger, seen = Ledger(), set()
    for agent, sequence in arrivals:
        key = TrajectoryKey(agent, 7, sequence)
        assert ledger.is_new(key) == (key not in seen)
        if key not in seen:
            ledger.record(key)
            seen.add(key)
    sequences = {key.agent_id: {k.sequence for k in seen if k[0] == key[0]} for key in seen}
    first_absent = {
        AgentKey(agent, 7): min(set(range(len(arrived) + 1)) - arrived)
        for agent, arrived in sequences.items()
    }
    assert ledger.accounted() == first_absent
    assert ledger.missing == sum(max(arrived) + 1 for arrived in sequences.values()) - len(seen)
    assert ledger.missing == ledger.missing_of("ab".__contains__)
    assert Ledger.from_metadata(json.loads(json.dumps(ledger.to_metadata()))) == ledger


def test_trajectories_that_an_agent_no_longer_holds_are_lost_and_not_missing() -> None:
    ledger = Ledger()
    for sequence, held_from, missing, lost in (
        (0, 0, 0, 0),
        (5, 0, 4, 0),  # 1 to 4 may still arrive
        (2, 2, 2, 1),  # 1 will not
        (6, 5, 0, 3),  # nor will 3 and 4
        (9, 8, 1, 4),  # nor 7; 8 may
    ):
        ledger.record(TrajectoryKey("agent", 0, sequence), held_from)
        assert (ledger.missing, ledger.lost) == (missing, lost)
    assert ledger.accounted() == {AgentKey("agent", 0): 8}
    assert ledger.is_new(TrajectoryKey("agent", 0, 8))
    assert not ledger.is_new(TrajectoryKey("agent", 0, 4))  # given up


@pytest.mark.parametrize(("first", "lost"), [(399, 0), (390, 9), (0, 399)])
def test_what_a_new_agent_made_for_this_run_and_no_longer_holds_is_lost(first, lost) -> None:
    """An agent that served another run before begins at its own number; that is no loss."""
    ledger = Ledger()
    ledger.record(TrajectoryKey("agent", 0, 400), held_from=399, first_of_run=first)
    assert (ledger.missing, ledger.lost) == (1, lost)
    assert ledger.accounted() == {AgentKey("agent", 0): 399}
    ledger.record(TrajectoryKey("agent", 0, 399), held_from=399, first_of_run=first)
    assert (ledger.missing, ledger.lost) == (0, lost)
    assert ledger.accounted() == {AgentKey("agent", 0): 401}


def test_what_a_restarted_agent_had_not_sent_before_is_lost() -> None:
    ledger = Ledger()
    for sequence in (0, 1, 3):
        ledger.record(TrajectoryKey("agent", 10, sequence))
    assert ledger.missing == 1
    ledger.record(TrajectoryKey("agent", 11, 0))
    assert (ledger.missing, ledger.lost) == (0, 1)  # nobody holds 2 any more
    assert ledger.accounted() == {AgentKey("agent", 10): 4, AgentKey("agent", 11): 1}


ARRIVALS = st.tuples(st.integers(0, 2), st.integers(0, 9), st.integers(0, 5), st.booleans())


@settings(max_examples=200)
@given(st.lists(ARRIVALS, max_size=40))
def test_every_number_is_learned_rejected_lost_or_missing(arrivals) -> None:
    """Of each start of an agent, whatever arrives, and wherever its learner begins to count."""
    ledger, learned = Ledger(), 0
    for incarnation, sequence, behind, usable in arrivals:
        key = TrajectoryKey("agent", incarnation, sequence)
        if ledger.is_new(key):
            ledger.record(key, held_from=max(0, sequence - behind))
            learned += usable
            ledger.rejected += not usable
    counted = sum(tracker.next for tracker in ledger.agents.values())
    assert counted == learned + ledger.rejected + ledger.lost + ledger.missing
    accounted = sum(ledger.accounted().values())
    assert ledger.missing or accounted == learned + ledger.rejected + ledger.lost


def one_action(value: float) -> Float32:
    """Five actions, [5, 6], that are zero but for one number."""
    actions = np.zeros((5, 6), np.float32)
    actions[2, 3] = value
    return actions


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"world_digest": "0" * 16}, "0000000000000000"),
        ({"objects": np.zeros((6, 4, 16), np.float32)}, "expected 3 objects, got 4"),
        ({"arm": np.full((6, 18), np.nan, np.float32)}, "arm.*got ±nan"),
        ({"rewards": np.full(5, np.inf, np.float32)}, "rewards"),
        ({"actions": one_action(-1.5)}, "got ±1.5"),
        ({"actions": np.zeros((100, 6), np.float32)}, "expected 1 to 99 steps, got 100"),
        ({"actions": np.zeros((0, 6), np.float32)}, "got 0"),
    ],
)
def test_a_trajectory_that_does_not_fit_is_rejected(fields, message) -> None:
    rng = np.random.default_rng(0)
    replay = ReplayBuffer(100, WORLD)
    replay.insert(random_trajectory(rng), 0)
    with pytest.raises(LearningError, match=message):
        replay.check(random_trajectory(rng, sequence=1, **fields))


def test_an_empty_buffer_has_no_samples() -> None:
    with pytest.raises(LearningError, match="got an empty buffer"):
        ReplayBuffer(10, WORLD).sample(np.random.default_rng(0), 1)


def test_the_hand_is_stored_first() -> None:
    objects = np.arange(2 * 4 * 16, dtype=np.float32).reshape(2, 4, 16)
    np.testing.assert_array_equal(hand_first(objects, 2, 1), objects[:, [2, 0, 1, 3]])
    replay = ReplayBuffer(10, WORLD)
    trajectory = random_trajectory(np.random.default_rng(0), 1, objects=objects, hand_index=2)
    replay.insert(trajectory, 0)
    np.testing.assert_array_equal(replay.filled()["objects"], objects[:, [2, 0, 1, 3]])


def test_scenes_of_a_camera_may_have_any_number_of_objects() -> None:
    """The buffer grows to the largest scene; in smaller ones the last object is stored again."""
    group = PropertyGroup("shape", ("CUBE",), Seen(9))
    schema = ObjectSchema((group,))
    world, rng = World(schema, schema.vocabulary, joints=6), np.random.default_rng(0)
    columns = {"may_name": Column(np.uint64, of_objects=True)}
    replay = ReplayBuffer(100, world, columns=columns)
    program = parse("NEAR(HAND, CUBE)", schema.vocabulary)
    for sequence, count in enumerate((3, 2, 4)):
        objects = rng.normal(size=(6, count, 16)).astype(np.float32)
        one = random_trajectory(
            rng, sequence=sequence, objects=objects, program=program, world_digest=world.digest
        )
        replay.check(one)
        bits = np.arange(count, dtype=np.uint64)
        replay.insert(one, 0, {"may_name": bits})
        stored = replay.filled()["objects"][6 * sequence :]
        assert (stored[:, :count] == objects).all() and (stored[:, count:] == objects[:, -1:]).all()
    may_name = replay.arrays["may_name"][[0, 6, 12]]
    assert may_name.tolist() == [[0, 1, 2, 2], [0, 1, 1, 1], [0, 1, 2, 3]]
