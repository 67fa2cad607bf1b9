"""The policy: an action from an observation and a program, by weights that a learner published."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np

from pa_ros.acting.errors import ActingError
from pa_ros.acting.exploration import ExplorationNoise
from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float32, Observation, PolicySnapshot
from pa_ros.language import MIN_MAX, And, Expression, Logic, Not, Program
from pa_ros.language.evaluate import relevance, role_relevance
from pa_ros.native.library import why_not_network
from pa_ros.networks.config import NetworkConfig, actor_config
from pa_ros.networks.detectors import degrees
from pa_ros.networks.errors import NetworkError
from pa_ros.networks.families import family_of
from pa_ros.networks.parameters import Tensors, actor_shapes, check_tensors
from pa_ros.world.comparisons import choose
from pa_ros.world.schema import ObjectSchema
from pa_ros.world.scoring import Score, Scoring

if TYPE_CHECKING:  # it loads torch, which the fused code does not need
    from pa_ros.networks.inference import Inference

# A program means every object whose degree is at least this share of the greatest degree; to choose
# one of them, the share is greater, since undecided words give about half a degree.
MEANT, SURELY = 0.5, 0.75
# Shares of a relation's threshold: pushing stops at the first, and is slowed up to the second.
# Actions that are joint velocities can move the hand faster, so they are slowed earlier.
SLOWED, JOINTS_SLOWED = (0.6, 1.2), (0.0, 3.0)
AVOIDED_WITHIN_M = 0.40  # of the hand: what is farther away is not avoided
# At this distance from the hand, an object to be avoided counts as much as the goal; nearer by the
# second length, it counts e times as much.
EQUAL_M, NEARNESS_M = 0.30, 0.02

log = logging.getLogger(__name__)

MakeInference = Callable[[NetworkConfig, Tensors, Logic], "Inference"]


class Actor:
    """A policy. Without `noise` it is greedy.

    The fused code computes actions where it can, else torch. The choice depends on `network` and
    `inference` ("auto" or "torch") alone, so it is the same in process and over the graph. `logic`
    says what AND and OR of degrees are: MIN_MAX, under which equal programs act alike, or the
    PRODUCT that a learning agent's critic uses.
    """

    def __init__(
        self,
        network: NetworkConfig,
        inference: str = "auto",
        noise: ExplorationNoise | None = None,
        logic: Logic = MIN_MAX,
    ) -> None:
        self.network, self.logic = network, logic
        self._noise = noise
        self._evaluates_programs = family_of(network).evaluates_programs
        self._shapes = actor_shapes(network)
        world = network.world
        self._world, self._features = world, (world.object_features, world.arm_features)
        self._scoring = Scoring.of(world.vocabulary.relations)
        self._make_inference = inference_for(network, inference)
        self.backend = "torch" if _why_torch(network, inference) else "fused"
        self._inference: Inference | None = None
        self._tensors: Tensors = {}
        self._version: int | None = None

    @classmethod
    def of(cls, snapshot: PolicySnapshot, logic: Logic = MIN_MAX) -> Actor:
        """A greedy actor with these weights, of their architecture."""
        actor = cls.fitting(snapshot, logic)
        actor.load(snapshot)
        return actor

    @classmethod
    def fitting(cls, snapshot: PolicySnapshot, logic: Logic = MIN_MAX) -> Actor:
        """A greedy actor of a snapshot's architecture, still without weights."""
        try:
            return cls(actor_config(snapshot.architecture), logic=logic)
        except ConfigError as error:
            raise ActingError(str(error)) from error

    @property
    def version(self) -> int:
        """Version of the weights in use; ActingError before the first."""
        if self._version is None:
            raise ActingError("policy: expected weights before their version is asked, got none")
        return self._version

    def check(self, snapshot: PolicySnapshot) -> None:
        """Raise ActingError unless these weights fit."""
        ours = self.network.architecture
        if snapshot.architecture != ours:
            raise ActingError(f"policy: expected architecture {ours}, got {snapshot.architecture}")
        digest = self.network.world.digest
        if snapshot.world_digest != digest:
            raise ActingError(f"policy: expected world {digest}, got {snapshot.world_digest}")
        try:
            check_tensors(snapshot.tensors, self._shapes, "actor")
        except NetworkError as error:
            raise ActingError(f"policy version {snapshot.version}: {error}") from error

    def load(self, snapshot: PolicySnapshot) -> None:
        """Act with these weights from now on; ActingError, and no change, if they do not fit."""
        self.check(snapshot)
        if self._inference is None:
            self._inference = self._make_inference(self.network, snapshot.tensors, self.logic)
        else:
            self._inference.load(snapshot.tensors)
        self._tensors, self._version = snapshot.tensors, snapshot.version

    def act(self, observation: Observation, program: Program) -> Float32:
        """The greedy action, [J] in [-1, 1].

        Of the objects that the program means, the agent goes for the nearest two, or moves the hand
        to the nearest; networks alone would stop between them, since they sum over objects.

        Raises ProgramError for a word that the weights do not know, ActingError for objects or an
        arm of another size.
        """
        return self.infer(observation, program, commits=self._evaluates_programs)

    def explore(self, observation: Observation, program: Program) -> Float32:
        """The networks' action with this episode's exploration noise, clipped to [-1, 1], [J]."""
        if self._noise is None:
            raise ActingError("policy: expected exploration noise, got a greedy actor")
        action = self.infer(observation, program, commits=False)
        return self._noise.explore(action, observation.episode)

    def infer(self, observation: Observation, program: Program, commits: bool = False) -> Float32:
        """The networks' action. Where the program means several objects, comparisons choose among
        them, and an agent that `commits` takes the nearest; networks are not shown the rest."""
        if self._inference is None:
            raise ActingError("policy: expected weights before acting, got none")
        if commits and program.avoided is not None:
            return self._avoid(observation, program, program.avoided)
        arm, objects, hand = self._arm(observation), observation.objects, observation.hand_index
        speed = np.float32(1.0)
        if program.compares or commits:
            least = MEANT if program.compares else SURELY
            meant = self._meant(observation, least)(program)
            chosen = _compared(observation, program, meant, self._world.schema)
            if commits:
                chosen = _nearest_two(chosen, objects)
                if not program.moves_hand:
                    speed = self._speed(observation, program.relation, chosen)
            hidden = {*chain(*meant)} - {hand, *chain(*chosen)}
            shown = [i for i in range(len(objects)) if i not in hidden]
            objects, hand = objects[shown], shown.index(hand)
        return self._inference.act(objects, arm, program.sets_alone, hand) * speed

    def _speed(
        self, observation: Observation, relation: str, chosen: Sequence[Sequence[int]]
    ) -> np.float32:
        """The part of full speed at which an object is moved: less and less as the relation begins
        to hold, so that the object is not pushed on, and spheres do not roll away."""
        moved, targets = chosen
        seen, pose = observation.objects, observation.hand_pose
        measure = self._scoring.of_targets(targets, seen, relation, pose, moved).measure
        part = measure / self._scoring.threshold(relation, between=True)
        stopped, full = SLOWED if self._world.controller else JOINTS_SLOWED
        return np.float32(np.clip((part - stopped) / (full - stopped), 0.0, 1.0))

    def _avoid(self, observation: Observation, program: Program, avoided: Expression) -> Float32:
        """The action of an agent that commits. Networks learn to avoid one object, and keep farther
        away than they must. So the action that avoids nothing and those that avoid one near object
        each are averaged, the nearest objects most.
        """
        meant = self._meant(observation)
        to_avoid = {*meant(Program(avoided))[1]}
        targets = {*_compared(observation, program, meant(program), self._world.schema)[1]}
        if targets & to_avoid and not targets <= to_avoid and not program.compares:
            # Go for the targets that need not be avoided.
            program = replace(program, target=And((program.target, Not(avoided))))
            targets = {*meant(program)[1]}
        to_avoid -= targets
        distance = {i: float(np.linalg.norm(observation.objects[i, :3])) for i in sorted(to_avoid)}
        near = [i for i, metres in distance.items() if metres < AVOIDED_WITHIN_M]
        heedless = self.infer(_without(observation, to_avoid), program.relation_alone, commits=True)
        actions = [self.infer(_without(observation, to_avoid - {i}), program) for i in near]
        distances = np.array([EQUAL_M, *(distance[i] for i in near)])
        weight = np.exp((distances.min() - distances) / NEARNESS_M)
        return np.asarray(weight / weight.sum() @ np.stack([heedless, *actions]), np.float32)

    def degrees(self, observation: Observation) -> Float32:
        """Φ, [V, N]: the degree to which each word describes each object. Raises as `act`."""
        arm = self._arm(observation)
        return degrees(self.network, self._tensors, observation.objects, arm, self.logic)

    def relevance(self, observation: Observation, program: Program) -> tuple[float, ...]:
        """p, [N]: the degree to which the program means each object.

        Empty before there are weights, or for networks without degrees. Raises what `act` raises.
        """
        if self._inference is None or not self._evaluates_programs:
            return ()
        phi = self.degrees(observation)
        rows = self.network.vocabulary.row
        hand = observation.hand_index
        bodiless = self.network.vocabulary.bodiless
        p = relevance(program.relation_alone, phi.tolist(), rows, hand, self.logic, bodiless)
        if program.compares:
            meant = self._meant(observation)(program)
            chosen = _compared(observation, program, meant, self._world.schema)
            lost = {*chain(*meant)} - {*chain(*chosen)}
            p = [0.0 if i in lost else one for i, one in enumerate(p)]
        return tuple(p)

    def judge(self, observation: Observation, scoring: Scoring) -> Callable[[Program], Score]:
        """Scores of a state by the agent's own judgement: programs mean the objects to which they
        give at least half of the greatest degree.

        Raises NetworkError for networks without degrees, and what `act` raises.
        """
        sets_of = self._meant(observation)

        def score(program: Program) -> Score:
            moved, targets = _compared(observation, program, sets_of(program), self._world.schema)
            pair = None if program.moves_hand else moved
            seen, pose = observation.objects, observation.hand_pose
            return scoring.of_targets(targets, seen, program.relation, pose, pair)

        return score

    def _meant(
        self, observation: Observation, least: float = MEANT
    ) -> Callable[[Program], list[list[int]]]:
        """The objects of a program's two sets, before any comparison."""
        if not self._evaluates_programs:
            raise NetworkError(
                f"{self.network.family} networks: expected a verifier and no comparison, since "
                "they don't say which objects a program means",
                code="networks.unsupported_program",
            )
        phi = self.degrees(observation).tolist()
        vocabulary, hand = self.network.vocabulary, observation.hand_index

        def sets(program: Program) -> list[list[int]]:
            found = role_relevance(
                program.relation_alone, phi, vocabulary.row, hand, self.logic, vocabulary.bodiless
            )
            return [
                [i for i, p in enumerate(one) if p > 0.0 and p >= least * max(one)] for one in found
            ]

        return sets

    def _arm(self, observation: Observation) -> Float32:
        """Arm part of Ω, [A]; ActingError for an observation of another size than the weights'."""
        arm = self._world.arm(observation)
        features = observation.objects.shape[-1], arm.size
        if features != self._features:
            raise ActingError(
                "policy: expected {} features of an object and {} of the arm, as it was trained "
                "with, got {} and {}".format(*self._features, *features)
            )
        return arm


