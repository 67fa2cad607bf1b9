"""Faults of messages: forged ones, and a relay that drops, repeats, delays or reorders them."""

from collections.abc import Callable
from dataclasses import replace
from signal import SIGCONT, SIGSTOP
from typing import Any, Final

import numpy as np

from chaos.faults import LEARNER, Act, Fault
from chaos.observer import STRANGER
from chaos.relay import CHANGES, RELAYED, SHARE
from chaos.stage import START_S, Stage, StageError
from pa_ros.ros import topics
from pa_ros.ros.peers import SILENT_S
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
from pa_ros.wire.signing import Signer
from pa_ros.wire.step import decode_command, encode_command
from pa_ros.world import Trajectory

RELAY_S: Final = 4.0  # that the relay changes messages
TIMES: Final = 5  # that a forged message is sent
AHEAD: Final = 10**6  # of a real agent's sequence number
LAST: Final = 2**64 - 1  # of all incarnations
Make = Callable[[Stage], Message]


def relay_faults() -> list[Fault]:
    """Each change on each relayed topic."""

    def change(name: str, what: str) -> Act:
        return lambda stage: stage.change_messages(name, what)

    return [
        Fault(f"{topic.name}: {SHARE:.0%} {what}", change(topic.name, what), change(topic.name, ""),
              RELAY_S, kind="relayed", silent="the protocol repairs it")
        for topic, _ in RELAYED for what in CHANGES
    ]  # fmt: skip


def stranger_faults() -> list[Fault]:
    """Messages that once did harm without a key; and any forged or replayed message with one."""
    without_key: list[tuple[str, Topic, Make]] = [
        ("a trajectory of a real agent, far ahead", topics.TRAJECTORIES, _far_ahead),
        ("a trajectory with 64 objects", topics.TRAJECTORIES, _crowded),
        ("a trajectory with numbers of 3e38", topics.TRAJECTORIES, _huge),
        ("a trajectory of a real agent that gave up a million", topics.TRAJECTORIES, _all_given_up),
        ("a trajectory of a real agent's last possible start", topics.TRAJECTORIES, _last_start),
        ("another arena_info", topics.ARENA_INFO, _arena),
        ("weights of nobody's run", topics.POLICY_WEIGHTS, _weights),
    ]
    with_key: list[tuple[str, Topic, Make]] = [
        ("a forged trajectory", topics.TRAJECTORIES, _far_ahead),
        ("a trajectory carried from another namespace", topics.TRAJECTORIES, _carried),
        ("features with a forged reward", topics.OBJECT_FEATURES, _rewarding_features),
        ("a forged command", topics.JOINT_COMMANDS, _command),
        ("a forged arena_info", topics.ARENA_INFO, _arena),
        ("forged weights", topics.POLICY_WEIGHTS, _weights),
        ("a forged learner_info", topics.LEARNER_INFO, _learner),
        ("a replayed trajectory", topics.TRAJECTORIES, lambda s: s.observer.last["trajectories"]),
        ("a replayed command", topics.JOINT_COMMANDS, lambda s: s.observer.last["joint_commands"]),
    ]
    while_waiting: list[tuple[str, Topic, Make]] = [
        ("arena_info with the real id", topics.ARENA_INFO, _short_arena),
        ("learner_info with the real id", topics.LEARNER_INFO, _worldless_learner),
    ]
    return [
        *(Fault(f"stranger: {name}", _send(topic, make), hold_s=2.0)
          for name, topic, make in without_key),
        *(Fault(f"stranger, while the learner is stopped: {name}", _send(topic, make, LEARNER),
                lambda stage: stage.signal(LEARNER, SIGCONT), hold_s=0.0)
          for name, topic, make in while_waiting),
        *(Fault(f"stranger, with a key: {name}", _send(topic, make), hold_s=2.0, kind="keyed")
          for name, topic, make in with_key),
    ]  # fmt: skip


