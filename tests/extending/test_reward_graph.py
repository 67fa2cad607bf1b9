"""A custom reward and TD3 over the graph."""

from __future__ import annotations

from pathlib import Path

import pytest

from helpers.learners import EXAMPLES, FRAMES, SMALL, load_example
from helpers.waiting import DEADLINE_S
from pa_ros.core.experience import LearnerInfo
from pa_ros.ros import topics
from pa_ros.tools.client import client_node
from pa_ros.tools.graph import start_nodes, watch
from pa_ros.tools.launch_params import Parameters
from pa_ros.tools.launcher import Supervisor
from pa_ros.wire.arena import ArenaDescription, decode_arena_info
from pa_ros.wire.learning import decode_learner_info, decode_weights
from pa_ros.world import reward_from

EXTENSIONS = [str(EXAMPLES / "reward.py")]
REWARD = '{"name": "shaped", "weight": 0.8}'


@pytest.mark.graph
def test_the_arena_announces_it_and_the_learner_learns_from_it(tmp_path: Path) -> None:
    load_example("reward")
    arenas: list[ArenaDescription] = []
    learners: list[LearnerInfo] = []
    versions: list[int] = []
    given: Parameters = {
        "sim_node": {"reward": REWARD, "extensions": EXTENSIONS},
        "agent_node": {"learning": True, "agent_id": "agent"},
        "learner_node": {"algorithm": "td3", **SMALL, "extensions": EXTENSIONS},
    }
    with Supervisor(tmp_path) as supervisor, client_node("watch") as node:
        for topic, take in (
            (topics.ARENA_INFO, lambda m: arenas.append(decode_arena_info(m))),
            (topics.LEARNER_INFO, lambda m: learners.append(decode_learner_info(m))),
            (
                topics.POLICY_WEIGHTS,
                lambda m: versions.append(decode_weights(m).snapshot.version),
            ),
        ):
            node.create_subscription(topic.type, topic.name, take, topic.reader)
        start_nodes(supervisor, given, tmp_path)

        def learned() -> bool:
            return bool(arenas and learners) and max(versions, default=0) >= FRAMES // 100

        assert watch(node, supervisor, lambda: None, learned, DEADLINE_S)
    assert arenas[0].reward == reward_from(REWARD).to_json()
    assert (learners[0].reward, learners[0].algorithm) == (arenas[0].reward, "td3")
