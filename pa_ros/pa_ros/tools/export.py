"""Trained networks as ONNX files, compared with what they compute here."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from itertools import cycle, groupby, islice
from pathlib import Path

import numpy as np

from pa_ros.acting.executing import Actor
from pa_ros.agents import TrainedAgent
from pa_ros.arena import ARMS, conditions_for, random_policy, training_programs
from pa_ros.core.errors import ConfigError, needs_extra
from pa_ros.core.experience import Observation
from pa_ros.language import Program
from pa_ros.networks.config import actor_config
from pa_ros.networks.onnx_file import program_inputs, write_onnx
from pa_ros.perception import task_seen

PARITY = 1e-5  # largest difference of an action, each a share of a limit
OBSERVATIONS = 1000
SCENES_SEED = 3_000_001  # of scenes that no training run and no score uses


def export_onnx(agent: TrainedAgent, path: Path, programs: Sequence[Program] = ()) -> float:
    """Write an agent's actor as an ONNX file; `programs` join those of training in its metadata.

    Executes the file by onnxruntime on OBSERVATIONS observations, and returns the largest
    difference from its actions. Raises ConfigError without the extra onnx, for other
    networks, or if the difference exceeds PARITY; the file is left then, to be looked at.
    """
    with needs_extra("onnx", "export"):
        from onnxruntime import InferenceSession, SessionOptions
    network = actor_config(agent.snapshot.architecture)
    arm = ARMS[agent.arena.arm]
    about = {
        "design": agent.design.name,
        "arm": arm.name,
        "preset": agent.arena.preset,
        "weights": agent.digest,
        "words": json.dumps(agent.design.vocabulary.by_group),
        "joints": json.dumps(arm.joint_names),
        "joint_speed_limits": json.dumps(agent.arena.joint_speed_limits),  # rad/s
        "control_period_s": f"{agent.arena.control_period_s:g}",
    }
    named = dict.fromkeys([*training_programs(agent.design), *programs])
    write_onnx(path, network, agent.snapshot.tensors, named, about)
    options = SessionOptions()
    options.intra_op_num_threads = 1
    session = InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    actor, worst = Actor.of(agent.snapshot), 0.0
    found = observations(agent, OBSERVATIONS)
    for (_, program), members in groupby(found, lambda pair: (len(pair[0].objects), pair[1])):
        scenes = [seen for seen, _ in members]
        names = ["objects", "joint_position", "joint_velocity"]
        names += ["hand_pose"] if network.world.sees_hand_pose else []
        feeds = {n: np.array([getattr(seen, n) for seen in scenes], np.float32) for n in names}
        codes = program_inputs(program, network).items()
        feeds |= {name: np.array([code] * len(scenes), np.int64) for name, code in codes}
        (actions,) = session.run(["action"], feeds)
        expected = np.array([actor.infer(seen, program) for seen in scenes])
        worst = max(worst, float(np.abs(actions - expected).max()))
    if not worst <= PARITY:
        raise ConfigError(
            f"export: {path}: expected the networks' actions within {PARITY:g}, got a difference "
            f"of {worst:.2g}: do not use this file"
        )
    return worst


def observations(agent: TrainedAgent, count: int) -> Iterator[tuple[Observation, Program]]:
    """What an arm that moves at random sees in the agent's arena: a scene for each condition
    without comparisons."""
    conditions = conditions_for(agent.design)
    steps = -(-count // len(conditions))  # rounded up
    task = task_seen(agent.arena, agent.design, SCENES_SEED, agent.perception)
    act = random_policy(SCENES_SEED)

    def found() -> Iterator[tuple[Observation, Program]]:
        for scene, condition in enumerate(cycle(conditions)):
            seen, _ = task.reset(scene, condition)
            if task.program.compares:  # the agent compares outside the networks
                continue
            for _ in range(min(steps, agent.arena.episode_steps)):
                yield seen, task.program
                seen, _ = task.step(act(task))

    return islice(found(), count)
