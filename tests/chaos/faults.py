"""Faults of processes, disks and fleets: what is done to a stage, and what must follow."""

import resource
import signal
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import permutations
from pathlib import Path
from typing import Any, Final, Literal

from chaos.moody import RAISES, UNSYNCED
from chaos.stage import LAUNCHER, NODES, RECORDER, START_S, Stage, StageError
from pa_ros.learning.checkpoint_files import find_checkpoint

Kind = Literal[
    "learning", "keyed", "launched", "relayed", "executing", "fleet", "extended", "sighted", "robot"
]
Act = Callable[[Stage], object]

DOWN_S: Final = 3.0  # that an ended process stays away
STOPPED_S: Final = 5.0
SECOND_S: Final = 4.0  # that a second process runs beside the first
GONE_S: Final = 45.0  # in which DDS forgets killed nodes
LEARNER: Final = "learner_node"
FILES: Final = ("engine.safetensors", "metadata.json", "replay.safetensors")
SIGNALS: Final = (signal.SIGKILL, signal.SIGTERM, signal.SIGSTOP)
UNLIMITED: Final = resource.RLIM_INFINITY
NO_DIAGNOSTICS: Final = "this process publishes no diagnostics"


def _nothing(_: Stage) -> None:
    """Undo nothing."""


@dataclass(frozen=True)
class Fault:
    """`strike`, and `hold_s` later `lift`. One of the nodes must report it, unless `silent`."""

    name: str
    strike: Act
    lift: Act = _nothing
    hold_s: float = DOWN_S
    kind: Kind = "learning"
    silent: str = ""  # why no node needs to report it
    damages: int = 0  # checkpoints that may be lost
    halts: bool = False  # the arm must hold still
    harmless: bool = False  # nothing may hold meanwhile, so no node may report anything
    rests: bool = False  # the arm must come to rest, and may move again
    others_continue: bool = False  # the learner must keep learning from another arena
    ends_all: bool = False  # no process may be left meanwhile
    ready: Callable[[Stage], bool] = lambda _: True  # awaited before the strike


def process_faults() -> list[Fault]:
    """Every process of a learning graph: killed, stopped, restarted, and started twice."""
    faults = []
    for name in (*NODES, RECORDER):
        silent = NO_DIAGNOSTICS if name == RECORDER else ""
        faults += [
            *(signalled(name, number, silent=silent) for number in SIGNALS),
            Fault(f"{name}: restart", _restart(name), hold_s=0.0, silent=silent or "too short"),
            Fault(f"{name}: started twice", partial(_start_second, name), _stop(f"{name}-second"),
                  SECOND_S, silent=silent),
        ]  # fmt: skip
    return faults


def order_faults() -> list[Fault]:
    """All nodes stopped, and started in every other order."""
    return [
        Fault(f"started in order {', '.join(order)}", partial(_start_in_order, order), hold_s=0.0,
              silent="waiting for each other is no trouble")
        for order in permutations(NODES)
    ]  # fmt: skip


def executing_faults() -> list[Fault]:
    """An agent that stops sending commands in real time."""
    return [
        signalled("agent_node", number, "real time, agent_node:", kind="executing", halts=True)
        for number in (signal.SIGKILL, signal.SIGSTOP)
    ]


