"""The rules of executing: which of several objects, how fast, and how far from what is avoided.

Networks are trained without these rules. They read what the networks say of each object
(`Policy.degrees`), which costs a fraction of an action, so they add little to a control step.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from itertools import chain
from math import atan2, dist, hypot
from typing import NamedTuple

import numpy as np

from pa_ros.acting.errors import ActingError
from pa_ros.acting.exploration import ExplorationNoise
from pa_ros.acting.policy import Degrees, Policy
from pa_ros.core.experience import Float32, Float64, Observation
from pa_ros.language import MIN_MAX, And, Logic, Not, Program
from pa_ros.language.syntax import HOLD, NEAR, ON
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.errors import NetworkError
from pa_ros.networks.inference import AVOIDED, MOVED, RELEVANT, TARGET
from pa_ros.world.comparisons import choose
from pa_ros.world.poses import POSE_WIDTH, in_base
from pa_ros.world.relation import (
    BLOCK_M,
    GRIP_M,
    HELD_LIMITS,
    NOT_HELD_M,
    ON_BESIDE_M,
    ON_HEIGHT_M,
    RELATIONS,
)
from pa_ros.world.scoring import REWARDED, Score, Scoring

# A program means every object whose degree is at least this share of the greatest degree; to choose
# one of them, the share is greater, since undecided words give about half a degree.
MEANT, SURELY = 0.5, 0.75
# Shares of a relation's threshold: pushing stops at the first, and is slowed up to the second. So
# is reaching with a gripper: networks often leave what they have reached. Actions that are joint
# velocities can move the hand faster, so they are slowed earlier.
SLOWED, JOINTS_SLOWED = (0.6, 1.2), (0.0, 3.0)
# What is to rest somewhere is brought there from above, as the empty hand is to what it takes.
FROM_ABOVE_M = 0.03  # over the highest object nearby, until the middle is reached
# Beside the middle: networks may stop before it. So from the first on the hand goes there by rule,
# and from the second on, or from anywhere with something in the hand, where networks would go there
# more slowly.
OVER_M, BESIDE_M = 0.06, 0.12
CENTERED_M = 0.006  # beside the middle: from here on it comes down
STILL = 0.1  # rad/s: it lets go when no joint is faster
LOWERING, LEAVING = 0.2, 0.3  # of full speed: coming down, and rising after it has let go
NEAR_M = 0.15  # sideways: what it must be above
TOUCHED_M = 0.06  # from where the hand would hold it: an object that it may touch
UP = 2  # of the axes of an action
UPWARD = np.array([0.0, 0.0, 1.0])
# Lengths where NEAR has its usual threshold; where it has another one, they are as much longer.
AVOIDED_WITHIN_M = 0.40  # of the hand: what is farther away is not avoided
# At this distance from the hand, an object to be avoided counts as much as the goal; nearer by the
# second length, it counts e times as much.
EQUAL_M, NEARNESS_M = 0.30, 0.02

Objects = Sequence[int]
"""Indices of objects of a scene."""


class _Forms(NamedTuple):
    """A program as networks take it."""

    program: Program
    plain: Program  # without comparisons
    heedless: Program  # without what it avoids, too
    compares: bool
    moves_hand: bool
    taking: Program  # of the hand, that holds what is to rest somewhere; plain

    @classmethod
    def of(cls, program: Program) -> _Forms:
        plain = program.sets_alone
        heedless = plain.relation_alone
        taking = Program(program.moved, HOLD)
        return cls(program, plain, heedless, program.compares, program.moves_hand, taking)


class Actor(Policy):
    """A policy that executes programs. Without `noise` it is greedy."""

    def __init__(
        self,
        network: NetworkConfig,
        inference: str = "auto",
        noise: ExplorationNoise | None = None,
        logic: Logic = MIN_MAX,
    ) -> None:
        super().__init__(network, inference, logic)
        self._noise = noise
        self._scoring = network.world.scoring
        self._longer = network.world.nearness
        self._slowed = SLOWED if network.world.controller else JOINTS_SLOWED
        # Whether the networks move the hand, and can take things with it.
        self._takes = HOLD in network.world.relations and network.world.controller is not None
        self._forms: _Forms | None = None  # of the newest program
        self._has_held = -1  # the newest episode in which the hand held something

    def act(self, observation: Observation, program: Program) -> Float32:
        """The greedy action, [J] in [-1, 1].

        Of the objects that the program means, the agent goes for the nearest two, or moves the hand
        to the nearest; networks alone would stop between them, since they sum over objects.

        Raises ProgramError for a word that the weights do not know, ActingError for objects or an
        arm of another size.
        """
        forms = self._forms_of(program)
        if not self.evaluates_programs:
            return self.infer(observation, forms.plain)
        degrees = self.degrees(observation, forms.plain)
        if program.avoided is not None:
            return self._avoid(observation, forms, degrees)
        chosen, others = self._choose(observation, forms, degrees)
        if self._puts(program) and all(chosen):
            return self._put(observation, forms, chosen, others)
        action = self.infer(observation, forms.plain, others)
        if not forms.moves_hand:
            return action * self._speed(observation, program, chosen)
        if self._takes and program.relation == NEAR:
            action[:-1] *= self._speed(observation, program, chosen)
        return action

    def explore(self, observation: Observation, program: Program) -> Float32:
        """The networks' action with this episode's exploration noise, clipped to [-1, 1], [J]."""
        if self._noise is None:
            raise ActingError("policy: expected exploration noise, got a greedy actor")
        forms, others = self._forms_of(program), set[int]()
        plain = forms.taking if self._explores_taking(observation, program) else forms.plain
        if program.compares:
            meant = _sets(self.degrees(observation, plain), MEANT)
            chosen = self._compared(observation, program, meant)
            others = _left_out(observation, meant, chosen)
        return self._noise.explore(self.infer(observation, plain, others), observation.episode)

    def _put(
        self, observation: Observation, forms: _Forms, chosen: Sequence[Objects], others: set[int]
    ) -> Float32:
        """The action that takes what is to rest somewhere, brings it there, puts it down on the
        middle, and leaves it alone once it rests there."""
        hand, (moved, *_), (under, *_) = observation.hand_pose, *chosen
        seen = in_base(hand, observation.objects[:, :POSE_WIDTH].astype(np.float64))
        rests = RELATIONS[ON].measure(seen[moved], seen[under], hand)
        away = RELATIONS[HOLD].measure(hand, seen)
        taken = bool(away[moved] <= self._scoring.threshold(HOLD))
        if rests <= self._scoring.threshold(ON) or _touches_another(observation, away, moved):
            action = np.zeros(self._world.actions, np.float32)
            action[UP], action[-1] = LEAVING, -1.0
            return action
        if observation.hand_pose[-1] > 0 and not taken:  # it holds another object
            return self._put_down(observation, seen[:, :3], away)
        action = self.infer(observation, forms.plain if taken else forms.taking, others)
        over = self._comes_from_above(
            action, taken, *_way(observation, seen[:, :3], moved, under if taken else None)
        )
        if taken:
            action[-1] = 1.0
        if taken and over and rests - HELD_LIMITS <= REWARDED:  # first stop, then let go
            moves = float(np.abs(observation.joint_velocity).max()) > STILL
            action[:-1], action[-1] = 0.0, 1.0 if moves else -1.0
        return action

    def _put_down(self, observation: Observation, seen: Float64, away: Float64) -> Float32:
        """The action that puts what the hand holds down where it is, on the table or on what is
        below, and lets it go. `away` [N] is how far each object is from being held, m."""
        away = away.copy()
        away[observation.hand_index] = np.inf
        held = int(away.argmin())
        below = np.hypot(*(seen - seen[held])[:, :UP].T) < BLOCK_M
        below[[held, observation.hand_index]] = False
        top = float(seen[below, UP].max(initial=-BLOCK_M / 2))  # middle of what it comes to rest on
        action = np.zeros(self._world.actions, np.float32)
        if seen[held, UP] - top > BLOCK_M + ON_HEIGHT_M:
            action[UP], action[-1] = -LOWERING, 1.0
        else:
            action[-1] = -1.0
        return action

    def _comes_from_above(
        self, action: Float32, carries: bool, way: Float64, above: float, above_all: float
    ) -> bool:
        """Change an action so that it goes a `way` (m, [2], outward and around the base) to the
        middle of something and then down, `above` (m) what is near; whether it is over the
        middle. `above_all`: also above the end of the way, if it carries something there."""
        controller = self._world.controller
        assert controller is not None
        step = controller.hand_speed * controller.period_s  # m, at full speed
        beside = hypot(*way)
        if above < FROM_ABOVE_M / 2 and beside > ON_BESIDE_M:  # so low that it would push or drag
            action[:UP] = 0.0
        else:
            # Half of the way in a step, so that an arm that is a step late does not swing.
            there = way / max(2 * step, beside / LOWERING)
            slower = action[:UP] @ way < there @ way
            if beside <= OVER_M or slower and (carries or beside <= BESIDE_M):
                action[:UP] = there
        over = beside <= CENTERED_M
        rising = min((FROM_ABOVE_M - above_all) / step, 1.0)
        action[UP] = -LOWERING if over else max(action[UP], rising)
        return over

    def _explores_taking(self, observation: Observation, program: Program) -> bool:
        """Whether exploring begins with taking: until the hand has held something in this episode.
        Agents learn to take long before they put anything anywhere (RHER, Luo et al. 2023)."""
        if observation.hand_pose[-1] > 0:
            self._has_held = observation.episode
        return self._puts(program) and self._has_held != observation.episode

    def _puts(self, program: Program) -> bool:
        """Whether a program puts something somewhere, and the networks can take it."""
        return program.relation == ON and self._takes

    def relevance(self, observation: Observation, program: Program) -> tuple[float, ...]:
        """p, [N]: the degree to which the program means each object.

        Empty before there are weights, or for networks without degrees. Raises what `act` raises.
        """
        if self._version is None or not self.evaluates_programs:
            return ()
        degrees = self.degrees(observation, self._forms_of(program).heedless)
        p = degrees[RELEVANT]
        if program.compares:
            meant = _sets(degrees, MEANT)
            left_out = {*chain(*meant)}.difference(*self._compared(observation, program, meant))
            p = [0.0 if i in left_out else one for i, one in enumerate(p)]
        return tuple(p)

    def judge(self, observation: Observation, scoring: Scoring) -> Callable[[Program], Score]:
        """Scores of a state by the agent's own judgement: programs mean the objects to which they
        give at least half of the greatest degree.

        Raises NetworkError for networks without degrees, and what `act` raises.
        """
        self._need_degrees()

        def score(program: Program) -> Score:
            degrees = self.degrees(observation, program.sets_alone.relation_alone)
            sets = self._compared(observation, program, _sets(degrees, MEANT))
            return scoring.of_program(program, sets, observation.objects, observation.hand_pose)

        return score

    def _avoid(self, observation: Observation, forms: _Forms, degrees: Degrees) -> Float32:
        """The action under a program that avoids a set. Networks learn to avoid one object, and
        keep farther away than they must. So the action that avoids nothing and those that avoid one
        near object each are averaged, the nearest objects most.
        """
        program, avoided = forms.program, forms.program.avoided
        assert avoided is not None
        to_avoid = {*_meant(degrees[AVOIDED], MEANT)}
        targets = {*self._compared(observation, program, _sets(degrees, MEANT))[1]}
        if targets & to_avoid and not targets <= to_avoid and not program.compares:
            # Go for the targets that need not be avoided.
            forms = _Forms.of(replace(program, target=And((program.target, Not(avoided)))))
            degrees = self.degrees(observation, forms.plain)
            targets = {*_sets(degrees, MEANT)[1]}
        to_avoid -= targets
        places = observation.objects[:, :3].tolist()  # in the frame of the hand
        distance = {i: hypot(*places[i]) for i in sorted(to_avoid)}
        near = [i for i, metres in distance.items() if metres < AVOIDED_WITHIN_M * self._longer]
        _, others = self._choose(observation, forms, degrees, to_avoid)
        heedless = self.infer(observation, forms.heedless, others | to_avoid)
        if not near:
            return heedless
        actions = [self.infer(observation, forms.plain, to_avoid - {i}) for i in near]
        distances = np.array([EQUAL_M * self._longer, *(distance[i] for i in near)])
        weight = np.exp((distances.min() - distances) / (NEARNESS_M * self._longer))
        return np.asarray(weight / weight.sum() @ np.stack([heedless, *actions]), np.float32)

    def _choose(
        self,
        observation: Observation,
        forms: _Forms,
        degrees: Degrees,
        hidden: Collection[int] = (),
    ) -> tuple[Sequence[Objects], set[int]]:
        """The object of each set that the agent goes for, and what networks are not to see: the
        others that the program means. Neither contains a `hidden` object."""
        least = MEANT if forms.compares else SURELY
        targets = _meant(degrees[TARGET], least, hidden)
        hand = [observation.hand_index]
        moved = hand if forms.moves_hand else _meant(degrees[MOVED], least, hidden)
        meant = moved, targets
        if len(moved) == len(targets) == 1:  # nothing to choose, as in most scenes
            return meant, set()
        chosen = self._compared(observation, forms.program, meant)
        chosen = _nearest_two(chosen, observation.objects)
        return chosen, _left_out(observation, meant, chosen)

    def _compared(
        self, observation: Observation, program: Program, sets: Sequence[Objects]
    ) -> Sequence[Objects]:
        """The objects that a program's comparisons choose from its two sets."""
        if not program.compares:
            return sets
        objects, pose, schema = observation.objects, observation.hand_pose, self._world.schema
        return [
            choose(comparison, one, objects, pose, schema)
            for comparison, one in zip(program.chosen, sets, strict=True)
        ]

    def _speed(
        self, observation: Observation, program: Program, chosen: Sequence[Objects]
    ) -> np.float32:
        """The part of full speed at which an object is moved: less and less as the relation begins
        to hold, so that the object is not pushed on, and spheres do not roll away."""
        seen, pose = observation.objects, observation.hand_pose
        measure = self._scoring.of_program(program, chosen, seen, pose).measure
        part = measure / self._scoring.threshold_of(program)
        stopped, full = self._slowed
        return np.float32(min(max((part - stopped) / (full - stopped), 0.0), 1.0))

    def _forms_of(self, program: Program) -> _Forms:
        if self._forms is None or self._forms.program is not program:
            if program.compares:
                self._need_degrees()
            self._forms = _Forms.of(program)
        return self._forms

    def _need_degrees(self) -> None:
        if not self.evaluates_programs:
            raise NetworkError(
                f"{self.network.family} networks: expected a verifier and no comparison, since "
                "they don't say which objects a program means",
                code="networks.unsupported_program",
            )


