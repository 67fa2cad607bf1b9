"""`pa_ros launch` and `pa_ros send` on graphs of real processes, in ROS domains of their own."""

import os
import re
import signal
from pathlib import Path

import pytest

from helpers.processes import pa_ros, processes_of
from helpers.waiting import DEADLINE_S, wait_for
from pa_ros.cli.main import main

pytestmark = pytest.mark.graph
ARENA = """
sim_node:
  ros__parameters: {mode: real_time, real_time_factor: 20.0, program_source: topic, seed: 3}
agent_node:
  ros__parameters: {weights: random}
"""


class Launch:
    """A `pa_ros launch` of an arena and an agent with random weights."""

    def __init__(self, folder: Path, namespace: str) -> None:
        self.folder = folder
        params = folder / "given.yaml"
        params.write_text(ARENA)
        options = ["--params", str(params), "--out", str(folder / "run"), "--namespace", namespace]
        self.process = pa_ros("launch", *options)

    @property
    def nodes(self) -> list[int]:
        return processes_of(self.folder, "--params-file")

    def wait_until_up(self) -> None:
        wait_for(lambda: len(self.nodes) == 2, "two nodes")

    def end(self) -> tuple[int, str, str]:
        """Status, standard output and standard error, once it has ended."""
        out, err = self.process.communicate(timeout=DEADLINE_S)
        return self.process.returncode, out, err

    def close(self) -> None:
        self.process.kill()
        self.process.communicate(timeout=DEADLINE_S)
        wait_for(lambda: not self.nodes, "no process left")


@pytest.fixture
def launch(tmp_path):
    started: list[Launch] = []

    def start(namespace: str) -> Launch:
        folder = tmp_path / namespace
        folder.mkdir()
        started.append(Launch(folder, namespace))
        return started[-1]

    yield start
    for one in started:
        one.close()


def test_programs_are_pursued_accepted_and_refused_and_ctrl_c_stops_all_nodes(launch, capfd):
    def send(*arguments: str) -> tuple[int, str, str]:
        """The exit status and what is printed."""
        status = main(["send", *arguments, "--namespace", "/arena1", "--timeout", "50"])
        said = capfd.readouterr()
        return status, said.out, said.err

    graph = launch(namespace="arena1")
    program = "NEAR( HAND,RED )"
    status, out, err = send(program)
    assert status == 0, err
    assert "/arena1/agent_node, /arena1/sim_node: accepted NEAR(HAND, RED)" in out

    # With random weights the arm hardly moves, and no block starts within reach.
    status, out, err = send(program, "--wait")
    assert status == 1, err
    assert re.search(r"0\.\d+ m; p of [A-Z ]+ 0\.\d\d, ", out)  # feedback
    assert re.search(r"not satisfied: distance 0\.\d+ m: the time limit came", out)

    status, out, err = send("NEAR(HAND, AND(RAD, CUBE))")
    assert status == 2
    assert "program.unknown_word" in err and "did you mean RED?" in err
    suggested = err.partition("programs that make sense now:\n")[2].split("\n")
    assert all(line.startswith("  NEAR(HAND, ") for line in suggested[:-1]) and len(suggested) > 3

    status, out, err = send("--scene", "5")
    assert status == 0, err
    episode, blocks, active, distance, *_ = out.splitlines()
    assert episode == "began episode 5" and blocks.startswith("blocks: ") and " m" in distance
    assert active == "program: NEAR(HAND, RED)"

    graph.process.send_signal(signal.SIGINT)
    status, out, err = graph.end()
    assert (status, err) == (0, "")
    assert "started sim_node, agent_node" in out
    assert out.endswith("stopping\nstopped agent_node\nstopped sim_node\n")
    assert not graph.nodes


def test_a_node_that_dies_ends_its_launch_and_no_node_outlives_a_killed_launcher(tmp_path, launch):
    one, other = launch(namespace="one"), launch(namespace="other")
    one.wait_until_up()
    os.kill(one.nodes[0], signal.SIGKILL)
    other.wait_until_up()
    other.process.kill()
    status, _, err = one.end()
    assert status == 1 and "ended by itself (killed by SIGKILL)" in err
    wait_for(lambda: not processes_of(tmp_path, "--params-file"), "all nodes to end")
