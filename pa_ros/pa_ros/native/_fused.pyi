"""The fused DPG update and actor in C++; use pa_ros.native.engine."""

from collections.abc import Sequence
import enum
from typing import Annotated

import numpy
from numpy.typing import NDArray


MAX_WORDS: int = 128

MAX_SLOTS: int = 32

MAX_GROUPS: int = 8

MAX_FEATURES: int = 256

MAX_ACTIONS: int = 16

MAX_NUMBERS: int = 4096

MAX_PROGRAMS: int = 64

MAX_RELATIONS: int = 16

LARGEST_PART: float = 43.599998474121094

class Network:
    """What the engine is told of an actor or a critic."""

    @staticmethod
    def trunk(*, hidden: int, attention: int, arm_features: int, actions: int, scale: Sequence[float], group_sizes: Sequence[int], words: Sequence[tuple[int, Sequence[float], float]], detectors: bool, hide_properties: bool, critic: bool, self_weight: float, relations: int = 0, min_max: bool = False, roles: bool = False, avoids: bool = False, upper_layers: int = 0) -> Network:
        """
        A programmable one. `scale`: of each feature of an object. `words`: the first feature of each one's value, its numbers as scaled, and how near is near; no numbers: true of nothing. `relations`: 0 where programs ask for one alone. `min_max`: what AND and OR of degrees are, of an actor that doesn't learn. `roles`: programs say what is moved and where to; `avoids`: what is avoided.
        """

    @staticmethod
    def canonical(*, hidden: int, arm_features: int, actions: int, scale: Sequence[float], group_sizes: Sequence[int], words: Sequence[tuple[int, Sequence[float], float]], slots: Sequence[Sequence[int]], critic: bool) -> Network:
        """
        An MLP. `slots`: the words, one of each group, of the block that fills each.
        """

    @property
    def hidden(self) -> int: ...

    @property
    def attention(self) -> int: ...

    @property
    def words(self) -> int: ...

    @property
    def relations(self) -> int: ...

    @property
    def upper_layers(self) -> int: ...

    @property
    def avoids(self) -> bool: ...

    @property
    def object_features(self) -> int: ...

    @property
    def actions(self) -> int: ...

    @property
    def detectors(self) -> bool: ...

    @property
    def critic(self) -> bool: ...

    @property
    def is_canonical(self) -> bool: ...

class Layout:
    """Offsets and sizes in a flat buffer, in floats: see layout.h."""

    @property
    def hidden(self) -> int: ...

    @property
    def columns(self) -> int: ...

    @property
    def rows(self) -> int: ...

    @property
    def local(self) -> int: ...

    @property
    def avoid(self) -> int: ...

    @property
    def receiver(self) -> int: ...

    @property
    def sender(self) -> int: ...

    @property
    def query(self) -> int: ...

    @property
    def context(self) -> int: ...

    @property
    def detectors(self) -> int: ...

    @property
    def first(self) -> int: ...

    @property
    def attention_weight(self) -> int: ...

    @property
    def relation(self) -> int: ...

    @property
    def second(self) -> int: ...

    @property
    def second_bias(self) -> int: ...

    @property
    def upper(self) -> int: ...

    @property
    def action(self) -> int: ...

    @property
    def output(self) -> int: ...

    @property
    def output_bias(self) -> int: ...

    @property
    def inputs(self) -> int: ...

def layout_of(network: Network) -> Layout: ...

class Trained:
    """A network's flat buffers, float32, as views."""

    @property
    def parameters(self) -> Annotated[NDArray[numpy.float32], dict(shape=(None,))]: ...

    @property
    def target(self) -> Annotated[NDArray[numpy.float32], dict(shape=(None,))]: ...

    @property
    def gradient(self) -> Annotated[NDArray[numpy.float32], dict(shape=(None,))]: ...

    @property
    def first_moment(self) -> Annotated[NDArray[numpy.float32], dict(shape=(None,))]: ...

    @property
    def second_moment(self) -> Annotated[NDArray[numpy.float32], dict(shape=(None,))]: ...

class Metrics:
    """Of one update; `largest_part`: see LARGEST_PART."""

    @property
    def critic_loss(self) -> float: ...

    @property
    def mean_q(self) -> float: ...

    @property
    def actor_gradient_norm(self) -> float: ...

    @property
    def largest_part(self) -> float: ...

