"""What a learner announces and publishes, made up for tests of agents."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pa_ros.acting.config import ExplorationConfig
from pa_ros.acting.requests import ArenaFacts
from pa_ros.arena import design_named, preset_named, world_of
from pa_ros.core.experience import AgentKey, PolicySnapshot
from pa_ros.core.published import LearnerInfo, PublishedPolicy
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.parameters import initial_actor
from pa_ros.world import Sparse

DESIGN, ARENA = design_named("2-L"), preset_named("fast")
WORDS, WORLD = DESIGN.vocabulary, world_of(ARENA, DESIGN)
FACTS = ArenaFacts(WORLD.digest, ARENA.control_period_s, (0.20,), Sparse().to_json())
NETWORK = NetworkConfig(world=WORLD, hidden=8, attention=4)
ME, YOU = AgentKey("me", 5), AgentKey("you", 5)

LEARNER = LearnerInfo(
    run_id="run",
    learner_id="learner",
    first_version=0,
    world_digest=FACTS.world_digest,
    architecture=NETWORK.architecture,
    trajectory_steps=10,
    policy_lag=1,
    exploration=ExplorationConfig().to_json(),
    inference="auto",
    control_period=FACTS.control_period,
    thresholds=FACTS.thresholds,
    reward=FACTS.reward,
    stamp_ns=1,
)


def again(learner: LearnerInfo, version: int, **changes: object) -> LearnerInfo:
    """The learner started once more, of the same run unless told otherwise."""
    later = {"learner_id": learner.learner_id + "'", "stamp_ns": learner.stamp_ns + 1}
    return replace(learner, **later, first_version=version, **changes)  # type: ignore[arg-type]


def snapshot(version: int, network: NetworkConfig = NETWORK) -> PolicySnapshot:
    """Weights that only their version tells."""
    tensors = initial_actor(network, np.random.default_rng(version))
    return PolicySnapshot(version, network.architecture, network.world.digest, tensors)


def published(
    version: int, mine: int = 0, yours: int = 0, learner: LearnerInfo = LEARNER
) -> PublishedPolicy:
    """A version that accounts for so many trajectories of ME and of YOU."""
    accounts = {ME: mine, YOU: yours}
    ids = learner.run_id, learner.learner_id
    return PublishedPolicy(snapshot(version), *ids, {k: n for k, n in accounts.items() if n})
