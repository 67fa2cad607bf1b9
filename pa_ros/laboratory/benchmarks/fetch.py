"""Gymnasium-Robotics' FetchPush and FetchPickAndPlace as a world of ours, beside hindsight
experience replay (HER) of Stable-Baselines3.

The environments are unchanged. Their block and their goal are two objects of a world, the goal
being a place, and the agent executes `NEAR(BLOCK, PLACE)`. Fetch has no words: these two only tell
the objects apart. An episode succeeds if the environment says so at its end, as in RHER
(Luo et al. 2023). Each contender has one processor, whose time is counted without evaluations.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import count
from math import cos, inf, isfinite, pi, sin
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np

from laboratory.studies.tables import read_rows, write_rows
from pa_ros.acting.executing import Actor
from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float32, Float64, Observation, Verdict
from pa_ros.core.text import Report
from pa_ros.core.update import HAND_INDEX
from pa_ros.language import PRODUCT, Program, parse
from pa_ros.language.syntax import NEAR
from pa_ros.learning.config import TrainConfig
from pa_ros.learning.loop import train
from pa_ros.learning.recipes import STACK, LearningSettings
from pa_ros.world import Score, Scoring
from pa_ros.world.poses import IDENTITY, objects_from_poses
from pa_ros.world.schema import ObjectSchema, OneHot, PropertyGroup
from pa_ros.world.world import World

OURS = "ours"
PEERS = {"DDPG": "stable_baselines3", "TQC": "sb3_contrib"}
ENVIRONMENTS = {"push": "FetchPush-v4", "pick": "FetchPickAndPlace-v4"}
FRAMES = {"push": 60_000, "pick": 100_000}
SOLVED = 0.95
EVERY, TRIED, EPISODES = 10_000, 50, 100  # frames between scores; episodes of each, and at the end
TRIED_SEED, EPISODES_SEED = 1_000_003, 2_000_003  # of episodes that training does not see

KINDS = "BLOCK", "PLACE"
BLOCK, PLACE = 1, 2  # indices of the objects, after the hand
SCHEMA = ObjectSchema((PropertyGroup("kind", KINDS, OneHot(KINDS), bodiless=("PLACE",)),))
# Fetch's action is four numbers. The three that move the hand and the one that moves the fingers
# are the joints of our world.
WORLD = World(SCHEMA, SCHEMA.vocabulary.moving("PLACE"), joints=4)
PUT = parse("NEAR(BLOCK, PLACE)", WORLD.vocabulary)
REACH = parse("NEAR(HAND, PLACE)", WORLD.vocabulary)
# How near the block must be to the goal for a reward. Agents are scored by Fetch's 0.05, but those
# rewarded within 0.05 often left the block a few millimeters outside (as `REWARDED` in the arena).
NEAR_M = 0.03
BESIDE_M = {"push": 0.09, "pick": 0.0}  # of the block: where the hand first goes
HAND_M = 0.04  # what NEAR means of the hand
TABLE_M = np.array([1.34, 0.75, 0.42])  # the middle of the table, which is our base
STEP_M = 0.05  # how far the hand moves in a step at most; also how far the fingers open
FAST_M = 0.01  # how far a block that is pushed fast moves in a step
STEPS = 50  # of an episode, in training and where it is scored
FALLEN_M = 0.40  # height of a block that has left the table, which ends a training episode
GUIDED = 0.8  # share of training episodes in which the hand first goes to the block, as in RHER

CHANGED: dict[str, Any] = {
    "learner.schedule.trajectory_steps": STEPS,
    "learner.replay.warmup_frames": 2_000,
    "learner.updates.per_frame": 2.0,
    "learner.optimizer.half_life": 160_000,
    "learner.action_penalty": 0.0,
    "network.family": "true-properties",  # there are no words to learn
    "network.position_scale": 40.0,  # since thresholds are half of our arena's
}

Seen = Mapping[str, Float64]
"""Fetch's observation: `observation` [25], `achieved_goal` [3], `desired_goal` [3]."""
Act = Callable[[Seen], Float32]
"""Fetch's action, [4]."""


