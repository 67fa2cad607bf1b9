"""A bag back in the graph: its bytes, its timing, its episodes and its learning."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from rosbags.typesys import get_types_from_msg

from helpers.recordings import SMALL, decoded, train, written
from helpers.waiting import DEADLINE_S, wait_for
from pa_ros.bags.experience import Experience
from pa_ros.bags.format import reliable_qos, topic
from pa_ros.bags.reader import Bag
from pa_ros.bags.writer import BagWriter
from pa_ros.cli.main import main
from pa_ros.core.errors import ConfigError
from pa_ros.ros import topics
from pa_ros.ros.executor import spin_until
from pa_ros.tools.client import client_node
from pa_ros.tools.playback import PlaybackError, PlaybackOptions, Player
from pa_ros.tools.record import Recorder
from pa_ros.wire.definitions import installed_types, to_cdr
from pa_ros.wire.fields import header_stamp
from pa_ros.wire.program import ProgramRequest, encode_program
from pa_ros.wire.step import Command, decode_clock, encode_command

pytestmark = pytest.mark.graph
PERIOD_NS = 20_000_000
STEPS = 150


@pytest.fixture
def programs(tmp_path) -> Path:
    """50 programs, one every 20 ms; a verdict, and a topic whose type is nowhere installed."""
    store = installed_types()
    store.register(get_types_from_msg("int32 x\n", "elsewhere_msgs/msg/Thing"))
    with BagWriter(tmp_path / "programs") as bag:
        bag.add(topic(store, "/program", "msgs_schema/msg/Program", [reliable_qos(1, True)]))
        bag.add(topic(store, "/thing", "elsewhere_msgs/msg/Thing", [reliable_qos(10)]))
        for i in range(50):
            message = encode_program(ProgramRequest(str(i), f"NEAR(HAND, W{i})"))
            bag.write("/program", to_cdr(store, message), 10**18 + i * PERIOD_NS)
        bag.write("/thing", b"\0\1\0\0\1\0\0\0", 10**18)
    return tmp_path / "programs"


def listened(node, kind):
    """Messages that a reader of a topic hears from here on."""
    heard: list[object] = []
    node.create_subscription(kind.type, kind.name, heard.append, kind.reader)
    return heard


def replayed(node, bag: Path, **options):
    with Bag(bag) as opened:
        return Player(opened, node, PlaybackOptions(**options)).run()


def test_everything_is_replayed_with_the_recorded_timing_and_quality(programs):
    with client_node("test") as node:
        heard = listened(node, topics.PROGRAM)
        played = replayed(node, programs, topics=("program",))
        spin_until(node, lambda: len(heard) == 50, DEADLINE_S)
        (info,) = node.get_publishers_info_by_topic("/program")
    assert [message.text for message in heard] == [f"NEAR(HAND, W{i})" for i in range(50)]
    assert played.counts == {"/program": 50}
    assert 0.0 <= min(list(played.late_s)[25:]) < 5e-3  # never early, and not ever later
    assert info.qos_profile.durability.name == "TRANSIENT_LOCAL"


def test_start_duration_and_rate(programs):
    """The latched message before the start is published too, as a late joiner would hear it."""
    with client_node("test") as node:
        heard = listened(node, topics.PROGRAM)
        started = time.monotonic()
        replayed(
            node, programs, topics=("/program",), start_s=0.39, duration_s=0.3, rate=0.5, wait_s=0.5
        )
        assert time.monotonic() - started > 0.5  # never early
        spin_until(node, lambda: len(heard) == 16, DEADLINE_S)
    assert [int(message.program_id) for message in heard] == list(range(19, 35))


def test_a_type_that_is_not_here_is_passed_over_and_an_unknown_topic_refused(programs, capsys):
    assert main(["play", str(programs), "--rate", "0", "--wait", "0.1"]) == 0
    out = capsys.readouterr().out
    assert "/thing is left out: elsewhere_msgs/msg/Thing is not installed here" in out
    assert "nobody listened to /program" in out
    assert main(["play", str(programs), "--topics", "verdict"]) == 2
    assert "expected one of /program, /thing, got verdict" in capsys.readouterr().err
    assert main(["play", str(programs), "--topics", "thing"]) == 2
    with pytest.raises(ConfigError, match="got -1"):
        PlaybackOptions(rate=-1)


def test_a_start_beyond_the_end_is_refused(programs, capsys):
    assert main(["play", str(programs), "--start", "1000"]) == 2
    assert "--start: expected less than the bag's " in capsys.readouterr().err


def test_what_holds_nothing_is_not_played_in_a_loop(tmp_path):
    written(tmp_path / "bag", 0)
    with client_node("test") as node:
        played = replayed(node, tmp_path / "bag", loop=True, wait_s=0.0)
    assert played.counts == {"/program": 0}


def test_loop_and_clock(programs):
    with client_node("test") as node, Bag(programs) as bag:
        heard, ticks = listened(node, topics.PROGRAM), listened(node, topics.ROS_CLOCK)
        options = PlaybackOptions(rate=5.0, topics=("program",), loop=True, clock=True)
        player = Player(bag, node, options)
        player.run(lambda: player.played.counts["/program"] >= 90)
        spin_until(node, lambda: len(heard) >= 90 and len(ticks) > 50, DEADLINE_S)
    assert [int(message.program_id) for message in heard[:90]] == [i % 50 for i in range(90)]
    seconds = [decode_clock(tick) for tick in ticks]
    assert 10**18 - 10**8 < min(seconds) and max(seconds) <= 10**18 + 50 * PERIOD_NS


def test_as_fast_as_it_is_taken_loses_nothing(tmp_path):
    """2,000 messages of 10 kB to a reader that keeps all and takes its time."""
    store = installed_types()
    with BagWriter(tmp_path / "bag") as bag:
        qos = [reliable_qos(1, keep_all=True)]
        bag.add(topic(store, "/trajectories", "msgs_schema/msg/Trajectory", qos))
        for i in range(2000):
            message = topics.TRAJECTORIES.type(sequence=i, program="X" * 10_000)
            bag.write("/trajectories", to_cdr(store, message), 10**18 + i)
    heard: list[int] = []

    def receive(message) -> None:
        time.sleep(0.0002)
        heard.append(message.sequence)

    with client_node("test") as node:
        kind = topics.TRAJECTORIES
        node.create_subscription(kind.type, kind.name, receive, kind.reader)
        replayed(node, tmp_path / "bag", rate=0.0)
        spin_until(node, lambda: len(heard) == 2000, DEADLINE_S)
    assert heard == list(range(2000))


@contextmanager
def process(node: str, *parameters: str) -> Iterator[None]:
    """A node of ours as a process of its own."""
    arguments = [part for parameter in parameters for part in ("-p", parameter)]
    command = [sys.executable, "-m", f"{node}.main", "--ros-args", *arguments]
    with subprocess.Popen(command) as running:
        try:
            yield
        finally:
            running.terminate()
            running.wait(DEADLINE_S)


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
        with process("sim_node", "seed:=9", "design:=2-L"):
            wait_for(lambda: recorder.counts["/arena_info"] == 1, "the arena")
            act(node, lambda: recorder.counts["/verdict"] >= STEPS)
    found: dict[tuple[str, int], tuple] = {}
    for name, message in decoded(bag):
        if name in ("/object_features", "/joint_states", "/verdict"):
            fields = ("episode", "step", "features", "position", "velocity", "reward", "distance")
            values = [getattr(message, field, None) for field in fields]
            found[name, header_stamp(message)] = tuple(map(repr, values))
    return found


def test_commands_replayed_into_a_fresh_arena_give_the_same_positions(tmp_path):
    """An episode and a half, with the recorded timing; every number to the last bit."""
    first = episode_of(tmp_path / "first", act_at_random)
    second = episode_of(tmp_path / "second", replay_commands(tmp_path / "first"))
    # The last step of an episode takes no command; an arena may speak once before it is heard.
    assert 3 * STEPS <= len(first.keys() & second.keys()) <= 3 * (STEPS + 1)
    assert {key: first[key] for key in first.keys() & second.keys()} == {
        key: second[key] for key in first.keys() & second.keys()
    }


def test_commands_without_their_arena_say_so(tmp_path, monkeypatch):
    """An arena that stands elsewhere never comes to the step that is answered."""
    store = installed_types()
    command = topics.JOINT_COMMANDS.type(agent_id="a")
    command.header.stamp.sec = 10**6
    with BagWriter(tmp_path / "bag") as bag:
        qos = [reliable_qos(100)]
        bag.add(topic(store, "/joint_commands", "msgs_schema/msg/JointCommand", qos))
        bag.write("/joint_commands", to_cdr(store, command), 10**18)
    monkeypatch.setattr("pa_ros.tools.playback.ACK_S", 0.3)
    with client_node("test") as node:
        node.create_publisher(
            topics.OBJECT_FEATURES.type, topics.OBJECT_FEATURES.name, topics.OBJECT_FEATURES.writer
        )
        with pytest.raises(PlaybackError, match="another seed"):
            replayed(node, tmp_path / "bag", wait_s=0.1)


def test_a_learner_fed_by_a_replayed_bag_learns_the_recorded_weights(tmp_path):
    assert train(tmp_path, "--record", tmp_path / "bag", frames=400) == 0
    settings = [f"{name}:={value}" for name, value in SMALL.items()]
    chosen = [topics.POLICY_WEIGHTS, topics.PROVENANCE]
    names = ("arena_info", "trajectories")
    with client_node("test") as node, Recorder(tmp_path / "live", node, chosen) as recorder:
        with process("learner_node", "seed:=5", *settings):
            replayed(node, tmp_path / "bag", rate=0.0, topics=names, wait_s=DEADLINE_S)
            wait_for(lambda: recorder.counts["/policy_weights"] == 5, "the last weights")
    live = {m.version: m.checksum for n, m in decoded(tmp_path / "live") if "weights" in n}
    with Bag(tmp_path / "bag") as bag:
        recorded = {k: one.checksum for k, one in Experience(bag).published.items()}
    assert live == recorded and len(live) == 5
