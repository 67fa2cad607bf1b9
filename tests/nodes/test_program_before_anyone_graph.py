"""A user's program that is there before the arena's first step is answered."""

from __future__ import annotations

from graph import graph

from agent_node.node import AgentNode
from pa_ros.ros import topics
from pa_ros.wire import codec
from pa_ros.wire.records import ProgramRequest
from sim_node.node import SimNode


def test_the_first_steps_own_program_is_announced_though_a_users_replaces_it() -> None:
    """Else the agent waits for it for ever, and a lockstep arena for the agent."""
    with graph(SimNode, agent_node__weights="random") as probe:
        text = (
            "NEAR(HAND, OR(AND(RED, CUBE), AND(RED, SPHERE), AND(BLUE, CUBE), AND(BLUE, SPHERE)))"
        )
        request = ProgramRequest("user/1", text)
        speaker = probe.speaker(topics.PROGRAM)
        speaker.publish(codec.encode_program(request))
        assert probe.until(lambda: probe.count(topics.PROGRAM_STATUS) > 0)
        assert codec.decode_program_status(probe.last(topics.PROGRAM_STATUS)).accepted
        probe.nodes.append(AgentNode())
        assert probe.reaches(5)
        assert probe.last(topics.OBJECT_FEATURES).program_id == "user/1"
