"""Strangers: messages in the names of others, with a shared key and without one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from chaos.faults import Fault
from chaos.observer import STRANGER
from chaos.stage import START_S, Stage, StageError
from pa_ros.ros import topics
from pa_ros.ros.topics import Topic
from pa_ros.wire import Message
from pa_ros.wire.arena import decode_arena_info, encode_arena_info
from pa_ros.wire.learning import (
    decode_learner_info,
    decode_trajectory,
    decode_weights,
    encode_learner_info,
    encode_trajectory,
    encode_weights,
)
from pa_ros.wire.step import decode_command, encode_command
from pa_ros.world import Trajectory

TIMES: Final = 5  # that a message is sent
AHEAD: Final = 10**6  # of a real agent's sequence
Make = Callable[[Stage], Message]


def stranger_faults() -> list[Fault]:
    """What was found to do harm, without a key; and anything at all, with one."""
    opened: list[tuple[str, Topic, Make]] = [
        ("a trajectory of a real agent, far ahead", topics.TRAJECTORIES, _far_ahead),
        ("a trajectory with 64 objects", topics.TRAJECTORIES, _crowded),
        ("a trajectory with numbers of 3e38", topics.TRAJECTORIES, _absurd),
        ("another arena_info", topics.ARENA_INFO, _arena),
        ("weights of nobody's run", topics.POLICY_WEIGHTS, _weights),
    ]
    keyed: list[tuple[str, Topic, Make]] = [
        ("a forged trajectory", topics.TRAJECTORIES, _far_ahead),
        ("a forged command", topics.JOINT_COMMANDS, _command),
        ("a forged arena_info", topics.ARENA_INFO, _arena),
        ("forged weights", topics.POLICY_WEIGHTS, _weights),
        ("a forged learner_info", topics.LEARNER_INFO, _learner),
        ("a replayed trajectory", topics.TRAJECTORIES, _again("trajectories")),
        ("a replayed command", topics.JOINT_COMMANDS, _again("joint_commands")),
    ]
    return [
        *(Fault(f"stranger: {name}", _send(topic, make), hold_s=2.0)
          for name, topic, make in opened),
        *(Fault(f"stranger, with a key: {name}", _send(topic, make), hold_s=2.0, kind="keyed")
          for name, topic, make in keyed),
    ]  # fmt: skip


def _send(topic: Topic, make: Make) -> Callable[[Stage], None]:
    def send(stage: Stage) -> None:
        publisher = topic.publisher(stage.node)
        try:
            heard = stage.until(lambda: publisher.get_subscription_count() > 1, START_S)
            if not heard:
                raise StageError(f"{topic.name}: expected a listener, got none")
            for _ in range(TIMES):
                publisher.publish(make(stage))
            stage.wait(1.0)
        finally:
            stage.node.destroy_publisher(publisher)

    return send


def _trajectory(stage: Stage) -> Trajectory:
    """The last that was published, decoded."""
    arena = stage.observer.arena
    if arena is None:
        raise StageError("arena_info: expected one before this fault, got none")
    return decode_trajectory(stage.observer.last["trajectories"], arena.world)


def _forged(stage: Stage, trajectory: Trajectory) -> Message:
    stage.observer.forged.add(trajectory.key)
    stage.observer.forgeries += 1
    return Message(encode_trajectory(trajectory))


def _far_ahead(stage: Stage) -> Message:
    real = _trajectory(stage)
    number = real.sequence + AHEAD
    return _forged(stage, replace(real, sequence=number, held_from=min(real.held_from, number)))


def _crowded(stage: Stage) -> Message:
    real = _trajectory(stage)
    objects = np.repeat(real.objects[:, :1], 64, axis=1)
    return _forged(stage, replace(real, agent_id=STRANGER, objects=objects))


def _absurd(stage: Stage) -> Message:
    real = _trajectory(stage)
    objects = np.full_like(real.objects, 3e38)
    return _forged(stage, replace(real, agent_id=STRANGER, objects=objects))


def _arena(stage: Stage) -> Message:
    real = decode_arena_info(stage.observer.last["arena_info"])
    strange = replace(real, arena_id=STRANGER, thresholds=(9.0,), control_period=7.0)
    return Message(encode_arena_info(strange))


def _weights(stage: Stage) -> Message:
    real = decode_weights(stage.observer.last["policy_weights"])
    wild = {name: np.full_like(tensor, 1e3) for name, tensor in real.snapshot.tensors.items()}
    snapshot = replace(real.snapshot, tensors=wild, version=real.snapshot.version + AHEAD)
    return Message(encode_weights(replace(real, run_id=STRANGER, snapshot=snapshot,
                                                learner_id=STRANGER)))  # fmt: skip


def _learner(stage: Stage) -> Message:
    real = decode_learner_info(stage.observer.last["learner_info"])
    later = replace(real, learner_id=STRANGER, run_id=STRANGER, stamp_ns=real.stamp_ns + 10**9)
    return Message(encode_learner_info(later))


def _command(stage: Stage) -> Message:
    joints = len(stage.observer.positions[-1][1])
    real = decode_command(stage.observer.last["joint_commands"], joints)
    return Message(encode_command(replace(real, action=np.zeros(joints, np.float32))))


def _again(topic: str) -> Make:
    """The very same message once more, its signature too."""

    def make(stage: Stage) -> Message:
        return stage.observer.last[topic]

    return make