def _send(topic: Topic, make: Make, stopped: str = "") -> Act:
    def send(stage: Stage) -> None:
        if stopped:
            stage.signal(stopped, SIGSTOP)
            stage.wait(1.5 * SILENT_S)
        publisher = topic.publisher(stage.node)
        try:
            # The observer subscribes too.
            if not stage.until(lambda: publisher.get_subscription_count() > 1, START_S):
                raise StageError(f"{topic.name}: expected a subscriber, got none")
            for _ in range(TIMES):
                publisher.publish(make(stage))
            stage.wait(1.0)
        finally:
            stage.node.destroy_publisher(publisher)

    return send


def _last_trajectory(stage: Stage) -> Trajectory:
    arena = stage.observer.arena
    if arena is None:
        raise StageError("arena_info: expected one before this fault, got none")
    return decode_trajectory(stage.observer.last["trajectories"], arena.world)


def _first(trajectory: Trajectory, **changes: Any) -> Trajectory:
    """The first one of another agent, or of another start."""
    return replace(trajectory, sequence=0, held_from=0, first_of_run=0, **changes)


def _forged(stage: Stage, trajectory: Trajectory) -> Message:
    stage.observer.forged.add(trajectory.key)
    return Message(encode_trajectory(trajectory))


def _far_ahead(stage: Stage) -> Message:
    real = _last_trajectory(stage)
    return _forged(stage, replace(real, sequence=real.sequence + AHEAD))


def _all_given_up(stage: Stage) -> Message:
    real = _last_trajectory(stage)
    number = real.sequence + AHEAD
    return _forged(stage, replace(real, sequence=number, held_from=number))


def _last_start(stage: Stage) -> Message:
    """Well-formed, so it is believed; but it must not bar the real agent."""
    return Message(encode_trajectory(_first(_last_trajectory(stage), incarnation=LAST)))


def _carried(stage: Stage) -> Message:
    """Signed with the right key, for another namespace."""
    message = _forged(stage, _first(_last_trajectory(stage), agent_id=STRANGER))
    return Signer(stage.key, "/elsewhere/agent_node", 1).sign("/elsewhere/trajectories", message)


def _crowded(stage: Stage) -> Message:
    real = _last_trajectory(stage)
    objects = np.repeat(real.objects[:, :1], 64, axis=1)
    return _forged(stage, _first(real, agent_id=STRANGER, objects=objects))


def _huge(stage: Stage) -> Message:
    real = _last_trajectory(stage)
    objects = np.full_like(real.objects, 3e38)
    return _forged(stage, _first(real, agent_id=STRANGER, incarnation=1, objects=objects))


def _short_arena(stage: Stage) -> Message:
    real = decode_arena_info(stage.observer.last["arena_info"])
    return Message(encode_arena_info(replace(real, episode_steps=1)))


def _worldless_learner(stage: Stage) -> Message:
    real = decode_learner_info(stage.observer.last["learner_info"])
    return Message(encode_learner_info(replace(real, world_digest="0" * 16)))


def _rewarding_features(stage: Stage) -> Message:
    """The next step, ahead of the arena, with another reward."""
    message: Any = stage.observer.last["object_features"]
    message.step, message.reward, message.signature = message.step + 1, 777.0, []
    return Message(message)


def _arena(stage: Stage) -> Message:
    real = decode_arena_info(stage.observer.last["arena_info"])
    strange = replace(real, arena_id=STRANGER, thresholds=(9.0,), control_period=7.0)
    return Message(encode_arena_info(strange))


def _weights(stage: Stage) -> Message:
    real = decode_weights(stage.observer.last["policy_weights"])
    wild = {name: np.full_like(tensor, 1e3) for name, tensor in real.snapshot.tensors.items()}
    snapshot = replace(real.snapshot, tensors=wild, version=real.snapshot.version + AHEAD)
    strange = replace(real, run_id=STRANGER, snapshot=snapshot, learner_id=STRANGER)
    return Message(encode_weights(strange))


def _learner(stage: Stage) -> Message:
    real = decode_learner_info(stage.observer.last["learner_info"])
    later = replace(real, learner_id=STRANGER, run_id=STRANGER, stamp_ns=real.stamp_ns + 10**9)
    return Message(encode_learner_info(later))


def _command(stage: Stage) -> Message:
    joints = len(stage.observer.positions[-1][1])
    real = decode_command(stage.observer.last["joint_commands"], joints)
    return Message(encode_command(replace(real, action=np.zeros(joints, np.float32))))
