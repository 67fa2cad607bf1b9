"""How fast the learner is, beside other ways to do the same and beside what must be computed."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from itertools import cycle, islice

import numpy as np
import torch

from pa_ros.acting.actor import Actor
from pa_ros.benchmarks.cost import Rates, Sizes, floor_us, update_cost
from pa_ros.benchmarks.machine import measure_rates
from pa_ros.benchmarks.rounds import Contender, measure
from pa_ros.benchmarks.straightforward import StraightforwardEngine
from pa_ros.core.experience import Float32, Observation
from pa_ros.core.report import Report
from pa_ros.core.update import Batch, Engine
from pa_ros.language import Program
from pa_ros.learning.algorithms import ALGORITHMS
from pa_ros.learning.algorithms.dpg.config import DPGConfig
from pa_ros.learning.config import LearnerConfig
from pa_ros.learning.learner import Learner
from pa_ros.native import library as fused_library
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.inference import TorchActor
from pa_ros.networks.parameters import initial_actor, initial_critic
from pa_ros.world import Trajectory
from pa_ros.world.schema import ObjectSchema

log = logging.getLogger(__name__)
Update = Callable[[Batch], None]

OURS = "learner.updates_per_s"
TWO_THREADS = "learner.updates_per_s_2_threads"
SAMPLED = "learner.sampled_updates_per_s"
STRAIGHTFORWARD = "learner.straightforward_updates_per_s"
EAGER = "learner.eager_updates_per_s"
SB3 = "learner.sb3_ddpg_updates_per_s"
SBX = "learner.sbx_ddpg_updates_per_s"
GPU = "learner.gpu_updates_per_s"
ACT, ACT_TORCH = "actor.inference_us", "actor.inference_torch_us"
TRAJECTORY_STEPS, TRAJECTORIES = 100, 20


def bench_learner(
    network: NetworkConfig,
    config: LearnerConfig,
    programs: Sequence[Program],
    sizes: Sizes = Sizes(),  # noqa: B008 (frozen)
    others: Sequence[Contender] = (),
    rounds: int = 15,
    slice_s: float = 0.25,
) -> Report:
    """Updates per second, medians over rounds, of ours and of what it is compared with.

    `programs` are those of training; `others` run in the same rounds. One thread
    each but where the name says otherwise. FusedError if the fused update is not there.
    """
    facts = _sizes(sizes, network)
    torch.set_num_threads(1)
    config = config.changed(**{"replay.batch_size": sizes.transitions})
    learner = random_learner(network, config, programs, sizes)
    batches = list(learner.batches(16))
    contenders = [
        *_engines(learner, batches),
        Contender(SAMPLED, learner.update),
        *_actors(learner, programs[0]),
        *others,
    ]
    measure(contenders, rounds, slice_s)
    report = {**facts, **_rows(contenders)}
    cost = update_cost(network, sizes)
    rates = measure_rates(cost.bytes)
    return {**report, **_floor_rows(network, sizes, rates, report), **_ratios(report)}


def random_learner(
    network: NetworkConfig, config: LearnerConfig, programs: Sequence[Program], sizes: Sizes
) -> Learner:
    """A learner with random experience in its replay buffer and no update made."""
    frames = TRAJECTORY_STEPS * TRAJECTORIES
    waiting = config.changed(**{"replay.warmup_frames": frames})
    learner = Learner(network, waiting, programs, seed=0)
    rng = np.random.default_rng(0)
    for sequence in range(TRAJECTORIES):
        learner.consume(_trajectory(rng, network, programs, sizes.objects, sequence))
    return learner


def bare_updates(
    network: NetworkConfig, config: LearnerConfig, programs: Sequence[Program]
) -> Contender:
    """Updates by the clock, with the configuration's batch, of tables with four blocks."""
    sizes = Sizes(config.replay.batch_size, 5, config.relabeling.programs_per_transition)
    idle = random_learner(network, config, programs, sizes)
    run = repeated(engine_of(idle).update, list(idle.batches(16)))
    return Contender("bare", run, wall=True)


def repeated(update: Update, batches: Sequence[Batch]) -> Callable[[int], None]:
    """Updates with these batches in turn."""
    endless = cycle(batches)

    def run(calls: int) -> None:
        for batch in islice(endless, calls):
            update(batch)
        if torch.cuda.is_available():
            torch.cuda.synchronize()

    return run


def engine_of(learner: Learner, **changes: object) -> Engine:
    """A new engine for the learner's table, with some settings of the engine replaced."""
    config = learner.config.changed(**{f"engine.{name}": v for name, v in changes.items()})
    algorithm = ALGORITHMS[config.ALGORITHM]
    return algorithm.engine(learner.network, config, learner.table, np.random.default_rng(0))


def _engines(learner: Learner, batches: Sequence[Batch]) -> list[Contender]:
    ours = engine_of(learner, name="auto", threads=1)
    made: dict[str, Update] = {
        OURS: ours.update,
        EAGER: engine_of(learner, name="torch").update,
    }
    if ours.name == "fused":
        made[TWO_THREADS] = engine_of(learner, name="fused", threads=2).update
    if learner.network.family.evaluates_programs:
        made[STRAIGHTFORWARD] = _straightforward(learner).update
    if torch.cuda.is_available():
        made[GPU] = engine_of(learner, name="torch", device="cuda").update
    return [
        Contender(
            name,
            repeated(update, batches),
            threads=2 if name == TWO_THREADS else 1,
            wall=name in (TWO_THREADS, GPU),
        )
        for name, update in made.items()
    ]


