"""The reaching task: stepping, programs, time limit, clock and errors."""

import gc
import weakref

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from helpers.rejections import rejected
from pa_ros.arena import (
    ARMS,
    ArenaError,
    Block,
    Episode,
    Kind,
    PhysicsError,
    ReachTask,
    design_named,
    preset_named,
    scripted_action,
)
from pa_ros.arena.rearranging import bodies
from pa_ros.core.errors import PaError
from pa_ros.core.experience import Float64
from pa_ros.language import parse

PAPER, FAST = preset_named("paper"), preset_named("fast")
STILL = np.zeros(6)
WORDS = design_named("2-L").vocabulary


def new_task(seed: int = 0, **changes: object) -> ReachTask:
    return ReachTask(FAST.changed(**changes), design_named("2-L"), seed)  # type: ignore[arg-type]


def trace(task: ReachTask, episode: int, seed: int) -> list[bytes]:
    rng = np.random.default_rng(seed)
    observation, verdict = task.reset(episode)
    rows = [observation.objects.tobytes()]
    while not verdict.truncated:
        observation, verdict = task.step(rng.uniform(-1.5, 1.5, 6))
        rows.append(observation.objects.tobytes() + observation.joint_velocity.tobytes())
    return rows


@pytest.mark.parametrize("preset", [PAPER, FAST], ids=lambda config: config.preset)
def test_a_seed_reproduces_every_bit(preset) -> None:  # type: ignore[no-untyped-def]
    first = ReachTask(preset, design_named("3-D"), seed=11)
    other = ReachTask(preset, design_named("3-D"), seed=11)
    expected = [trace(first, episode, 1) for episode in range(3)]
    for episode in (2, 0, 1):
        assert trace(other, episode, 1) == expected[episode]


def test_time_limit_is_a_truncation_after_100_actions() -> None:
    task = new_task()
    _, verdict = task.reset(0)
    flags = [verdict.truncated]
    for _ in range(100):
        _, verdict = task.step(STILL)
        flags.append(verdict.truncated)
    assert flags == [False] * 100 + [True]
    with pytest.raises(ArenaError, match="step 100"):
        task.step(STILL)


def test_stamps_never_go_back() -> None:
    task = new_task(episode_steps=5)
    stamps = []
    for episode in (0, 1, 0):
        observation, verdict = task.reset(episode)
        stamps.append(observation.stamp_ns)
        while not verdict.truncated:
            observation, verdict = task.step(STILL)
            stamps.append(observation.stamp_ns)
    assert stamps == [100_000_000 * (i + 1) for i in range(18)]


def test_verdicts_follow_from_the_true_positions() -> None:
    task = new_task()
    seen = set()
    for episode in range(4):
        _, verdict = task.reset(episode)
        target = next(i for i, b in enumerate(task.episode.blocks) if b.kind.words <= words(task))
        assert verdict.reward == -1.0  # the hand starts near no block
        while not verdict.truncated:
            observation, verdict = task.step(scripted_action(task))
            simulated = task.simulation.data
            hand, block = (simulated.body(name).xpos for name in ("hand", f"block{target}"))
            true = np.linalg.norm(hand - block)
            assert verdict.distance == pytest.approx(true, abs=1e-6)
            assert verdict.satisfied == (verdict.distance <= 0.20)
            assert verdict.reward == (1.0 if verdict.satisfied else -1.0)
            seen.add(verdict.reward)
    assert seen == {1.0, -1.0}


def words(task: ReachTask) -> set[str]:
    return set(task.episode.program.words)


def test_a_program_can_change_during_an_episode_without_effect_on_physics() -> None:
    task, same = new_task(), new_task()
    task.reset(3), same.reset(3)
    for step in range(10):
        if step == 5:
            observation, _ = task.set_program(parse("NEAR(HAND, OR(BLUE, CUBE))", WORDS), "mine")
            assert (observation.step, observation.program_id) == (5, "mine")
        command = np.full(6, 0.3)
        a, b = task.step(command)[0], same.step(command)[0]
        np.testing.assert_array_equal(a.objects, b.objects)
    assert a.program_id == "mine"
    observation, _ = task.reset(4)
    assert observation.program_id not in ("mine", a.program_id)


@pytest.mark.parametrize("command", [np.zeros(5), np.array([0, 0, np.nan, 0, 0, 0])])
def test_wrong_commands_are_rejected_and_move_nothing(command: Float64) -> None:
    task = new_task()
    observation, _ = task.reset(0)
    with rejected("arena.command"):
        task.step(command)
    np.testing.assert_array_equal(task.simulation.objects(), observation.objects)
    assert task.step(STILL)[0].step == 1


def test_a_step_before_the_first_reset_is_rejected() -> None:
    with rejected("arena.episode", match="expected a reset before"):
        new_task().step(STILL)


def test_commands_are_clamped_to_the_limits() -> None:
    task, clamped = new_task(), new_task()
    task.reset(0), clamped.reset(0)
    for _ in range(5):
        a, _ = task.step(np.array([1e6, -1e6, 3.0, -3.0, 1e6, 2.0]))
        b, _ = clamped.step(np.array([1.5, -1.5, 1.5, -1.5, 1.5, 1.5]))
        np.testing.assert_array_equal(a.objects, b.objects)
    np.testing.assert_array_equal(np.abs(task.simulation.data.ctrl), 1.5)


def test_a_custom_episode_is_placed() -> None:
    blocks = (
        Block(Kind(color="RED", shape="CUBE"), 0.4, 0.1, 0.5),
        Block(Kind(color="BLUE", shape="SPHERE"), -0.3, 0.3, -2.0),
    )
    start = (1.0, *(joint.start for joint in ARMS["jaco"].joints[1:]))
    task, blue = new_task(), parse("NEAR(HAND, BLUE)", WORDS)
    observation, _ = task.reset_to(Episode(9, "custom", blocks, start, blue))
    np.testing.assert_allclose(observation.joint_position, start)
    np.testing.assert_allclose(task.simulation.positions[1:, :2], [[0.4, 0.1], [-0.3, 0.3]])
    for block, placed in zip(blocks, bodies(task)[1:], strict=True):
        turned = Rotation.from_quat(placed.quaternion)
        assert turned.as_euler("ZYX") == pytest.approx([block.yaw, 0.0, 0.0])


def test_unstable_physics_is_an_error(tmp_path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    monkeypatch.chdir(tmp_path)
    task = new_task()
    task.reset(0)
    task.simulation.data.qvel[:6] = 1e12
    with pytest.raises(PhysicsError, match="BADQVEL"):
        task.step(STILL)
    assert not list(tmp_path.iterdir()), "MuJoCo's log would lie in the user's folder"
    with pytest.raises(ArenaError):
        task.step(STILL)
    assert issubclass(PhysicsError, PaError)
    assert task.reset(0)[0].step == 0


def test_an_unused_simulation_is_freed_with_its_models() -> None:
    """Without garbage collection, which runs rarely for a few large objects."""
    gc.disable()
    try:
        task = new_task()
        task.reset(0)
        held = weakref.ref(task.simulation)
        del task
        assert held() is None
    finally:
        gc.enable()
