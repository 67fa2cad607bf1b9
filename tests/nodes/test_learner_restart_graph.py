"""A learner that goes and comes again beside agents that stay: nothing missing, nobody alarmed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from agent_node.node import AgentNode
from helpers.graph import Probe, begin_run, graph
from learner_node.config import LearnerNodeConfig
from learner_node.node import LearnerNode
from sim_node.node import SimNode

pytestmark = pytest.mark.graph

OPTIONS: dict[str, Any] = {
    "learner.replay.warmup_frames": 20,
    "learner.replay.batch_size": 8,
    "learner.schedule.trajectory_steps": 10,
    "network.hidden": 16,
}
GIVEN = {
    "agent_node__learning": True,
    "agent_node__resend_period_s": 0.5,
    **{f"learner_node__{name}": value for name, value in OPTIONS.items()},
}


def replace_learner(probe: Probe) -> None:
    """Stop the learner as SIGTERM does, let the agents come to a halt, and start another."""
    *others, learner = probe.nodes
    learner.executor.remove_node(learner)
    learner.close()
    learner.destroy_node()
    probe.nodes = others
    probe.until(lambda: False, 1.5)  # the agent sends what nobody hears, and then waits
    probe.heard["policy_weights"].clear()
    probe.health.pop("/learner_node")
    probe.nodes = [*others, LearnerNode()]


def version(probe: Probe) -> int:
    return int(float(probe.value("learner_node", "version") or 0))


def assert_all_is_well(probe: Probe, above: int) -> None:
    """Versions advance, no trajectory is missing, and learner and agent say OK."""
    assert probe.until(lambda: version(probe) > above + 10)
    assert probe.until(lambda: probe.value("learner_node", "missing_trajectories") == "0")
    assert probe.until(lambda: probe.message("learner_node") == "learning")
    # for as long as the one that went may still be there, the agent says that there are two
    assert probe.until(lambda: probe.message("agent_node") == "acting")
    assert probe.health["/learner_node"].level == probe.health["/agent_node"].level == 0


def test_a_learner_stopped_and_resumed_beside_its_agent_misses_nothing(tmp_path: Path) -> None:
    out = str(tmp_path / "run")
    begin_run(LearnerNodeConfig(**OPTIONS, out=out))  # to go on from both times
    nodes = SimNode, AgentNode, LearnerNode
    with graph(*nodes, **GIVEN, learner_node__out=out, learner_node__resume=True) as probe:
        assert probe.until(lambda: version(probe) > 10)
        before = version(probe)
        replace_learner(probe)
        assert_all_is_well(probe, before)
        assert probe.value("learner_node", "lost_trajectories") == "0"


def test_another_run_beside_an_old_agent_misses_nothing() -> None:
    with graph(SimNode, AgentNode, LearnerNode, **GIVEN) as probe:
        assert probe.until(lambda: version(probe) > 10)
        replace_learner(probe)
        assert_all_is_well(probe, 0)
