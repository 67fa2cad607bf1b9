"""A custom property group is simulated, named and learned."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from helpers.learners import trained
from pa_ros.arena import (
    ArenaConfig,
    ReachTask,
    conditions_for,
    design_named,
    preset_named,
    world_of,
)
from pa_ros.arena.appearance import Look, look_of
from pa_ros.arena.designs import Design, Kind, kinds
from pa_ros.arena.render import top_view
from pa_ros.core import extensions
from pa_ros.core.errors import ConfigError
from pa_ros.learning.checkpoints import load_policy
from pa_ros.world.schema import ObjectSchema, OneHot, PropertyGroup

SIZES = str(Path(__file__).with_name("sizes.py"))


@pytest.fixture
def design() -> Design:
    extensions.load([SIZES])
    return design_named("sizes")


@pytest.fixture
def arena() -> ArenaConfig:
    return preset_named("fast")


def test_blocks_differ_in_size_in_the_simulation_and_in_the_features(
    design: Design, arena: ArenaConfig
) -> None:
    task = ReachTask(arena, design, seed=0)
    assert (
        task.world.schema.feature_names[-1] == "size_m_from_middle"
        and task.world.object_features == 17
    )
    observation, _ = task.reset(0)
    model, seen = task.simulation.model, set()
    for i, block in enumerate(task.episode.blocks):
        edge = {"SMALL": 0.04, "LARGE": 0.08}[block.kind["size"]]
        np.testing.assert_allclose(model.geom(f"block{i}").size, edge / 2)
        assert observation.objects[i + 1, -1] == pytest.approx(edge - 0.06)
        seen.add(edge)
    assert seen == {0.04, 0.08}
    for _ in range(10):  # they stay at rest
        observation, _ = task.step(np.zeros(6))
    lengths = task.simulation.positions[1:, 2]
    edges = observation.objects[1:, -1] + 0.06
    np.testing.assert_allclose(lengths, edges / 2, atol=2e-4)
    assert top_view(task, 120).shape == (120, 120, 3)


def test_every_group_has_its_conditions(design: Design, arena: ArenaConfig) -> None:
    names = conditions_for(design)
    assert {"only-size", "not-size", "only-color", "not-color", "depth-3"} <= set(names)
    assert not {"not-shape", "ignore-new", "reach-new-size"} & set(names)  # one shape, none new
    task = ReachTask(arena, design, seed=2)
    for name in names:
        task.reset(0, name)
        assert name.startswith("several") or len(task.verifier.targets) == 1
    task.reset(0, "not-size")
    assert "NOT(SMALL)" in str(task.program) or "NOT(LARGE)" in str(task.program)


def test_it_is_learned_in_process(design: Design, arena: ArenaConfig, tmp_path: Path) -> None:
    world = world_of(arena, design)
    no_sparsity: Any = {"learner.detectors.sparsity": 0}  # it would zero the weights of a short run
    learner = trained(tmp_path, design=design, **no_sparsity)
    assert learner.engine.name == "fused" and learner.counters.updates == 200
    arrays = learner.engine.tensors()
    assert arrays["actor.detectors.weight"].shape == (len(design.vocabulary.words), 17 + 18)
    column = world.schema.slices["size"]
    rows = [design.vocabulary.row[word] for word in ("SMALL", "LARGE")]
    learned = arrays["actor.detectors.weight"][rows, column]
    assert np.abs(learned).min() > 0  # they were 0 at the start, so the number is used
    sizes = learner.replay.arrays["objects"][: learner.replay.rows, 1:, column]
    np.testing.assert_allclose(np.unique(sizes), [-0.02, 0.02], atol=1e-7)
    assert load_policy(tmp_path / "checkpoint").world_digest == world.digest


def designed(**values: tuple[str, ...]) -> Design:
    """A design with all combinations of some values."""
    groups = (PropertyGroup(name, words, OneHot(words)) for name, words in values.items())
    schema = ObjectSchema(tuple(groups))
    train = kinds(values)
    count = min(4, len(train))
    return Design("own", values, schema.vocabulary, train, n_blocks=count, schema=schema)


def test_a_custom_color_without_a_look_is_grey() -> None:
    design = designed(shape=("CUBE", "SPHERE"), color=("RED", "ORANGE"))
    ReachTask(preset_named("fast"), design, 0).reset(0)
    assert look_of(Kind(color="ORANGE", shape="CUBE")) == Look()
    assert look_of(Kind(color="RED", shape="CUBE")).rgba != Look.rgba


def test_an_unknown_shape_is_rejected_before_the_first_episode() -> None:
    design = designed(shape=("CUBE", "CONE"), color=("RED", "BLUE"))
    with pytest.raises(ConfigError, match=r"shape: CONE: .* of \['CUBE'.*'PLACE'\], got 'CONE'"):
        ReachTask(preset_named("fast"), design, 0)