@dataclass(frozen=True, slots=True)
class FetchScore:
    """One evaluation of one contender."""

    environment: str
    contender: str
    seed: int
    frames: int
    seconds: float  # of a processor, for training alone
    episodes: int
    success: float  # share of episodes that end with the block at the goal


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the benchmark's options."""
    parser.add_argument("--env", choices=ENVIRONMENTS, default="push", help="(%(default)s)")
    parser.add_argument("--seeds", type=int, default=1, help="of each contender (%(default)s)")
    parser.add_argument("--first-seed", type=int, default=0, help="(%(default)s)")
    parser.add_argument("--frames", type=int, help="of ours (push 60,000; pick 100,000)")
    parser.add_argument(
        "--minutes", type=float, default=60.0, help="of a processor for each peer (%(default)s)"
    )
    parser.add_argument(
        "--contenders", nargs="+", choices=(OURS, *PEERS), default=(OURS, *PEERS), metavar="NAME"
    )
    parser.add_argument(
        "--runs", type=Path, default=Path("docs/results/fetch.runs"),
        help="folder of the runs' scores; finished runs are not repeated (%(default)s)",
    )  # fmt: skip


def run(options: argparse.Namespace) -> Report:
    """Train and score the contenders; figures of all runs in the folder.

    Raises ConfigError for a library that is not installed.
    """
    for seed in range(options.first_seed, options.first_seed + options.seeds):
        for name in options.contenders:
            path = options.runs / f"{options.env}-{name}-{seed}.csv"
            if path.exists() and read_rows(path, FetchScore)[-1].episodes >= EPISODES:
                continue
            for module in ("gymnasium_robotics", *([] if name == OURS else [PEERS[name]])):
                if importlib.util.find_spec(module) is None:
                    raise ConfigError(f"fetch: {name} needs {module} (make install-fetch)")
            scores = _Scores(options.env, name, seed, path)
            if name == OURS:
                frames = options.frames or FRAMES[options.env]
                end = train_ours(options.env, seed, frames, scores)
            else:
                end = train_peer(options.env, name, seed, options.minutes, scores)
            scores.add(*end, last=True)
    paths = sorted(options.runs.glob("*.csv"))
    return report([row for path in paths for row in read_rows(path, FetchScore)])


def report(scores: Sequence[FetchScore]) -> Report:
    """Medians over seeds at the end; how many seeds ever scored at least SOLVED, and after how
    many frames the median one first did."""
    found: dict[str, float | int | str] = {}
    curves: dict[str, dict[int, list[FetchScore]]] = {}
    for row in scores:
        name = f"fetch.{row.environment}.{row.contender}"
        curves.setdefault(name, {}).setdefault(row.seed, []).append(row)
    for name, by_seed in curves.items():
        ends = [rows[-1] for rows in by_seed.values()]
        solved = [min((row.frames for row in rows if row.success >= SOLVED), default=inf)
                  for rows in by_seed.values()]  # fmt: skip
        found |= {f"{name}.seeds": len(ends),
                  f"{name}.solved": sum(map(isfinite, solved))}  # fmt: skip
        found |= {f"{name}.{figure}": median(getattr(row, figure) for row in ends)
                  for figure in ("frames", "seconds", "success")}  # fmt: skip
        if isfinite(median(solved)):
            found[f"{name}.frames_to_solve"] = median(solved)
    return found


def make(env: str) -> gymnasium.Env[Any, Any]:
    """One of ENVIRONMENTS."""
    import gymnasium_robotics
    import mujoco
    from gymnasium_robotics.utils import mujoco_utils

    # Version 1.4.2 compares joint types as if they were numbers, which in MuJoCo 4 they are not.
    types = {name: int(one) for name, one in mujoco.mjtJoint.__members__.items()}
    mujoco_utils.mujoco = SimpleNamespace(**{**vars(mujoco), "mjtJoint": SimpleNamespace(**types)})
    gymnasium.register_envs(gymnasium_robotics)
    return gymnasium.make(ENVIRONMENTS[env])


