"""A node as a process: parameters, exit status, and what it leaves behind."""

from __future__ import annotations

import array
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from helpers.waiting import DEADLINE_S, wait_for
from pa_ros.ros import topics
from pa_ros.ros.environment import (
    LOOPBACK_PROFILE,
    NETWORK_CHOICES,
    prepare_environment,
    ros_arguments,
)
from pa_ros.ros.node_main import PARENT
from pa_ros.tools.client import client_node

graph = pytest.mark.graph
LOOPBACK, MULTICAST = "0100007F", "0100FFEF"  # 127.0.0.1; 239.255.0.1, bound on loopback


def start(node: str, *arguments: str, **variables: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        ["env", "--default-signal=HUP", sys.executable, "-m", f"{node}.main", *arguments],
        env={**os.environ, **variables},
        stderr=subprocess.PIPE,
        text=True,
    )


def sockets_of(pid: int) -> set[str]:
    """Local addresses, in hexadecimal, of a process's UDP and TCP sockets."""
    links = []
    for entry in Path(f"/proc/{pid}/fd").iterdir():
        try:
            links.append(os.readlink(entry))
        except OSError:
            continue
    inodes = {link[8:-1] for link in links if link.startswith("socket:")}
    found = set()
    for table in ("udp", "udp6", "tcp", "tcp6"):
        for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            columns = line.split()
            if columns[9] in inodes:
                found.add(columns[1].split(":")[0])
    return found


def shared_memory_of(pid: int) -> list[str]:
    """Segments of a middleware's shared memory that a process has."""
    mapped = Path(f"/proc/{pid}/maps").read_text().splitlines()
    return [line for line in mapped if "/dev/shm/fastrtps" in line]


@graph
@pytest.mark.parametrize(
    ("node", "parameters", "reason"),
    [
        ("sim_node", {"design": "9-Z"}, "got '9-Z'"),
        ("sim_node", {"sed": 3}, "got ['sed']"),
        ("agent_node", {"weights": "checkpoint", "checkpoint": "/no/such"}, "found none"),
        ("learner_node", {"resume": True, "out": "/no/such"}, "found none"),
        ("agent_node", {"weights": "checkpoint", "checkpoint": "x" * 300}, "found none"),
        ("learner_node", {"out": "x" * 300}, "File name too long"),
        ("agent_node", {"learner": "~foo"}, "learner: expected a namespace"),
        ("learner_node", {"arenas": ["a b"]}, "arenas: expected a namespace"),
    ],
)
def test_a_parameter_that_cannot_be_is_refused_with_the_value(node, parameters, reason):
    process = start(node, *ros_arguments(parameters))
    _, errors = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 2
    assert reason in errors and errors.startswith(f"{node}: [")
    assert "Traceback" not in errors


@graph
def test_a_missing_parameters_file_is_refused():
    process = start("sim_node", *ros_arguments(params_file="/no/such.yaml"))
    _, errors = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 2
    assert "/no/such.yaml" in errors and "Traceback" not in errors


@graph
def test_a_node_logs_elsewhere_where_its_user_has_no_home(tmp_path):
    without = {"HOME": "/proc/none", "TMPDIR": str(tmp_path)}
    process = start("sim_node", **without)
    wait_for(lambda: LOOPBACK in sockets_of(process.pid), "a socket")
    process.terminate()
    _, errors = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 0, errors
    assert list(tmp_path.glob(f"pa_ros-log-{os.getuid()}/*"))


@graph
@pytest.mark.parametrize("command", [["sim_node.main"], ["pa_ros", "send", "RED"]])
def test_a_folder_for_logs_that_cannot_be_written_is_one_line(command):
    process = subprocess.run(
        [sys.executable, "-m", *command],
        env={**os.environ, "ROS_LOG_DIR": "/proc/none"},
        stderr=subprocess.PIPE,
        text=True,
        timeout=DEADLINE_S,
    )
    assert process.returncode == 2
    assert "/proc/none" in process.stderr and "Traceback" not in process.stderr


@graph
def test_a_node_listens_on_this_machine_alone_and_leaves_nothing_when_killed():
    process = start("sim_node")
    wait_for(lambda: len(sockets_of(process.pid)) > 1, "both kinds of sockets")
    assert sockets_of(process.pid) == {LOOPBACK, MULTICAST}
    assert not shared_memory_of(process.pid)  # else it stayed behind
    process.kill()
    process.communicate(timeout=DEADLINE_S)


