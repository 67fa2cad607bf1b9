"""A small graph for fault injection: nodes as processes, a recorder, and an observer."""

import os
import signal
import sys
import uuid
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, TypeVar

from rclpy.node import Node

from chaos import moody
from chaos.observer import Observer
from chaos.relay import Relay, remaps
from pa_ros.core.errors import PaError
from pa_ros.learning.checkpoint_files import find_checkpoint
from pa_ros.learning.errors import CheckpointError
from pa_ros.learning.folder import checkpoint_of, holds_checkpoint
from pa_ros.ros.environment import ros_arguments
from pa_ros.ros.executor import spin_until
from pa_ros.tools.client import client_node
from pa_ros.tools.launch_params import Parameters, write_parameters
from pa_ros.tools.launcher import Patience, Supervisor, node_command

MARK: Final = "PA_ROS_CHAOS"  # environment variable of every process of a stage
HELD_RAD: Final = 2e-3  # a holding arm may settle by this much
SETTLE_S: Final = 1.0  # until nodes notice that commands stopped
START_S: Final = 60.0  # much longer than a graph needs to start
NODES: Final = ("sim_node", "agent_node", "learner_node")
RECORDER: Final = "recorder"
LAUNCHER: Final = "launcher"
SMALL: Final = {  # learns with small networks, quick to start and to resume
    "learner.replay.warmup_frames": 20,
    "learner.replay.batch_size": 32,
    "learner.replay.capacity_frames": 50_000,
    "learner.updates.per_frame": 4,
    "learner.schedule.trajectory_steps": 20,
    "network.hidden": 16,
}


class StageError(PaError):
    """A graph that could not be brought to work, or a fault that had another effect."""

    code = "chaos.stage"


def parameters_of(kind: str, folder: Path) -> Parameters:
    """The parameters of a kind of stage; `folder` receives the key of a "keyed" one."""
    if kind == "executing":
        scene = {"mode": "real_time", "real_time_factor": 2.0, "episode_steps": 100_000}
        return {"sim_node": {"seed": 4, **scene}, "agent_node": {"seed": 4, "weights": "random"}}
    if kind == "sighted":
        scene = {"design": "3-D", "mode": "real_time", "episode_steps": 100_000}
        view = {"rate_hz": 10.0, "view": "above", "width": 240, "height": 240}
        return {
            "sim_node": {"seed": 2, **scene, **{f"camera.{k}": v for k, v in view.items()}},
            "camera_node": {},
            "agent_node": {"seed": 4, "weights": "checkpoint", "checkpoint": "shipped:camera"},
        }
    if kind == "robot":
        return {"robot_node": {"robot": str(folder.resolve() / "robot.yaml"), "autostart": True}}
    learning: Parameters = {
        "sim_node": {"seed": 4, "episode_steps": 40, "resend_period_s": 0.25},
        "agent_node": {"seed": 4, "learning": True, "resend_period_s": 0.5, "stuck_after_s": 2.0},
        "learner_node": {"seed": 4, **SMALL, "checkpoint_every_frames": 400},
    }
    if kind == "keyed":
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / "key"
        path.touch(mode=0o600)
        path.write_bytes(os.urandom(32))
        return {name: {**values, "auth_key_file": str(path.resolve())}
                for name, values in learning.items()}  # fmt: skip
    if kind == "extended":
        for name in ("sim_node", "learner_node"):
            learning[name] |= {"extensions": [moody.__file__]}
        learning["sim_node"] |= {"reward": "moody"}
    if kind == "fleet":  # a second arena feeds the same learner
        agent = learning["agent_node"]
        return {
            "sim_node": learning["sim_node"],
            "agent_node": agent | {"agent_id": "arena1"},
            "learner_node": learning["learner_node"] | {"arenas": ["", "arena2"]},
            "arena2/sim_node": learning["sim_node"] | {"seed": 5},
            "arena2/agent_node": agent | {"seed": 5, "agent_id": "arena2"},
        }
    return learning


