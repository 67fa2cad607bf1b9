"""Presets, settings and designs of the arena."""

from dataclasses import replace
from typing import Any

import pytest

from pa_ros.arena import DESIGNS, ArenaConfig, Design, Kind, design_named
from pa_ros.core.errors import ConfigError
from pa_ros.language import Vocabulary

VALUES = {"color": ("RED", "BLUE"), "shape": ("CUBE", "SPHERE")}
WORDS = Vocabulary.of(shape=VALUES["shape"], color=VALUES["color"])


@pytest.mark.parametrize(
    ("field", "value", "shown"),
    [
        ("thresholds", (-0.1,), "-0.1"),
        ("episode_steps", 0, "got 0"),
        ("joint_speed_limits", (1.0,) * 5, "(1.0, 1.0, 1.0, 1.0, 1.0)"),
        ("control_period_s", 0.105, "expected a multiple of timestep_s = 0.01, got 0.105"),
        ("arm", "panda", "expected 7 numbers, the joints of panda, got 6"),
    ],
)
def test_a_wrong_value_is_rejected_and_shown(field: str, value: Any, shown: str) -> None:
    with pytest.raises(ConfigError) as refusal:
        ArenaConfig().changed(**{field: value})
    assert shown in str(refusal.value)


def test_designs_are_those_of_figure_2() -> None:
    sizes = {
        name: (len(d.train), len(d.held_out)) for name in DESIGNS for d in [design_named(name)]
    }
    figure = {"2-C": (4, 0), "2-L": (3, 1), "3-C": (9, 0), "3-D": (6, 3), "3-D-exact": (6, 3)}
    assert {name: sizes[name] for name in figure} == figure  # extensions may have registered more
    assert design_named("2-L").held_out == (Kind(color="BLUE", shape="SPHERE"),)
    for kind in design_named("3-D").held_out:  # the diagonal: each property once
        others = [k for k in design_named("3-D").held_out if k != kind]
        assert all(kind["color"] != k["color"] and kind["shape"] != k["shape"] for k in others)
    assert design_named("2-C").vocabulary.words == ("CUBE", "SPHERE", "RED", "BLUE")
    assert design_named("3-D").vocabulary.group_sizes == (4, 5)
    assert design_named("3-D-exact").vocabulary.group_sizes == (3, 3)


@pytest.mark.parametrize(
    "change",
    [
        {"n_blocks": 5},
        {"values": VALUES | {"color": ("RED", "GREEN")}},  # no word for GREEN
        {"values": {"color": ("RED", "BLUE")}},  # without shapes
        {"novel": {"color": "RED"}},  # not new
        {"train": (Kind(color="RED", shape="CYLINDER"),)},
        {"held_out": (Kind(color="RED", shape="CUBE"),)},  # also trained
    ],
)
def test_a_contradictory_design_is_rejected(change: dict[str, Any]) -> None:
    design = Design("d", VALUES, WORDS, (Kind(color="RED", shape="CUBE"),))
    with pytest.raises(ConfigError, match="design d"):
        replace(design, **change)
