"""Agents that see, over the graph: the same bits as in one process, and EQUAL when repeated."""

from contextlib import closing
from copy import copy, deepcopy
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest

from agent_node.node import AgentNode
from helpers.graph import Probe, graph, learned_over_the_graph
from helpers.learners import small
from helpers.pictures import opengl
from pa_ros.acting.agent import Agent
from pa_ros.acting.errors import ActingError
from pa_ros.agents import load_agent
from pa_ros.arena.render import top_view
from pa_ros.bags.episodes import episodes
from pa_ros.bags.experience import Experience, arenas_of
from pa_ros.bags.film import RecordedScene
from pa_ros.bags.reader import Bag
from pa_ros.bags.verify import learner_of, verify
from pa_ros.cli import main as cli
from pa_ros.core.experience import AgentKey, PublishedPolicy
from pa_ros.learning.checkpoints import load_policy
from pa_ros.networks.config import actor_config
from pa_ros.ros import topics
from pa_ros.tools.launch_params import load_parameters, packaged, seeing
from pa_ros.wire.arena import decode_arena_info
from pa_ros.wire.fields import header_stamp, write_stamp
from pa_ros.wire.learning import weights_checksum
from pa_ros.wire.step import decode_step
from pa_ros.world.schema import ObjectSchema

pytest.importorskip("cv2", reason="no OpenCV: install programmable-agents[camera]")
from sim_node.camera.node import CameraNode
from sim_node.node import SimNode

SEED, EPISODES = 7, 5  # in the first of these episodes the arm hides a block for a while
SETTINGS = small(20, 16, 32)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a run's `bag` and its `checkpoint`."""
    opengl()
    folder = tmp_path_factory.mktemp("seen")
    train = ["train", "--design", "2-L", "--perception", "camera", "--seed", str(SEED)]
    settings = [word for name, value in SETTINGS.items() for word in (f"--{name}", str(value))]
    out = ["--out", str(folder), "--record", str(folder / "bag"), "--eval-every", "0"]
    assert cli.main([*train, *settings, *out, "--frames", str(100 * EPISODES)]) == 0
    return folder


def test_a_run_from_pictures_is_repeated_to_the_last_bit(recorded: Path) -> None:
    with Bag(recorded / "bag") as bag:
        experience = Experience.read(bag)
        assert len(experience.keys) > EPISODES  # an object was found within an episode
        found = verify(experience)
        sizes = {
            one.trajectory.objects.shape[1]
            for one in experience.used(experience.arenas[0].world)
            if one.trajectory is not None
        }
    assert found.equal and found.checked == found.frames == 100 * EPISODES
    assert len(sizes) > 1


def test_a_film_shows_blocks_that_were_only_seen_in_grey(recorded: Path) -> None:
    with Bag(recorded / "bag") as bag:
        episode, arena = next(iter(episodes(bag))), arenas_of(bag)[-1]
    stage = RecordedScene(arena, episode.rows[0].step)
    stage.show(episode.rows[-1].step)
    assert stage.task.verifier.named == ()
    table = top_view(stage.task, 200).reshape(-1, 3).astype(int)
    assert int(np.ptp(table, axis=1).max()) < 20, "no color but the table's"


def test_learning_from_its_bag_keeps_the_camera(recorded: Path, tmp_path: Path) -> None:
    assert cli.main(["train", "--from-bag", str(recorded / "bag"), "--out", str(tmp_path)]) == 0
    assert load_agent(tmp_path).perception == load_agent(recorded).perception


def test_an_agent_in_an_arena_with_another_camera_is_told_so(recorded: Path) -> None:
    policy = load_policy(recorded / "checkpoint")
    world, agent = actor_config(policy.architecture).world, Agent(AgentKey("a", 1))
    agent.offer(PublishedPolicy(policy, run_id=""))
    agent.check_world(world)
    changed = [{**group, "calibration": "another"} for group in world.schema.to_data()]
    with pytest.raises(ActingError, match="expected properties seen with the camera's calibration"):
        agent.check_world(replace(world, schema=ObjectSchema.from_data(changed)))


def test_launch_takes_the_camera_of_the_agents_checkpoint() -> None:
    executed = seeing(load_parameters(packaged("execute_3d")), "camera")
    assert executed["agent_node"]["checkpoint"] == "shipped:camera"
    assert executed["sim_node"]["perception"] == "shipped:camera"
    assert seeing(load_parameters(packaged("train_2l")), "corner")["sim_node"] == {
        **load_parameters(packaged("train_2l"))["sim_node"],
        "perception": "corner",
    }


@pytest.mark.graph
def test_the_graph_learns_the_same_bits_from_pictures(recorded: Path, tmp_path: Path) -> None:
    given = {
        "sim_node": {"seed": SEED, "perception": "camera", "eval_every_episodes": 1},
        "agent_node": {"learning": True, "seed": SEED, "agent_id": "agent"},
        "learner_node": {"seed": SEED, **SETTINGS, "out": str(tmp_path / "run")},
    }
    there, arena = learned_over_the_graph(tmp_path / "graph", given, version=3)
    assert arena.perception == load_agent(recorded).perception
    assert load_agent(tmp_path / "run").perception == arena.perception
    with Bag(recorded / "bag") as bag:
        experience = Experience.read(bag)
        learner = learner_of(experience)
        for one in experience.used(learner.network.world):
            if one.trajectory is not None and learner.counters.version < there.version:
                learner.consume(one.trajectory)
    assert learner.counters.version == there.version
    assert weights_checksum(learner.snapshot()) == weights_checksum(there)


