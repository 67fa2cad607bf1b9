"""What arena, agent and learner do, and don't, in each state of the standard's lifecycle."""

import gc
from pathlib import Path

import numpy as np
import pytest
from rclpy.parameter import Parameter

from agent_node.node import AgentNode
from helpers.graph import (
    ACTIVATE,
    CLEANUP,
    CONFIGURE,
    DEACTIVATE,
    SCENE,
    SMALL,
    SMALL_LEARNER,
    TRAINED,
    Probe,
    User,
    goals_of,
    graph,
)
from helpers.learners import ARENA, trajectory
from learner_node.node import LearnerNode
from learner_node.worker import LearnerWorker
from pa_ros.learning.checkpoints import read_metadata
from pa_ros.learning.folder import checkpoint_of
from pa_ros.ros import topics
from pa_ros.ros.health import WARN
from pa_ros.wire.arena import encode_arena_info
from pa_ros.wire.fields import read_stamp
from pa_ros.wire.learning import encode_trajectory
from pa_ros.wire.services import ResetRequest, encode_reset
from pa_ros.wire.step import Command, encode_command
from sim_node.node import SimNode

pytestmark = pytest.mark.graph
KINDS = ("task", "fd")  # threads and open files of this process
STEPS = SMALL["learner.schedule.trajectory_steps"]
LEARNING = {
    "sim_node__resend_period_s": 0.2,
    "agent_node__learning": True,
    "agent_node__agent_id": "a",
    "agent_node__resend_period_s": 0.2,
    **SMALL_LEARNER,
}


def stays_silent(probe: Probe, topic: topics.Topic, for_s: float = 0.4) -> bool:
    """Whether nothing more of a topic comes, what was under way being over."""
    probe.until(lambda: False, 0.1)
    before = probe.count(topic)
    probe.until(lambda: False, for_s)
    return probe.count(topic) == before


def resumes(probe: Probe, topic: topics.Topic, more: int = 3) -> bool:
    """Whether more messages of a topic come."""
    before = probe.count(topic)
    return probe.until(lambda: probe.count(topic) >= before + more)


def test_time_stops_in_an_inactive_arena_which_rejects_requests() -> None:
    with graph(SimNode, **SCENE) as probe:
        arena = probe.nodes[0]
        user, speaker = User(probe, arena), probe.speaker(topics.JOINT_COMMANDS)
        assert resumes(probe, topics.OBJECT_FEATURES)
        assert user.ask(DEACTIVATE) == (True, "inactive")
        for topic in (topics.OBJECT_FEATURES, topics.CLOCK, topics.TF):
            assert stays_silent(probe, topic)
        speaker.publish(encode_command(Command(0, 0, 0, "me", 0, np.ones(6, np.float32))))
        asked = probe.call(topics.RESET, encode_reset(ResetRequest(3)))
        assert (asked.success, asked.code) == (False, "arena.inactive")
        assert probe.until(lambda: arena.refusals.counts["arena.inactive"] == 2)
        assert probe.until(lambda: probe.message("sim_node").startswith("inactive: waits to be"))
        assert probe.health["/sim_node"].level == WARN
        stamp, arena_id = arena.session.current.observation.stamp_ns, arena.session.arena_id
        assert user.ask(ACTIVATE) == (True, "active")
        assert resumes(probe, topics.CLOCK) and arena.session.arena_id == arena_id
        assert arena.session.current.observation.stamp_ns > stamp
        stamps = [read_stamp(tick.clock) for tick in probe.heard["clock"]]
        assert stamps == sorted(stamps)


def test_an_arena_configured_again_has_a_new_id_and_new_parameters() -> None:
    with graph(SimNode, AgentNode, **TRAINED, sim_node__design="3-D") as probe:
        arena, agent = probe.nodes
        user, before = User(probe, arena), arena.session.arena_id
        assert probe.until(lambda: agent.arena is not None)
        user.ask(DEACTIVATE)
        user.ask(CLEANUP)
        assert user.set("design", "9-Z").startswith("design: expected one of ['2-C', ")
        assert user.set("seed", 5) == user.set("design", "3-C") == ""
        assert user.ask(CONFIGURE) == (True, "inactive")
        assert user.ask(ACTIVATE) == (True, "active")
        assert arena.session.arena_id != before and arena.config.seed == 5
        assert probe.until(lambda: agent.arena.arena_id == arena.session.arena_id)
        assert resumes(probe, topics.JOINT_COMMANDS)


