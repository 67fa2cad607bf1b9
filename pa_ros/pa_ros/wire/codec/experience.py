"""Stretches of experience (Transitions)."""

from __future__ import annotations

import numpy as np

from pa_ros.core.experience import ARM_FEATURES, JOINTS, OBJECT_FEATURES, Stretch
from pa_ros.wire import errors
from pa_ros.wire.arrays import float32_field, read_float32
from pa_ros.wire.codec.stamp import write_stamp
from pa_ros.wire.codec.step import objects_and_hand
from pa_ros.wire.interfaces import Transitions

MAX_TRANSITIONS = 10_000


def encode_transitions(stretch: Stretch, stamp_ns: int = 0) -> Transitions:
    """A stretch, `stamp_ns` being the simulation time of its first row."""
    message = Transitions()
    write_stamp(message.stamp, stamp_ns)
    message.agent_id = stretch.agent_id
    message.sequence = stretch.sequence
    message.policy_version = stretch.policy_version
    message.episode = stretch.episode
    message.first_step = stretch.first_step
    message.program = stretch.program
    message.vocabulary_digest = stretch.vocabulary_digest
    message.hand_index = stretch.hand_index
    message.transition_count = len(stretch)
    message.object_count = stretch.objects.shape[1]
    message.objects = float32_field(stretch.objects)
    message.arm = float32_field(stretch.arm)
    message.actions = float32_field(stretch.actions)
    message.rewards = float32_field(stretch.rewards)
    message.ends_episode = stretch.ends_episode
    message.terminated = stretch.terminated
    return message


def decode_transitions(message: Transitions, vocabulary_digest: str | None = None) -> Stretch:
    """A stretch, refused unless it is written in the vocabulary named (None: in any).

    Raises VocabularyError, RangeError, SizeError, NonFiniteError.
    """
    if vocabulary_digest not in (None, message.vocabulary_digest):
        field, received = "transitions.vocabulary_digest", message.vocabulary_digest
        raise errors.VocabularyError(field, vocabulary_digest, received)
    if not message.agent_id:
        raise errors.RangeError("transitions.agent_id", "a name", repr(message.agent_id))
    length = message.transition_count
    if not 1 <= length <= MAX_TRANSITIONS:
        raise errors.RangeError("transitions.transition_count", f"1 to {MAX_TRANSITIONS}", length)
    count, hand_index = objects_and_hand("transitions", message)
    actions = read_float32("transitions.actions", message.actions, (length, JOINTS))
    if np.abs(actions).max() > 1.0:
        raise errors.RangeError("transitions.actions", "[-1, 1]", np.abs(actions).max())
    rows = length + 1
    objects = (rows, count, OBJECT_FEATURES)
    return Stretch(
        agent_id=message.agent_id,
        sequence=message.sequence,
        policy_version=message.policy_version,
        episode=message.episode,
        first_step=message.first_step,
        program=message.program,
        hand_index=hand_index,
        objects=read_float32("transitions.objects", message.objects, objects),
        arm=read_float32("transitions.arm", message.arm, (rows, ARM_FEATURES)),
        actions=actions,
        rewards=read_float32("transitions.rewards", message.rewards, (length,)),
        ends_episode=message.ends_episode,
        terminated=message.terminated,
        vocabulary_digest=message.vocabulary_digest,
    )