@pytest.mark.graph
def test_the_console_shows_what_an_arena_sees(recorded: Path) -> None:
    pytest.importorskip("viser", reason="the extra `console` is not installed")
    from pa_ros.console.live import LiveConsole

    page = MagicMock()
    scene = {"sim_node__perception": str(recorded / "checkpoint"), "sim_node__mode": "real_time"}
    with graph(SimNode, **scene) as probe, closing(LiveConsole(probe, probe, page, "")) as console:

        def shown() -> bool:
            console.tick(pages=1)
            return bool(page.show_picture.called)

        assert probe.until(shown)
        task = probe.nodes[0].session.task
        (picture,) = page.show_picture.call_args[0]
        boxes = (picture != task.pictures()[0]).any(-1)
        left, top, right, bottom = task.sight.tracker.tracks[0].looks[0].box
        assert boxes[top, left : right + 1].all() and boxes.mean() < 0.2


class Relay:
    """Passes the arena's pictures on to camera_node, until it is told to stop."""

    def __init__(self, probe: Probe) -> None:
        self.on = True
        self.picture, self.info = (
            self._pass_on(probe, topic) for topic in (topics.CAMERA_IMAGE, topics.CAMERA_INFO)
        )

    def _pass_on(self, probe: Probe, topic: topics.Topic) -> Any:
        out = topic.within("relayed").publisher(probe)
        topic.subscribe(probe, lambda message: out.publish(message) if self.on else None)
        return out


@pytest.mark.graph
def test_an_agent_acts_by_what_camera_node_sees_and_holds_when_pictures_stop(
    recorded: Path,
) -> None:
    checkpoint = str(recorded / "checkpoint")
    seen, info = (t.within("seen") for t in (topics.OBJECT_FEATURES, topics.ARENA_INFO))
    remaps = [
        *(f"agent_node:{name}:=seen/{name}" for name in ("object_features", "arena_info")),
        *(f"camera_node:camera/{n}:=relayed/camera/{n}" for n in ("image_raw", "camera_info")),
    ]
    camera = {"rate_hz": 10.0, "view": "above", "width": 240, "height": 240}
    given = {f"sim_node__camera.{name}": value for name, value in camera.items()}
    given |= {"sim_node__mode": "real_time", "camera_node__perception": checkpoint}
    given |= {"agent_node__weights": "checkpoint", "agent_node__checkpoint": checkpoint}
    with graph(SimNode, CameraNode, AgentNode, remaps=remaps, **given) as probe:
        steps: list[Any] = []
        arenas: list[Any] = []
        seen.subscribe(probe, steps.append)
        info.subscribe(probe, arenas.append)
        relay = Relay(probe)
        assert probe.until(lambda: probe.count(topics.JOINT_COMMANDS) > 20)
        world = decode_arena_info(arenas[-1]).world
        assert world.digest == actor_config(load_policy(Path(checkpoint)).architecture).world.digest
        true = probe.last(topics.OBJECT_FEATURES)
        shown = decode_step(steps[-1], world.joints, world.object_features).observation
        assert 1 < len(shown.objects) <= true.object_count
        assert probe.until(lambda: probe.message("camera_node").startswith("sees "))
        good = probe.last(topics.CAMERA_IMAGE), probe.last(topics.CAMERA_INFO)

        relay.on = False
        stopped = "the arm holds: expected camera/image_raw and camera/camera_info, got none of use"
        assert probe.until(lambda: stopped in probe.message("camera_node"))
        probe.until(lambda: False, 1.0)  # what was under way has arrived
        before, commands = len(steps), probe.count(topics.JOINT_COMMANDS)

        def holds() -> int:
            return int(probe.value("sim_node", "holds"))

        held = holds()
        assert probe.until(lambda: holds() > held + 5)
        assert (len(steps), probe.count(topics.JOINT_COMMANDS)) == (before, commands)

        assert probe.until(partial(_is_early, probe, relay.picture, deepcopy(good[0])))
        old, odd, small, blind = deepcopy(good[0]), copy(good[0]), copy(good[0]), copy(good[1])
        old.header.stamp.sec, odd.encoding = 0, "yuv422"
        small.height, small.data = 120, small.data[: 120 * small.step]
        blind.k = np.zeros(9)
        for out, bad, code in (
            (relay.picture, old, "perception.stamp"),
            (relay.picture, odd, "wire.encoding"),
            (relay.picture, small, "perception.picture"),
            (relay.info, blind, "wire.uncalibrated"),
        ):
            assert probe.until(partial(_is_refused, probe, out, bad, code)), code
        said = "s; refused: camera/camera_info: camera_info.k: exp"
        assert probe.until(lambda: said in probe.message("camera_node"))
        relay.on = True
        assert probe.until(lambda: len(steps) > before + 5)
        assert probe.until(lambda: probe.message("camera_node").endswith(" objects"))


def _is_early(probe: Probe, out: Any, picture: Any) -> bool:
    """Publish a picture half a second ahead of the steps; whether camera_node has said so."""
    step_ns = header_stamp(probe.last(topics.OBJECT_FEATURES))
    write_stamp(picture.header.stamp, step_ns + 5 * 10**8)
    out.publish(picture)
    return "some that are later than every step" in probe.message("camera_node")


def _is_refused(probe: Probe, out: Any, bad: Any, code: str) -> bool:
    """Publish a bad message once more; whether camera_node has refused it."""
    if code != "perception.stamp":
        bad.header.stamp = probe.last(topics.OBJECT_FEATURES).header.stamp
    out.publish(bad)
    return bool(probe.value("camera_node", f"refused.{code}"))
