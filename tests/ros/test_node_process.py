"""A node as a process: arguments, exit status, sockets, shared memory."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from helpers.waiting import DEADLINE_S, wait_for
from pa_ros.cli.main import COMMANDS, NEED_ROS
from pa_ros.ros.environment import (
    LOCALHOST_ONLY,
    LOOPBACK_PROFILE,
    NETWORK_CHOICES,
    PEERS,
    RANGE,
    prepare_environment,
    ros_arguments,
)
from pa_ros.ros.node_main import PARENT

graph = pytest.mark.graph
LOOPBACK, MULTICAST = "0100007F", "0100FFEF"  # 127.0.0.1; 239.255.0.1, bound on loopback


def start(node: str, *arguments: str, **variables: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", f"{node}.main", *arguments],
        env={**os.environ, **variables},
        stderr=subprocess.PIPE,
        text=True,
    )


def stopped(process: subprocess.Popen[str], number: signal.Signals) -> int:
    """The exit status of a process after a signal; it must print no traceback."""
    process.send_signal(number)
    _, errors = process.communicate(timeout=DEADLINE_S)
    assert "Traceback" not in errors
    return process.returncode


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
    ("node", "arguments", "reason"),
    [
        ("sim_node", ros_arguments({"design": "9-Z"}), "got '9-Z'"),
        ("sim_node", ["fast"], "expected --ros-args or --help, got 'fast'"),
        ("learner_node", ros_arguments({"resume": True, "out": "/no/such"}), "found none"),
    ],
)
def test_a_bad_argument_or_parameter_is_refused_with_its_value(node, arguments, reason):
    process = start(node, *arguments)
    _, errors = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 2
    assert reason in errors and f"{node}: [" in errors
    assert "Traceback" not in errors


@graph
def test_a_node_of_a_user_without_home_logs_to_the_temporary_folder(tmp_path):
    without = {"HOME": "/proc/none", "TMPDIR": str(tmp_path)}
    process = start("sim_node", *ros_arguments({"autostart": False}), **without)
    wait_for(lambda: LOOPBACK in sockets_of(process.pid), "a socket")
    assert stopped(process, signal.SIGINT) == 0
    assert list(tmp_path.glob(f"pa_ros-log-{os.getuid()}/*"))


@graph
def test_a_folder_for_logs_that_cannot_be_written_is_rejected_in_one_line():
    process = start("sim_node", ROS_LOG_DIR="/proc/none")
    _, errors = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 2
    assert "/proc/none" in errors and "Traceback" not in errors


@graph
def test_a_node_listens_only_on_loopback_uses_no_shared_memory_and_stops_when_asked():
    process = start("sim_node")
    wait_for(lambda: len(sockets_of(process.pid)) > 1, "both kinds of sockets")
    assert sockets_of(process.pid) == {LOOPBACK, MULTICAST}
    assert not shared_memory_of(process.pid)  # it would be left behind by SIGKILL
    assert stopped(process, signal.SIGTERM) == 0


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
def test_the_users_choice_of_network_is_kept(choice, monkeypatch):
    for name in NETWORK_CHOICES:
        monkeypatch.delenv(name, raising=False)
    theirs = "SUBNET" if choice == RANGE else "theirs"
    monkeypatch.setenv(choice, theirs)
    prepare_environment()
    set_now = {name: os.environ[name] for name in NETWORK_CHOICES if name in os.environ}
    assert set_now == {choice: theirs}


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({}, ""),
        ({RANGE: "LOCALHOST"}, ""),
        ({RANGE: "localhost"}, ""),
        ({RANGE: "subnet"}, "got 'subnet': takes it for LOCALHOST"),
        ({RANGE: "OFF", PEERS: "10.0.0.1"}, ""),
        ({LOCALHOST_ONLY: "1", RANGE: "SUBNET", PEERS: "10.0.0.1"}, ""),
    ],
)
def test_the_graph_stays_on_this_machine(asked, said, monkeypatch, capsys):
    for name in (*NETWORK_CHOICES, LOCALHOST_ONLY):
        monkeypatch.setenv(name, asked.get(name, ""))
    prepare_environment()
    # ROS listens on every interface if one of these is left beside the profile.
    assert os.environ.get(RANGE, "") in ("", "OFF") and not os.environ.get(LOCALHOST_ONLY)
    errors = capsys.readouterr().err
    assert said in errors and len(errors.splitlines()) == bool(said)
    assert os.environ["FASTRTPS_DEFAULT_PROFILES_FILE"] == str(LOOPBACK_PROFILE)
    assert LOOPBACK_PROFILE.is_file()
    monkeypatch.delenv("FASTRTPS_DEFAULT_PROFILES_FILE")


STARTS = {
    "node": ["-m", "sim_node.main"],
    "command": ["-m", "pa_ros", "send"],
    "notebook": ["-c", "import pa_ros\ntry: pa_ros.Arm\nexcept ImportError as e: exit(str(e))"],
}


@pytest.mark.parametrize("name", ["PYTHONPATH", "RMW_IMPLEMENTATION", "RCL_ASSERT_RMW_ID_MATCHES"])
@pytest.mark.parametrize("start", STARTS.values(), ids=STARTS)
def test_an_environment_for_another_ros_is_refused_in_one_line(name, start, tmp_path):
    (tmp_path / "rclpy").mkdir()
    (tmp_path / "rclpy/__init__.py").write_text("raise ImportError('rclpy._pybind11\\nsee')")
    value = str(tmp_path) if name == "PYTHONPATH" else "rmw_cyclonedds_cpp"
    env = {**os.environ, name: value}
    done = subprocess.run([sys.executable, *start], env=env, stderr=subprocess.PIPE, text=True)
    assert done.returncode in (1, 2) and len(done.stderr.splitlines()) == 1, done.stderr
    assert name in done.stderr and value in done.stderr and "unset" in done.stderr


def test_other_commands_do_not_import_ros():
    modules = [module for name, (module, _) in COMMANDS.items() if name not in NEED_ROS]
    code = f"import sys, {', '.join(modules)}; sys.exit('rclpy' in sys.modules)"
    env = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2] / "pa_ros")}  # the laboratory
    assert subprocess.run([sys.executable, "-c", code], env=env).returncode == 0


@graph
@pytest.mark.parametrize("closed", ["2>&-", ">&-", "<&- >&- 2>&-"])
def test_nodes_and_commands_run_without_standard_streams(closed):
    send = f'"$1" -m pa_ros send --timeout 0.5 {closed}; echo $?'
    command = ["sh", "-c", f'{send}; exec "$1" -m sim_node.main {closed}', "sh", sys.executable]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "3\n", "the status where there is no arena"
        wait_for(lambda: len(sockets_of(process.pid)) > 1, "sockets of the node")
        process.send_signal(signal.SIGTERM)
        assert process.wait(DEADLINE_S) == 0


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
