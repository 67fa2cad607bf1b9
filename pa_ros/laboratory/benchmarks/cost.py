"""What one DPG update must compute, counted from its sizes, and the least time that this takes.

The counts are those of the cheapest arrangement we know (docs/machines.md), with each value
computed once. What an implementation computes again or moves through memory is not counted.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass
from math import prod

from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.families import Shapes, family_of
from pa_ros.networks.parameters import actor_shapes, critic_shapes

ADAM_FLOPS = 12  # per parameter: 3 for m, 4 for v, 5 for the step
FLOAT_BYTES = 4


@dataclass(frozen=True)
class Sizes:
    """One batch: B transitions of N objects × K programs."""

    transitions: int = 64
    objects: int = 5
    programs: int = 1


@dataclass(frozen=True)
class Cost:
    """Operations and bytes of one update of actor and critic."""

    flops: float = 0.0  # multiplications and additions, one each
    exponentials: float = 0.0
    tanhs: float = 0.0  # of one number: an exponential and a reciprocal
    pair_tanhs: float = 0.0  # tanh(x + y) from e^2x and e^2y: a product and a reciprocal
    bytes: float = 0.0  # batch and parameters, each read and written once if possible

    def __add__(self, other: Cost) -> Cost:
        return Cost(*(a + b for a, b in zip(astuple(self), astuple(other), strict=True)))

    def __mul__(self, times: float) -> Cost:
        return Cost(*(times * a for a in astuple(self)))


@dataclass(frozen=True)
class Rates:
    """What one thread of this machine does per microsecond, with operands in its first cache."""

    flops: float
    exponentials: float
    tanhs: float
    pair_tanhs: float
    bytes: float  # read and written, in a copy of as much as the parameters take


def floor_us(cost: Cost, rates: Rates) -> float:
    """The least time of these operations, microseconds.

    Arithmetic shares the vector units, so its times add up; memory can be read meanwhile.
    """
    arithmetic = (
        cost.flops / rates.flops
        + cost.exponentials / rates.exponentials
        + cost.tanhs / rates.tanhs
        + cost.pair_tanhs / rates.pair_tanhs
    )
    return max(arithmetic, cost.bytes / rates.bytes)


def update_cost(network: NetworkConfig, sizes: Sizes) -> Cost:
    """One update of programmable networks: targets, both gradients, Adam."""
    return _networks(network, sizes) + _adam(network) + _batch(network, sizes)


def _networks(network: NetworkConfig, z: Sizes) -> Cost:
    """Forward four times, backward twice; the critic's head once more, at π(s)."""
    family = family_of(network)
    words, actions = len(network.vocabulary.words), network.world.actions
    rows, total = z.transitions * z.programs, Cost()
    for critic in (False, True):
        detectors = words if family.detects(critic) else 0
        total += _trunk(network, z, detectors) * 2 + _trunk_backward(network, z, detectors)
    actor_head = Cost(flops=rows * 2 * network.hidden * actions, tanhs=rows * network.hidden)
    critic_head = actor_head + Cost(flops=rows * 2 * network.hidden)
    squash = Cost(tanhs=rows * actions)
    backward = Cost(flops=rows * network.hidden * (4 * actions + 2))
    heads = (actor_head + squash) * 2 + critic_head * 3 + backward * 2
    return total + heads + Cost(flops=rows * 2 * network.hidden * actions)  # ∂Q/∂a


def _trunk(network: NetworkConfig, z: Sizes, detectors: int) -> Cost:
    """From the observation to h: first layers, pairs, weighted sums, second layers."""
    b, n, k, h = z.transitions, z.objects, z.programs, network.hidden
    a, pairs = network.attention, z.transitions * z.objects**2
    first = 2 * b * _first_layers(network, n, detectors)
    sums = 2 * b * k * h * (n + n * n) + 2 * pairs * a  # Σ p f, Σ p α r and w·tanh
    second = 2 * b * k * 2 * h * h
    return Cost(
        flops=first + sums + second,
        exponentials=b * n * (2 * h + 2 * a + detectors) + pairs,
        tanhs=b * n * h,
        pair_tanhs=pairs * (h + a),
    )


def _trunk_backward(network: NetworkConfig, z: Sizes, detectors: int) -> Cost:
    """From ∂/∂h to the parameters' gradients; inputs need no gradients."""
    b, n, k, h = z.transitions, z.objects, z.programs, network.hidden
    pairs = b * n * n
    first = 2 * b * _first_layers(network, n, detectors)
    second = 2 * 2 * b * k * 2 * h * h
    messages = pairs * h * (4 * k + 5)  # both factors of each product; 1 − t², two sums
    local = b * n * h * (4 * k + 3)
    attention = pairs * network.attention * 7
    return Cost(flops=first + second + messages + local + attention)


def _scene(network: NetworkConfig, objects: int) -> int:
    """Numbers that describe a state."""
    return objects * network.world.object_features + network.world.arm_features


def _first_layers(network: NetworkConfig, objects: int, detectors: int) -> int:
    """Weights times inputs of all first layers: f, r of receiver and sender, query, context, Φ."""
    schema, arm = network.world.schema, network.world.arm_features
    columns = 3 * network.hidden + 2 * network.attention
    seen = schema.width if network.relations_see_properties else schema.properties.start
    return columns * (objects * seen + arm) + detectors * (objects * schema.width + arm)


def _adam(network: NetworkConfig) -> Cost:
    """Adam; parameters, moments, gradients and target parameters move once."""
    parameters = sum(map(_count, (actor_shapes(network), critic_shapes(network))))
    moved = 2 * 3 + 2 + 1 + 1  # p, m, v both ways; g written and read; p of the forward; target
    return Cost(flops=ADAM_FLOPS * parameters, bytes=FLOAT_BYTES * moved * parameters)


def _batch(network: NetworkConfig, z: Sizes) -> Cost:
    scene = _scene(network, z.objects)
    floats = z.transitions * (2 * scene + network.world.actions + 1 + 2 * z.programs)
    return Cost(bytes=FLOAT_BYTES * floats)


def _count(shapes: Shapes) -> int:
    return sum(prod(shape) for shape in shapes.values())