def test_an_agent_configured_again_is_no_second_agent() -> None:
    with graph(SimNode, AgentNode, **SCENE, **TRAINED, sim_node__real_time_factor=5.0) as probe:
        arena, agent = probe.nodes
        user, name = User(probe, agent), agent.agent_id
        assert resumes(probe, topics.JOINT_COMMANDS)
        for transition in (DEACTIVATE, CLEANUP, CONFIGURE, ACTIVATE):
            assert user.ask(transition)[0]
        assert resumes(probe, topics.JOINT_COMMANDS, 5) and agent.agent_id == name
        said = [arena.collect()[1], agent.collect()[1]]
        assert resumes(probe, topics.JOINT_COMMANDS, 5)
        assert {*said, arena.collect()[1], agent.collect()[1]} == {"running", "acting"}


def test_an_inactive_agent_sends_no_commands_and_aborts_its_goal() -> None:
    given = {"sim_node__program_source": "topic", "agent_node__controller": "velocity"}
    with (
        graph(SimNode, AgentNode, **SCENE, **TRAINED, **given) as probe,
        goals_of(probe) as client,
    ):
        arena, agent = probe.nodes
        user = User(probe, agent)
        assert probe.until(lambda: probe.count(topics.OBJECT_FEATURES) > 0)

        def result(text: str, then=lambda: None, hold_s=1.0):
            handle = client.send(text, hold_s=hold_s)
            then()
            return client.result(handle)[1]

        def deactivate() -> None:
            assert resumes(probe, topics.VELOCITY_COMMANDS)
            assert user.ask(DEACTIVATE) == (True, "inactive")

        ended = result("NEAR(HAND, AND(GREEN, CUBE))", deactivate, hold_s=1e9)
        assert (ended.success, ended.code) == (False, "goal.inactive") and ended.reason
        assert stays_silent(probe, topics.JOINT_COMMANDS)
        assert not any(probe.last(topics.VELOCITY_COMMANDS).data)
        assert probe.until(lambda: not arena.session.task.simulation.data.qvel[:6].round(2).any())
        assert result("NEAR(HAND, RED)").code == "goal.inactive"
        assert user.ask(ACTIVATE) == (True, "active")
        assert resumes(probe, topics.JOINT_COMMANDS)
        assert result("NEAR(HAND, AND(RED, CUBE))").success


def sent_and_accounted(probe: Probe) -> tuple[int, int, int]:
    """Trajectories that were completed, those that wait for the learner, those it learned from."""
    _, agent, learner = probe.nodes
    frames = int(learner.worker.metrics["frames"])
    assert frames % STEPS == 0
    completed = int(agent.collect()[2]["trajectories"])
    return completed, len(agent.agent.unaccounted), frames // STEPS


def test_deactivating_nodes_loses_and_duplicates_no_trajectory(tmp_path: Path) -> None:
    out = tmp_path / "run"
    with graph(SimNode, AgentNode, LearnerNode, **LEARNING, learner_node__out=out) as probe:
        learner = probe.nodes[-1]
        users = [User(probe, node) for node in probe.nodes]
        arena_user, agent_user, learner_user = users

        def version() -> int:
            return int(learner.worker.metrics["version"]) if learner.worker else 0

        def advances() -> bool:
            since = version()
            return probe.until(lambda: version() > since + 2)

        assert advances()
        for user in (learner_user, agent_user, arena_user, learner_user):
            assert user.ask(DEACTIVATE) == (True, "inactive")
            probe.until(lambda: False, 0.5)  # in which others go on, if they do, and send again
            if user is learner_user:
                saved = read_metadata(checkpoint_of(out))["counters"]["version"]
                assert saved == version() and stays_silent(probe, topics.POLICY_WEIGHTS)
            assert user.ask(ACTIVATE) == (True, "active")
            assert advances()
        # The arena holds; then what was sent is what is accounted for, each once.
        assert arena_user.ask(DEACTIVATE) == (True, "inactive")
        assert probe.until(lambda: sent_and_accounted(probe)[1] == 0)
        completed, _, learned = sent_and_accounted(probe)
        assert completed == learned == version()
        metrics = learner.worker.metrics
        assert metrics["missing_trajectories"] == metrics["lost_trajectories"] == 0
        assert probe.nodes[1].agent.lost == 0 and probe.nodes[1].agent.interrupted == 0