class Stage:
    """Processes by name that can be hurt and started again; the learner resumes its checkpoint."""

    def __init__(
        self, folder: Path, node: Node, kind: str, environment: Mapping[str, str] | None = None
    ) -> None:
        """`kind` is a `faults.Kind`; `environment` is added to that of every process."""
        self.folder, self.node = folder, node
        self.observer = Observer(node)
        self.mark = uuid.uuid4().hex
        self.bags: list[Path] = []
        self._parameters, self._kind = parameters_of(kind, folder), kind
        self._relay = Relay(node) if kind == "relayed" else None
        self._pids: dict[str, int] = {}
        self._starts = 0
        patience = Patience(interrupt_s=10.0, terminate_s=3.0)
        self.moods = folder.resolve()  # of an "extended" one
        own = {MARK: self.mark, moody.MOODS: str(self.moods), **(environment or {})}
        self._supervisor = Supervisor(folder / "log", own, patience)

    @property
    def nodes(self) -> tuple[str, ...]:
        return tuple(self._parameters)

    @property
    def learns(self) -> bool:
        return "learner_node" in self._parameters

    @property
    def progress(self) -> int:
        """Grows while a graph that does not learn works."""
        return self.observer.steps

    @property
    def key(self) -> bytes:
        """The key of a "keyed" stage."""
        return (self.folder / "key").read_bytes()

    @property
    def checkpoint(self) -> Path:
        return checkpoint_of(self.folder / "run")

    def versions(self) -> list[int]:
        """Versions of the finished checkpoints on disk, newest first."""
        try:
            newest = find_checkpoint(self.checkpoint).name  # a newer one is being written
        except CheckpointError:
            return []
        found = (one.parent.name for one in self.checkpoint.glob("version-*/metadata.json"))
        return sorted((int(name[8:]) for name in found if name <= newest), reverse=True)

    def begin(self) -> None:
        """Start everything and wait until it works. Raises StageError."""
        if self._kind == "launched":
            self.start(LAUNCHER)
        else:
            if self.learns:
                self.start(RECORDER)
                self.until(lambda: any(self.bags[-1].glob("*.mcap")), START_S)
            for name in self._parameters:
                self.start(name)
        self.until(lambda: self.works() or any(map(self.ended, self._pids)), START_S)
        self._supervisor.check()
        if not self.works():
            raise StageError(f"stage: expected a graph that works in {START_S:g} s, got "
                             f"{self.observer.summary() or 'no diagnostics'}")  # fmt: skip

    def works(self) -> bool:
        """Whether all nodes report OK and some work was done."""
        done = self.observer.ledger.version > 3 if self.learns else self.progress > 10
        return done and self.observer.all_ok(self.nodes)

    def unrest(self, since_s: float, stays: bool) -> str:
        """What is wrong if the arm must be at rest soon after a time (s, monotonic) and, if it
        `stays` so, until now; empty: nothing."""
        moved = self.observer.moved(since_s + SETTLE_S)
        return f"the arm moved by {moved:.4f} rad" if stays and moved > HELD_RAD else ""

    @property
    def stalled(self) -> bool:
        """Whether this process was too busy to be a good agent, which nodes may report."""
        return False

    def harm(self) -> tuple[str, list[str]]:
        """What the arm did since the last call, and what it must not have done."""
        return "", []

    def until(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Serve observer and relay until the condition holds; whether it does in time."""
        return spin_until(self.node, condition, timeout_s)

    def wait(self, seconds: float) -> None:
        self.until(lambda: False, seconds)

    def change_messages(self, topic: str, change: str) -> None:
        """Let the relay change messages of a topic (one of `relay.CHANGES`, or "")."""
        assert self._relay is not None
        self._relay.changes[topic] = change

    def start(self, name: str, beside: bool = False) -> None:
        """Start a process, or a second one `beside` it."""
        self._starts += 1
        label = f"{name}-second" if beside else name
        command = self._command(name, beside)
        self._pids[label] = self._supervisor.start(_file_name(label), command)

    def _command(self, name: str, beside: bool) -> list[str]:
        namespace = self.node.get_namespace()
        if name in (RECORDER, LAUNCHER) and not beside:
            self.bags.append(self.folder / f"bag-{len(self.bags)}")
        if name == RECORDER:
            command = [sys.executable, "-m", "pa_ros", "record", str(self.bags[-1])]
            return [*command, "--namespace", namespace]
        path = self.folder / f"{_file_name(name)}-{self._starts}.yaml"
        if name == LAUNCHER:
            write_parameters(path, {n: self._values(n, beside) for n in self.nodes})
            options = ["--out", str(self.folder / f"launch-{self._starts}")]
            bag = self.folder / f"bag-second-{self._starts}" if beside else self.bags[-1]
            options += ["--record", str(bag), "--namespace", namespace]
            return [sys.executable, "-m", "pa_ros", "launch", "--params", str(path), *options]
        write_parameters(path, {name: self._values(name, beside)}, namespace)
        rules = remaps(name) if self._kind == "relayed" else {}
        within, _, node = name.rpartition("/")
        place = f"{namespace}/{within}" if within else namespace
        return [*node_command([node], path, place), *ros_arguments(remaps=rules)[1:]]

    def _values(self, name: str, beside: bool = False) -> dict[str, Any]:
        """A node's parameters; the learner resumes if there is a checkpoint."""
        values = dict(self._parameters[name])
        if name == "learner_node":
            out = self.folder / ("second" if beside else "run")
            values |= {"out": str(out.resolve()), "resume": holds_checkpoint(out)}
        if name.endswith("/agent_node"):  # in a fleet
            values["learner"] = self.node.get_namespace()
        return values

    def signal(self, name: str, number: signal.Signals) -> None:
        os.kill(self.pid(name), number)

    def pid(self, name: str) -> int:
        """The process id; also of the recorder that the launcher has started."""
        if name in self._pids:
            return self._pids[name]
        recording = [b"record", str(self.bags[-1]).encode()]
        for entry in Path("/proc").glob("[0-9]*/cmdline"):
            words = entry.read_bytes().split(b"\0")
            if all(word in words for word in recording) and b"launch" not in words:
                return int(entry.parent.name)
        raise StageError(f"{name}: expected a process, found none")

    def count(self, name: str) -> int:
        """How many nodes of this name are in the graph."""
        within = self.node.get_namespace()
        return int(self.node.get_node_names_and_namespaces().count((name, within)))

    def stop(self, name: str) -> None:
        """Stop a process as Ctrl-C does."""
        self._supervisor.stop([_file_name(name)])

    def ended(self, name: str) -> bool:
        """Whether a process has ended by itself."""
        stat = Path(f"/proc/{self._pids[name]}/stat")
        try:
            return stat.read_text().rpartition(")")[2].split()[0] == "Z"
        except OSError:
            return True

    def log(self, name: str) -> str:
        path = self.folder / "log" / f"{_file_name(name)}.log"
        return path.read_text(errors="replace") if path.exists() else ""

    def end(self) -> None:
        """Stop everything, the recorder last."""
        self._supervisor.stop([n for n in self._supervisor.names if n != RECORDER])
        self._supervisor.stop()


def _file_name(name: str) -> str:
    return name.replace("/", ".")


S = TypeVar("S", bound=Stage)


@contextmanager
def staged(folder: Path, number: int, kind: str, make: Callable[..., S]) -> Iterator[S]:
    """A stage that works, in its own namespace; everything is stopped afterwards."""
    with client_node("chaos", f"chaos{number}") as node:
        stage = make(folder, node, kind)
        try:
            stage.begin()
            yield stage
        finally:
            stage.end()
