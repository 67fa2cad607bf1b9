"""Bags: of programs, of acted episodes, of small runs, and recorded from running graphs."""

import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from helpers.learners import small
from helpers.processes import pa_ros
from helpers.waiting import DEADLINE_S, wait_for
from pa_ros.arena import ARMS, Kind, ReachTask, design_named, preset_named
from pa_ros.arena.rearranging import bodies, rearrange
from pa_ros.bags.format import reliable_qos, topic
from pa_ros.bags.reader import Bag
from pa_ros.bags.writer import BagOptions, BagWriter
from pa_ros.cli.main import main
from pa_ros.core.experience import Body, Observation, Step, Verdict
from pa_ros.language import Program, parse
from pa_ros.provenance.arena import describe
from pa_ros.ros.topics import Topic
from pa_ros.wire.arena import encode_arena_info
from pa_ros.wire.definitions import installed_types, message_type, to_cdr
from pa_ros.wire.program import ProgramRequest, decode_program, encode_program
from pa_ros.wire.step import Command, encode_command, encode_joints, encode_step

STORE = installed_types()
TOPIC = topic(STORE, "/program", "msgs_schema/msg/Program", [reliable_qos(1, latched=True)])
START = 1_700_000_000_000_000_000


def payload(i: int, size: int = 10) -> bytes:
    return to_cdr(STORE, encode_program(ProgramRequest(str(i), "X" * size)))


def written(
    folder: Path, count: int, size: int = 10, close: bool = True, **options: Any
) -> BagWriter:
    """Write a bag of `count` programs, one per second; without `close`, as after SIGKILL."""
    bag = BagWriter(folder, BagOptions(**options))
    bag.add(TOPIC)
    for i in range(count):
        bag.write("/program", payload(i, size), START + i * 10**9, START + i * 10**9 - 5, i + 1)
        bag.flush()
    if close:
        bag.close({"pa_ros.test": "yes"})
    return bag


def identifiers(path: Path) -> list[int]:
    with Bag(path) as bag:
        programs = [decode_program(bag.deserialize(recorded)) for recorded in bag.messages()]
    return [int(program.program_id) for program in programs]


def storage_file(folder: Path) -> Path:
    (file,) = folder.glob("*.mcap")
    return file


STEPS = 30
Acted = tuple[Observation, Verdict, Command | None, Program, bool]
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])
ARENA, DESIGN = preset_named("fast"), design_named("2-L")


def rearranged() -> list[Acted]:
    """An episode in which the first block is removed and two others are added later."""
    task, found = ReachTask(ARENA, DESIGN, 3), list[Acted]()
    observation, verdict = task.reset(7)
    kinds = [block.kind for block in task.episode.blocks]
    for step in range(9):
        if step == 3:
            rearrange(task, kinds[1:], bodies(task)[2:])
        if step == 6:
            corners = [Body.at_rest(np.array([x, -0.4, 0.0]), UPRIGHT) for x in (-0.4, -0.3)]
            spare = Kind(**{**kinds[0], "color": "GREEN"})
            added, placed = [*kinds[1:], kinds[0], spare], [*bodies(task)[1:], *corners]
            rearrange(task, added, placed, [len(placed) - 2, len(placed) - 1])
        found.append((observation, verdict, None, task.program, False))
        observation, verdict = task.step(np.full(6, 0.2))
    return found


def acted() -> list[Acted]:
    """Two short episodes, training 7 and evaluation 7, with the commands that were executed."""
    task, rng, found = ReachTask(ARENA, DESIGN, 3), np.random.default_rng(0), []
    for evaluation in (False, True):
        observation, verdict = task.reset(7, "eval" if evaluation else "train")
        for step in range(STEPS + 1):
            action = rng.uniform(-1, 1, 6).astype(np.float32)
            stamp = observation.stamp_ns
            command = Command(7, step, stamp, "a", 4, action) if step < STEPS else None
            found.append((observation, verdict, command, task.program, evaluation))
            if command is not None:
                observation, verdict = task.step(action * np.array(ARENA.joint_speed_limits))
    return found