def _way(
    observation: Observation, seen: Float64, moved: int, under: int | None
) -> tuple[Float64, float, float]:
    """How far the hand has to go outward and around the base to be over an object that it is to
    take, or with it over what is to be `under` it, m [2]. How far above the highest object
    near it this is, m; infinite if none is near. And how far above those and what is to be under
    it, m, also if that is not near. `seen` [N, 3] are places, m."""
    hand = observation.hand_pose
    at, to = (hand[:3] - GRIP_M * UPWARD, seen[moved]) if under is None else seen[[moved, under]]
    (x, y), (u, v) = at[:UP], to[:UP]
    turn = atan2(x * v - y * u, x * u + y * v)  # around the base
    near = np.hypot(*(seen - at)[:, :UP].T) < NEAR_M
    near[observation.hand_index] = False
    above = at[UP] - seen[:, UP]
    if under is not None:
        near[moved] = False
        above -= BLOCK_M
    nearest = float(above[near].min(initial=np.inf))
    all_above = nearest if under is None else min(nearest, float(above[under]))
    way = np.array([hypot(u, v) - hypot(x, y), hypot(*hand[:UP]) * turn])
    return way, nearest, all_above


def _touches_another(observation: Observation, away: Float64, chosen: int) -> bool:
    """Whether the empty hand is at another object than the chosen one, so near that moving sideways
    would take it along. `away` [N] is how far each is from being held, m."""
    if observation.hand_pose[-1] > 0:
        return False
    nearest = float(np.delete(away, observation.hand_index).min())
    return nearest < min(float(away[chosen]), NOT_HELD_M + TOUCHED_M)