def resident_mb(pid: int) -> float:
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


@graph
def test_what_a_large_message_took_is_given_back():
    large = topics.JOINT_COMMANDS.type(action=array.array("f", bytes(100_000_000)))
    with start("sim_node") as process, client_node("test") as node:
        publisher = topics.JOINT_COMMANDS.publisher(node)
        wait_for(publisher.get_subscription_count, "an arena")
        before, most = resident_mb(process.pid), 0.0

        def passed() -> bool:
            nonlocal most
            most = max(most, resident_mb(process.pid))
            return most > before + 100 and resident_mb(process.pid) < before + 30

        publisher.publish(large)
        try:
            wait_for(passed, f"memory as it was, {before:.0f} MB")
        finally:
            process.terminate()
        assert "received 25000000" in process.communicate(timeout=DEADLINE_S)[1]


@graph
@pytest.mark.parametrize(
    ("number", "autostart"),
    [(signal.SIGINT, True), (signal.SIGTERM, False), (signal.SIGHUP, True)],
)
def test_a_node_stops_cleanly_when_asked(number, autostart):
    process = start("sim_node", *ros_arguments({"autostart": autostart}))
    try:
        wait_for(lambda: LOOPBACK in sockets_of(process.pid), "a socket")
        process.send_signal(number)
        _, errors = process.communicate(timeout=DEADLINE_S)
    finally:
        process.kill()
    assert process.returncode == 0
    assert "Traceback" not in errors


INTERRUPTED_EARLY = """
import os, signal, sys

class Interrupts:
    def find_spec(self, name, *_):
        if name == "rclpy":
            sys.meta_path.remove(self)
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Interrupts())
from sim_node.main import main
sys.exit(main())
"""


@graph
def test_a_node_stops_cleanly_when_asked_while_it_starts():
    process = subprocess.run(
        [sys.executable, "-c", INTERRUPTED_EARLY],
        stderr=subprocess.PIPE, text=True, timeout=DEADLINE_S,
    )  # fmt: skip
    assert process.returncode == 0, process.stderr
    assert "Traceback" not in process.stderr


@graph
def test_a_node_whose_launcher_is_gone_does_not_start():
    process = start("sim_node", **{PARENT: "1"})
    process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 1


@pytest.mark.parametrize("choice", NETWORK_CHOICES)
def test_the_users_choice_of_network_stands(choice, monkeypatch):
    for name in NETWORK_CHOICES:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv(choice, "theirs")
    prepare_environment()
    set_now = {name: os.environ[name] for name in NETWORK_CHOICES if name in os.environ}
    assert set_now == {choice: "theirs"}


def test_without_a_choice_the_graph_stays_on_this_machine(monkeypatch):
    for name in NETWORK_CHOICES:
        monkeypatch.delenv(name, raising=False)
    prepare_environment()
    assert os.environ["FASTRTPS_DEFAULT_PROFILES_FILE"] == str(LOOPBACK_PROFILE)
    assert LOOPBACK_PROFILE.is_file()
    monkeypatch.delenv("FASTRTPS_DEFAULT_PROFILES_FILE")


def test_without_a_home_nothing_is_made_anywhere_else(monkeypatch, tmp_path):
    for name in ("HOME", "ROS_HOME", "ROS_LOG_DIR"):
        monkeypatch.setenv(name, "")  # noted, to be as it was afterwards
        del os.environ[name]
    made = []
    monkeypatch.setattr("os.makedirs", lambda path, **_: made.append(path))
    prepare_environment()
    assert os.environ["ROS_LOG_DIR"].endswith(f"pa_ros-log-{os.getuid()}") and not made
    del os.environ["ROS_LOG_DIR"]
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    (tmp_path / "log").mkdir()
    prepare_environment()
    assert "ROS_LOG_DIR" not in os.environ and made == [f"{tmp_path}/log"]


def test_arguments_carry_parameters_names_and_remaps():
    arguments = ros_arguments(
        {"a": True, "b": 0.5, "c": ["x", "y=1"], "d": "3"},
        params_file="p.yaml", namespace="/arena1", name="n", remaps={"program": "/program"},
    )  # fmt: skip
    assert arguments == [
        "--ros-args", "--params-file", "p.yaml", "-p", "a:=true", "-p", "b:=0.5",
        "-p", 'c:=["x", "y=1"]', "-p", 'd:="3"', "-r", "__ns:=/arena1", "-r", "__node:=n",
        "-r", "program:=/program",
    ]  # fmt: skip
