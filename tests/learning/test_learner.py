"""The learner: exact update-to-data ratio, idempotence, versions, relabeled batches."""

from typing import cast

import numpy as np
import pytest

from helpers.worlds import PROGRAMS, SCORING, WORLD, dpg, random_trajectory
from pa_ros.core.errors import ConfigError
from pa_ros.core.update import Batch, Engine
from pa_ros.language import ProgramError, Vocabulary, parse
from pa_ros.learning.errors import LearningError
from pa_ros.learning.learner import Learner
from pa_ros.networks.config import NetworkConfig

NETWORK = NetworkConfig(world=WORLD, hidden=6, attention=4)


def learner(network: NetworkConfig = NETWORK, **fields: object) -> Learner:
    values = {
        "replay__batch_size": 4,
        "replay__capacity_frames": 1000,
        "replay__warmup_frames": 0,
        "engine__name": "torch",
        "schedule__trajectory_steps": 10,
    }
    return Learner(network, dpg(**(values | fields)), PROGRAMS, 0, SCORING)


class Recorder:
    """Wraps a engine and keeps what it was given."""

    def __init__(self, engine: object) -> None:
        self._engine = engine
        self.calls: list[str] = []
        self.batches: list[Batch] = []

    def __getattr__(self, name: str) -> object:
        return getattr(self._engine, name)

    def update(self, batch: Batch) -> None:
        self.calls.append("update")
        self.batches.append(batch)

    def end_episode(self) -> None:
        self.calls.append("copy")


@pytest.mark.parametrize("ratio", [0.0, 0.3, 1.0, 2.5])
def test_update_to_data_ratio_is_exact(ratio) -> None:
    rng = np.random.default_rng(0)
    one = learner(updates__per_frame=ratio)
    recorder = Recorder(one.engine)
    one.engine = cast(Engine, recorder)
    frames = 0
    for sequence in range(12):
        steps = 1 + sequence % 5
        assert one.consume(random_trajectory(rng, steps, sequence=sequence))
        frames += steps
        assert abs(one.counters.updates - ratio * frames) < 1
        assert one.counters.version == sequence + 1
    assert len(recorder.batches) == one.counters.updates == int(ratio * frames + 1e-9)
    assert one.counters.frames == frames


def test_targets_are_copied_after_the_updates_of_an_episodes_last_trajectory() -> None:
    rng = np.random.default_rng(0)
    one = learner()
    recorder = Recorder(one.engine)
    one.engine = cast(Engine, recorder)
    for sequence, ends in enumerate([False, True, False]):
        one.consume(random_trajectory(rng, 2, sequence=sequence, ends_episode=ends))
    assert recorder.calls == ["update"] * 4 + ["copy"] + ["update"] * 2
    assert one.counters.episodes == 1


def test_no_updates_until_warm() -> None:
    rng = np.random.default_rng(0)
    one = learner(replay__warmup_frames=10)
    updates = []
    for sequence in range(4):
        one.consume(random_trajectory(rng, 5, sequence=sequence))
        updates.append(one.counters.updates)
    assert updates == [0, 0, 5, 10]


def test_a_refused_trajectory_changes_nothing() -> None:
    rng = np.random.default_rng(0)
    one = learner()
    one.consume(random_trajectory(rng))
    before = (one.counters.version, len(one.table), one.replay.to_metadata())
    with pytest.raises(LearningError):
        one.consume(random_trajectory(rng, sequence=1, rewards=np.full(5, np.nan, np.float32)))
    unknown = parse("NEAR(HAND, CUBIC)", Vocabulary.of(shape=("CUBIC",), color=("RED",)))
    with pytest.raises(ProgramError):
        one.consume(random_trajectory(rng, sequence=1, program=unknown))
    assert (one.counters.version, len(one.table), one.replay.to_metadata()) == before


def test_published_versions() -> None:
    rng = np.random.default_rng(0)
    one = learner(schedule__policy_lag=1, engine__name="auto")
    first = one.snapshot()
    assert first.version == 0
    one.consume(random_trajectory(rng))
    second = one.snapshot()
    assert second.version == 1 and list(one.published) == [first, second]
    assert not np.array_equal(first.tensors["output.bias"], second.tensors["output.bias"])
    for tensor in second.tensors.values():
        assert tensor.flags.c_contiguous and tensor.dtype == np.float32
    assert second.architecture == NETWORK.architecture
    assert second.world_digest == WORLD.digest


def test_published_weights_are_a_running_mean_if_asked_for() -> None:
    rng = np.random.default_rng(0)
    newest, mean = learner(), learner(updates__published=0.25)
    expected = mean.snapshot().tensors
    for sequence in range(3):
        trajectory = random_trajectory(rng, 10, sequence=sequence)
        for one in (newest, mean):
            one.consume(trajectory)
        actor = newest.snapshot().tensors
        assert all(np.array_equal(actor[k], v) for k, v in mean.engine.actor_tensors().items())
        expected = {k: v + np.float32(0.25) * (actor[k] - v) for k, v in expected.items()}
    for name, tensor in mean.snapshot().tensors.items():
        np.testing.assert_array_equal(tensor, expected[name])
        assert tensor.dtype == np.float32


def test_batches_are_gathered_from_transitions() -> None:
    rng = np.random.default_rng(0)
    one = learner()
    recorder = Recorder(one.engine)
    one.engine = cast(Engine, recorder)
    trajectory = random_trajectory(rng, 8, terminated=True, program=PROGRAMS[1])
    one.consume(trajectory)
    assert len(recorder.batches) == 8
    for batch in recorder.batches:
        assert batch.program.shape == batch.reward.shape == (4, 1)
        assert (batch.program == 1).all()
        for b in range(4):
            (t,) = np.flatnonzero((trajectory.arm[:-1] == batch.arm[b]).all(1))
            np.testing.assert_array_equal(batch.objects[b], trajectory.objects[t])
            np.testing.assert_array_equal(batch.next_objects[b], trajectory.objects[t + 1])
            np.testing.assert_array_equal(batch.next_arm[b], trajectory.arm[t + 1])
            np.testing.assert_array_equal(batch.action[b], trajectory.actions[t])
            assert batch.reward[b, 0] == trajectory.rewards[t]
            assert batch.discount[b] == (0.0 if t == 7 else np.float32(0.99))
        arrays = (batch.objects, batch.arm, batch.action, batch.next_objects, batch.next_arm)
        for array in (*arrays, batch.program, batch.reward, batch.discount):
            assert array.flags.c_contiguous


@pytest.mark.parametrize("device", ["cuda:99", "meta"])
def test_a_device_that_cannot_hold_numbers_is_refused(device) -> None:
    with pytest.raises(ConfigError, match=f"expected one that torch has here, got '{device}'"):
        learner(engine__device=device)
