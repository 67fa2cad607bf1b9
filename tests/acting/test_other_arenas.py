"""Weights that meet an arena of another arm, other relations or objects: they act, or reject it."""

import numpy as np
import pytest

from pa_ros.acting.agent import Agent
from pa_ros.acting.errors import ActingError
from pa_ros.arena import ReachTask, design_named, preset_named, world_of
from pa_ros.core.errors import PaError
from pa_ros.core.experience import AgentKey, PolicySnapshot, PublishedPolicy, Step
from pa_ros.language import Then
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.families import FAMILIES
from pa_ros.networks.parameters import initial_actor

PLACES = {  # design, arm and relations of an arena
    "usual": ("2-L", "jaco", ("NEAR",)),
    "more words": ("3-D", "jaco", ("NEAR",)),
    "another arm": ("3-D", "panda", ("NEAR",)),
    "another relation": ("2-L", "jaco", ("ABOVE",)),
}


def task_of(place: str) -> ReachTask:
    design, arm, relations = PLACES[place]
    return ReachTask(preset_named("fast", arm), design_named(design).with_relations(*relations), 0)


def agent_of(family: str) -> Agent:
    """An agent with weights for the usual arena."""
    world = world_of(preset_named("fast"), design_named("2-L").with_relations("NEAR"))
    network = NetworkConfig(world=world, family=family, hidden=6, attention=4, canonical_hidden=8)
    tensors = initial_actor(network, np.random.default_rng(0))
    agent = Agent(AgentKey("a", 1))
    agent.offer(PublishedPolicy(PolicySnapshot(0, network.architecture, world.digest, tensors), ""))
    return agent


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("family", tuple(FAMILIES))
def test_weights_act_in_other_arenas_or_reject_them_with_a_reason(family, place) -> None:
    agent, task = agent_of(family), task_of(place)
    observation, _ = task.reset(0)
    agent.observe(Step(observation), task.program)
    agent.prepare()
    if place == "usual":
        agent.check_program(task.program)
        assert Agent(agent.key).relevance(Step(observation), task.program) == ()
        p = agent.relevance(Step(observation), Then((task.program, task.program)))
        knows = FAMILIES[family].evaluates_programs
        assert len(p) == (len(observation.objects) if knows else 0)
        assert agent.act().any()
    elif place == "another arm":
        said = "18 of the arm, as it was trained with, got 16 and 21"
        with pytest.raises(ActingError, match=said):
            agent.act()
    elif place == "another relation":
        with pytest.raises(PaError, match="ABOVE"):
            agent.check_program(task.program)