def _sets(degrees: Degrees, least: float, hidden: Collection[int] = ()) -> list[list[int]]:
    """The objects of a program's two sets, before any comparison."""
    return [_meant(degrees[MOVED], least, hidden), _meant(degrees[TARGET], least, hidden)]


def _meant(degrees: Sequence[float], least: float, hidden: Collection[int] = ()) -> list[int]:
    """The objects that have at least this share of the greatest degree."""
    if hidden:
        degrees = [0.0 if i in hidden else p for i, p in enumerate(degrees)]
    greatest = max(degrees)
    if greatest == 0.0:
        return []
    enough = least * greatest
    return [i for i, p in enumerate(degrees) if p >= enough]


def _left_out(
    observation: Observation, meant: Sequence[Objects], chosen: Sequence[Objects]
) -> set[int]:
    """The objects that were meant and not chosen, but for the hand."""
    return {*chain(*meant)}.difference((observation.hand_index,), *chosen)


def _nearest_two(sets: Sequence[Objects], objects: Float32) -> Sequence[Objects]:
    """One object of each of two sets, so that the two are as near as possible; the sets themselves
    if there are no two."""
    moved, targets = sets
    places = objects[:, :3].tolist()
    pairs = [(dist(places[i], places[j]), i, j) for i in moved for j in targets if i != j]
    if not pairs:
        return sets
    _, i, j = min(pairs)
    return [(i,), (j,)]
