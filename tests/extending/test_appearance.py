"""Custom looks of blocks are used, or rejected by group and value."""

from __future__ import annotations

import pytest

from pa_ros.arena import ReachTask, preset_named
from pa_ros.arena.appearance import Look, look_of
from pa_ros.arena.designs import Design, Kind, kinds
from pa_ros.core.errors import ConfigError
from pa_ros.world.schema import ObjectSchema, OneHot, PropertyGroup


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
    with pytest.raises(ConfigError, match=r"shape: CONE: .* of \['CUBE'.*'CAPSULE'\], got 'CONE'"):
        ReachTask(preset_named("fast"), design, 0)
