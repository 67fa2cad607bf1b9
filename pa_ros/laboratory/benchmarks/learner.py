"""How fast an update of the learner is, beside other ways to do the same and a lower bound.

docs/machines.md states and explains the figures.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from importlib.metadata import version
from itertools import cycle, islice
from typing import Any

import gymnasium
import numpy as np
import torch

from helpers.formulas import StraightforwardEngine
from laboratory.benchmarks.cost import Sizes, floor_us, update_cost
from laboratory.benchmarks.machine import measure_rates
from laboratory.benchmarks.samples import whole_episode
from laboratory.benchmarks.timing import Contender, measure
from pa_ros.acting.executing import Actor
from pa_ros.arena import design_named, preset_named, training_programs, world_of
from pa_ros.arena.gym_env import ENV_ID
from pa_ros.core.experience import Float32, Observation
from pa_ros.core.text import Report
from pa_ros.core.update import Batch, Engine
from pa_ros.learning.algorithms import ALGORITHMS
from pa_ros.learning.algorithms.dpg.builder import initial_networks
from pa_ros.learning.algorithms.dpg.config import DPGConfig
from pa_ros.learning.config import LearnerConfig
from pa_ros.learning.learner import Learner
from pa_ros.learning.recipes import LearningSettings
from pa_ros.native import library as fused_library
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.families import family_of
from pa_ros.world.schema import ObjectSchema

Update = Callable[[Batch], None]

DESIGN, RECIPE = "2-L", "ours"
OURS = "learner.updates_per_s"
TWO_THREADS = "learner.updates_per_s_2_threads"
SAMPLED = "learner.sampled_updates_per_s"  # batches drawn from the replay buffer
STRAIGHTFORWARD = "learner.straightforward_updates_per_s"
EAGER = "learner.eager_updates_per_s"
SB3 = "learner.sb3_ddpg_updates_per_s"
ACT = "actor.inference_us"
RATIOS = {  # of OURS to each, or of SAMPLED where the other draws its batches too
    "learner.ratio_to_straightforward": (OURS, STRAIGHTFORWARD),
    "learner.ratio_to_eager": (OURS, EAGER),
    "learner.ratio_to_sb3_ddpg": (SAMPLED, SB3),
    "learner.ratio_2_threads": (TWO_THREADS, OURS),
}
TRAJECTORY_STEPS, TRAJECTORIES = 100, 20
SB3_HIDDEN = [400, 400]  # paper, appendix "Training parameters"
SB3_STEPS = 1000  # of random actions, to fill its replay buffer


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the benchmark's options."""
    parser.add_argument("--network", default="programmable", help="networks' kind (%(default)s)")
    parser.add_argument("--batch", type=int, default=64, help="transitions (%(default)s)")


def run(options: argparse.Namespace) -> Report:
    """Everything, on design 2-L with one program per transition."""
    network, config = setting(options.network)
    config = config.changed(**{"relabeling.programs_per_transition": 1})
    sizes = Sizes(options.batch)
    return bench_learner(network, config, stable_baselines(sizes.transitions), sizes)


def setting(kind: str) -> tuple[NetworkConfig, LearnerConfig]:
    """Networks of this kind and the learner's settings, as `pa_ros train` has them."""
    world = world_of(preset_named("fast"), design_named(DESIGN))
    settings = LearningSettings(recipe=RECIPE)
    return settings.network.changed(family=kind).for_world(world), settings.learner


def bench_learner(
    network: NetworkConfig,
    config: LearnerConfig,
    others: Sequence[Contender] = (),
    sizes: Sizes = Sizes(),  # noqa: B008 (frozen)
    rounds: int = 15,
    slice_s: float = 0.25,
) -> Report:
    """Updates per second (medians over rounds) of ours and of what it is compared with.

    One thread each unless the name says otherwise. `others` take part in the same rounds. Raises
    FusedError if the fused update is not available.
    """
    torch.set_num_threads(1)
    config = config.changed(**{"replay.batch_size": sizes.transitions})
    learner = random_learner(network, config, sizes)
    contenders = [
        *_engines(learner, list(learner.batches(16))),
        Contender(SAMPLED, learner.update),
        Contender(ACT, _acting(learner)),
        *others,
    ]
    measure(contenders, rounds, slice_s)
    report: dict[str, Any] = {
        "learner.network": network.family,
        "learner.batch": sizes.transitions,
        "learner.objects": sizes.objects,
        "learner.programs_per_transition": sizes.programs,
        "learner.instructions": fused_library.level(),
    }
    for c in contenders:
        report[c.name] = 1e6 / c.rate if c.name.endswith("_us") else c.rate
        report[f"{c.name}_spread"] = c.spread
    if family_of(network).evaluates_programs:
        report |= _floor(network, sizes, 1e6 / report[OURS])
    return report | {
        name: report[one] / report[other]
        for name, (one, other) in RATIOS.items()
        if {one, other} <= report.keys()
    }


def random_learner(network: NetworkConfig, config: LearnerConfig, sizes: Sizes) -> Learner:
    """A learner with random experience in its replay buffer and no update made."""
    steps, frames = TRAJECTORY_STEPS, TRAJECTORY_STEPS * TRAJECTORIES
    waiting = config.changed(**{"replay.warmup_frames": frames})
    programs = training_programs(design_named(DESIGN))
    learner = Learner(network, waiting, programs, seed=0)
    rng = np.random.default_rng(0)
    for sequence in range(TRAJECTORIES):
        program = programs[sequence % len(programs)]
        learner.consume(
            whole_episode(
                network.world,
                sequence,
                program,
                _scenes(rng, network.world.schema, steps + 1, sizes.objects),
                rng.normal(size=(steps + 1, network.world.arm_features)),
                rng.uniform(-1, 1, (steps, network.world.actions)),
                rng.choice([-1.0, 1.0], steps),
            )
        )
    return learner


