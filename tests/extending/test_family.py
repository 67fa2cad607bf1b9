"""The example of a family of networks learns, acts and explains with all that there is."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pa_ros
from helpers.learners import NETWORK, load_example, trained
from pa_ros.core.errors import ConfigError
from pa_ros.networks.config import actor_config
from pa_ros.networks.families import family_of
from pa_ros.networks.parameters import initial_critic


def test_it_learns_in_torch_and_its_agent_acts_and_explains(tmp_path: Path) -> None:
    load_example("transformer")
    settings: dict[str, Any] = {"network.family": "transformer"}
    learner = trained(tmp_path, **settings)
    assert learner.engine.name == "torch" and learner.counters.updates > 0
    learned = learner.snapshot().tensors
    assert learned["detectors.weight"].any() and not learned["detectors.bias"].any()
    agent, arena = pa_ros.load(tmp_path), pa_ros.make_arena("2-L")
    assert agent.act(arena.observation, "NEAR(HAND, RED)").shape == (6,)
    assert "RED" in str(agent.explain(arena.observation, "NEAR(HAND, RED)"))


def test_the_seed_determines_the_initial_weights_which_the_family_may_change() -> None:
    load_example("transformer")
    network = NETWORK.changed(family="transformer")
    family = family_of(network)
    one, same, other = (
        initial_critic(network, np.random.default_rng(seed), start=-20.0) for seed in (0, 0, 1)
    )
    assert all(np.array_equal(one[name], same[name]) for name in one)
    assert not np.array_equal(one["enter.weight"], other["enter.weight"])
    assert one["output.bias"] == [-20.0] and np.all(one["layer.norm1.weight"] == 1.0)
    actor = family.initial(network, False, np.random.default_rng(0))
    assert 0 < np.abs(actor["output.weight"]).max() <= 0.01 / network.hidden**0.5


def test_its_weights_are_told_from_those_of_other_families() -> None:
    load_example("transformer")
    network = NETWORK.changed(family="transformer")
    assert actor_config(network.architecture).family == "transformer"
    assert network.architecture != NETWORK.architecture
    assert network.changed(attention=5).architecture == network.architecture
    with pytest.raises(ConfigError, match="transformer"):
        NETWORK.changed(family="transfomer")
