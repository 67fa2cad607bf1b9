"""Logically equal programs: how differently does an agent act under them?

Over soft sets double negation, De Morgan, order and grouping hold exactly, so the agent must act
alike up to float precision. Idempotence, distribution and absorption hold if AND and OR are the
smaller and the greater degree. With products (x and x is x²) they hold only where detectors say 0
or 1, so the difference measures how crisp the detectors are (paper, eq. logic). The excluded middle
holds in neither.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np
import torch
from numpy.typing import NDArray

from pa_ros.agents import TrainedAgent
from pa_ros.arena import play
from pa_ros.core.experience import Observation
from pa_ros.evaluation.evaluate import EPISODES_SEED
from pa_ros.language import LOGICS, MIN_MAX, And, Expression, Not, Or, Program, Word
from pa_ros.language.flat import Compiled
from pa_ros.networks.config import actor_config
from pa_ros.networks.relevance import program_tensors, relevant_objects
from pa_ros.networks.torch_actor import TorchActor
from pa_ros.perception import task_seen
from pa_ros.world.programs import ProgramTable

CONDITIONS = ("eval", "depth-3")
"""Conditions of the scenes, and of the programs that the laws are applied to."""

Pair = tuple[Expression, Expression]


@dataclass(frozen=True)
class Law:
    """Two equal expressions made of `e`, which names a block of color c and shape s."""

    name: str
    exact: frozenset[str]  # names of the logics in which it holds over soft sets too
    pair: Callable[[Expression, Word, Word], Pair]


_EVERY, _LATTICE, _NONE = frozenset(LOGICS), frozenset({MIN_MAX.name}), frozenset[str]()

LAWS = (
    Law("double negation", _EVERY, lambda e, c, s: (e, Not(Not(e)))),
    Law("De Morgan", _EVERY, lambda e, c, s: (e, de_morgan(e))),
    Law("commuted", _EVERY, lambda e, c, s: (e, commuted(e))),
    Law("associated AND", _EVERY, lambda e, c, s: (And((And((e, c)), s)), And((e, And((c, s)))))),
    Law("associated OR", _EVERY, lambda e, c, s: _associated_or(e, And((e, c)), And((e, s)))),
    Law("idempotent AND", _LATTICE, lambda e, c, s: (e, And((e, e)))),
    Law("idempotent OR", _LATTICE, lambda e, c, s: (e, Or((e, e)))),
    Law("distributive AND", _LATTICE, lambda e, c, s: _distributive(And, Or, e, c, s)),
    Law("distributive OR", _LATTICE, lambda e, c, s: _distributive(Or, And, e, c, s)),
    Law("absorption", _LATTICE, lambda e, c, s: (e, Or((e, And((e, c)))))),
    Law("excluded middle", _NONE, lambda e, c, s: (e, Or((e, And((c, Not(c))))))),
)


def de_morgan(expression: Expression) -> Expression:
    """The expression with every AND written as NOT OR NOT, and every OR as NOT AND NOT."""
    match expression:
        case Word():
            return expression
        case Not(operand):
            return Not(de_morgan(operand))
        case And(operands):
            return Not(Or(tuple(Not(de_morgan(operand)) for operand in operands)))
        case Or(operands):
            return Not(And(tuple(Not(de_morgan(operand)) for operand in operands)))


def commuted(expression: Expression) -> Expression:
    """The expression with all operands in reverse order."""
    match expression:
        case Word():
            return expression
        case Not(operand):
            return Not(commuted(operand))
        case And(operands):
            return And(tuple(commuted(operand) for operand in reversed(operands)))
        case Or(operands):
            return Or(tuple(commuted(operand) for operand in reversed(operands)))


def _associated_or(x: Expression, y: Expression, z: Expression) -> Pair:
    return Or((Or((x, y)), z)), Or((x, Or((y, z))))


def _distributive(
    outer: type[And] | type[Or], inner: type[And] | type[Or], x: Expression, y: Word, z: Word
) -> Pair:
    return outer((x, inner((y, z)))), inner((outer((x, y)), outer((x, z))))


@dataclass(frozen=True, slots=True)
class Difference:
    """The largest differences between the two programs of a law, over one seed's episodes.

    p and action are compared at every observation of the episodes in which the agent executes the
    left program; scores are the rewards per step of executing either.
    """

    seed: int
    law: str
    exact: bool
    condition: str
    episodes: int
    p: float
    action: float  # of any joint, in [0, 2]
    score: float
    mean_score: float  # mean difference, right minus left


class _Comparison:
    """One agent on one task."""

    def __init__(self, agent: TrainedAgent) -> None:
        network = actor_config(agent.snapshot.architecture)
        self._logic = agent.logic
        self._act = agent.policy
        self._limits = np.array(agent.arena.joint_speed_limits)
        self._world, self._vocabulary = network.world, network.vocabulary
        self._inference = TorchActor(network, agent.snapshot.tensors, agent.logic)
        self._task = task_seen(agent.arena, agent.design, EPISODES_SEED, agent.perception)

    def measure(self, law: Law, condition: str, index: int) -> tuple[float, float, float]:
        """An episode's largest differences of p and of the action; right minus left score."""
        task = self._task
        task.reset(index, condition)
        # The laws need a color and a shape that are true of the target.
        (target,) = task.verifier.targets
        kind = task.episode.blocks[target - 1].kind
        values = [Word(value) for value in kind.values()]
        sides = law.pair(task.program.target, values[0], values[-1])
        left, right = map(Program, sides)
        seen, score = self._execute(left)
        _, other_score = self._execute(right)
        p = self._relevance(seen, left, right)  # [T, 2, N]
        actions = np.array([[self._act(o, side) for side in (left, right)] for o in seen])
        actions /= self._limits  # [T, 2, J]
        return (
            float(np.abs(p[:, 0] - p[:, 1]).max()),
            float(np.abs(actions[:, 0] - actions[:, 1]).max()),
            other_score - score,
        )

    def _execute(self, program: Program) -> tuple[list[Observation], float]:
        """Execute a program in the task's current episode, from its start."""
        self._task.reset_to(self._task.episode)
        start = self._task.set_program(program)
        steps = [*play(self._task, lambda seen: self._act(seen, program), start)]
        rewards = [verdict.reward for _, verdict in steps[1:]]
        return [seen for seen, _ in steps], sum(rewards) / len(rewards)

    def _relevance(self, seen: list[Observation], *programs: Program) -> NDArray[np.float32]:
        """p of each program at each observation in float32, as the networks compute it."""
        table = ProgramTable(self._vocabulary, programs)
        arms = map(self._world.arm, seen)
        scenes = zip(seen, arms, strict=True)
        phi = np.stack([self._inference.properties(o.objects, arm) for o, arm in scenes])
        fields = (field.expand(len(seen), *field.shape) for field in program_tensors(table))
        hand = seen[0].hand_index
        p = relevant_objects(torch.from_numpy(phi), hand, Compiled(*fields), self._logic)
        return np.asarray(p.numpy())


def difference_table(agents: Mapping[int, TrainedAgent], episodes: int) -> list[Difference]:
    """A row for each programmable agent (by seed), each of CONDITIONS and each law."""
    rows = []
    for seed, agent in agents.items():
        comparison = _Comparison(agent)
        for condition, law in product(CONDITIONS, LAWS):
            found = np.array(
                [comparison.measure(law, condition, index) for index in range(episodes)]
            )  # [E, 3]
            p, action, score = (float(value) for value in np.abs(found).max(axis=0))
            mean = float(found[:, 2].mean())
            figures = condition, episodes, p, action, score, mean
            rows.append(Difference(seed, law.name, agent.logic.name in law.exact, *figures))
    return rows