class FetchScoring(Scoring):
    """The arena's rule, except that NEAR_M decides where the block is near and is rewarded."""

    def of_measure(self, measure: Any, relation: str = NEAR, between: bool = False) -> Score:
        """Score measures of the hand, or `between` the block and the goal."""
        holds = measure <= (NEAR_M if between else self.threshold(relation))
        return Score(measure, holds, self.reward(holds, measure))


def observed(
    seen: Seen,
    program: Program,
    goal: Float64 | None = None,
    when: tuple[int, int, int] = (0, 0, 0),
) -> Observation:
    """Fetch's observation as ours; the hand never turns, so its axes are the base's.

    :param goal: [3] m, where the place is in Fetch's frame; None: at Fetch's goal.
    :param when: episode, step and stamp (ns).
    """
    from gymnasium_robotics.utils.rotations import euler2quat

    own = seen["observation"]
    poses = np.stack([IDENTITY] * 3)
    target = seen["desired_goal"] if goal is None else goal
    poses[:, :3] = np.stack([own[:3], own[3:6], target]) - TABLE_M
    poses[BLOCK, 3:] = np.roll(euler2quat(own[11:14]), -1)
    objects = objects_from_poses(SCHEMA, [{"kind": kind} for kind in KINDS], poses)
    # The hand's pose says where it is, so its joints' positions say how the block moves instead.
    moves = own[14:17] + own[20:23]  # m in a step; Fetch's is relative to the hand
    place, speed = np.array([*(moves / FAST_M), own[9] / STEP_M]), own[20:24] / STEP_M
    return Observation(*when, objects, place, speed, HAND_INDEX, str(program), poses[0])


class FetchTask:
    """A Fetch environment as the training loop takes one (`pa_ros.learning.interfaces`).

    In a share GUIDED of the episodes the program is at first REACH, with the place at the block or
    beside it. When it holds, the place moves to the goal, and the program is PUT.
    """

    control_period_s = 0.04

    def __init__(self, env: str, seed: int) -> None:
        """`seed` and the index determine an episode."""
        self._env, self._seed, self._beside_m = make(env), seed, BESIDE_M[env]
        self.scoring: Scoring = FetchScoring({NEAR: HAND_M})
        self.program = PUT
        self._first_goal: Float64 | None = None
        self._episode = self._step = self._stamp_ns = 0

    def reset(self, episode_index: int, condition: str = "train") -> tuple[Observation, Verdict]:
        """Begin an episode."""
        rng = np.random.default_rng([self._seed, episode_index])
        self._episode, self._step = episode_index, 0
        seen, _ = self._env.reset(seed=int(rng.integers(2**31)))
        angle = rng.uniform(0.0, 2 * pi)
        beside = self._beside_m * np.array([cos(angle), sin(angle), 0.0])
        self._first_goal = seen["achieved_goal"] + beside if rng.random() < GUIDED else None
        return self._judged(seen, False)

    def step(self, joint_velocity: Float64) -> tuple[Observation, Verdict]:
        """Act by Fetch's action, [4]."""
        seen, _, _, truncated, _ = self._env.step(joint_velocity.astype(np.float32))
        self._step += 1
        return self._judged(seen, bool(truncated or seen["achieved_goal"][2] < FALLEN_M))

    def _judged(self, seen: Seen, truncated: bool) -> tuple[Observation, Verdict]:
        self._stamp_ns += round(self.control_period_s * 1e9)
        now, score = self._scored(seen)
        if self._first_goal is not None and score.satisfied:
            self._first_goal = None
            now, score = self._scored(seen)
        return now, Verdict(float(score.reward), bool(score.satisfied), score.measure, truncated)

    def _scored(self, seen: Seen) -> tuple[Observation, Score]:
        goal = self._first_goal
        self.program, moved = (PUT, BLOCK) if goal is None else (REACH, HAND_INDEX)
        now = observed(seen, self.program, goal, (self._episode, self._step, self._stamp_ns))
        sets = (moved,), (PLACE,)
        return now, self.scoring.of_program(self.program, sets, now.objects, now.hand_pose)


