"""Episodes of a recording, step by step, from the arena's topics or from transitions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pa_ros.bags.errors import ForeignBagError
from pa_ros.bags.experience import ARENA_INFO, TRAJECTORIES, recorded_world
from pa_ros.bags.reader import Bag
from pa_ros.core.errors import PaError
from pa_ros.core.experience import Float32, Float64
from pa_ros.wire import Message
from pa_ros.wire.arena import decode_arena_info
from pa_ros.wire.fields import header_stamp
from pa_ros.wire.learning import decode_trajectory
from pa_ros.wire.program import decode_program, decode_program_status
from pa_ros.wire.step import (
    decode_command,
    decode_hand_pose,
    decode_joints,
    decode_objects,
    decode_step_mark,
    decode_verdict,
)
from pa_ros.world import Trajectory
from pa_ros.world.schema import POSE

FEATURES: Final = "msgs_schema/msg/ObjectFeatures"
JOINT_STATES: Final = "sensor_msgs/msg/JointState"
VERDICT: Final = "msgs_schema/msg/Verdict"
COMMAND: Final = "msgs_schema/msg/JointCommand"
PROGRAM: Final = "msgs_schema/msg/Program"
PROGRAM_STATUS: Final = "msgs_schema/msg/ProgramStatus"
STEP_TYPES: Final = (FEATURES, JOINT_STATES, VERDICT, COMMAND, PROGRAM, PROGRAM_STATUS)
_SETTLED: Final = 20  # rows of the next episode after which nothing of the one before still comes


@dataclass
class Row:
    """One control step; NaN, or of the joints nothing, where the recording says nothing."""

    step: int
    stamp_ns: int  # simulation time; -1: not recorded
    objects: Float32  # [N, F], in the order of the world's schema
    hand_index: int
    program: str  # in force; its id where the text is not recorded
    joint_position: Float64 = field(default_factory=lambda: np.empty(0))  # [J] rad
    joint_velocity: Float64 = field(default_factory=lambda: np.empty(0))  # [J] rad/s
    action: Float32 = field(default_factory=lambda: np.empty(0, np.float32))  # [J]
    hand_pose: Float64 = field(default_factory=lambda: np.full(7, np.nan))  # in the base frame
    policy_version: int = -1  # of the weights that chose the action
    reward: float = float("nan")  # of this row's state
    distance: float = float("nan")  # m, to the nearest object that the program names

    @property
    def looks(self) -> bytes:
        """What tells scenes of other objects apart: their features but for the poses."""
        return np.ascontiguousarray(self.objects[:, len(POSE) :]).tobytes()


@dataclass
class RecordedEpisode:
    """What was recorded of one episode."""

    number: int
    evaluation: bool
    rows: list[Row] = field(default_factory=list)

    @property
    def rewards(self) -> Float64:
        """Rewards of the steps taken: those of all rows but the first, where recorded."""
        values = np.array([row.reward for row in self.rows if row.step > 0])
        return values[~np.isnan(values)] if len(values) else values

    @property
    def missing(self) -> int:
        """Control steps between the first and the last that are not recorded."""
        steps = [row.step for row in self.rows]
        return steps[-1] - steps[0] + 1 - len(set(steps)) if steps else 0

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Rows as arrays by name, the first axis being the row; see docs/bags.md for units."""
        rows = self.rows
        stamps = [row.stamp_ns / 1e9 if row.stamp_ns >= 0 else np.nan for row in rows]
        return {
            "step": np.array([row.step for row in rows]),
            "stamp_s": np.array(stamps),
            "objects": _padded([row.objects for row in rows]),
            "joint_position": _stacked([row.joint_position for row in rows]),
            "joint_velocity": _stacked([row.joint_velocity for row in rows]),
            "action": _stacked([row.action for row in rows]),
            "policy_version": np.array([row.policy_version for row in rows]),
            "reward": np.array([row.reward for row in rows]),
            "distance": np.array([row.distance for row in rows]),
            "program": np.array([row.program for row in rows]),
        }  # fmt: skip


def _padded(rows: Sequence[Float32]) -> Float32:
    """Objects of each row as one array, [T, N, F] with the largest N; NaN where a row has fewer."""
    padded = np.full((len(rows), max(map(len, rows)), rows[0].shape[1]), np.nan, np.float32)
    for into, row in zip(padded, rows, strict=True):
        into[: len(row)] = row
    return padded


