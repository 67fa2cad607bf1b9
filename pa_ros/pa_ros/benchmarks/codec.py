"""What the codec costs per message, in microseconds: `pa_ros bench codec`."""

from __future__ import annotations

import platform
import timeit
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
from rclpy.serialization import serialize_message

from pa_ros.core.experience import AgentKey, Observation, PolicySnapshot, Verdict
from pa_ros.core.published import PublishedPolicy
from pa_ros.language import parse
from pa_ros.learning.checkpoints import load_policy
from pa_ros.wire import Message
from pa_ros.wire.learning import (
    decode_trajectory,
    decode_weights,
    encode_trajectory,
    encode_weights,
)
from pa_ros.wire.signing import KEY_BYTES, Checker, Signer
from pa_ros.wire.step import (
    Command,
    decode_command,
    decode_observation,
    decode_verdict,
    encode_command,
    encode_observation,
    encode_verdict,
)
from pa_ros.world import Trajectory
from pa_ros.world.schema import PAPER
from pa_ros.world.world import World

_WORLD = World(PAPER, PAPER.vocabulary, joints=6)
JOINT_NAMES = tuple(f"joint_{i}" for i in range(1, _WORLD.joints + 1))
_OBJECTS = 5
_TRANSITIONS = 100
_WEIGHTS = {"message.0.weight": (150, 68), "message.1.weight": (150, 150), "all.else": (40_000,)}


def bench_codec(repeats: int = 5, calls: int = 2000) -> dict[str, float | str]:
    """Best of `repeats` means over `calls`; `codec.encode_us` is a control step's observation.

    Conversion to and from message objects only: serialization is rmw's and not counted, but how
    long its result is (`codec.features_bytes` …), without DDS's own words; and what compressing
    the shipped 3-D actor would save.
    """
    rng = np.random.default_rng(0)
    observation, verdict, command = sample_step()
    trajectory, policy = _trajectory(rng), _policy(rng)
    pair = encode_observation(observation, JOINT_NAMES)
    messages = (
        encode_verdict(verdict),
        encode_command(command),
        encode_trajectory(trajectory),
        encode_weights(policy),
    )
    work: dict[str, tuple[Callable[[], object], int]] = {
        "encode_us": (lambda: encode_observation(observation, JOINT_NAMES), calls),
        "decode_us": (lambda: decode_observation(*pair, JOINT_NAMES), calls),
        "encode_verdict_us": (lambda: encode_verdict(verdict), calls),
        "decode_verdict_us": (lambda: decode_verdict(messages[0]), calls),
        "encode_command_us": (lambda: encode_command(command), calls),
        "decode_command_us": (lambda: decode_command(messages[1]), calls),
        "encode_trajectory_us": (lambda: encode_trajectory(trajectory), calls // 10),
        "decode_trajectory_us": (lambda: decode_trajectory(messages[2], _WORLD), calls // 10),
        "encode_weights_us": (lambda: encode_weights(policy), calls // 100),
        "decode_weights_us": (lambda: decode_weights(messages[3]), calls // 100),
    }
    names = ("verdict", "command", "trajectory", "weights")
    for name, message in zip(names[1:], messages[1:], strict=True):
        work |= _signing(name, Message(message), calls // 10)
    report: dict[str, float | str] = {"python": platform.python_version(), "numpy": np.__version__}
    for name, message in zip(("features", "joints", *names), (*pair, *messages), strict=True):
        report[f"codec.{name}_bytes"] = len(serialize_message(message))
    actor = load_policy(Path("shipped:3-D")).tensors.values()
    weights = b"".join(tensor.tobytes() for tensor in actor)
    report["codec.actor_bytes"] = len(weights)
    report["codec.actor_zlib_bytes"] = len(zlib.compress(weights, 1))
    work["actor_zlib_us"] = (lambda: zlib.compress(weights, 1), calls // 100)
    for name, (call, number) in work.items():
        number = max(1, number)
        report[f"codec.{name}"] = (
            min(timeit.repeat(call, number=number, repeat=repeats)) / number * 1e6
        )
    return report


def _signing(
    name: str, message: Message, calls: int
) -> dict[str, tuple[Callable[[], object], int]]:
    """Signing a message, and the same and checking it: a message is let through once."""
    key = bytes(KEY_BYTES)
    signer, checker = Signer(key, "/bench", 1), Checker(key)
    return {
        f"sign_{name}_us": (lambda: signer.sign(message), calls),
        f"sign_and_check_{name}_us": (lambda: checker.check(signer.sign(message)), calls),
    }


def sample_step(seed: int = 0) -> tuple[Observation, Verdict, Command]:
    """The content of one control step, of the sizes that the arena has."""
    rng = np.random.default_rng(seed)
    objects = rng.normal(size=(_OBJECTS, _WORLD.object_features)).astype(np.float32)
    joints = rng.normal(size=(2, _WORLD.joints))
    pose = np.array([0.4, 0.0, 0.3, 0.0, 0.0, 0.0, 1.0])
    observation = Observation(3, 7, 10**9, objects, joints[0], joints[1], 0, "generated-3", pose)
    verdict = Verdict(3, 7, 10**9, "generated-3", -1.0, False, 0.4, False)
    action = rng.uniform(-1, 1, _WORLD.actions).astype(np.float32)
    return observation, verdict, Command(3, 7, 10**9, "agent", 1, action)


def _trajectory(rng: np.random.Generator) -> Trajectory:
    rows = _TRANSITIONS + 1
    return Trajectory(
        agent_id="agent",
        sequence=0,
        policy_version=0,
        episode=0,
        first_step=0,
        program=parse("NEAR(HAND, AND(RED, CUBE))", _WORLD.vocabulary),
        hand_index=0,
        objects=rng.normal(size=(rows, _OBJECTS, _WORLD.object_features)).astype(np.float32),
        arm=rng.normal(size=(rows, _WORLD.arm_features)).astype(np.float32),
        actions=rng.uniform(-1, 1, (_TRANSITIONS, _WORLD.actions)).astype(np.float32),
        rewards=np.ones(_TRANSITIONS, dtype=np.float32),
        ends_episode=True,
        terminated=False,
        world_digest=_WORLD.digest,
    )


def _policy(rng: np.random.Generator) -> PublishedPolicy:
    tensors = {k: rng.normal(size=shape).astype(np.float32) for k, shape in _WEIGHTS.items()}
    snapshot = PolicySnapshot(1, "{}", "0" * 16, tensors)
    return PublishedPolicy(snapshot, "run", "learner", {AgentKey("agent", 1): 1})
