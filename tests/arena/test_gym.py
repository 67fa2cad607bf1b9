"""The Gymnasium environment."""

import copy
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from pa_ros.arena import ENV_ID, ReachEnv, conditions_for, design_named
from pa_ros.core.errors import ConfigError
from pa_ros.language import ProgramError

STRUCTURED = ReachEnv(design="3-D", observation="structured")
UNBOUNDED = "ignore:.*Box observation space (min|max)imum value is .*infinity"


@pytest.mark.filterwarnings(UNBOUNDED)
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"preset": "paper", "design": "3-D", "condition": "eval"},
        {"observation": "structured", "design": "3-D", "condition": "depth-4"},
        {"observation": "structured", "arm": "panda"},
    ],
)
def test_gymnasiums_checker_accepts_it(options: dict[str, Any]) -> None:
    check_env(gymnasium.make(ENV_ID, **options).unwrapped)


def test_a_flat_observation_contains_the_relation_if_there_are_several() -> None:
    env, seen = ReachEnv(relations=("NEAR", "ABOVE", "BEHIND")), set()
    several = env.design
    assert several.name == "2-L", "as on the command line"
    for _ in range(12):
        flat, info = env.reset()
        assert flat.shape == env.observation_space.shape
        asked = np.flatnonzero(flat[-3:])
        assert several.vocabulary.relations[int(asked.item())] == info["program"].split("(")[0]
        seen.add(int(asked.item()))
    assert len(seen) > 1


def test_each_kind_has_a_fixed_place_in_the_flat_observation() -> None:
    env = ReachEnv(design="3-C")
    pool = design_named("3-C").pool
    for _ in range(10):
        flat, _ = env.reset()
        slots = flat[18 : 18 + 16 * len(pool)].reshape(len(pool), 16)
        present = {block.kind for block in env.task.episode.blocks}
        for kind, row in zip(pool, slots, strict=True):
            assert row.any() == (kind in present)
        words = env.design.vocabulary.words
        named = {words[i] for i in np.flatnonzero(flat[-9:])}
        (kind,) = (kind for kind in pool if kind.words == named)
        assert str(env.task.episode.program) == f"NEAR(HAND, {kind.conjunction})"


def test_eval_has_the_flat_observation_of_train_so_that_one_policy_fits_both() -> None:
    train, other, wider = (
        ReachEnv(design="3-D", condition=name).observation_space.shape[0]
        for name in ("train", "eval", "ignore-new")
    )
    assert train == other == 18 + 16 * len(design_named("3-D").pool) + 9 < wider


def test_every_condition_runs_within_its_spaces() -> None:
    for condition in (c for c in conditions_for(design_named("3-D")) if "compare" not in c):
        env = ReachEnv(design="3-D", condition=condition)
        structured = ReachEnv(design="3-D", condition=condition, observation="structured")
        assert structured.observation_space == STRUCTURED.observation_space, condition
        for _ in range(3):
            seen, _ = structured.reset()
            assert structured.observation_space.contains(seen), condition
            flat, info = env.reset()
            for _ in range(5):
                assert env.observation_space.contains(flat), condition
                flat, reward, _, _, info = env.step(env.action_space.sample())
                assert reward in (-1.0, 1.0) and info["is_success"] == (reward > 0), condition


def test_the_structured_program_evaluates_to_the_programs_targets() -> None:
    """Executed over true properties, its last register contains the verifier's targets."""
    env = ReachEnv(design="3-D", condition="depth-5", observation="structured")
    for _ in range(5):
        seen, _ = env.reset()
        words = env.design.vocabulary.words
        kinds = [None, *(block.kind for block in env.task.episode.blocks)]
        rows = [[kind is not None and word in kind.words for kind in kinds] for word in words]
        registers = [np.array(row, float) for row in rows]
        registers.append(np.array([1.0] + [0.0] * (len(kinds) - 1)))
        for op, a, b in seen["program"].reshape(-1, 3):
            x, y = registers[a], registers[b]
            registers.append((1 - x, x * y, x + y - x * y, x)[op])
        now, _ = env.task.set_program(env.task.program)
        third = replace(now, objects=np.roll(now.objects, 2, 0), hand_index=2)
        assert env.structured is not None
        again = env.structured(third, env.task.program)["objects"]
        np.testing.assert_array_equal(again, seen["objects"])
        named = np.flatnonzero(registers[-1][1:]) + 1
        assert named.tolist() == list(env.task.verifier.targets)


