"""The fused update against formulas in float64 autograd, written out as docs/DESIGN.md has them."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from helpers.formulas import Scenes, parameters
from helpers.formulas import actor as formulas
from helpers.fused_settings import (
    PROGRAMS,
    SMALL,
    VOCABULARY,
    Setting,
    check_batches,
    check_gradients,
    make_batch,
    setting,
)
from helpers.worlds import dpg
from pa_ros.language import LOGICS, Logic, parse
from pa_ros.language.vocabulary import Vocabulary, WordGroup
from pa_ros.learning.algorithms.dpg.builder import make_engine
from pa_ros.learning.algorithms.dpg.learner import TorchDPG
from pa_ros.native.engine import FusedActor
from pa_ros.networks.torch_actor import TorchActor
from pa_ros.world.relation import RELATIONS
from pa_ros.world.schema import PAPER, ObjectSchema, PropertyGroup, Real


@pytest.mark.parametrize("kind", ["programmable", "distilled-critic", "true-properties"])
@pytest.mark.parametrize("objects", [2, 3, 5, 8, 9])
def test_gradients_for_every_number_of_objects(kind: str, objects: int) -> None:
    made = setting(kind)
    batch = make_batch(np.random.default_rng(objects), 11, objects, 2, len(made.table))
    check_gradients(made, batch)


@pytest.mark.parametrize("programs", [1, 3, 4, 7, 8, 11])
def test_gradients_for_every_number_of_programs(programs: int) -> None:
    made = setting()
    check_gradients(made, make_batch(np.random.default_rng(programs), 9, 5, programs, 6))


@pytest.mark.parametrize("kind", ["programmable", "distilled-critic"])
@pytest.mark.parametrize("weight", [0.0, 0.3])
@pytest.mark.parametrize(("objects", "programs"), [(2, 1), (3, 2), (5, 1), (9, 4)])
def test_gradients_of_little_attention_to_oneself(kind, weight, objects, programs) -> None:
    made = setting(kind, self_weight=weight)
    check_gradients(made, make_batch(np.random.default_rng(objects), 8, objects, programs, 6))


MIXTURES = [("NEAR", "ABOVE"), tuple(name for name in RELATIONS if name not in ("HOLD", "ON"))]


@pytest.mark.parametrize("relations", MIXTURES, ids=len)
@pytest.mark.parametrize("kind", ["programmable", "distilled-critic", "true-properties"])
@pytest.mark.parametrize(("objects", "programs"), [(2, 1), (9, 5), (4, 11)])
def test_gradients_where_programs_ask_for_different_relations(relations, kind, objects, programs):
    made = setting(kind, relations=relations, hidden=33)
    assert "relation.weight" in made.actor and made.network.world.arm_features == 25
    check_batches(made, objects, programs)


def test_the_actor_uses_the_programs_relation() -> None:
    made = setting(relations=("NEAR", "ABOVE", "LEFT_OF"))
    actor, reference = FusedActor(made.network, made.actor), TorchActor(made.network, made.actor)
    batch = make_batch(np.random.default_rng(0), 1, 5, 1, 6, 25)
    seen = batch.objects[0], batch.arm[0]
    actions = []
    for relation in made.network.vocabulary.relations:
        program = replace(parse(PROGRAMS[1], VOCABULARY), relation=relation)
        actions.append(actor.act(*seen, program, 0))
        np.testing.assert_allclose(actions[-1], reference.act(*seen, program, 0), atol=2e-6)
    assert np.abs(np.diff(actions, axis=0)).min() > 1e-6


@pytest.mark.parametrize("row", range(len(PROGRAMS)))
@pytest.mark.parametrize("scale", [1.0, 300.0])
def test_gradients_of_each_program_with_p_near_0_and_1(row: int, scale: float) -> None:
    made = setting(scale=scale)
    batch = make_batch(np.random.default_rng(row), 8, 5, 1, 1)
    batch.program[:] = row
    check_gradients(made, batch)


@pytest.mark.parametrize(
    ("objects", "hidden", "attention", "size"), [(1, 7, 3, 1), (17, 16, 16, 5), (20, 33, 17, 3)]
)
def test_gradients_of_unusual_sizes(objects: int, hidden: int, attention: int, size: int) -> None:
    made = setting(vocabulary=SMALL, hidden=hidden, attention=attention)
    batch = make_batch(np.random.default_rng(0), size, objects, 2, len(made.table))
    check_gradients(made, batch)


def saturated(factor: float) -> Setting:
    made = setting()
    for name in ("message.0.weight", "query.weight", "context.weight"):
        made.critic[name] *= factor
    return made


def test_gradients_when_first_layers_saturate(caplog: pytest.LogCaptureFixture) -> None:
    """Sums of large numbers of opposite sign, up to about 37 each, the arm's share included."""
    check_gradients(saturated(20), make_batch(np.random.default_rng(3), 16, 4, 1, 6))
    assert not caplog.records


