"""Episodes of a recording, step by step, from the arena's topics or from transitions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pa_ros.bags.errors import BagError
from pa_ros.bags.experience import TRAJECTORIES, recorded_world
from pa_ros.bags.reader import Bag
from pa_ros.core.experience import Float32, Float64, Observation, Step
from pa_ros.wire.learning import decode_trajectory
from pa_ros.wire.step import Command, decode_command, decode_step
from pa_ros.world import Trajectory

FEATURES: Final = "msgs_schema/msg/ObjectFeatures"
COMMAND: Final = "msgs_schema/msg/JointCommand"
_COMPLETE_AFTER: Final = 20  # rows of the next episode: by then all of the one before has arrived


@dataclass
class Row:
    """A recorded control step, and the action that answered it."""

    step: Step
    reward: float  # of the step's state; NaN: not recorded
    action: Float32 = field(default_factory=lambda: np.empty(0, np.float32))  # [J]; []: none
    policy_version: int = -1  # of the weights that chose the action; -1: not recorded

    @property
    def seen(self) -> Observation:
        """What was observed."""
        return self.step.observation

    @property
    def distance(self) -> float:
        """To the nearest object that the program names (m); NaN: nobody judged the step."""
        return self.step.verdict.distance if self.step.verdict is not None else np.nan


@dataclass
class RecordedEpisode:
    """The recording of one episode."""

    number: int
    evaluation: bool
    rows: list[Row] = field(default_factory=list)

    @property
    def rewards(self) -> Float64:
        """Recorded rewards of the steps taken: all rows but the first."""
        values = np.array([row.reward for row in self.rows if row.seen.step > 0])
        return values[~np.isnan(values)] if len(values) else values

    @property
    def missing(self) -> int:
        """Control steps between the first and the last that are not recorded."""
        steps = [row.seen.step for row in self.rows]
        return steps[-1] - steps[0] + 1 - len(set(steps)) if steps else 0

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The rows as arrays by name; the first axis is the row. Units: docs/tools.md."""
        rows, seen = self.rows, [row.seen for row in self.rows]
        stamps = [one.stamp_ns / 1e9 if one.stamp_ns >= 0 else np.nan for one in seen]
        return {
            "step": np.array([one.step for one in seen]),
            "stamp_s": np.array(stamps),
            "objects": padded(rows, max(len(one.objects) for one in seen), np.nan),
            "joint_position": np.stack([one.joint_position for one in seen]),
            "joint_velocity": np.stack([one.joint_velocity for one in seen]),
            "action": _stacked([row.action for row in rows]),
            "policy_version": np.array([row.policy_version for row in rows]),
            "reward": np.array([row.reward for row in rows]),
            "distance": np.array([row.distance for row in rows]),
            "stage": np.array([row.step.stage for row in rows]),
            "program": np.array([row.step.program for row in rows]),
        }  # fmt: skip


def padded(rows: Sequence[Row], count: int, fill: float) -> Float32:
    """The rows' objects as [T, count, F], with `fill` where a row has fewer of them."""
    objects = np.full((len(rows), count, rows[0].seen.objects.shape[1]), fill, np.float32)
    for into, row in zip(objects, rows, strict=True):
        into[: len(row.seen.objects)] = row.seen.objects
    return objects