def test_a_reward_can_be_named() -> None:
    env = gymnasium.make(ENV_ID, reward='{"name": "sparse", "satisfied": 3.0, "otherwise": -2.0}')
    env.reset(seed=0)
    assert env.step(np.zeros(6, np.float32))[1] in (3.0, -2.0)
    with pytest.raises(ConfigError, match=r"expected one of \['sparse'.*'dense'"):
        gymnasium.make(ENV_ID, reward="dense")


def test_the_program_of_an_episode_can_be_chosen() -> None:
    env = ReachEnv(design="3-D", observation="structured")
    env.reset(seed=0)
    named = [block.kind.words for block in env.task.episode.blocks]
    word = next(iter(sorted(named[0])))
    env.reset()
    assert env.task.episode.index == 1
    seen, info = env.reset(seed=0, options={"program": f"NEAR(HAND, NOT({word}))"})
    assert info["program"] == f"NEAR(HAND, NOT({word}))" and env.task.episode.index == 0
    other, _ = env.reset(seed=0, options={"program": f"NEAR(HAND, {word})"})
    np.testing.assert_array_equal(seen["objects"], other["objects"])
    assert not np.array_equal(seen["program"], other["program"])
    for options, error, said in (
        ({"program": "NEAR(HAND, A)"}, ProgramError, "no such object"),
        ({"programme": "x"}, ConfigError, r"expected only 'program', got \['programme'\]"),
    ):
        with pytest.raises(error, match=said):
            env.reset(seed=0, options=options)  # type: ignore[arg-type]
    _, _, terminated, truncated, info = env.step(np.zeros(6, np.float32))
    assert not terminated and not truncated and info["program"]


def test_a_flat_observation_takes_no_program_that_it_cannot_state() -> None:
    """It names one block by all its words, so it can ask for that block alone."""
    env = ReachEnv(design="3-D")
    env.reset(seed=0)
    kinds = [block.kind for block in env.task.episode.blocks]
    for kind in kinds:
        flat, info = env.reset(seed=0, options={"program": f"NEAR(HAND, {kind.conjunction})"})
        stated = {env.design.vocabulary.words[i] for i in np.flatnonzero(flat[-9:])}
        assert stated == kind.words and info["program"] == f"NEAR(HAND, {kind.conjunction})"
    with pytest.raises(ConfigError, match="expected one that names a single block.*structured"):
        env.reset(seed=0, options={"program": f"NEAR(HAND, NOT({kinds[0]['shape']}))"})


def test_what_is_to_be_avoided_is_observed_or_refused() -> None:
    env = ReachEnv(design="3-D-avoid", observation="structured")
    env.reset(seed=0)
    a, b = (block.kind.conjunction for block in env.task.episode.blocks[:2])
    texts = f"NEAR(HAND, {a})", f"AVOID({b}, NEAR(HAND, {a}))"
    avoided = [env.reset(seed=0, options={"program": text})[0]["avoided"] for text in texts]
    assert avoided[0] == len(env.design.vocabulary.words) != avoided[1]
    assert env.observation_space.contains(env.reset()[0])
    with pytest.raises(ConfigError, match="of 3-D-avoid: expected one that avoids nothing"):
        ReachEnv(design="3-D-avoid")
    flat = ReachEnv(design="3-D")
    flat.reset(seed=0)
    a, b = (block.kind.conjunction for block in flat.task.episode.blocks[:2])
    with pytest.raises(ConfigError, match="expected one that avoids nothing"):
        flat.reset(seed=0, options={"program": f"AVOID({b}, NEAR(HAND, {a}))"})


@pytest.mark.parametrize("observation", ["flat", "structured"])
def test_a_deep_copy_is_independent(observation: str) -> None:
    """Copy and original both continue like an environment that was never copied."""
    made = [gymnasium.make(ENV_ID, observation=observation) for _ in range(2)]
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1, 1, (12, 6)).astype(np.float32)
    for env in made:
        env.reset(seed=3)
        for action in actions[:4]:
            env.step(action)
    original, reference = made
    copied = copy.deepcopy(original)

    def later(env: gymnasium.Env[Any, Any]) -> list[tuple[Any, ...]]:
        """To the end of this episode's actions, and through another episode."""
        rest: list[tuple[Any, ...]] = [env.step(action) for action in actions[4:]]
        return [*rest, env.reset(), *(env.step(action) for action in actions)]

    expected = later(reference)
    for env in (copied, original):
        for one, other in zip(later(env), expected, strict=True):
            np.testing.assert_equal(one, other)