def recorded(folder: Path, steps: list[Acted]) -> Path:
    store = installed_types()
    with BagWriter(folder) as bag:
        clock = iter(range(10**18, 10**18 + 10**9, 1000))
        declared: set[str] = set()

        def write(name: str, message: Any) -> None:
            if name not in declared:
                declared.add(name)
                kind = message_type(type(message))
                bag.add(topic(store, name, kind, [reliable_qos(100)]))
            bag.write(name, to_cdr(store, message), next(clock))

        about = describe(ARENA, DESIGN, 3, [parse("NEAR(HAND, RED)", DESIGN.vocabulary)], "x")
        write("/arena_info", encode_arena_info(about))
        for i, (observation, verdict, command, program, evaluation) in enumerate(steps):
            features = encode_step(Step(observation, verdict, str(program), evaluation))
            parts = [
                ("/joint_states", encode_joints(observation, ARMS["jaco"].joint_names)),
                ("/object_features", features),
            ]
            if command is not None:
                parts.append(("/joint_commands", encode_command(command)))
            for name, message in parts if i % 2 else reversed(parts):
                write(name, message)
            if i == 5:
                write("/object_features", features)
    return folder


SMALL = small(20, 8, 16)


def train(out: Path, *arguments: str | Path, frames: int = 500) -> int:
    """Run `pa_ros train` with small networks; its exit status."""
    options = [f"--{name}={value}" for name, value in SMALL.items()]
    fixed = ["--seed", "5", "--eval-every", "0", "--frames", str(frames)]
    return main(["train", "--out", str(out), *fixed, *options, *map(str, arguments)])


def rewritten(
    bag: Path,
    copy: Path,
    change: Callable[[str, Any], list[Any]],
    rename: Callable[[str], str] = lambda name: name,
) -> Path:
    """A copy of a bag, each message replaced by those that `change(topic, message)` returns, and
    each topic renamed."""
    store = installed_types()
    with Bag(bag) as source, BagWriter(copy) as target:
        for name, type_name in source.types.items():
            target.add(topic(store, rename(name), type_name, source.qos(name)))
        for recorded in source.messages():
            for message in change(recorded.topic, source.deserialize(recorded)):
                payload = bytes(store.serialize_cdr(message, recorded.type_name))
                target.write(rename(recorded.topic), payload, recorded.stamp_ns)
    return copy


def decoded(bag: Path) -> list[tuple[str, Any]]:
    """(topic, message) in recorded order, decoded by mcap-ros2-support instead of our reader."""
    found = []
    for file in sorted(bag.glob("*.mcap")):
        with file.open("rb") as stream:
            reader = make_reader(stream, decoder_factories=[DecoderFactory()])
            found += [(r.channel.topic, r.decoded_message) for r in reader.iter_decoded_messages()]
    return found


def publisher_heard(node: Any, topic: Topic, listeners: int = 1) -> Any:
    """A publisher that is already connected to its subscribers."""
    publisher = node.create_publisher(topic.type, topic.name, topic.writer)
    wait_for(lambda: publisher.get_subscription_count() >= listeners, "a listener")
    return publisher


def launched(folder: Path, nodes: dict[str, Any], size: int, *words: str) -> tuple[Path, str]:
    """Launch and record a graph from the command line, and interrupt it when the bag has `size`
    bytes; the bag and what was printed. `nodes` holds the parameters of each node."""
    params = folder / "params.yaml"
    params.write_text(yaml.safe_dump({k: {"ros__parameters": v} for k, v in nodes.items()}))
    folders = ("--out", folder / "run", "--record", folder / "bag")
    with pa_ros("launch", "--params", params, *words, *folders) as process:
        try:
            storage = folder / "bag" / "bag.mcap"
            wait_for(lambda: storage.exists() and storage.stat().st_size > size, "recording")
            process.send_signal(signal.SIGINT)
            out, err = process.communicate(timeout=DEADLINE_S)
        finally:
            process.kill()
    assert process.returncode == 0, err
    return folder / "bag", out