def _stacked(rows: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Rows as one array, [T, J]; NaN for those that are empty."""
    width = max(map(len, rows))
    return np.stack([row if len(row) else np.full(width, np.nan, row.dtype) for row in rows])


def episodes(bag: Bag, namespace: str | None = None) -> Iterator[RecordedEpisode]:
    """Episodes in the order of the recording; from transitions if the steps are not recorded.

    Raises ForeignBagError if the bag has neither.
    """
    if FEATURES in bag.types.values():
        return _from_steps(bag, namespace)
    if TRAJECTORIES in bag.types.values():
        return _from_transitions(bag, namespace)
    raise ForeignBagError(
        f"bag: {bag.path}: expected topics of type {FEATURES} or {TRAJECTORIES}, got "
        f"{', '.join(sorted(set(bag.types.values()))) or 'no topics'}"
    )


def _from_transitions(bag: Bag, namespace: str | None) -> Iterator[RecordedEpisode]:
    open_: dict[str, RecordedEpisode] = {}  # by agent
    world = recorded_world(bag, namespace)
    decode = partial(decode_trajectory, world=world)
    for recorded in bag.messages([bag.topic_of(TRAJECTORIES, namespace)]):
        trajectory = bag.through(recorded, decode)
        episode = open_.get(trajectory.agent_id)
        if episode is None or not _continues(episode, trajectory):
            if episode is not None:
                yield episode
            episode = open_[trajectory.agent_id] = RecordedEpisode(trajectory.episode, False)
        _extend(episode, trajectory)
    yield from open_.values()


def _continues(episode: RecordedEpisode, trajectory: Trajectory) -> bool:
    return episode.number == trajectory.episode and episode.rows[-1].step == trajectory.first_step


def _extend(episode: RecordedEpisode, trajectory: Trajectory) -> None:
    if not episode.rows:
        episode.rows.append(_row(trajectory, 0))
    for t in range(len(trajectory)):
        before = episode.rows[-1]
        before.action, before.policy_version = trajectory.actions[t], trajectory.policy_version
        following = _row(trajectory, t + 1)
        following.reward = float(trajectory.rewards[t])
        episode.rows.append(following)


def _row(trajectory: Trajectory, t: int) -> Row:
    joints = trajectory.arm[t][: 3 * trajectory.actions.shape[1]].astype(np.float64)
    sine, cosine, velocity = np.split(joints, 3)
    return Row(
        trajectory.first_step + t,
        -1,
        trajectory.objects[t],
        trajectory.hand_index,
        str(trajectory.program),
        np.arctan2(sine, cosine),
        velocity,
    )


def _from_steps(bag: Bag, namespace: str | None) -> Iterator[RecordedEpisode]:
    """Parts of a step come in any order; whatever comes of a step before its features waits."""
    builder = _Builder(_joint_names(bag, namespace))
    wanted = [bag.topic_of(t, namespace) for t in STEP_TYPES if t in bag.types.values()]
    for recorded in bag.messages(wanted):
        bag.through(recorded, partial(builder.take, recorded.type_name))
        yield from builder.finished(_SETTLED)
    yield from builder.finished(0)


class _Builder:
    def __init__(self, joint_names: tuple[str, ...]) -> None:
        self._joint_names = joint_names
        self._texts: dict[str, str] = {}  # of programs, by id
        self._open: list[RecordedEpisode] = []  # the newest last
        self._rows: dict[int, Row] = {}  # of the open ones, by stamp
        self._early: dict[int, list[tuple[str, Message]]] = {}

    def take(self, type_name: str, message: Message) -> None:
        if type_name == PROGRAM:
            request = decode_program(message)
            self._texts[request.program_id] = request.text
            return
        if type_name == PROGRAM_STATUS:  # a recorder that came late has the program from here
            judgement = decode_program_status(message)
            if judgement.accepted:
                self._texts.setdefault(judgement.program_id, judgement.canonical)
            return
        stamp_ns = header_stamp(message)
        if type_name == FEATURES:
            self._begin_row(stamp_ns, message)
            for kind, part in self._early.pop(stamp_ns, ()):
                self._fill(self._rows[stamp_ns], kind, part)
        elif stamp_ns in self._rows:
            self._fill(self._rows[stamp_ns], type_name, message)
        else:
            self._early.setdefault(stamp_ns, []).append((type_name, message))
            while len(self._early) > 10 * _SETTLED:
                self._early.pop(next(iter(self._early)))

    def finished(self, settled: int) -> Iterator[RecordedEpisode]:
        """Episodes that are over; with 0, all that are left."""
        while self._open and (
            not settled or len(self._open) > 1 and len(self._open[1].rows) >= settled
        ):
            episode = self._open.pop(0)
            for row in episode.rows:
                row.program = self._texts.get(row.program, row.program)
                self._rows.pop(row.stamp_ns, None)
            yield episode

    def _begin_row(self, stamp_ns: int, message: Message) -> None:
        if stamp_ns in self._rows:
            return  # sent again, because nobody answered
        newest = self._open[-1] if self._open else None
        mark = decode_step_mark(message)
        of = (mark.episode, mark.evaluation)
        again = newest is None or (newest.number, newest.evaluation) != of
        if newest is None or again or mark.step <= newest.rows[-1].step:
            newest = RecordedEpisode(*of)
            self._open.append(newest)
        program = mark.program or self._texts.get(mark.program_id, mark.program_id)
        row = Row(mark.step, stamp_ns, *decode_objects(message), program)
        row.hand_pose = decode_hand_pose(message)
        newest.rows.append(row)
        self._rows[stamp_ns] = row

    def _fill(self, row: Row, type_name: str, message: Message) -> None:
        if type_name == JOINT_STATES:
            joints = decode_joints(message, self._joint_names)
            row.joint_position, row.joint_velocity = joints
        elif type_name == VERDICT:
            verdict = decode_verdict(message)
            row.reward, row.distance = verdict.reward, verdict.distance
        else:
            command = decode_command(message)
            row.action, row.policy_version = command.action, command.policy_version


def _joint_names(bag: Bag, namespace: str | None) -> tuple[str, ...]:
    if ARENA_INFO not in bag.types.values():
        return ()
    for recorded in bag.messages([bag.topic_of(ARENA_INFO, namespace)]):
        try:
            return bag.through(recorded, decode_arena_info).joint_names
        except PaError:
            return ()
    return ()