def fleet_faults() -> list[Fault]:
    """One arena of two that feed one learner: gone, late, slow, back; and the learner killed.

    The faults hit the arena in the learner's namespace; the other one must continue.
    """
    arena, other = ("sim_node", "agent_node"), ("arena2/sim_node", "arena2/agent_node")

    def late(stage: Stage) -> None:
        for name in other:
            stage.stop(name)
        stage.wait(DOWN_S)
        for name in other:
            stage.start(name)

    lags = [
        signalled(name, signal.SIGSTOP, f"fleet, an arena lags: its {name}", kind="fleet",
                   others_continue=True)
        for name in arena
    ]  # fmt: skip
    killed = _each(*(signal_to(name, signal.SIGKILL) for name in arena))
    return [
        Fault("fleet, an arena dies and comes back under its name", killed,
              _each(*map(_restart, arena)), DOWN_S, "fleet", others_continue=True),
        *lags,
        Fault("fleet, an agent comes back under its name at once",
              _each(signal_to("agent_node", signal.SIGKILL), _restart("agent_node")), kind="fleet",
              silent="it is a new incarnation with new sequence numbers", others_continue=True),
        Fault("fleet, the other arena joins late", late, hold_s=0.0, kind="fleet",
              silent="joining late is no trouble"),
        signalled(LEARNER, signal.SIGKILL, "fleet, the learner dies:", kind="fleet"),
    ]  # fmt: skip


def launcher_faults() -> list[Fault]:
    """`pa_ros launch` killed, stopped, restarted, started twice; its recorder killed."""
    on_launch = partial(Fault, kind="launched", silent=NO_DIAGNOSTICS)
    return [
        *(on_launch(f"launcher: {number.name}", signal_to(LAUNCHER, number), _launch_again,
                    2 * STOPPED_S, ends_all=True) for number in (signal.SIGKILL, signal.SIGTERM)),
        signalled(LAUNCHER, signal.SIGSTOP, kind="launched", silent=NO_DIAGNOSTICS),
        on_launch("launcher: restart", _launch_again, hold_s=0.0),
        on_launch("launcher: started twice", _launch_twice, _stop(f"{LAUNCHER}-second"), 0.0),
        on_launch("launched recorder: SIGKILL", _kill_launched_recorder, _launch_again,
                  2 * STOPPED_S, ends_all=True),
    ]  # fmt: skip


def disk_faults() -> list[Fault]:
    """Full disks, made by the kernel's limit of a file's size; and damaged checkpoints."""
    damages: dict[str, Callable[[Path], None]] = {
        "{} truncated": _cut,
        "a bit of {} flipped": _flip,
    }
    return [
        Fault("learner_node: disk full", _limit_files(LEARNER, 0), _limit_files(LEARNER, UNLIMITED),
              STOPPED_S),
        Fault("recorder: disk full", _limit_files(RECORDER, 0), _restart(RECORDER), 2.0,
              silent=NO_DIAGNOSTICS),
        Fault("checkpoint: foreign files", _leave_notes, hold_s=0.0,
              silent="nothing is damaged", ready=lambda stage: bool(stage.versions())),
        *(Fault(f"checkpoint: {text.format(name)}", partial(_damage_newest, name, damage),
                hold_s=0.0, damages=1, ready=lambda stage: len(stage.versions()) > 1)
          for text, damage in damages.items() for name in FILES),
    ]  # fmt: skip


def extension_faults() -> list[Fault]:
    """A reward, and a folder's sync, that fail for a while."""
    on_extended = partial(Fault, kind="extended")
    return [
        on_extended("sim_node: an extension's reward raises", _in_mood(RAISES), _no_more(RAISES)),
        on_extended("learner_node: its folder cannot sync", _in_mood(UNSYNCED), _end_unsynced,
                    STOPPED_S, silent="a checkpoint is written all the same"),
    ]  # fmt: skip


def signalled(name: str, number: signal.Signals, title: str = "", **rest: Any) -> Fault:
    """A signal to a process, which is woken or started again afterwards."""
    title, strike = title or f"{name}:", signal_to(name, number)
    if number == signal.SIGSTOP:
        wake = signal_to(name, signal.SIGCONT)
        return Fault(f"{title} SIGSTOP {STOPPED_S:.0f} s", strike, wake, STOPPED_S, **rest)
    return Fault(f"{title} {number.name}", strike, _restart(name), **rest)


def _each(*acts: Act) -> Act:
    def act(stage: Stage) -> None:
        for one in acts:
            one(stage)

    return act