def test_warns_where_exponentials_end(caplog: pytest.LogCaptureFixture) -> None:
    made = saturated(150)
    engine = made.engine()
    for seed in range(2):
        engine.update(make_batch(np.random.default_rng(seed), 16, 4, 1, 6))
    assert [record.levelname for record in caplog.records] == ["WARNING"]
    assert np.isfinite(engine.tensors()["critic.message.0.weight"]).all()


def test_hundreds_of_updates_stay_with_float64() -> None:
    made = setting(vocabulary=SMALL)
    engine, reference = made.engine(), made.reference()
    rng = np.random.default_rng(5)
    batches = [make_batch(rng, 16, 4, 1, len(made.table)) for _ in range(20)]
    for step in range(300):
        for one in (engine, reference):
            one.update(batches[step % len(batches)])
        if step % 50 == 49:
            engine.end_episode()
            reference.end_episode()
    ours = engine.tensors()
    for name, expected in reference.tensors().items():
        if not name.startswith("adam."):
            error = np.linalg.norm(ours[name] - expected)
            assert error <= 1e-4 * np.linalg.norm(expected), name


def test_same_inputs_same_bits_and_instances_do_not_interfere() -> None:
    made = setting()
    rng = np.random.default_rng(2)
    batches = [make_batch(rng, 64, 5, 2, 6) for _ in range(3)]
    alone = made.engine()
    for batch in batches:
        alone.update(batch)
    first, other = made.engine(), setting("distilled-critic", scale=3).engine()
    for batch in batches:
        first.update(batch)
        other.update(make_batch(rng, 7, 3, 1, 6))
    expected = alone.tensors()
    for name, tensor in first.tensors().items():
        np.testing.assert_array_equal(tensor, expected[name], err_msg=name)
    assert not np.array_equal(other.tensors()["actor.query.weight"], expected["actor.query.weight"])


def test_exchanges_state_with_the_torch_engine() -> None:
    made = setting(vocabulary=SMALL)
    rng = np.random.default_rng(9)
    batches = [make_batch(rng, 16, 5, 1, len(made.table)) for _ in range(3)]
    theirs = TorchDPG(made.network, made.config, made.table, made.actor, made.critic)
    ours = setting(vocabulary=SMALL, scale=2).engine()
    theirs.update(batches[0])
    ours.load_tensors(theirs.tensors())
    for batch in batches[1:]:
        ours.update(batch)
        theirs.update(batch)
    expected = theirs.tensors()
    for name, tensor in ours.tensors().items():
        np.testing.assert_allclose(tensor, expected[name], rtol=1e-3, atol=2e-5, err_msg=name)
    assert ours.tensors()["adam.critic.step"] == expected["adam.critic.step"] == 3
    theirs.load_tensors(ours.tensors())
    assert ours.metrics() == pytest.approx(theirs.metrics(), rel=1e-3)


@pytest.mark.parametrize("biased", [False, True])
@pytest.mark.parametrize("sees_arm", [False, True])
@pytest.mark.parametrize("kind", ["programmable", "true-properties"])
def test_unused_weights_stay_0_and_the_rest_learns_as_in_torch(
    kind: str, sees_arm: bool, biased: bool
) -> None:
    made = setting(
        kind,
        relations_see_properties=False,
        detectors_have_biases=biased,
        detectors_see_arm=sees_arm,
    )
    ours = made.engine()
    config = dpg(made.config, engine__name="torch", engine__dtype="float64")
    theirs = TorchDPG(made.network, config, made.table, made.actor, made.critic)
    rng = np.random.default_rng(5)
    for _ in range(5):
        batch = make_batch(rng, 16, 5, 2, len(made.table))
        ours.update(batch)
        theirs.update(batch)
    expected = theirs.tensors()
    for name, tensor in ours.tensors().items():
        np.testing.assert_allclose(tensor, expected[name], rtol=1e-3, atol=2e-6, err_msg=name)
    properties = np.r_[7:16]
    for name in ("query", "context", "local.0", "message.0"):
        for network in ("actor", "critic"):
            weight = ours.tensors()[f"{network}.{name}.weight"]
            columns = weight.reshape(len(weight), -1, 34)
            assert not columns[..., properties].any() and columns[..., :7].all()
    if kind == "programmable":
        for network in ("actor", "critic"):
            tensors = ours.tensors()
            weight, bias = (tensors[f"{network}.detectors.{x}"] for x in ("weight", "bias"))
            assert weight[:, :16].any() and weight[:, 16:].any() == sees_arm
            assert bias.any() == biased


