"""Networks, batches and bounds for comparing the fused engine with the formulas in float64."""

from dataclasses import dataclass, replace
from itertools import cycle
from typing import Any

import numpy as np
import pytest

from helpers.formulas import StraightforwardEngine
from helpers.worlds import dpg
from pa_ros.core.update import HAND_INDEX, Batch
from pa_ros.language import parse
from pa_ros.language.vocabulary import Vocabulary
from pa_ros.learning.algorithms.dpg.builder import fused_engine
from pa_ros.learning.algorithms.dpg.config import DPGConfig
from pa_ros.native.engine import FusedEngine
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.parameters import Tensors, initial_actor, initial_critic
from pa_ros.world.programs import ProgramTable
from pa_ros.world.schema import PAPER, ObjectSchema
from pa_ros.world.world import World

PROGRAMS = (
    "NEAR(HAND, RED)",
    "NEAR(HAND, AND(RED, CUBE))",
    "NEAR(HAND, OR(BLUE, SPHERE))",
    "NEAR(HAND, NOT(GREEN))",
    "NEAR(HAND, AND(CUBE, SPHERE, RED, NOT(CYLINDER)))",
    "NEAR(HAND, OR(AND(NOT(OR(AND(RED, CUBE), BLUE)), SPHERE), NOT(AND(A, OR(C, GREEN)))))",
)
VOCABULARY = Vocabulary.of(
    shape=("CUBE", "SPHERE", "CYLINDER", "C"), color=("RED", "GREEN", "BLUE", "A", "B")
)
SMALL = Vocabulary.of(shape=("CUBE", "SPHERE"), color=("RED", "BLUE"))


@dataclass
class Setting:
    """Networks, settings, programs and initial tensors of a learner."""

    network: NetworkConfig
    config: DPGConfig
    table: ProgramTable
    actor: Tensors
    critic: Tensors

    def engine(self, **changes: object) -> FusedEngine:
        config = dpg(self.config, **changes)  # type: ignore[arg-type]
        return fused_engine(self.network, config, self.table, self.actor, self.critic)

    def reference(self) -> StraightforwardEngine:
        """The plain formulas, in float64."""
        config = dpg(self.config, engine__dtype="float64")
        return StraightforwardEngine(self.network, config, self.table, self.actor, self.critic)


def setting(
    kind: str = "programmable",
    scale: float = 1.0,
    vocabulary: Vocabulary = VOCABULARY,
    schema: ObjectSchema = PAPER,
    joints: int = 6,
    relations: tuple[str, ...] = ("NEAR",),
    texts: tuple[str, ...] = (),
    **sizes: Any,
) -> Setting:
    """Random networks. `scale` multiplies the detectors; a large one moves p near 0 and 1. The
    programs use `relations` in turn; `texts` are more of them."""
    vocabulary = vocabulary.asking(*relations)
    network = NetworkConfig(
        world=World(schema, vocabulary, joints), family=kind, actor_output_scale=0.3, **sizes
    )  # type: ignore[arg-type]
    table = ProgramTable(vocabulary)
    words = set(vocabulary.words)
    for text, relation in zip(PROGRAMS, cycle(relations)):  # noqa: B905 - endless
        program = replace(parse(text, VOCABULARY), relation=relation)
        if words.issuperset(program.words):
            table.add(program)
    for text in texts:
        table.add(parse(text, vocabulary))
    rng = np.random.default_rng(1)
    actor, critic = initial_actor(network, rng), initial_critic(network, rng)
    for tensors in (actor, critic):
        if "detectors.weight" in tensors:
            tensors["detectors.weight"] *= scale
    config = dpg(
        optimizer__half_life=4.0,
        action_penalty=0.02,
        detectors__gain=3.0,
        detectors__sparsity=0.4,
        detectors__free_from=0.2,
    )
    return Setting(network, config, table, actor, critic)


def make_batch(
    rng: np.random.Generator, size: int, objects: int, programs: int, rows: int, arm: int = 18
) -> Batch:
    """Random observations of the right kind: a hand and blocks with one shape and one color."""

    def scene() -> np.ndarray:
        x = np.zeros((size, objects, 16), np.float32)
        x[..., :3] = rng.normal(0, 0.3, (size, objects, 3))
        x[..., 3:7] = rng.normal(0, 0.5, (size, objects, 4))
        shape, color = (rng.integers(0, n, (size, objects)) for n in (4, 5))
        np.put_along_axis(x, 7 + shape[..., None], 1.0, -1)
        np.put_along_axis(x, 11 + color[..., None], 1.0, -1)
        x[:, HAND_INDEX] = 0
        x[:, HAND_INDEX, 6] = 1
        return x

    def normal(*shape: int) -> np.ndarray:
        return rng.normal(size=shape).astype(np.float32)

    discount = np.where(rng.random(size) < 0.1, 0, 0.99).astype(np.float32)
    return Batch(
        objects=scene(),
        arm=normal(size, arm),
        action=rng.uniform(-1, 1, (size, 6)).astype(np.float32),
        next_objects=scene(),
        next_arm=normal(size, arm),
        program=rng.integers(0, rows, (size, programs)).astype(np.int32),
        reward=rng.choice([-1.0, 1.0], (size, programs)).astype(np.float32),
        discount=discount,
    )


def assert_close(ours: dict[str, np.ndarray], theirs: dict[str, np.ndarray], bound: float) -> None:
    """Each tensor's largest error, against its largest element or float32's unit of the largest."""
    assert ours.keys() == theirs.keys()
    unit = {
        owner: 2**-23 * max(np.abs(x).max() for name, x in theirs.items() if name.startswith(owner))
        for owner in ("actor", "critic")
    }
    for name, tensor in theirs.items():
        error, size = np.abs(ours[name] - tensor).max(), np.abs(tensor).max()
        assert error <= bound * size + unit[name.partition(".")[0]], (name, error, size)


def expected_gradients(reference: StraightforwardEngine, batch: Batch) -> dict[str, np.ndarray]:
    """Gradients under the names of `FusedEngine.gradients`."""
    gradients = reference.gradients(batch)
    return {f"{o}.{k}": g.numpy() for o, named in gradients.items() for k, g in named.items()}


def check_gradients(made: Setting, batch: Batch, **changes: object) -> None:
    engine, reference = made.engine(**changes), made.reference()
    engine.update(batch)
    expected = expected_gradients(reference, batch)
    assert_close(engine.gradients(), expected, 1e-5)
    assert engine.metrics()["critic_loss"] == pytest.approx(reference.loss, rel=1e-5)
    squares = [np.square(g).sum() for name, g in expected.items() if name.startswith("actor.")]
    norm = engine.metrics()["actor_gradient_norm"]
    assert norm == pytest.approx(np.sqrt(sum(squares)), rel=1e-4)


def check_batches(made: Setting, objects: int, programs: int) -> None:
    """Check the gradients of a small batch, and of a large one by two threads."""
    rng, arm = np.random.default_rng(objects), made.network.world.arm_features
    for size, threads in ((13, 1), (70, 2)):
        batch = make_batch(rng, size, objects, programs, len(made.table), arm)
        check_gradients(made, batch, engine__threads=threads)