def _without(observation: Observation, hidden: set[int]) -> Observation:
    """An observation of a scene without some of its objects."""
    shown = [i for i in range(len(observation.objects)) if i not in hidden]
    hand = shown.index(observation.hand_index)
    return replace(observation, objects=observation.objects[shown], hand_index=hand)


def _compared(
    observation: Observation,
    program: Program,
    sets: Sequence[Sequence[int]],
    schema: ObjectSchema,
) -> list[tuple[int, ...]]:
    """The objects that a program's comparisons choose from its two sets."""
    return [
        choose(comparison, one, observation.objects, observation.hand_pose, schema)
        for comparison, one in zip(program.chosen, sets, strict=True)
    ]


def _nearest_two(sets: Sequence[Sequence[int]], objects: Float32) -> list[tuple[int, ...]]:
    """One object of each of two sets, so that the two are as near as possible; the sets themselves
    if there are no two."""
    moved, targets = sets
    places = objects[:, :3].astype(np.float64)
    pairs = [(i, j) for i in moved for j in targets if i != j]
    if not pairs:
        return [tuple(moved), tuple(targets)]
    i, j = min(pairs, key=lambda pair: float(np.linalg.norm(places[pair[0]] - places[pair[1]])))
    return [(i,), (j,)]


def _why_torch(network: NetworkConfig, inference: str) -> str:
    """Why torch computes actions; empty: the fused code computes them."""
    return "chosen" if inference == "torch" else why_not_network(network)


@lru_cache(maxsize=16)
def inference_for(network: NetworkConfig, inference: str) -> MakeInference:
    """FusedActor where it applies, else TorchActor; the choice is logged once."""
    reason = _why_torch(network, inference)
    log.info("actor inference: %s", f"torch ({reason})" if reason else "fused")
    if reason:
        from pa_ros.networks.inference import TorchActor

        return TorchActor
    from pa_ros.native.engine import FusedActor

    return FusedActor