def signal_to(name: str, number: signal.Signals) -> Act:
    return lambda stage: stage.signal(name, number)


def _stop(name: str) -> Act:
    return lambda stage: stage.stop(name)


def _restart(name: str) -> Act:
    def restart(stage: Stage) -> None:
        stage.stop(name)
        stage.start(name)

    return restart


def _start_second(name: str, stage: Stage) -> None:
    """Start the node once more; returns when it has joined the graph or ended."""
    stage.start(name, beside=True)
    joined = stage.count(name) + 1
    stage.until(lambda: stage.count(name) >= joined or stage.ended(f"{name}-second"), START_S)


def _start_in_order(order: tuple[str, ...], stage: Stage) -> None:
    for name in NODES:
        stage.stop(name)
    for name in order:
        stage.start(name)
        stage.wait(1.5)


def _launch_again(stage: Stage) -> None:
    stage.stop(LAUNCHER)
    stage.until(lambda: not any(stage.count(name) for name in stage.nodes), GONE_S)
    stage.start(LAUNCHER)


def _launch_twice(stage: Stage) -> None:
    """A second launcher must be rejected, because its nodes are in the graph already."""
    second = f"{LAUNCHER}-second"
    stage.start(LAUNCHER, beside=True)
    if not stage.until(lambda: stage.ended(second), START_S):
        raise StageError("launcher: expected a second one to be rejected, but it runs")
    if "already in the graph" not in stage.log(second):
        raise StageError(f"launcher: expected a rejection, got {stage.log(second)[-300:]}")


def _kill_launched_recorder(stage: Stage) -> None:
    """The launcher must end and name its recorder."""
    stage.signal(RECORDER, signal.SIGKILL)
    if not stage.until(lambda: stage.ended(LAUNCHER), START_S):
        raise StageError("launcher: expected it to end with its recorder, but it runs")
    if f"{RECORDER} ended by itself" not in stage.log(LAUNCHER):
        raise StageError(f"launcher: expected the cause, got {stage.log(LAUNCHER)[-300:]}")


def _in_mood(name: str) -> Act:
    return lambda stage: (stage.moods / name).touch()


def _no_more(name: str) -> Act:
    return lambda stage: (stage.moods / name).unlink()


def _end_unsynced(stage: Stage) -> None:
    """A checkpoint must have been written meanwhile, which the restarted learner resumes."""
    began_s = (stage.moods / UNSYNCED).stat().st_mtime
    written_s = find_checkpoint(stage.checkpoint).stat().st_mtime
    stage.signal(LEARNER, signal.SIGKILL)
    _no_more(UNSYNCED)(stage)
    _restart(LEARNER)(stage)
    if written_s < began_s:
        raise StageError("learner_node: expected a checkpoint while folders could not be synced")


def _limit_files(name: str, size: int) -> Act:
    limits = (size, UNLIMITED)
    return lambda stage: resource.prlimit(stage.pid(name), resource.RLIMIT_FSIZE, limits)


def _damage_newest(name: str, damage: Callable[[Path], None], stage: Stage) -> None:
    """Stop the learner, damage a file of its newest checkpoint, start it again."""
    stage.signal(LEARNER, signal.SIGTERM)
    stage.until(lambda: stage.ended(LEARNER), STOPPED_S)
    stage.stop(LEARNER)
    damage(find_checkpoint(stage.checkpoint) / name)
    stage.start(LEARNER)


def _leave_notes(stage: Stage) -> None:
    """Kill the learner, put a file into each of its checkpoints, start it again."""
    stage.signal(LEARNER, signal.SIGKILL)
    stage.until(lambda: stage.ended(LEARNER), STOPPED_S)
    for folder in stage.checkpoint.glob("version-*"):
        (folder / "notes.txt").touch()
    _restart(LEARNER)(stage)


def _cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def _flip(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) * 2 // 3] ^= 4
    path.write_bytes(bytes(content))
