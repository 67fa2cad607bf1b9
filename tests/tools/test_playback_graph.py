"""A bag played into a graph: its bytes, its timing, its episodes and its learning."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from rosbags.typesys import get_types_from_msg

from helpers.processes import node_command, running
from helpers.recordings import SMALL, decoded, train
from helpers.waiting import DEADLINE_S, wait_for
from pa_ros.bags.experience import Experience
from pa_ros.bags.format import reliable_qos, topic
from pa_ros.bags.reader import Bag
from pa_ros.bags.writer import BagWriter
from pa_ros.cli.main import main
from pa_ros.ros import topics
from pa_ros.ros.environment import ros_arguments
from pa_ros.ros.executor import spin_until
from pa_ros.tools.client import client_node
from pa_ros.tools.playback import PlaybackOptions, Player
from pa_ros.tools.record import Recorder
from pa_ros.wire.definitions import installed_types, to_cdr
from pa_ros.wire.fields import header_stamp, read_stamp
from pa_ros.wire.program import ProgramRequest, encode_program
from pa_ros.wire.step import Command, encode_command

pytestmark = pytest.mark.graph
PERIOD_NS = 20_000_000
STEPS = 150


@pytest.fixture(scope="module")
def programs(tmp_path_factory) -> Path:
    """A bag of 50 programs, one every 20 ms, and a topic whose type is not installed."""
    folder = tmp_path_factory.mktemp("programs") / "bag"
    store = installed_types()
    store.register(get_types_from_msg("int32 x\n", "elsewhere_msgs/msg/Thing"))
    with BagWriter(folder) as bag:
        bag.add(topic(store, "/program", "msgs_schema/msg/Program", [reliable_qos(1, True)]))
        bag.add(topic(store, "/thing", "elsewhere_msgs/msg/Thing", [reliable_qos(10)]))
        for i in range(50):
            message = encode_program(ProgramRequest(str(i), f"NEAR(HAND, W{i})"))
            bag.write("/program", to_cdr(store, message), 10**18 + i * PERIOD_NS)
        bag.write("/thing", b"\0\1\0\0\1\0\0\0", 10**18)
    return folder


def received(node, kind):
    """Messages that a subscriber of a topic receives from here on."""
    found: list[object] = []
    node.create_subscription(kind.type, kind.name, found.append, kind.reader)
    return found


def replayed(node, bag: Path, **options):
    with Bag(bag) as opened:
        return Player(opened, node, PlaybackOptions(**options)).run()


def test_everything_is_replayed_with_the_recorded_timing_and_quality(programs):
    with client_node("test") as node:
        messages = received(node, topics.PROGRAM)
        played = replayed(node, programs, topics=("program",))
        spin_until(node, lambda: len(messages) == 50, DEADLINE_S)
        (info,) = node.get_publishers_info_by_topic("/program")
    assert [message.text for message in messages] == [f"NEAR(HAND, W{i})" for i in range(50)]
    assert played.counts == {"/program": 50}
    assert 0.0 <= min(list(played.late_s)[25:]) < 5e-3  # never early, and not ever later
    assert info.qos_profile.durability.name == "TRANSIENT_LOCAL"


def test_start_duration_and_rate(programs):
    """The latched message before the start is published too, as a late subscriber gets it."""
    with client_node("test") as node:
        messages = received(node, topics.PROGRAM)
        started = time.monotonic()
        replayed(
            node, programs, topics=("/program",), start_s=0.39, duration_s=0.3, rate=0.5, wait_s=0.5
        )
        assert time.monotonic() - started > 0.5  # never early
        spin_until(node, lambda: len(messages) == 16, DEADLINE_S)
    assert [int(message.program_id) for message in messages] == list(range(19, 35))


@pytest.mark.parametrize(
    ("arguments", "status", "said"),
    [
        (["--rate", "0", "--wait", "0"], 0, "/thing is left out: elsewhere_msgs/msg/Thing is not"),
        (["--topics", "verdict"], 2, "expected one of /program, /thing, got verdict"),
        (["--topics", "thing"], 2, "nothing to play"),
        (["--start", "1000"], 2, "--start: expected less than the bag's "),
    ],
)
def test_what_cannot_be_played_is_named(programs, capsys, arguments, status, said):
    assert main(["play", str(programs), *arguments]) == status
    output = capsys.readouterr()
    assert said in output.out + output.err


def test_loop_and_clock(programs):
    with client_node("test") as node, Bag(programs) as bag:
        messages, ticks = received(node, topics.PROGRAM), received(node, topics.ROS_CLOCK)
        options = PlaybackOptions(rate=5.0, topics=("program",), loop=True, clock=True)
        player = Player(bag, node, options)
        player.run(lambda: player.played.counts["/program"] >= 90)
        spin_until(node, lambda: len(messages) >= 90 and len(ticks) > 50, DEADLINE_S)
    assert [int(message.program_id) for message in messages[:90]] == [i % 50 for i in range(90)]
    seconds = [read_stamp(tick.clock) for tick in ticks]
    assert 10**18 - 10**8 < min(seconds) and max(seconds) <= 10**18 + 50 * PERIOD_NS


def test_a_published_clock_replaces_the_recorded_one_but_no_arenas_own() -> None:
    clock, text = "rosgraph_msgs/msg/Clock", "std_msgs/msg/String"
    types = {"/clock": clock, "/one/clock": clock, "/sim_clock": text, "/one/text": text}
    bag: Any = Mock(types=types)
    bag.qos.return_value = []
    assert set(Player(bag, Mock(), PlaybackOptions()).played.counts) == set(types)
    played = Player(bag, Mock(), PlaybackOptions(clock=True)).played
    assert set(played.counts) == set(types) - {"/clock"}


def test_playing_as_fast_as_possible_loses_nothing(tmp_path):
    """1,000 messages of 10 kB to a subscriber that keeps all and takes its time."""
    store = installed_types()
    with BagWriter(tmp_path / "bag") as bag:
        qos = [reliable_qos(1, keep_all=True)]
        bag.add(topic(store, "/trajectories", "msgs_schema/msg/Trajectory", qos))
        for i in range(1000):
            message = topics.TRAJECTORIES.type(sequence=i, program="X" * 10_000)
            bag.write("/trajectories", to_cdr(store, message), 10**18 + i)
    sequences: list[int] = []

    def receive(message) -> None:
        time.sleep(0.0002)
        sequences.append(message.sequence)

    with client_node("test") as node:
        kind = topics.TRAJECTORIES
        node.create_subscription(kind.type, kind.name, receive, kind.reader)
        replayed(node, tmp_path / "bag", rate=0.0)
        spin_until(node, lambda: len(sequences) == 1000, DEADLINE_S)
    assert sequences == list(range(1000))


def act_at_random(node, stop: Callable[[], bool]) -> None:
    """Answer an arena in lockstep, each step once."""
    kind, rng, answered = topics.JOINT_COMMANDS, np.random.default_rng(0), set()
    publisher = node.create_publisher(kind.type, kind.name, kind.writer)

    def answer(features) -> None:
        stamp = header_stamp(features)
        if stamp not in answered and len(answered) < STEPS:
            answered.add(stamp)
            action = rng.uniform(-1, 1, 6).astype(np.float32)
            command = Command(features.episode, features.step, stamp, "a", 0, action)
            publisher.publish(encode_command(command))

    features = topics.OBJECT_FEATURES
    node.create_subscription(features.type, features.name, answer, features.reader)
    assert spin_until(node, stop, DEADLINE_S)


def replay_commands(bag: Path) -> Callable[..., None]:
    def act(node, stop: Callable[[], bool]) -> None:
        replayed(node, bag, topics=("joint_commands",))
        wait_for(stop, "the last step")

    return act


def episode_of(bag: Path, act: Callable[..., None]) -> dict[tuple[str, int], tuple]:
    """What a new arena of one seed gives, recorded: all of it, by topic and stamp."""
    with client_node("test") as node, Recorder(bag, node) as recorder:
        arena = node_command("sim_node", *ros_arguments({"seed": 9, "design": "2-L"}))
        with running(bag.parent, arena):
            wait_for(lambda: recorder.counts["/arena_info"] == 1, "the arena")
            act(node, lambda: recorder.counts["/object_features"] >= STEPS)
    found: dict[tuple[str, int], tuple] = {}
    for name, message in decoded(bag):
        if name in ("/object_features", "/joint_states"):
            fields = ("episode", "step", "features", "position", "velocity", "reward", "distance")
            values = [getattr(message, field, None) for field in fields]
            found[name, header_stamp(message)] = tuple(map(repr, values))
    return found


def test_commands_replayed_into_a_fresh_arena_give_the_same_positions(tmp_path):
    """An episode and a half, with the recorded timing; every number to the last bit."""
    first = episode_of(tmp_path / "first", act_at_random)
    second = episode_of(tmp_path / "second", replay_commands(tmp_path / "first"))
    # The last step of an episode takes no command, and the first observation may be missed.
    both = first.keys() & second.keys()
    assert 2 * STEPS <= len(both) <= 2 * (STEPS + 1)
    assert [first[key] for key in both] == [second[key] for key in both]


def test_commands_for_another_arena_are_not_played(tmp_path, monkeypatch):
    """Another arena does not reach the step that the command answers."""
    store = installed_types()
    command = topics.JOINT_COMMANDS.type(agent_id="a")
    command.stamp.sec = 10**6
    with BagWriter(tmp_path / "bag") as bag:
        qos = [reliable_qos(100)]
        bag.add(topic(store, "/joint_commands", "msgs_schema/msg/JointCommand", qos))
        bag.write("/joint_commands", to_cdr(store, command), 10**18)
    monkeypatch.setattr("pa_ros.tools.playback.ACK_S", 0.3)
    with client_node("test") as node:
        topics.OBJECT_FEATURES.publisher(node)
        with pytest.raises(match="use the recorded seed"):
            replayed(node, tmp_path / "bag", wait_s=0.1)


def test_a_learner_fed_by_a_replayed_bag_learns_the_recorded_weights(tmp_path):
    assert train(tmp_path, "--record", tmp_path / "bag", frames=400) == 0
    learner = node_command("learner_node", *ros_arguments({"seed": 5, **SMALL}))
    chosen = [topics.POLICY_WEIGHTS, topics.PROVENANCE]
    names = ("arena_info", "trajectories")
    with client_node("test") as node, Recorder(tmp_path / "live", node, chosen) as recorder:
        with running(tmp_path, learner):
            replayed(node, tmp_path / "bag", rate=0.0, topics=names, wait_s=DEADLINE_S)
            wait_for(lambda: recorder.counts["/policy_weights"] == 5, "the last weights")
    live = {m.version: m.checksum for n, m in decoded(tmp_path / "live") if "weights" in n}
    with Bag(tmp_path / "bag") as bag:
        recorded = {k: one.checksum for k, one in Experience.read(bag).published.items()}
    assert live == recorded and len(live) == 5
