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

SHADES = str(Path(__file__).with_name("shades.py"))


@pytest.fixture
def design() -> Design:
    extensions.load([SHADES])
    return design_named("shades")


@pytest.fixture
def arena() -> ArenaConfig:
    return preset_named("fast")


def test_blocks_differ_in_shade_on_the_table_and_in_the_features(
    design: Design, arena: ArenaConfig
) -> None:
    task = ReachTask(arena, design, seed=0)
    assert task.world.schema.feature_names[-1] == "shade_from_middle"
    observation, _ = task.reset(0)
    for i, block in enumerate(task.episode.blocks):
        brightness = {"DARK": 0.4, "BRIGHT": 1.0}[block.kind["shade"]]
        assert observation.objects[i + 1, -1] == pytest.approx(brightness - 0.7)
        plain = look_of(Kind(color=block.kind["color"], shape="CUBE")).rgb
        assert look_of(block.kind).rgb == pytest.approx([brightness * one for one in plain])
    assert top_view(task, 120).shape == (120, 120, 3)


def test_every_group_has_its_conditions(design: Design, arena: ArenaConfig) -> None:
    names = conditions_for(design)
    assert {"only-shade", "not-shade", "only-color", "not-color", "depth-3"} <= set(names)
    assert not {"not-shape", "ignore-new", "reach-new-shade"} & set(names)  # one shape, none new
    task = ReachTask(arena, design, seed=2)
    for name in names:
        task.reset(0, name)
        assert name.startswith("several") or len(task.verifier.targets) == 1
    task.reset(0, "not-shade")
    assert "NOT(DARK)" in str(task.program) or "NOT(BRIGHT)" in str(task.program)


def test_it_is_learned_in_process(design: Design, arena: ArenaConfig, tmp_path: Path) -> None:
    world = world_of(arena, design)
    no_sparsity: Any = {"learner.detectors.sparsity": 0}  # it would zero the weights of a short run
    learner = trained(tmp_path, design=design, **no_sparsity)
    assert learner.engine.name == "fused" and learner.counters.updates == 200
    arrays = learner.engine.tensors()
    assert arrays["actor.detectors.weight"].shape == (len(design.vocabulary.words), 17 + 18)
    column = world.schema.slices["shade"]
    rows = [design.vocabulary.row[word] for word in ("DARK", "BRIGHT")]
    learned = arrays["actor.detectors.weight"][rows, column]
    assert np.abs(learned).min() > 0  # they were 0 at the start, so the number is used
    shades = learner.replay.arrays["objects"][: learner.replay.rows, 1:, column]
    np.testing.assert_allclose(np.unique(shades), [-0.3, 0.3], atol=1e-7)
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
