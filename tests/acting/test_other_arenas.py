"""Weights that meet an arena of another arm, other relations or objects: done, or refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

from pa_ros.acting.agent import Agent, Step
from pa_ros.acting.errors import ActingError
from pa_ros.arena import (
    ArenaConfig,
    Design,
    ReachTask,
    design_named,
    preset_named,
    world_of,
)
from pa_ros.core.errors import PaError
from pa_ros.core.experience import AgentKey, Observation, PolicySnapshot, PublishedPolicy
from pa_ros.language import Program
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.errors import NetworkError
from pa_ros.networks.families import FAMILIES
from pa_ros.networks.parameters import initial_actor


@dataclass(frozen=True)
class Place:
    """A kind of arena."""

    design: str = "2-L"
    arm: str = "jaco"
    relations: tuple[str, ...] = ("NEAR",)

    @property
    def made_of(self) -> tuple[ArenaConfig, Design]:
        design = design_named(self.design).with_relations(*self.relations)
        return preset_named("fast", self.arm), design

    def network(self, family: str) -> NetworkConfig:
        world = world_of(*self.made_of)
        return NetworkConfig(world=world, family=family, hidden=6, attention=4, canonical_hidden=8)


PLACES = [
    Place(),
    Place("3-D"),
    Place("3-D-exact"),
    Place("3-D", arm="panda"),
    Place(relations=("ABOVE",)),
    Place("3-D", relations=("NEAR", "LEFT_OF")),
]


@cache
def scene(place: Place) -> tuple[Observation, Program]:
    config, design = place.made_of
    task = ReachTask(config, design, seed=0)
    observation, _ = task.reset(0)
    return observation, task.program


def agent_of(place: Place, family: str) -> Agent:
    network = place.network(family)
    tensors = initial_actor(network, np.random.default_rng(0))
    snapshot = PolicySnapshot(0, network.architecture, network.world.digest, tensors)
    agent = Agent(AgentKey("a", 1))
    agent.offer(PublishedPolicy(snapshot, ""))
    return agent


def refusal(ask: Callable[..., object], *arguments: object) -> PaError | None:
    try:
        ask(*arguments)
    except PaError as error:
        return error
    return None


@pytest.mark.parametrize("family", FAMILIES)
def test_weights_of_each_world_act_in_the_arenas_of_others_or_refuse_them(family) -> None:
    for ours in PLACES:
        for theirs in PLACES:
            agent, (observation, program) = agent_of(ours, family), scene(theirs)
            agent.observe(Step(observation, program))
            agent.prepare()
            unknown = refusal(agent.check_program, program)
            shown = refusal(agent.relevance, observation, program)
            acted = refusal(agent.act)
            one = ours.network(family).world
            if ours == theirs:
                assert (unknown, shown, acted) == (None, None, None)
            if one.arm_features != one.arm(observation).size:
                assert isinstance(acted, ActingError)
                features = f"{one.object_features} features of an object and {one.arm_features}"
                assert f"expected {features} of the arm, got" in str(acted)
            known = {*one.vocabulary.words, *one.relations}
            if family == "programmable" and not {*program.words, program.relation} <= known:
                assert unknown.code == "program.unknown_word"
            if family == "canonical" and program.relation not in one.relations:
                assert isinstance(unknown, NetworkError)
                assert "expected a relation of" in str(unknown) and str(program) in str(unknown)
