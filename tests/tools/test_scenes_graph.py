"""What stands on the table of an arena that runs, and what could be asked there."""

import subprocess
import sys
from dataclasses import replace

import pytest

from helpers.graph import graph
from pa_ros.arena import ArenaConfig, design_named, preset_named, training_programs
from pa_ros.arena.task import world_of
from pa_ros.cli.main import main
from pa_ros.core.errors import ConfigError
from pa_ros.language import parse, require_target
from pa_ros.ros import topics
from pa_ros.tools.arm import Arm
from pa_ros.tools.monitor import GraphFigures
from pa_ros.tools.scenes import SceneFigures, SceneMonitor, suggested_programs
from pa_ros.wire.arena import describe_robot, encode_arena_info
from pa_ros.wire.program import ProgramRequest, encode_program
from pa_ros.wire.services import ResetRequest, encode_reset
from sim_node.node import SimNode

ARENA = {
    "sim_node__design": "3-D", "sim_node__seed": 2, "sim_node__program_source": "topic",
    "sim_node__condition": "ignore-new",  # some blocks have words that programs don't know
}  # fmt: skip


@pytest.mark.graph
def test_samples_show_blocks_program_and_distance_of_an_arena_that_waits():
    """In lockstep, with nobody who commands: the step that stands is shown all the same."""
    with graph(SimNode, **ARENA) as probe:
        monitor, other = SceneMonitor(probe), SceneMonitor(probe, "/elsewhere")
        assert probe.until(lambda: monitor.scene is not None)
        scene, session = monitor.scene, probe.nodes[0].session
        arena = scene.arena
        kinds = [block.kind.words for block in session.task.episode.blocks]
        assert other.scene is None
        assert dict(scene.rows())["program"] == "none"
        assert list(scene.blocks) == [str(b.kind) for b in session.task.episode.blocks]
        found = scene.programs
        vocabulary = arena.world.vocabulary
        for text in found:
            require_target(parse(text, vocabulary), kinds, None)
        assert len(found) > 4
        both = [name.split() for name in scene.blocks if {*name.split()} <= {*vocabulary.words}]
        named = [f"NEAR(HAND, AND({color}, {shape}))" for color, shape in both]
        assert list(found[: len(both)]) == named, "in the order of the blocks"

        request = encode_program(ProgramRequest("a", found[0]))
        probe.speaker(topics.PROGRAM).publish(request)
        assert probe.until(lambda: monitor.scene.program == found[0])
        assert probe.until(lambda: " m" in monitor.scene.line())
        fleet = SceneFigures(probe, GraphFigures(), ["", "elsewhere"])
        one = SceneFigures(probe, GraphFigures(), [])
        assert probe.until(lambda: "blocks" in dict(one.rows()))
        labels = [label for label, _ in one.rows()]
        assert labels[-5:] == ["blocks", "program", "distance", "refused messages", "alarms"]
        assert found[0] in one.line() and "/elsewhere: at" in dict(fleet.rows())

        before = scene.blocks
        outcome = probe.call(topics.RESET, encode_reset(ResetRequest(episode=7)))
        assert outcome.success
        assert probe.until(lambda: monitor.scene.episode == 7 and monitor.scene.blocks != before)


def test_where_blocks_can_be_moved_programs_that_move_one_are_suggested_first():
    design = design_named("push-2")
    world = world_of(preset_named(design.preset), design)
    about = describe_robot(world, {f"joint_{i}": 1.0 for i in range(world.joints)}, 0.1)
    about = replace(about, training_programs=training_programs(design))
    found = suggested_programs(about, ("RED CUBE", "BLUE CYLINDER", "RED PLACE"))
    to_block, to_place = found[:2]
    assert to_block == "NEAR(AND(RED, CUBE), AND(BLUE, CYLINDER))"
    assert to_place == "NEAR(AND(BLUE, CYLINDER), AND(RED, PLACE))"
    moves_hand = [parse(text, world.vocabulary).moves_hand for text in found]
    assert moves_hand == sorted(moves_hand) and moves_hand[-1]


@pytest.mark.graph
def test_an_arena_without_samples_is_seen_by_its_steps_until_samples_come():
    away = [f"sim_node:{topics.SAMPLES.name}:=away"]
    with graph(SimNode, remaps=away, **ARENA) as probe:

        def readers() -> int:
            return probe.count_subscribers(topics.OBJECT_FEATURES.name) - 1  # the probe's own

        monitor = SceneMonitor(probe)
        assert probe.until(lambda: readers() == 1)
        assert probe.call(topics.RESET, encode_reset(ResetRequest(episode=7))).success
        assert probe.until(lambda: monitor.scene is not None and monitor.scene.episode == 7)
        shown = topics.SAMPLES.publisher(probe)
        assert probe.until(lambda: readers() == 0)
        probe.destroy_publisher(shown)
        assert probe.until(lambda: readers() == 1)


@pytest.mark.graph
def test_an_arena_that_only_describes_itself_or_is_elsewhere_is_told_from_none(monkeypatch):
    monkeypatch.setattr("pa_ros.tools.connection.NOTICE_S", 0.2)
    with graph() as probe:
        world = world_of(ArenaConfig(), design_named("3-D"))
        about = describe_robot(world, {f"joint_{i}": 1.0 for i in range(world.joints)}, 0.1)
        left = topics.ARENA_INFO.within("left").publisher(probe)
        left.publish(encode_arena_info(about))
        monkeypatch.setattr("pa_ros.tools.connection.namespaces_of_arenas", lambda _: ("/left",))
        with pytest.raises(ConfigError, match=r"expected one with an arena \(/left\), got /$"):
            Arm()
        command = [sys.executable, "-m", "pa_ros", "send", "--timeout", "8", "--namespace", "left"]
        with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as sent:
            assert probe.until(lambda: sent.poll() is not None)
            assert sent.returncode == 3
            assert f"arena {about.arena_id} describes itself, but no" in sent.stderr.read()


@pytest.mark.graph
def test_a_sender_says_early_that_there_is_no_arena(monkeypatch, capfd):
    monkeypatch.setattr("pa_ros.tools.connection.NOTICE_S", 0.2)
    assert main(["send", "NEAR(HAND, RED)", "--timeout", "0.5"]) == 3
    first, last = capfd.readouterr().err.splitlines()
    assert first.endswith(", namespace /: waits for one, 0.5 s at most")
    assert "within 0.5 s" in last