def _straightforward(learner: Learner) -> StraightforwardEngine:
    rng, network = np.random.default_rng(0), learner.network
    tensors = initial_actor(network, rng), initial_critic(network, rng)
    config = learner.config
    assert isinstance(config, DPGConfig)  # the benchmark's protocol is for no other algorithm
    return StraightforwardEngine(network, config, learner.table, *tensors)


def _actors(learner: Learner, program: Program) -> list[Contender]:
    """One observation to one action, by what agents use and by torch."""
    network, snapshot = learner.network, learner.snapshot()
    actor = Actor(network)
    actor.load(snapshot)
    plain = TorchActor(network, snapshot.tensors, actor.logic)
    objects = learner.replay.arrays["objects"][0].copy()
    joints = np.random.default_rng(0).normal(size=network.world.joints)
    pose = np.array([0.4, 0.0, 0.3, 0.0, 0.0, 0.0, 1.0])
    observation = Observation(0, 0, 0, objects, joints, joints, 0, "0.0", pose)
    arm = network.world.arm(observation)

    def fused(calls: int) -> None:
        for _ in range(calls):
            actor.act(observation, program)

    def reference(calls: int) -> None:
        for _ in range(calls):
            plain.act(observation.objects, arm, program, 0)

    return [Contender(ACT, fused), Contender(ACT_TORCH, reference)]


def _rows(contenders: Sequence[Contender]) -> dict[str, float]:
    rows: dict[str, float] = {}
    for c in contenders:
        rows[c.name] = 1e6 / c.rate if c.name.endswith("_us") else c.rate
        rows[f"{c.name}_spread"] = c.spread
        rows[f"{c.name}_cpu_share"] = c.share
    return rows


def _sizes(sizes: Sizes, network: NetworkConfig) -> dict[str, float | str]:
    return {
        "learner.network": network.kind,
        "learner.batch": sizes.transitions,
        "learner.objects": sizes.objects,
        "learner.programs_per_transition": sizes.programs,
        "learner.instructions": fused_library.level(),
    }


def _floor_rows(
    network: NetworkConfig, sizes: Sizes, rates: Rates, report: Report
) -> dict[str, float]:
    """What an update must compute, what this machine could do, and the time it would take."""
    cost = update_cost(network, sizes)
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
        "learner.update_us": 1e6 / float(report[OURS]),
        "learner.floor_ratio": 1e6 / float(report[OURS]) / floor,
    }


def _ratios(report: Report) -> dict[str, float]:
    """Ours over each of the others, and the two-thread rate over ours."""
    ours = float(report[OURS])
    names = {STRAIGHTFORWARD: "straightforward", EAGER: "eager", GPU: "gpu"}
    ratios = {
        f"learner.ratio_to_{short}": ours / float(report[name])
        for name, short in names.items()
        if name in report
    }
    for name in (SB3, SBX):  # train() draws its batches from a replay buffer, so ours does here
        if name in report:
            short = name.removeprefix("learner.").removesuffix("_updates_per_s")
            ratios[f"learner.ratio_to_{short}"] = float(report[SAMPLED]) / float(report[name])
    if TWO_THREADS in report:
        ratios["learner.ratio_2_threads"] = float(report[TWO_THREADS]) / ours
    return ratios


def random_scenes(
    rng: np.random.Generator, schema: ObjectSchema, count: int, objects: int
) -> Float32:
    """Ω of one scene seen `count` times, [count, N, F]: a hand, then blocks of any kind."""
    scenes = np.zeros((count, objects, schema.width), np.float32)
    scenes[..., :3] = rng.normal(0, 0.3, (count, objects, 3))
    scenes[..., 3:7] = rng.normal(0, 0.5, (count, objects, 4))
    for i in range(objects):
        values = {g.name: g.features.values[i % len(g.features.values)] for g in schema}
        scenes[:, i, schema.properties] = schema.features(values)[schema.properties]
    scenes[:, 0] = 0.0
    scenes[:, 0, 6] = 1.0
    return scenes


def _trajectory(
    rng: np.random.Generator,
    network: NetworkConfig,
    programs: Sequence[Program],
    objects: int,
    sequence: int,
) -> Trajectory:
    steps = TRAJECTORY_STEPS
    return Trajectory(
        agent_id="bench",
        sequence=sequence,
        policy_version=0,
        episode=sequence,
        first_step=0,
        program=programs[sequence % len(programs)],
        hand_index=0,
        objects=random_scenes(rng, network.world.schema, steps + 1, objects),
        arm=rng.normal(size=(steps + 1, network.world.arm_features)).astype(np.float32),
        actions=rng.uniform(-1, 1, (steps, network.world.actions)).astype(np.float32),
        rewards=rng.choice([-1.0, 1.0], steps).astype(np.float32),
        ends_episode=True,
        terminated=False,
        world_digest=network.world.digest,
    )
