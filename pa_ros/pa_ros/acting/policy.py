"""The policy: an action from an observation and a program, by weights that a learner published."""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Sequence
from functools import lru_cache
from typing import Self

import numpy as np

from pa_ros.acting.errors import ActingError
from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float32, Observation, PolicySnapshot
from pa_ros.language import MIN_MAX, Logic, Program
from pa_ros.native.library import why_not_network
from pa_ros.networks.config import NetworkConfig, actor_config
from pa_ros.networks.detectors import degrees
from pa_ros.networks.errors import NetworkError
from pa_ros.networks.families import family_of
from pa_ros.networks.inference import Inference
from pa_ros.networks.parameters import Tensors, actor_shapes, check_tensors

log = logging.getLogger(__name__)

Degrees = Sequence[Sequence[float]]
"""Of p and the sets of a program, [4][N]."""
MakeInference = Callable[[NetworkConfig, Tensors, Logic], Inference]


class Policy:
    """The networks with one version's weights; `Actor` adds the rules of executing.

    The fused code computes actions where it can, else torch. The choice depends on `network` and
    `inference` ("auto" or "torch") alone, so it is the same in process and over the graph. `logic`
    says what AND and OR of degrees are: MIN_MAX, under which equal programs act alike, or the
    PRODUCT that a learning agent's critic uses.
    """

    def __init__(
        self, network: NetworkConfig, inference: str = "auto", logic: Logic = MIN_MAX
    ) -> None:
        self.network, self.logic = network, logic
        self.evaluates_programs = family_of(network).evaluates_programs
        """Whether there are degrees, which say what programs mean."""
        self._shapes = actor_shapes(network)
        self._world = network.world
        self._features = network.world.object_features, network.world.arm_features
        self._make_inference = inference_for(network, inference)
        self.backend = "torch" if _why_torch(network, inference) else "fused"
        self._inference: Inference | None = None
        self._tensors: Tensors = {}
        self._version: int | None = None
        self._seen: Observation | None = None  # the newest
        self._inputs: tuple[Float32, Float32]  # of the networks, made of `_seen`

    @classmethod
    def of(cls, snapshot: PolicySnapshot, logic: Logic = MIN_MAX) -> Self:
        """A greedy one with these weights, of their architecture."""
        policy = cls.fitting(snapshot, logic)
        policy.load(snapshot)
        return policy

    @classmethod
    def fitting(cls, snapshot: PolicySnapshot, logic: Logic = MIN_MAX) -> Self:
        """A greedy one of a snapshot's architecture, still without weights."""
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

    def infer(
        self, observation: Observation, program: Program, hidden: Collection[int] = ()
    ) -> Float32:
        """The networks' action, [J], in a scene without its `hidden` objects.

        Raises ProgramError or NetworkError for a program that they cannot represent, ActingError
        before there are weights, or for objects or an arm of another size.
        """
        objects, arm = self._inputs_of(observation)
        hand = observation.hand_index
        if hidden:
            shown = [i for i in range(len(objects)) if i not in hidden]
            objects, hand = objects.take(shown, 0), shown.index(hand)
        return self._ready().act(objects, arm, program, hand)

    def degrees(self, observation: Observation, program: Program) -> Degrees:
        """How far the program means each object: p, then its sets (`networks.inference`).

        Only where networks evaluate programs. Raises what `infer` raises.
        """
        objects, arm = self._inputs_of(observation)
        array = self._ready().degrees(objects, arm, program, observation.hand_index)
        numbers: Degrees = array.tolist()  # of few objects: quicker than the array
        return numbers

    def phi(self, observation: Observation) -> Float32:
        """Φ, [V, N]: the degree to which each word describes each object.

        Raises ActingError for objects or an arm of another size than the weights'.
        """
        objects, arm = self._inputs_of(observation)
        return degrees(self.network, self._tensors, objects, arm, self.logic)

    def _inputs_of(self, observation: Observation) -> tuple[Float32, Float32]:
        """Objects [N, F] and the arm's part of Ω [A], as `Inference` takes them."""
        if self._seen is not observation:  # several computations ask for one
            objects = np.ascontiguousarray(observation.objects, np.float32)
            arm = self._world.arm(observation)
            features = objects.shape[-1], arm.size
            if features != self._features:
                raise ActingError(
                    "policy: expected {} features of an object and {} of the arm, as it was "
                    "trained with, got {} and {}".format(*self._features, *features)
                )
            self._seen, self._inputs = observation, (objects, arm)
        return self._inputs

    def _ready(self) -> Inference:
        if self._inference is None:
            raise ActingError("policy: expected weights before acting, got none")
        return self._inference


def _why_torch(network: NetworkConfig, inference: str) -> str:
    """Why torch computes actions; empty: the fused code computes them."""
    return "chosen" if inference == "torch" else why_not_network(network)


@lru_cache(maxsize=16)
def inference_for(network: NetworkConfig, inference: str) -> MakeInference:
    """FusedActor where it applies, else TorchActor; the choice is logged once."""
    reason = _why_torch(network, inference)
    log.info("actor inference: %s", f"torch ({reason})" if reason else "fused")
    if reason:  # torch is loaded where it is needed alone
        from pa_ros.networks.torch_actor import TorchActor

        return TorchActor
    from pa_ros.native.engine import FusedActor

    return FusedActor
