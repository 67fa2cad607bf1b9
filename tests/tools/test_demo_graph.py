"""`pa_ros demo` on the graph: what it leaves when it gives up, is interrupted, and executes."""

import json
import re
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from helpers.waiting import DEADLINE_S, wait_for
from pa_ros.acting.execution import Execution
from pa_ros.arena import design_named, preset_named, training_programs, world_of
from pa_ros.core.errors import ConfigError
from pa_ros.evaluation.scoring.tally import HeldOutTarget
from pa_ros.learning.checkpoints import load_policy, save_checkpoint
from pa_ros.learning.learner import Learner
from pa_ros.learning.protocols import protocol_named
from pa_ros.tools.client import client_node
from pa_ros.tools.demo import phases
from pa_ros.tools.demo.config import DemoConfig
from pa_ros.tools.demo.results import Outcome, write_report
from pa_ros.tools.demo.scenes import demo_programs, find_scene

graph = pytest.mark.graph
DESIGN, ARENA = design_named("2-L"), preset_named("fast")


def start(folder: Path, *options: str) -> subprocess.Popen:
    command = [sys.executable, "-m", "pa_ros", "demo", "--out", str(folder), *options]
    pipe = subprocess.PIPE
    return subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True)


def processes_of(folder: Path) -> list[Path]:
    """Running processes that name a folder in their command, the demo's own left out."""
    needle = f"{folder}/".encode()
    found = []
    for entry in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            if needle in entry.read_bytes():
                found.append(entry)
        except (FileNotFoundError, ProcessLookupError):
            continue
    return found


def is_served(address: str) -> bool:
    try:
        return bool(urlopen(address, timeout=5).status == 200)
    except (OSError, ValueError):
        return False


@graph
def test_too_little_time_is_said_and_leaves_what_was_learned(tmp_path):
    folder = tmp_path / "demo"
    with start(
        folder, "--no-shipped", "--no-console", "--minutes", "0.2", "--seed", "5"
    ) as process:
        out, err = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 1, err
    assert "Target NOT reached" in out and "No success within 0.2 minutes" in out
    assert load_policy(folder / "checkpoint").version > 0
    report = json.loads((folder / "demo.json").read_text())
    assert report["demo.reached"] == report["demo.programs"] == 0
    assert report["demo.frames"] > 100 and report["demo.train_wall_s"] >= 12
    assert (folder / "learning-curve.png").exists() and (folder / "phi.png").exists()
    assert not processes_of(tmp_path)


@graph
def test_ctrl_c_stops_everything_and_the_page(tmp_path):
    folder = tmp_path / "demo"
    with start(folder, "--no-shipped") as process:
        try:
            assert process.stdout is not None
            said = re.compile(
                r"the page to look at, in a moment: (\S+/)\?websocket=\S+/(\S+)|no page to look"
            )
            found = next(filter(None, map(said.match, process.stdout)))
            if found[1]:
                wait_for(lambda: is_served(found[1]), "the page")
                assert not any(found[2] in said for said in command_lines())  # all users see those
                log = folder / "log" / "console.log"
                wait_for(lambda: found[2] in log.read_text(), "the same token")
            learning = re.compile("zero-shot score.*frames [1-9]")
            assert any(learning.match(line) for line in process.stdout)
            assert len(processes_of(folder)) == 3
            process.send_signal(signal.SIGINT)
            out, _ = process.communicate(timeout=DEADLINE_S)
        finally:
            process.kill()
    assert process.returncode == 130 and "interrupted" in out
    assert not (found[1] and is_served(found[1]))
    assert not processes_of(tmp_path)


def command_lines() -> list[str]:
    found = []
    for entry in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):
            found.append(entry.read_bytes().decode(errors="replace"))
    return found


def demo_config(folder: Path, real_time_factor: float) -> DemoConfig:
    return DemoConfig(
        design=DESIGN,
        arena=ARENA,
        seed=0,
        minutes=1.0,
        folder=folder / "demo",
        real_time_factor=real_time_factor,
    )