@pytest.mark.parametrize("name", ["fused", "torch"])
def test_sparsity_removes_small_detector_weights_only(name: str) -> None:
    made = setting()
    made.actor["detectors.weight"] = np.full_like(made.actor["detectors.weight"], 1e-5)
    made.actor["detectors.weight"][:, ::2] = 0.5
    weights = {}
    for sparsity in (0.0, 2.0):  # Adam's first steps are of one rate, so 2 outweighs each
        config = dpg(made.config, detectors__sparsity=sparsity, detectors__free_from=0.4)
        config = dpg(config, engine__name=name)
        engine = make_engine(made.network, config, made.table, np.random.default_rng())
        engine.load_tensors(made.engine().tensors())
        engine.update(make_batch(np.random.default_rng(3), 16, 5, 1, len(made.table)))
        weights[sparsity] = engine.tensors()["actor.detectors.weight"]
    assert weights[0.0].all()
    np.testing.assert_array_equal(weights[2.0][:, ::2], weights[0.0][:, ::2])
    assert not weights[2.0][:, 1::2].any()


@pytest.mark.parametrize("kind", ["programmable", "true-properties"])
@pytest.mark.parametrize("logic", LOGICS.values(), ids=LOGICS)
@pytest.mark.parametrize(("hand", "self_weight"), [(0, 1.0), (2, 0.3), (2, 0.0)])
def test_actor_equals_the_formulas(kind: str, hand: int, self_weight: float, logic: Logic) -> None:
    made = setting(kind, self_weight=self_weight)
    actor, named = FusedActor(made.network, made.actor, logic), parameters(made.actor)
    reference = TorchActor(made.network, made.actor, logic)
    for objects in (5, 3):
        batch = make_batch(np.random.default_rng(objects), 1, objects, 1, 6)
        order = np.roll(np.arange(objects), hand)  # the hand at its index; the rest in any order
        index = int(np.flatnonzero(order == 0)[0])
        for text in PROGRAMS:
            program = parse(text, VOCABULARY)
            features = torch.from_numpy(batch.objects[:, order]).double()
            joints = torch.from_numpy(batch.arm).double()
            rows = torch.zeros(1, 1, dtype=torch.long)
            scene = Scenes(features, joints, [program], rows, index, logic)
            expected = formulas(made.network, named, scene)[0, 0].detach()
            seen = batch.objects[0][order], batch.arm[0], program, index
            np.testing.assert_allclose(actor.act(*seen), expected, rtol=0, atol=2e-6)
            np.testing.assert_allclose(reference.act(*seen), expected, rtol=0, atol=2e-6)


def test_equal_programs_act_alike_under_min_and_max_only() -> None:
    made = setting()
    batch = make_batch(np.random.default_rng(0), 1, 5, 1, 6)
    once, twice = (parse(f"NEAR(HAND, {e})", VOCABULARY) for e in ("RED", "AND(RED, RED)"))
    differ = {}
    for name, logic in LOGICS.items():
        for kind in FusedActor, TorchActor:
            actor = kind(made.network, made.actor, logic)
            both = [actor.act(batch.objects[0], batch.arm[0], e, 0) for e in (once, twice)]
            differ[name, kind] = float(np.abs(np.subtract(*both)).max())
    for kind in FusedActor, TorchActor:
        assert differ["min_max", kind] == 0.0
        assert differ["product", kind] > 1e-5


SIZE = PropertyGroup(
    "size", ("SMALL", "LARGE"), Real(("m",), {"SMALL": (0.04,), "LARGE": (0.08,)}, 0.01, 25.0)
)
SIZED = ObjectSchema((*PAPER.groups, SIZE))


@pytest.mark.parametrize("joints", [3, 7])
@pytest.mark.parametrize("kind", ["programmable", "distilled-critic", "true-properties"])
def test_other_worlds_are_the_formulas_too(kind: str, joints: int) -> None:
    """A group of numbers more, another arm."""
    words = Vocabulary((*VOCABULARY.groups, WordGroup("size", ("SMALL", "LARGE"))))
    made = setting(kind, vocabulary=words, schema=SIZED, joints=joints, hidden=20, attention=7)
    made.table.add(parse("NEAR(HAND, AND(SMALL, NOT(RED)))", words))
    rng, rows = np.random.default_rng(5), len(made.table)
    batch = make_batch(rng, 9, 4, 2, rows)
    sizes = rng.choice(np.array([0.0, 0.04, 0.08], np.float32), (2, 9, 4, 1))
    draw = lambda n: rng.normal(size=(9, n)).astype(np.float32)  # noqa: E731
    check_gradients(made, replace(
        batch,
        objects=np.concatenate([batch.objects, sizes[0]], -1),
        next_objects=np.concatenate([batch.next_objects, sizes[1]], -1),
        arm=draw(3 * joints), next_arm=draw(3 * joints), action=np.tanh(draw(joints)),
    ))  # fmt: skip