def _stacked(rows: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Rows as one array [T, J]; NaN for rows that are empty."""
    width = max(map(len, rows))
    return np.stack([row if len(row) else np.full(width, np.nan, row.dtype) for row in rows])


def episodes(bag: Bag, namespace: str | None = None) -> Iterator[RecordedEpisode]:
    """The episodes in recorded order; from transitions if the steps are not recorded.

    Raises BagError (code bag.foreign) if the bag has neither.
    """
    if FEATURES in bag.types.values():
        return _from_steps(bag, namespace)
    if TRAJECTORIES in bag.types.values():
        return _from_transitions(bag, namespace)
    raise BagError(
        f"bag: {bag.path}: expected topics of type {FEATURES} or {TRAJECTORIES}, got "
        f"{', '.join(sorted(set(bag.types.values()))) or 'no topics'}",
        code="bag.foreign",
    )


def _from_transitions(bag: Bag, namespace: str | None) -> Iterator[RecordedEpisode]:
    open_: dict[str, RecordedEpisode] = {}  # by agent
    world = recorded_world(bag, namespace)
    decode = partial(decode_trajectory, world=world)
    for trajectory in bag.decoded([bag.topic_of(TRAJECTORIES, namespace)], decode):
        episode = open_.get(trajectory.agent_id)
        continues = (
            episode is not None
            and episode.number == trajectory.episode
            and episode.rows[-1].seen.step == trajectory.first_step
        )
        if episode is None or not continues:
            if episode is not None:
                yield episode
            episode = RecordedEpisode(
                trajectory.episode, False, [_row(trajectory, 0, world.joints)]
            )
            open_[trajectory.agent_id] = episode
        for t in range(len(trajectory)):
            before = episode.rows[-1]
            before.action, before.policy_version = trajectory.actions[t], trajectory.policy_version
            episode.rows.append(_row(trajectory, t + 1, world.joints))
    yield from open_.values()


def _row(trajectory: Trajectory, t: int, joints: int) -> Row:
    """The state before transition `t`. Transitions tell neither its time, -1, nor the hand's pose,
    zeros."""
    arm = trajectory.arm[t][: 3 * joints].astype(np.float64)
    sine, cosine, velocity = np.split(arm, 3)
    seen = Observation(
        episode=trajectory.episode,
        step=trajectory.first_step + t,
        stamp_ns=-1,
        objects=trajectory.objects[t],
        joint_position=np.arctan2(sine, cosine),
        joint_velocity=velocity,
        hand_index=trajectory.hand_index,
        program_id="",
        hand_pose=np.zeros(7),
    )
    reward = float(trajectory.rewards[t - 1]) if t else np.nan
    return Row(Step(seen, program=str(trajectory.program)), reward)


def _from_steps(bag: Bag, namespace: str | None) -> Iterator[RecordedEpisode]:
    builder = _Builder()
    recorded_types = [t for t in (FEATURES, COMMAND) if t in bag.types.values()]
    for recorded in bag.messages([bag.topic_of(t, namespace) for t in recorded_types]):
        message = bag.deserialize(recorded)
        if recorded.type_name == FEATURES:
            builder.add_step(decode_step(message))
        else:
            builder.add_command(decode_command(message))
        yield from builder.finished(_COMPLETE_AFTER)
    yield from builder.finished(0)


class _Builder:
    """Collects the steps of episodes, and the commands that answer them, in any order."""

    def __init__(self) -> None:
        self._open: list[RecordedEpisode] = []  # the newest last
        self._rows: dict[int, Row] = {}  # of the open episodes, by stamp
        self._early: dict[int, Command] = {}  # arrived before the step that they answer

    def add_step(self, step: Step) -> None:
        seen = step.observation
        if seen.stamp_ns in self._rows:
            return  # the arena repeated an observation that nobody answered
        newest = self._open[-1] if self._open else None
        same = newest is not None and (newest.number, newest.evaluation) == (
            seen.episode,
            step.evaluation,
        )
        # An arena that is reset to the same episode counts its steps from 0 again.
        if newest is None or not same or seen.step <= newest.rows[-1].seen.step:
            newest = RecordedEpisode(seen.episode, step.evaluation)
            self._open.append(newest)
        row = Row(step, step.verdict.reward if step.verdict is not None else np.nan)
        newest.rows.append(row)
        self._rows[seen.stamp_ns] = row
        if seen.stamp_ns in self._early:
            self.add_command(self._early.pop(seen.stamp_ns))

    def add_command(self, command: Command) -> None:
        row = self._rows.get(command.stamp_ns)
        if row is not None:
            row.action, row.policy_version = command.action, command.policy_version
            return
        self._early[command.stamp_ns] = command
        while len(self._early) > 10 * _COMPLETE_AFTER:  # their steps are not recorded
            self._early.pop(next(iter(self._early)))

    def finished(self, rows_after: int) -> Iterator[RecordedEpisode]:
        """Yield the episodes whose successor has so many rows; with 0, all that are left."""
        while self._open and (
            not rows_after or len(self._open) > 1 and len(self._open[1].rows) >= rows_after
        ):
            episode = self._open.pop(0)
            for row in episode.rows:
                self._rows.pop(row.seen.stamp_ns, None)
            yield episode