@graph
def test_programs_are_executed_on_the_graph_and_recorded(tmp_path):
    """With untrained weights, and faster: the path is the same."""
    protocol = protocol_named("ours")
    network = protocol.network_config(world_of(ARENA, DESIGN))
    config = demo_config(tmp_path, real_time_factor=20.0)
    learner = Learner(network, protocol.learner, training_programs(DESIGN), 0)
    save_checkpoint(config.checkpoint, learner)
    programs, outcome = demo_programs(DESIGN), Outcome(reached=True)
    scenes = [find_scene(ARENA, DESIGN, config.scene_seed, p) for p in programs]
    with client_node("test") as node:
        asked = list(zip(programs, scenes, strict=True))
        phases.execute_programs(node, config, asked, outcome, lambda: False)
    assert [program for program, _, _ in outcome.executions] == programs
    for _, scene, execution in outcome.executions:
        # The arm hardly moves, so the distance shows that the scene asked for was up.
        assert execution.distance == pytest.approx(scene.distance, abs=0.2)
        assert not execution.satisfied and execution.ended == "window"
    assert not outcome.success
    assert sent_programs(config.folder / "programs") == [program.text for program in programs]
    assert not processes_of(tmp_path)


@graph
def test_the_shipped_agent_executes_in_a_folder_of_its_own(tmp_path):
    config = demo_config(tmp_path, real_time_factor=5.0)
    shipped, outcome = config.of_shipped(), Outcome()
    with client_node("test") as node:
        phases.show_shipped(node, shipped, outcome, lambda: False)
    assert shipped.folder == config.folder / "shipped" and shipped.design.name == "3-D"
    assert outcome.executed, [e for _, _, e in outcome.executions]
    assert len(sent_programs(shipped.folder / "programs")) == 6
    target = HeldOutTarget(random=-0.97, scripted=0.88)
    write_report(config, target, Outcome(), outcome)
    report = json.loads((config.folder / "demo.json").read_text())
    assert report["shipped.programs"] == 6 and report["shipped.held_out.satisfied"] == 1
    assert report["demo.programs"] == 0 and not processes_of(tmp_path)


def sent_programs(bag: Path) -> list[str]:
    with (bag / f"{bag.name}.mcap").open("rb") as stream:
        rows = make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages(
            topics=["/program"]
        )
        messages = [row.decoded_message for row in rows]
    # Who isn't heard in time says it again under the same id: one program.
    return list({m.program_id: m.text for m in messages}.values())


def outcome_of(satisfied: list[bool], reached: bool = True) -> Outcome:
    nowhere: Any = None  # where it was executed does not matter
    executions = [
        (program, nowhere, Execution(near, 0.1, 1.0 if near else None, 2.0, "held"))
        for program, near in zip(demo_programs(DESIGN), satisfied, strict=True)
    ]
    return Outcome(reached=reached, executions=executions)


@pytest.mark.parametrize(
    ("satisfied", "reached", "success"),
    [
        ([True] * 6, True, True),
        ([False] + [True] * 5, True, True),  # five, the held-out one among them
        ([True, False] + [True] * 4, True, False),  # the held-out one is needed
        ([False, True, False] + [True] * 3, True, False),
        ([True] * 6, False, False),
    ],
)
def test_success_is_the_held_out_program_and_five_of_six(satisfied, reached, success):
    assert outcome_of(satisfied, reached).success is success


@pytest.mark.parametrize(
    ("seed", "minutes", "reason"),
    [(-1, 20.0, "got -1"), (0, 0.0, "got 0"), (0, float("nan"), "nan")],
)
def test_options_that_cannot_be_are_refused(seed, minutes, reason, tmp_path):
    with pytest.raises(ConfigError, match=reason):
        DemoConfig(design=DESIGN, arena=ARENA, seed=seed, minutes=minutes, folder=tmp_path)


@pytest.mark.parametrize("preset", ["fast", "paper"])
def test_the_nodes_learn_by_our_protocol_on_either_arm(preset, tmp_path):
    training = DemoConfig(design=DESIGN, arena=preset_named(preset), folder=tmp_path).training()
    assert training["sim_node"]["preset"] == preset
    assert training["learner_node"]["protocol"] == "ours"
    assert "protocol" not in training["agent_node"]