def test_a_learner_resumes_its_run_after_cleanup(tmp_path: Path) -> None:
    given = {k: v for k, v in LEARNING.items() if k.startswith("learner_node__")}
    given["learner_node__out"] = tmp_path / "run"
    with graph(LearnerNode, **given) as probe:
        learner = probe.nodes[0]
        user, sent = User(probe, learner), probe.speaker(topics.TRAJECTORIES)

        def worker() -> LearnerWorker:
            assert learner.worker is not None
            return learner.worker

        def learned(*numbers: int) -> None:
            for number in numbers:
                sent.publish(encode_trajectory(trajectory(number)))
            frames = 10 * (numbers[-1] + 1)
            assert probe.until(
                lambda: learner.worker is not None and worker().metrics["frames"] == frames
            )

        assert user.ask(DEACTIVATE) == (True, "inactive")
        probe.speaker(topics.ARENA_INFO).publish(encode_arena_info(ARENA))
        assert probe.until(lambda: probe.count(topics.ARENA_INFO) > 0)
        assert learner.worker is None
        assert user.ask(ACTIVATE) == (True, "active")
        learned(0, 1)
        assert user.ask(DEACTIVATE) == (True, "inactive")
        sent.publish(encode_trajectory(trajectory(2)))
        probe.until(lambda: False, 0.3)
        assert worker().metrics["frames"] == 20 and worker().backlog == 0
        assert user.ask(ACTIVATE) == (True, "active")
        learned(2)
        run_id = worker().run.info.run_id
        assert user.ask(DEACTIVATE) == (True, "inactive")
        assert user.ask(CLEANUP) == (True, "unconfigured")
        assert user.ask(CONFIGURE) == (False, "unconfigured")
        assert learner.refusals.counts["learning.folder_used"] == 1
        assert user.set("resume", True) == ""
        assert user.ask(CONFIGURE) == (True, "inactive")
        assert user.ask(ACTIVATE) == (True, "active")
        learned(3)
        assert worker().run.info.run_id == run_id
    assert read_metadata(checkpoint_of(tmp_path / "run"))["counters"]["version"] == 4


def test_going_through_all_states_again_and_again_leaves_nothing_behind(tmp_path: Path) -> None:
    out = tmp_path / "run"
    with graph(SimNode, AgentNode, LearnerNode, **LEARNING, learner_node__out=out) as probe:

        def cycle() -> None:
            for node in probe.nodes:
                for change in ("deactivate", "cleanup", "configure", "activate"):
                    getattr(node, f"trigger_{change}")()
                    probe.until(lambda: True, 0.0)
                    if node.has_parameter("resume"):
                        node.set_parameters([Parameter("resume", value=True)])
                assert node.state == "active"
            assert resumes(probe, topics.OBJECT_FEATURES)

        def left() -> list[int]:
            gc.collect()
            groups = [len(node.default_callback_group.entities) for node in probe.nodes]
            return [*groups, *(len(list(Path(f"/proc/self/{kind}").iterdir())) for kind in KINDS)]

        assert resumes(probe, topics.POLICY_WEIGHTS)
        cycle()
        before = left()
        for _ in range(5):
            cycle()
        # The agent makes and destroys some subscriptions as others come and go.
        assert all(now < then + 20 for now, then in zip(left(), before, strict=True))
