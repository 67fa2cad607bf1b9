"""Judge an actor's detectors: a table by word, and the best and the worst scenes.

(paper, figure 6 right and appendix "Detector visualizations")
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pa_ros.acting.insight import Insight
from pa_ros.agents import TrainedAgent
from pa_ros.arena import Design, Episode, ReachTask, conditions_for, play
from pa_ros.arena.drawn_programs import novel
from pa_ros.core.experience import Float32, Observation, Verdict
from pa_ros.evaluation.evaluate import EPISODES_SEED, pursuing
from pa_ros.language import Logic, parse, relevance, satisfying
from pa_ros.perception import task_seen
from pa_ros.world.poses import POSE_WIDTH, in_base

KNOWN, UNSEEN = "eval", "reach-new-both"
"""Conditions of the scenes; the second one, if the design has it, shows new properties."""

EVERY = 20  # control steps between the observations that are judged
FOUND_M = 0.03  # an object that a camera found is the block so near to it


@dataclass(frozen=True)
class DetectorLook:
    """Φ and p at one step of one episode under its program."""

    episode: Episode
    step: int
    targets: tuple[int, ...]  # objects that the program names
    words: tuple[str, ...]
    phi: Float32  # [V, N]
    logic: Logic  # by which the agent acts; Φ is sharpened for it
    p: NDArray[np.float64]  # [N]
    observation: Observation

    @property
    def margin(self) -> float:
        """p of the least relevant target minus p of the most relevant distractor, in [-1, 1]."""
        others = [i for i in range(1, len(self.p)) if i not in self.targets]
        highest = max((float(self.p[i]) for i in others), default=0.0)
        return min(float(self.p[i]) for i in self.targets) - highest


class DetectorView:
    """Φ of a trained agent, along the episodes in which it acts.

    Of an agent that sees, observations count in which all blocks were found.
    Raises ConfigError for an agent without detectors.
    """

    def __init__(self, agent: TrainedAgent) -> None:
        self._agent, self._insight = agent, Insight(agent.snapshot, agent.logic)
        self._task = task_seen(agent.arena, agent.design, EPISODES_SEED, agent.perception)

    def looks(self, condition: str, episodes: int) -> Iterator[DetectorLook]:
        """Yield a look every EVERY steps of episodes 0 … `episodes` − 1 of a condition."""
        for index in range(episodes):
            for observation, _ in self._play(self._task.reset(index, condition)):
                rows = self._rows(observation) if observation.step % EVERY == 0 else None
                if rows is not None:
                    yield self._look(replace(observation, objects=observation.objects[rows]))

    def show(self, look: DetectorLook) -> ReachTask:
        """The arena at the step of a look, for a picture; valid until the next call."""
        # The same actions from the same start lead to the same step: pictures need not be kept.
        for observation, _ in self._play(self._task.reset_to(look.episode)):
            if observation.step == look.step:
                break
        return self._task

    def _play(self, start: tuple[Observation, Verdict]) -> Iterator[tuple[Observation, Verdict]]:
        return play(self._task, pursuing(self._task, self._agent.policy), start)

    def _rows(self, observation: Observation) -> NDArray[np.intp] | None:
        """The rows of the hand and of each block; None if a block has none."""
        poses = observation.objects[1:, :POSE_WIDTH].astype(np.float64)
        places = in_base(observation.hand_pose, poses)[:, :2]
        true = self._task.simulation.positions[1:, :2]
        apart = np.linalg.norm(true[:, None] - places, axis=-1)
        found = apart.shape[1] > 0 and (apart.min(1) < FOUND_M).all()
        return np.concatenate([[0], 1 + apart.argmin(1)]) if found else None

    def _look(self, observation: Observation) -> DetectorLook:
        task, logic = self._task, self._agent.logic
        found = self._insight.explain(observation, task.program)
        when, targets = (task.episode, observation.step), task.verifier.targets
        return DetectorLook(*when, targets, found.words, found.phi, logic, found.p, observation)


@dataclass(frozen=True, slots=True)
class Accuracy:
    """How well one seed's detectors know one word, over all looks of a condition's episodes.

    Only looks count in which a block has the property. `right`: share of blocks whose degree is on
    the right side of one half. `separated`: share of looks in which every block with the property
    has a higher degree than every block without.
    """

    seed: int
    condition: str
    word: str
    seen: bool  # in training
    looks: int
    on: float  # mean degree of the blocks that have the property
    best_distractor: float  # mean over looks of the highest degree of the other blocks
    right: float
    separated: float


def accuracies(
    seed: int, design: Design, condition: str, looks: Sequence[DetectorLook]
) -> list[Accuracy]:
    """A row for each word of the design, and for "new shape" and "new color" if they occur.

    A new property is judged by the program that names it (appendix, exclusion or inclusion).
    """
    rows = []
    for word, expression, true_of in _properties(design):
        degrees = [_degrees(look, expression, design) for look in looks]
        truths = [
            np.array([bool(true_of & block.kind.words) for block in look.episode.blocks])
            for look in looks
        ]
        present = [(d, t) for d, t in zip(degrees, truths, strict=True) if t.any()]
        if present:
            seen = word in design.words
            rows.append(Accuracy(seed, condition, word, seen, len(present), *_judged(present)))
    return rows


def _properties(design: Design) -> list[tuple[str, str, frozenset[str]]]:
    """Name, expression, and the true words of the blocks for which it should be high."""
    found = [(word, word, frozenset({word})) for word in design.words]
    for group in design.schema.slices:
        spare, new = design.spare(group), design.novel.get(group)
        if spare and new:
            known = novel(design.values[group], spare)
            found.append((f"new {group}", known, frozenset({new})))
    return found


def _degrees(look: DetectorLook, expression: str, design: Design) -> NDArray[np.float64]:
    """Degree of an expression for each block, [N - 1], by the logic that the agent acts by.

    The hand is object 0.
    """
    program = parse(f"{design.vocabulary.relations[0]}(HAND, {expression})", design.vocabulary)
    row, logic = design.vocabulary.row, look.logic
    return np.array(relevance(program, look.phi.tolist(), row, 0, logic)[1:])


def _judged(
    looks: Sequence[tuple[NDArray[np.float64], NDArray[np.bool_]]],
) -> tuple[float, float, float, float]:
    on = np.concatenate([degree[true] for degree, true in looks])
    worst = np.array([degree[true].min() for degree, true in looks])
    rivals = np.array([degree[~true].max(initial=0.0) for degree, true in looks])
    right = np.concatenate([(degree > 0.5) == true for degree, true in looks])
    means = (on.mean(), rivals.mean(), right.mean(), (worst > rivals).mean())
    on_mean, rival_mean, right_share, separated = map(float, means)
    return on_mean, rival_mean, right_share, separated


def extremes(looks: Sequence[DetectorLook]) -> tuple[DetectorLook, DetectorLook]:
    """The looks with the greatest and the least margin; the earliest of equals."""
    return max(looks, key=lambda look: look.margin), min(looks, key=lambda look: look.margin)


def detector_conditions(design: Design) -> tuple[str, ...]:
    """KNOWN (or `train`, if nothing is held out), and UNSEEN if the design has it."""
    known = KNOWN if design.held_out else "train"
    return (known, UNSEEN) if UNSEEN in conditions_for(design) else (known,)


def detector_table(agents: Mapping[int, TrainedAgent], episodes: int) -> list[Accuracy]:
    """Accuracies of every agent (by seed) under `detector_conditions`."""
    return [
        row
        for seed, agent in agents.items()
        for condition in detector_conditions(agent.design)
        for row in accuracies(
            seed, agent.design, condition, list(DetectorView(agent).looks(condition, episodes))
        )
    ]


def named(look: DetectorLook) -> str:
    """The blocks that a look's program names, for a caption."""
    kinds = [block.kind for block in look.episode.blocks]
    flags = satisfying(look.episode.program, [kind.words for kind in kinds], None)
    return " and ".join(str(kind).lower() for kind, flag in zip(kinds, flags, strict=True) if flag)
