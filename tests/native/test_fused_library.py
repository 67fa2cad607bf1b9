"""When the fused update is used, by which instructions, and why it is not."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from helpers.fused_settings import setting
from helpers.worlds import dpg
from pa_ros.core.errors import ConfigError
from pa_ros.language.vocabulary import Vocabulary
from pa_ros.learning.algorithms.dpg.builder import make_engine, why_not_fused
from pa_ros.learning.algorithms.dpg.config import DPGConfig
from pa_ros.native import _fused
from pa_ros.native.errors import FusedError
from pa_ros.native.library import level
from pa_ros.world.programs import ProgramTable
from pa_ros.world.schema import ObjectSchema, OneHot, PropertyGroup
from pa_ros.world.world import World


def test_a_missing_library_is_a_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    made = setting()
    monkeypatch.setitem(sys.modules, "pa_ros.native._fused", None)
    monkeypatch.delattr("pa_ros.native._fused")
    assert "_fused" in why_not_fused(made.network, made.config)


def test_is_chosen_where_it_applies() -> None:
    made = setting()
    for choice, name in (("auto", "fused"), ("fused", "fused"), ("torch", "torch")):
        config = dpg(made.config, engine__name=choice)
        assert make_engine(made.network, config, made.table, np.random.default_rng()).name == name


def test_says_why_it_does_not_apply() -> None:
    config, network = DPGConfig(), setting().network
    assert why_not_fused(network, config) == ""
    assert why_not_fused(network.changed(family="canonical"), config) == ""
    many = tuple(f"COLOR{i}" for i in range(_fused.MAX_SLOTS + 1))
    color = PropertyGroup("color", many, OneHot(many))
    world = World(ObjectSchema((color,)), Vocabulary.of(color=many), joints=6)
    assert "slots" in why_not_fused(network.changed(world=world, family="canonical"), config)
    assert why_not_fused(network.changed(world=world), config) == ""
    assert "float64" in why_not_fused(network, dpg(config, engine__dtype="float64"))
    assert "cuda" in why_not_fused(network, dpg(config, engine__device="cuda"))
    with pytest.raises(ConfigError, match="got 'fused': .*cuda"):
        there = dpg(config, engine__name="fused", engine__device="cuda")
        make_engine(network, there, ProgramTable(network.vocabulary), np.random.default_rng())
    assert not isinstance(FusedError("x"), ConfigError)


def run_at(name: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Python in a process that is told which instructions to use."""
    environment = os.environ | {"PA_ROS_FUSED_LEVEL": name}
    command = [sys.executable, *arguments]
    return subprocess.run(command, env=environment, capture_output=True, text=True)


NARROWER = [name for name, available in _fused.levels() if available and name != level()]


@pytest.mark.parametrize("name", NARROWER)
def test_narrower_instruction_sets_agree(name: str) -> None:
    """The same gradient tests in a process that uses fewer instructions."""
    probe = "from pa_ros.native.library import level; print(level())"
    assert run_at(name, "-c", probe).stdout.strip() == name
    chosen = "number_of_programs or number_of_objects or unusual_sizes or saturate or actor_equals"
    folder = Path(__file__).parent
    files = [str(folder / f"test_fused{kind}.py") for kind in ("", "_canonical")]
    selection = ("-k", f"{chosen} or canonical and gradients")
    result = run_at(
        name, *("-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *files, *selection)
    )
    assert result.returncode == 0, result.stdout[-3000:]


def test_a_misspelt_instruction_set_is_an_error_and_not_a_reason() -> None:
    """Nobody is given torch, or other instructions, without a word."""
    probe = """
from helpers.fused_settings import setting
from pa_ros.core.errors import PaError
from pa_ros.native.library import level, why_not_network
for attempt in (level, lambda: why_not_network(setting().network)):
    try:
        attempt()
    except PaError as error:
        print(error.code, error)
"""
    folder = str(Path(__file__).parents[1])
    result = run_at("x86_64-v3", "-c", f"import sys; sys.path.insert(0, {folder!r})\n" + probe)
    known = ", ".join(name for name, _ in _fused.levels())
    lines = result.stdout.splitlines()
    assert len(lines) == 2, result.stderr[-3000:]
    for line in lines:
        assert line.startswith("learning.fused")
        assert f"PA_ROS_FUSED_LEVEL: expected one of {known} (this machine has" in line
        assert line.endswith("got 'x86_64-v3'")
