"""Children are watched, stopped in bounds, never outlive their launcher, and get a free domain."""

import os
import signal
import sys
from pathlib import Path

import pytest

from helpers.recordings import written
from helpers.waiting import wait_for
from pa_ros.cli import launch
from pa_ros.cli.main import main
from pa_ros.core.errors import ConfigError
from pa_ros.tools import domain
from pa_ros.tools.domain import DomainClaim, use_free_domain
from pa_ros.tools.launcher import ChildError, Patience, Supervisor, node_command

OBEDIENT = (  # also where the tests were started with SIGINT ignored, as a shell's `&` does
    "import signal, time; signal.signal(signal.SIGINT, signal.SIG_DFL)\n"
    "signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])\n"
    "print('up', flush=True)\ntime.sleep(60)"
)
DEAF = (
    "import signal, time\n"
    "for s in (signal.SIGINT, signal.SIGTERM): signal.signal(s, signal.SIG_IGN)\n"
    "print('up', flush=True)\ntime.sleep(60)"
)
QUICK = Patience(interrupt_s=0.3, terminate_s=0.3, kill_s=5.0)


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def start(supervisor: Supervisor, folder: Path, name: str, code: str) -> int:
    pid = supervisor.start(name, [sys.executable, "-c", code])
    wait_for(lambda: "up" in (folder / f"{name}.log").read_text())
    return pid


def test_a_child_imports_nothing_from_the_current_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("random", "types", "sim_node"):
        Path(f"{name}.py").write_text("raise SystemExit('the file of the user was run')")
    with Supervisor(tmp_path, patience=QUICK) as supervisor:
        supervisor.start("a", [sys.executable, "-m", "sim_node.main", "--help"])
        with pytest.raises(ChildError, match=r"exit status 0(.|\n)*of simulation time"):
            wait_for(lambda: supervisor.check())


def test_stop_interrupts_and_finally_kills(tmp_path):
    with Supervisor(tmp_path, patience=QUICK) as supervisor:
        pids = [start(supervisor, tmp_path, "a", OBEDIENT), start(supervisor, tmp_path, "b", DEAF)]
        supervisor.check()
        assert supervisor.stop() == {"a": -signal.SIGINT, "b": -signal.SIGKILL}
    assert not any(map(alive, pids))
    assert supervisor.names == []


def test_a_launch_reports_a_learner_that_had_to_be_killed(tmp_path, capsys):
    with Supervisor(tmp_path, patience=QUICK) as supervisor:
        start(supervisor, tmp_path, "learner_node", DEAF)
        start(supervisor, tmp_path, "sim_node", OBEDIENT)
        assert launch.stop(supervisor, tmp_path) == 1
    said = capsys.readouterr().err
    assert "learner_node failed (killed by SIGKILL)" in said and "up" in said
    assert "sim_node" not in said


def test_an_existing_bag_is_rejected_before_anything_is_started(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    written(tmp_path / "bag", 1)
    before = sorted(tmp_path.rglob("*"))
    assert main(["launch", "--record", "bag"]) == 2
    said = capsys.readouterr()
    assert said.out == "" and said.err.startswith("pa_ros launch: bag: bag")
    assert len(said.err.splitlines()) == 1 and sorted(tmp_path.rglob("*")) == before


STARTING = """
import time
print("up", flush=True)
time.sleep(0.5)
from pa_ros.core.signals import signals_noted
with signals_noted() as noted:
    while not noted():
        time.sleep(0.01)
"""


def test_a_child_that_is_stopped_while_it_starts_ends_in_order(tmp_path):
    with Supervisor(tmp_path) as supervisor:
        start(supervisor, tmp_path, "a", STARTING)
        assert supervisor.stop() == {"a": 0}
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])


def test_a_child_that_ends_is_reported_once_with_the_tail_of_its_log(tmp_path):
    with Supervisor(tmp_path, patience=QUICK) as supervisor:
        supervisor.start("a", [sys.executable, "-c", "print('why'); raise SystemExit(7)"])
        with pytest.raises(ChildError, match=r"a ended by itself \(exit status 7\)(.|\n)*why"):
            wait_for(lambda: supervisor.check())
        supervisor.check()


def test_node_command_runs_this_interpreter_in_a_namespace(tmp_path):
    command = node_command(["sim_node"], tmp_path / "p.yaml", "arena1")
    assert command[:3] == [sys.executable, "-m", "sim_node.main"]
    assert "__ns:=/arena1" in command and str(tmp_path / "p.yaml") in command
    assert not any("__ns" in word for word in node_command(["sim_node"], tmp_path / "p.yaml"))


def test_a_claimed_domain_is_not_given_again_until_it_is_closed(monkeypatch) -> None:
    with DomainClaim() as first:
        monkeypatch.setattr(domain, "DOMAINS", (first.number,))
        with pytest.raises(ConfigError, match="every one is in use"):
            DomainClaim()
    with DomainClaim() as again:
        assert again.number == first.number


def test_a_domain_is_chosen_for_this_process_and_its_children(monkeypatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    number = use_free_domain()
    assert number in domain.DOMAINS and os.environ["ROS_DOMAIN_ID"] == str(number)