def success(env: str, act: Act, episodes: int, first_seed: int) -> float:
    """The share of episodes that end in success."""
    environment, ends = make(env), []
    for seed in range(first_seed, first_seed + episodes):
        seen, _ = environment.reset(seed=seed)
        over = False
        while not over:
            seen, _, _, over, facts = environment.step(act(seen))
        ends.append(facts["is_success"])
    return float(np.mean(ends))


class _Scores:
    """The scores of one contender with one seed, and the time that training took."""

    def __init__(self, env: str, name: str, seed: int, path: Path) -> None:
        self._who, self._path, self._rows = (env, name, seed), path, list[FetchScore]()
        self._not_training_s = time.process_time()

    @property
    def seconds(self) -> float:
        """Of the processor, for training alone."""
        return time.process_time() - self._not_training_s

    def add(self, frames: int, act: Act, last: bool = False) -> float:
        """Score in time that does not count, and write all scores so far."""
        started, seconds = time.process_time(), self.seconds
        episodes, first_seed = (EPISODES, EPISODES_SEED) if last else (TRIED, TRIED_SEED)
        share = success(self._who[0], act, episodes, first_seed)
        self._rows.append(FetchScore(*self._who, frames, seconds, episodes, share))
        write_rows(self._path, self._rows)
        print(f"{self._path.stem}: {frames} frames in {seconds:.0f} s, {share:.2f}", flush=True)
        self._not_training_s += time.process_time() - started
        return share


def train_ours(env: str, seed: int, frames: int, scores: _Scores) -> tuple[int, Act]:
    """Train by the recipe; the frames that it took, and the policy."""
    changed = {**CHANGED, "learner.hindsight.in_air": env == "pick"}
    settings = LearningSettings(recipe=STACK, **changed)
    network, number = settings.network.for_world(WORLD), count(1)

    def evaluate(actor: Actor) -> dict[str, float]:
        return {"success": scores.add(next(number) * EVERY, partial(acted, actor))}

    with TemporaryDirectory() as name:
        config = TrainConfig(
            out=Path(name) / "run", seed=seed, frames=frames, evaluate_every_frames=EVERY
        )
        given = network, settings.learner, FetchTask(env, seed), np.ones(4), (PUT, REACH)
        learner = train(config, *given, evaluate)
    actor = Actor(network, logic=PRODUCT)
    actor.load(learner.snapshot())
    return learner.counters.frames, partial(acted, actor)


def acted(actor: Actor, seen: Seen) -> Float32:
    """The networks' action alone: the rules of executing are made for our arena's distances."""
    return actor.infer(observed(seen, PUT), PUT)


def train_peer(env: str, name: str, seed: int, minutes: float, scores: _Scores) -> tuple[int, Act]:
    """Train with networks and settings as in RHER and on Stable-Baselines3's page on HER."""
    from stable_baselines3 import HerReplayBuffer
    from stable_baselines3.common.noise import NormalActionNoise

    noise = NormalActionNoise(np.zeros(4), np.full(4, 0.2)) if name == "DDPG" else None
    model = getattr(importlib.import_module(PEERS[name]), name)(
        "MultiInputPolicy", make(env), seed=seed, device="cpu", action_noise=noise,
        gamma=0.95, tau=0.05, learning_rate=1e-3, batch_size=256, learning_starts=2_000,
        replay_buffer_class=HerReplayBuffer,
        replay_buffer_kwargs={"n_sampled_goal": 4, "goal_selection_strategy": "future"},
        policy_kwargs={"net_arch": [256, 256, 256]},
    )  # fmt: skip

    def act(seen: Seen) -> Float32:
        return np.asarray(model.predict(seen, deterministic=True)[0], np.float32)

    def continues(*_: Any) -> bool:
        if model.num_timesteps % EVERY == 0:
            scores.add(model.num_timesteps, act)
        return scores.seconds < 60.0 * minutes

    model.learn(10**9, callback=continues)
    return model.num_timesteps, act
