"""The fused update of canonical networks against the torch reference in float64."""

import numpy as np
import pytest
import torch

from helpers.worlds import dpg, objects_at, random_batch
from pa_ros.core.update import Batch
from pa_ros.language import Vocabulary, parse
from pa_ros.learning.algorithms.dpg.builder import fused_engine, make_engine
from pa_ros.learning.algorithms.dpg.config import DPGConfig
from pa_ros.learning.algorithms.dpg.learner import TorchDPG
from pa_ros.native.engine import FusedActor, FusedEngine
from pa_ros.networks.canonical import CanonicalActor
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.errors import NetworkError
from pa_ros.networks.families import target_one_hots
from pa_ros.networks.parameters import Tensors, initial_actor, initial_critic
from pa_ros.world.programs import ProgramTable
from pa_ros.world.schema import PAPER
from pa_ros.world.world import World

WORDS = Vocabulary.of(
    shape=("CUBE", "SPHERE", "CYLINDER", "C"), color=("RED", "GREEN", "BLUE", "A")
)
WORLD = World(PAPER, WORDS, joints=6)
TEXTS = ("NEAR(HAND, AND(RED, CUBE))", "NEAR(HAND, AND(SPHERE, BLUE))", "NEAR(HAND, AND(C, GREEN))")
# some of ∂Q/∂a is clipped, some is not
CONFIG = dpg(gradient_clip=0.05)


def network(hidden: int = 40) -> NetworkConfig:
    return NetworkConfig(world=WORLD, family="canonical", canonical_hidden=hidden)


def tensors(config: NetworkConfig) -> tuple[Tensors, Tensors]:
    """Larger than the initial ones, so that nothing is nearly linear."""
    rng = np.random.default_rng(1)
    made = initial_actor(config, rng), initial_critic(config, rng)
    for one in made:
        for name, tensor in one.items():
            tensor *= 60.0 if name.startswith("output") else 2.0
    return made


def table() -> ProgramTable:
    made = ProgramTable(WORDS)
    for text in TEXTS:
        made.add(parse(text, WORDS))
    return made


def both(
    hidden: int = 40, programs: ProgramTable | None = None, **changes: object
) -> tuple[FusedEngine, TorchDPG]:
    config, programs = network(hidden), programs or table()
    given = config, dpg(CONFIG, **changes), programs  # type: ignore[arg-type]
    reference = dpg(CONFIG, engine__name="torch", engine__dtype="float64")
    ours = fused_engine(*given, *tensors(config))
    return ours, TorchDPG(config, reference, programs, *tensors(config))


def batch_of(rng: np.random.Generator, size: int, programs: int) -> Batch:
    """A hand and two blocks; one scene in four has two of one kind, which share a slot."""
    batch = random_batch(rng, size, programs, len(TEXTS))
    for scenes in (batch.objects, batch.next_objects):
        scenes[::4, 2, 7:] = scenes[::4, 1, 7:]
    return batch


@pytest.mark.parametrize(("size", "k"), [(1, 1), (70, 1), (9, 2), (5, 11)])
@pytest.mark.parametrize(("hidden", "threads"), [(7, 1), (40, 2)])
def test_gradients(size, k, hidden, threads) -> None:
    ours, reference = both(hidden, engine__threads=threads)
    batch = batch_of(np.random.default_rng(size), size, k)
    ours.update(batch)
    reference.update(batch)
    gradients, expected = ours.gradients(), reference.gradients()
    assert gradients.keys() == expected.keys()
    for name, tensor in expected.items():
        scale = np.abs(tensor).max()
        assert scale > 0, name
        assert np.abs(gradients[name] - tensor).max() <= 1e-5 * scale + 1e-8, name
    assert ours.metrics() == pytest.approx(reference.metrics(), rel=1e-5)


def test_exchanges_state_with_torch_and_accepts_new_programs() -> None:
    programs = table()
    ours, reference = both(programs=programs)
    rng = np.random.default_rng(2)
    reference.update(batch_of(rng, 16, 1))
    ours.load_tensors(reference.tensors())
    assert ours.tensors()["adam.actor.step"] == 1
    assert programs.add(parse("NEAR(HAND, AND(CUBE, BLUE))", WORDS)) == len(TEXTS)
    batch = batch_of(rng, 16, 1)
    batch.program[:] = len(TEXTS)
    ours.update(batch)
    reference.update(batch)
    for name, tensor in reference.tensors().items():
        np.testing.assert_allclose(ours.tensors()[name], tensor, rtol=1e-4, atol=1e-7, err_msg=name)


@pytest.mark.parametrize("hand", [0, 2])
def test_actor(hand) -> None:
    config = network()
    actor, _ = tensors(config)
    module = CanonicalActor(config).double()
    module.load_state_dict({k: torch.from_numpy(v) for k, v in actor.items()})
    ours = FusedActor(config, actor)
    rng = np.random.default_rng(0)
    for text in TEXTS:
        program = parse(text, WORDS)
        objects = np.roll(objects_at(rng.normal(0, 0.3, (2, 3))), hand, axis=0)
        arm = rng.normal(size=18).astype(np.float32)
        goal = torch.from_numpy(target_one_hots(program, WORDS)).double()[None, None]
        seen = (torch.from_numpy(x).double()[None] for x in (objects, arm))
        expected = module(*seen, goal, hand)[0, 0].detach().numpy()
        np.testing.assert_allclose(ours.act(objects, arm, program, hand), expected, atol=2e-6)


def test_is_chosen_and_rejects_programs_that_it_cannot_represent() -> None:
    programs = table()
    engine = make_engine(network(), DPGConfig(), programs, np.random.default_rng(0))
    assert engine.name == "fused"
    actor, _ = tensors(network())
    seen = objects_at(np.zeros((2, 3))), np.zeros(18, np.float32)
    with pytest.raises(NetworkError):
        FusedActor(network(), actor).act(*seen, parse("NEAR(HAND, RED)", WORDS), 0)
    programs.add(parse("NEAR(HAND, OR(RED, CUBE))", WORDS))
    with pytest.raises(NetworkError):
        engine.update(batch_of(np.random.default_rng(0), 4, 1))
