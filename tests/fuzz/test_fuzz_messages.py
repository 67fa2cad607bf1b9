"""A message with changed fields is rejected by a PaError, or decoded and then usable."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from helpers import learners
from helpers.damage import damaged, explore
from helpers.learners import FACTS, LEARNER, ME, NETWORK, published
from laboratory.benchmarks.samples import JOINT_NAMES, sample_step
from msgs_schema.srv import Reset, SetSpeed
from pa_ros.acting.agent import Agent
from pa_ros.acting.learning_agent import LearningAgent
from pa_ros.core.errors import PaError
from pa_ros.core.experience import CommandKey, Executed, TrajectoryKey
from pa_ros.language import parse
from pa_ros.learning.algorithms.dpg.config import DPGConfig
from pa_ros.learning.learner import Learner
from pa_ros.learning.run import LearningRun
from pa_ros.networks.config import NetworkConfig
from pa_ros.wire.arena import decode_arena_info, encode_arena_info
from pa_ros.wire.diagnostics import (
    Health,
    Origin,
    decode_diagnostics,
    decode_provenance,
    encode_diagnostics,
    encode_provenance,
)
from pa_ros.wire.learning import (
    decode_learner_info,
    decode_trajectory,
    decode_weights,
    encode_learner_info,
    encode_trajectory,
    encode_weights,
)
from pa_ros.wire.program import (
    ProgramRequest,
    ProgramStatus,
    decode_program,
    decode_program_status,
    encode_program,
    encode_program_status,
)
from pa_ros.wire.program_book import ProgramBook
from pa_ros.wire.robot import decode_driver_joints
from pa_ros.wire.services import decode_reset, decode_speed
from pa_ros.wire.step import decode_command, decode_step, encode_command, encode_joints, encode_step
from pa_ros.world import reward_from
from pa_ros.world.schema import PAPER
from pa_ros.world.world import World

MESSAGES = 100_000  # of all kinds together
STEP, COMMAND = sample_step()
EXECUTED = Executed(CommandKey("agent", 1, 2), COMMAND.action)
FEATURES = encode_step(replace(STEP, executed=EXECUTED, program="NEAR(HAND, RED)"))
SETTINGS = DPGConfig().changed(
    **{"replay.capacity_frames": 500, "replay.batch_size": 4, "replay.warmup_frames": 5}
)
WORLD = World(PAPER, PAPER.vocabulary, joints=6)
ORIGIN = Origin("/sim_node", "a", "0.2", "numpy 2", 0, {"a": 1}, "2-L", "jaco", "fast", WORLD)
STATUS = ProgramStatus("p", "/sim_node", True, "NEAR(HAND, RED)")


def arena(message: Any) -> None:
    described = decode_arena_info(message)
    words = described.world.vocabulary
    ProgramBook(words).accept(ProgramRequest("p", f"NEAR(HAND, {words.words[0]})"))
    assert 0 < described.control_period < math.inf
    reward_from(described.reward)
    NetworkConfig(world=described.world, hidden=4, attention=4).architecture.encode()


def features(message: Any) -> None:
    step = decode_step(message, 6)
    assert np.isfinite(step.observation.objects).all()
    assert np.isfinite(WORLD.arm(step.observation)).all()
    assert step.executed is None or np.isfinite(step.executed.action).all()
    assert step.verdict is None or np.isfinite(step.verdict.reward) and step.verdict.distance >= 0


def joints(message: Any) -> None:
    decoded = decode_driver_joints(message, JOINT_NAMES)
    assert decoded is None or all(np.isfinite(part).all() for part in decoded)


def command(message: Any) -> None:
    assert np.isfinite(decode_command(message).action).all()


def learner(message: Any) -> None:
    agent = LearningAgent(ME, 0)
    agent.follow(decode_learner_info(message), FACTS)
    agent.prepare()


def weights(message: Any) -> None:
    """An agent without weights, and one that follows a learner, may load these."""
    policy = decode_weights(message)
    _acts(Agent(ME), policy)
    follower = LearningAgent(ME, 0)
    follower.follow(LEARNER, FACTS)
    follower.offer(published(0))
    _acts(follower, policy)


def _acts(agent: Agent, policy: Any) -> None:
    agent.offer(policy)
    agent.prepare()


def trajectory(message: Any) -> None:
    """A learner that inserts it keeps finite weights; one that rejects it is unchanged."""
    received = decode_trajectory(message, learners.WORLD)
    network = NETWORK.changed(world=learners.WORLD)
    run = LearningRun(Learner(network, SETTINGS, learners.ARENA.training_programs, 0), 0.1)
    before = run.learner.counters.version
    try:
        run.consume(received)
    except PaError:
        assert run.learner.counters.version == before
        raise
    assert all(np.isfinite(t).all() for t in run.policy().snapshot.tensors.values())


def program(message: Any) -> None:
    request = decode_program(message)
    assert request.program_id
    parse(request.text, learners.DESIGN.vocabulary)


RECEIVERS: dict[str, tuple[Any, Callable[[Any], object]]] = {
    "arena_info": (encode_arena_info(learners.ARENA), arena),
    "object_features": (FEATURES, features),
    "joint_states": (encode_joints(STEP.observation, JOINT_NAMES), joints),
    "joint_command": (encode_command(COMMAND), command),
    "learner_info": (encode_learner_info(LEARNER), learner),
    "policy_weights": (
        encode_weights(replace(published(1, 1), latest=TrajectoryKey(*ME, 0))),
        weights,
    ),
    "trajectory": (encode_trajectory(learners.trajectory(0)), trajectory),
    "program": (encode_program(ProgramRequest("p", "NEAR(HAND, RED)")), program),
    "program_status": (encode_program_status(STATUS), decode_program_status),
    "provenance": (encode_provenance(ORIGIN), decode_provenance),
    "diagnostics": (encode_diagnostics([Health("/a", 1, "x", {"k": "v"})], 5), decode_diagnostics),
    "reset": (Reset.Request(episode=3), decode_reset),
    "speed": (SetSpeed.Request(real_time_factor=1.0), decode_speed),
}


def check(name: str, message: Any) -> None:
    try:
        RECEIVERS[name][1](message)
    except PaError as error:
        assert error.code and str(error)


@pytest.mark.timeout(0)
@pytest.mark.parametrize("name", RECEIVERS)
def test_messages(name: str):
    explore(damaged(RECEIVERS[name][0]), partial(check, name), MESSAGES // len(RECEIVERS))


@pytest.mark.parametrize("name", RECEIVERS)
def test_an_unchanged_message_is_decoded(name: str):
    message, receive = RECEIVERS[name]
    receive(message)