def bare_updates(network: NetworkConfig, config: LearnerConfig) -> Contender:
    """Updates alone, timed by the clock, of the configuration's batch on scenes of four blocks."""
    sizes = Sizes(config.replay.batch_size, 5, config.relabeling.programs_per_transition)
    idle = random_learner(network, config, sizes)
    return Contender("bare", repeated(engine_of(idle).update, list(idle.batches(16))), wall=True)


def stable_baselines(batch: int = Sizes().transitions) -> list[Contender]:
    """`train()` of Stable-Baselines3's DDPG on the same frames and batch, if it is installed."""
    try:
        from stable_baselines3 import DDPG
    except ImportError as error:
        print(f"Stable-Baselines3 is left out: {error} (make install-bench)", file=sys.stderr)
        return []
    print(f"stable-baselines3 {version('stable-baselines3')}")
    model = DDPG(
        "MlpPolicy",
        gymnasium.make(ENV_ID, design=DESIGN),
        batch_size=batch,
        learning_starts=SB3_STEPS + 1,
        policy_kwargs={"net_arch": SB3_HIDDEN},
        seed=0,
        device="cpu",
    )
    model.learn(SB3_STEPS)
    torch.set_num_threads(1)
    return [Contender(SB3, lambda calls: model.train(gradient_steps=calls, batch_size=batch))]


def _engines(learner: Learner, batches: Sequence[Batch]) -> list[Contender]:
    updates: dict[str, Update] = {
        OURS: engine_of(learner, name="auto", threads=1).update,
        EAGER: engine_of(learner, name="torch").update,
        TWO_THREADS: engine_of(learner, name="fused", threads=2).update,
    }
    if family_of(learner.network).evaluates_programs:
        updates[STRAIGHTFORWARD] = _straightforward(learner).update
    return [
        Contender(name, repeated(update, batches), 1 + (name == TWO_THREADS), name == TWO_THREADS)
        for name, update in updates.items()
    ]


def engine_of(learner: Learner, **changes: object) -> Engine:
    """A new engine with the learner's programs; `changes` are settings of the engine."""
    config = learner.config.changed(**{f"engine.{name}": v for name, v in changes.items()})
    algorithm = ALGORITHMS[config.ALGORITHM]
    return algorithm.make_engine(learner.network, config, learner.table, np.random.default_rng(0))


def repeated(update: Update, batches: Sequence[Batch]) -> Callable[[int], None]:
    """A function that makes so many updates, with these batches in turn."""
    endless = cycle(batches)

    def run(calls: int) -> None:
        for batch in islice(endless, calls):
            update(batch)

    return run


def _straightforward(learner: Learner) -> StraightforwardEngine:
    network, config = learner.network, learner.config
    assert isinstance(config, DPGConfig)  # RECIPE's algorithm
    tensors = initial_networks(network, config, np.random.default_rng(0)).values()
    return StraightforwardEngine(network, config, learner.table, *tensors)


def _acting(learner: Learner) -> Callable[[int], None]:
    """One observation to one action, by the agents' actor."""
    world, program = learner.network.world, learner.table.programs[0]
    actor = Actor.of(learner.snapshot())
    objects = learner.replay.arrays["objects"][0].copy()
    joints = np.random.default_rng(0).normal(size=world.joints)
    pose = np.array([0.4, 0.0, 0.3, 0.0, 0.0, 0.0, 1.0])
    observation = Observation(0, 0, 0, objects, joints, joints, 0, "0.0", pose)

    def run(calls: int) -> None:
        for _ in range(calls):
            actor.act(observation, program)

    return run


def _floor(network: NetworkConfig, sizes: Sizes, update_us: float) -> dict[str, float]:
    """What an update must compute, this machine's rates, and the time it would take at least."""
    cost = update_cost(network, sizes)
    rates = measure_rates(cost.bytes)
    floor = floor_us(cost, rates)
    return {
        "learner.mflop": cost.flops / 1e6,
        "learner.exponentials": cost.exponentials,
        "learner.tanhs": cost.tanhs,
        "learner.pair_tanhs": cost.pair_tanhs,
        "learner.bytes": cost.bytes,
        "machine.gflop_per_s": rates.flops / 1e3,
        "machine.exponentials_per_us": rates.exponentials,
        "machine.tanhs_per_us": rates.tanhs,
        "machine.pair_tanhs_per_us": rates.pair_tanhs,
        "machine.copied_gb_per_s": rates.bytes / 1e3,
        "learner.floor_us": floor,
        "learner.update_us": update_us,
        "learner.floor_ratio": update_us / floor,
    }


def _scenes(rng: np.random.Generator, schema: ObjectSchema, count: int, objects: int) -> Float32:
    """Object features of one scene seen `count` times, [count, N, F]: the hand, then blocks."""
    scenes = np.zeros((count, objects, schema.width), np.float32)
    scenes[..., :3] = rng.normal(0, 0.3, (count, objects, 3))
    scenes[..., 3:7] = rng.normal(0, 0.5, (count, objects, 4))
    for i in range(objects):
        values = {g.name: g.features.values[i % len(g.features.values)] for g in schema}
        scenes[:, i, schema.properties] = schema.features(values)[schema.properties]
    scenes[:, 0] = 0.0
    scenes[:, 0, 6] = 1.0
    return scenes