class Engine:
    """One DPG update of actor and critic."""

    def __init__(self, actor: Network, critic: Network, *, actor_rate: float, critic_rate: float, beta1: float, beta2: float, epsilon: float, clip: float, action_penalty: float, detector_gain: float, sparsity: float, free_from: float, detector_arm: bool, detector_bias: bool, threads: int) -> None: ...

    @property
    def actor(self) -> Trained: ...

    @property
    def critic(self) -> Trained: ...

    def set_programs(self, *, op: Annotated[NDArray, dict(device='cpu', writable=False)], a: Annotated[NDArray, dict(device='cpu', writable=False)], b: Annotated[NDArray, dict(device='cpu', writable=False)], relation: Annotated[NDArray, dict(device='cpu', writable=False)], moved: Annotated[NDArray, dict(device='cpu', writable=False)], target: Annotated[NDArray, dict(device='cpu', writable=False)], avoided: Annotated[NDArray, dict(device='cpu', writable=False)]) -> None:
        """
        What rows of batches mean: compiled programs by the fields of their record, instructions [P, L] and all else [P], int32.
        """

    def set_targets(self, words: Annotated[NDArray, dict(device='cpu', writable=False)]) -> None:
        """
        The same for canonical networks: each target's words, [P, groups] int32.
        """

    def update(self, *, objects: Annotated[NDArray, dict(device='cpu', writable=False)], arm: Annotated[NDArray, dict(device='cpu', writable=False)], action: Annotated[NDArray, dict(device='cpu', writable=False)], next_objects: Annotated[NDArray, dict(device='cpu', writable=False)], next_arm: Annotated[NDArray, dict(device='cpu', writable=False)], program: Annotated[NDArray, dict(device='cpu', writable=False)], reward: Annotated[NDArray, dict(device='cpu', writable=False)], discount: Annotated[NDArray, dict(device='cpu', writable=False)], hand_index: int, correction1: float, correction2: float, rate_share: float = 1.0) -> Metrics:
        """
        The corrections are of Adam's moments, 1 - beta^step; the share is of both rates.
        """

class Actor:
    """Actions for one observation at a time."""

    def __init__(self, network: Network) -> None: ...

    @property
    def parameters(self) -> Annotated[NDArray[numpy.float32], dict(shape=(None,))]: ...

    def set_program(self, *, op: Annotated[NDArray, dict(device='cpu', writable=False)], a: Annotated[NDArray, dict(device='cpu', writable=False)], b: Annotated[NDArray, dict(device='cpu', writable=False)], relation: Annotated[NDArray, dict(device='cpu', writable=False)], moved: Annotated[NDArray, dict(device='cpu', writable=False)], target: Annotated[NDArray, dict(device='cpu', writable=False)], avoided: Annotated[NDArray, dict(device='cpu', writable=False)]) -> None:
        """Act on one program from now on: as `Engine.set_programs`, with P = 1."""

    def set_target(self, words: Annotated[NDArray, dict(device='cpu', writable=False)]) -> None:
        """The same for canonical networks: the target's words, [1, groups]."""

    def act(self, objects: Annotated[NDArray, dict(device='cpu', writable=False)], arm: Annotated[NDArray, dict(device='cpu', writable=False)], hand_index: int, action: Annotated[NDArray, dict(device='cpu')]) -> None:
        """Objects [N, F], arm [A]; writes the action, [J]."""

    def degrees(self, objects: Annotated[NDArray, dict(device='cpu', writable=False)], arm: Annotated[NDArray, dict(device='cpu', writable=False)], hand_index: int, degrees: Annotated[NDArray, dict(device='cpu')]) -> None:
        """
        The same; writes the degrees [4, N] of p, what is moved, the target and what is avoided.
        """

def level() -> str:
    """The instruction set in use."""

def levels() -> list[tuple[str, bool]]:
    """
    Every instruction set it was built for, and whether this machine has it.
    """

class Function(enum.Enum):
    """What `elementwise` computes."""

    EXPONENTIAL = 0

    TANH = 1

    TANH_OF_SUM = 2

def elementwise(function: Function, x: Annotated[NDArray, dict(device='cpu', writable=False)], y: Annotated[NDArray, dict(device='cpu', writable=False)], out: Annotated[NDArray, dict(device='cpu')], repeats: int = 1) -> None:
    """out = f(x, y); tanh(a + b) is given x = e^2a / 2 and y = e^2b."""

def product(a: Annotated[NDArray, dict(device='cpu', writable=False)], b: Annotated[NDArray, dict(device='cpu', writable=False)], out: Annotated[NDArray, dict(device='cpu')]) -> None:
    """out = a · b; b and out begin a line."""
