"""Families of networks: one object for all that depends on the kind."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
import torch

from helpers.worlds import PROGRAMS, WORDS, WORLD
from pa_ros.core.errors import ConfigError
from pa_ros.language import parse
from pa_ros.learning.algorithms.dpg.builder import make_engine
from pa_ros.learning.algorithms.dpg.config import DPGConfig
from pa_ros.native.library import why_not_network
from pa_ros.networks.config import NetworkConfig, actor_config
from pa_ros.networks.errors import NetworkError
from pa_ros.networks.families import FAMILIES, Programmable, codes_of, family_named
from pa_ros.world.programs import ProgramTable

NETWORK = NetworkConfig(world=WORLD, hidden=6, attention=4, canonical_hidden=8)


@pytest.mark.parametrize("name", FAMILIES)
def test_modules_take_what_they_are_told_and_have_the_tensors_of_the_table(name) -> None:
    network = NETWORK.changed(kind=name)
    table = ProgramTable(WORDS)
    rows = [table.add(program) for program in PROGRAMS]
    codes = [torch.from_numpy(code)[torch.tensor([rows])] for code in network.family.codes(table)]
    objects, arm = torch.rand(1, 3, 16), torch.rand(1, 18)
    for critic, module in enumerate(network.family.modules()):
        made = module(network)
        shapes = {k: tuple(v.shape) for k, v in made.state_dict().items()}
        assert shapes == network.family.shapes(network, critic=bool(critic))
        assert ("detectors.weight" in shapes) == network.family.detects(critic=bool(critic))
        action = [torch.rand(1, 6)] if critic else []
        answer = made(objects, arm, network.family.goals(*codes), *action)
        assert answer.shape[:2] == (1, len(PROGRAMS))


@pytest.mark.parametrize("name", FAMILIES)
def test_an_architecture_names_the_family_of_the_actor(name) -> None:
    network = NETWORK.changed(kind=name)
    there = actor_config(network.architecture)
    assert there.kind == network.family.actor
    assert there.family.shapes(there, critic=False) == network.family.shapes(network, critic=False)


def test_only_families_that_evaluate_programs_are_told_every_program() -> None:
    program = parse("NEAR(HAND, RED)", WORDS)
    for name, family in FAMILIES.items():
        network = NETWORK.changed(kind=name)
        if family.evaluates_programs:
            family.check(program, WORDS)
            assert len(codes_of(program, network)) == 3
            continue
        with pytest.raises(NetworkError):
            family.check(program, WORDS)
        with pytest.raises(NetworkError):
            codes_of(program, network)


def test_an_unknown_family_is_refused_by_name() -> None:
    with pytest.raises(ConfigError, match=r"expected one of \('programmable', .*got 'recurrent'"):
        family_named("recurrent")


@dataclass(frozen=True)
class Newcomer(Programmable):
    """A family of which the fused engine knows nothing."""


def test_a_newcomers_family_learns_by_torch(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(FAMILIES, "newcomer", Newcomer("newcomer", "newcomer", False, True))
    network = NETWORK.changed(kind="newcomer")
    assert "family 'newcomer'" in why_not_network(network)
    made = make_engine(network, DPGConfig(), ProgramTable(WORDS), np.random.default_rng(0))
    assert made.name == "torch"
    assert "detectors.weight" not in made.actor_tensors()
