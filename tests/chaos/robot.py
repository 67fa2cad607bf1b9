"""Faults of robot_node beside a simulated arm, and what the arm may do then (docs/robot.md)."""

from __future__ import annotations

import mmap
import struct
import subprocess
import sys
import time
from array import array
from contextlib import suppress
from math import nan
from pathlib import Path
from signal import SIGKILL, SIGSTOP, SIGTERM
from typing import Any, Final

import numpy as np
import yaml
from rclpy.node import Node

from chaos.arm import (
    CLASS,
    DETECTED,
    HOUR,
    REST_S,
    STALL_S,
    PushedArm,
    Record,
    Sent,
    Spoil,
    crowd,
    unspoilt,
)
from chaos.faults import Fault, signal_to, signalled
from chaos.pusher import LIMITS
from chaos.stage import Stage, StageError
from helpers.robots import robot_values
from pa_ros.ros.environment import ros_arguments

NODE, RELAY = "robot_node", "relay"
ACCELERATION: Final = 2.0  # rad/s²
LOWER, UPPER = np.array([-0.6, -0.6, 0.15]), np.array([0.6, 0.6, 0.6])  # m; above the blocks
OUTSIDE_M: Final = 0.02  # docs/robot.md: the hand stays so near to its box
OVERSHOOT: Final = 1.01  # of the simulated motors, share of the speed limit
RAMP_S: Final = float(LIMITS.max()) / ACCELERATION
AT_REST_S: Final = 0.4 + RAMP_S + 0.1  # it says so, too; the last part is the motors'
FAST: Final = 0.5  # rad/s, of the arm that is struck


class Rig(Stage):
    """robot_node beside a `PushedArm`."""

    def __init__(
        self,
        folder: Path,
        node: Node,
        kind: str = "robot",
        control: str = "velocity",
        seed: int = 0,
    ) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        values = robot_values(
            control=control,
            dry_run=False,
            max_acceleration=ACCELERATION,
            workspace={"lower": LOWER.tolist(), "upper": UPPER.tolist()},
        )
        thing = values["objects"][DETECTED]
        del thing["frame"]
        thing["detection"] = CLASS
        (folder / "robot.yaml").write_text(yaml.safe_dump(values, sort_keys=False))
        super().__init__(folder, node, kind, self._with_clock(folder.resolve()))
        self.arm = PushedArm(node, control, (LOWER, UPPER), seed)
        self.control, self.worst = control, Record()

    def _with_clock(self, folder: Path) -> dict[str, str]:
        """The environment that makes `set_clock` move the wall clock of processes."""
        library, self._clock = folder / "clock.so", folder / "clock"
        self._clock.write_bytes(bytes(mmap.PAGESIZE))
        source = Path(__file__).with_name("clock.c")
        subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-o", library, source, "-ldl"], check=True)
        return {"LD_PRELOAD": str(library), "CLOCK_FILE": str(self._clock)}

    def set_clock(self, by_s: int) -> None:
        with self._clock.open("r+b") as file:
            file.write(struct.pack("q", by_s))

    def end(self) -> None:
        try:
            super().end()
        finally:
            self.arm.close()

    @property
    def progress(self) -> int:
        return self.arm.moves

    def pid(self, name: str) -> int:
        if name != RELAY:
            return super().pid(name)
        for process in Path("/proc").glob("[0-9]*"):
            with suppress(OSError):  # it ended meanwhile
                words = (process / "cmdline").read_bytes().split(b"\0")
                if b"sim_node.robot.relay" in words and _parent(process) == self.pid(NODE):
                    return int(process.name)
        raise StageError(f"{NODE}: expected a relay as its child process, found none")

    def unrest(self, since_s: float, stays: bool) -> str:
        rest_s, stayed = self.arm.rest(since_s)
        if rest_s is None:
            late = time.monotonic() - since_s > AT_REST_S + REST_S
            return f"not at rest {AT_REST_S:.2f} s after the fault" if late else ""
        self.arm.record.rest_s = rest_s
        if rest_s > AT_REST_S:
            return f"at rest only after {rest_s:.2f} s, allowed {AT_REST_S:.2f}"
        return "" if stayed or not stays else "the arm did not stay at rest"

    @property
    def stalled(self) -> bool:
        return self.arm.record.stall_s > STALL_S

    def harm(self) -> tuple[str, list[str]]:
        record, self.arm.record = self.arm.record, Record()
        self.worst.add(record)
        checks = {
            f"outside its box by {record.outside_m * 1e3:.1f} mm": record.outside_m > OUTSIDE_M,
            f"{record.commanded:.3f} of the speed limit commanded": record.commanded > OVERSHOOT,
            f"at {record.real:.3f} of the speed limit": record.real > OVERSHOOT,
        }
        return str(record), [text for text, failed in checks.items() if failed]

    def _command(self, name: str, beside: bool) -> list[str]:
        arguments = ros_arguments(self._values(name), namespace=self.node.get_namespace())
        return [sys.executable, "-m", "sim_node.robot.main", *arguments]


def _parent(process: Path) -> int:
    return int((process / "stat").read_text().rpartition(")")[2].split()[1])


def robot_faults() -> list[Fault]:
    """Dead and stopped processes, lost and bad messages, and a wall clock that is set."""
    common: dict[str, Any] = {"kind": "robot", "ready": lambda s: _rig(s).arm.speed > FAST}
    dead = {"silent": "nobody else has diagnostics", "halts": True}
    no_harm: dict[str, Any] = {"silent": "the arm moves on", "harmless": True}
    crowded = [crowd(200)] * 2  # 100 times a second

    def sends(name: str, spoil: Spoil, **rest: Any) -> Fault:
        return Fault(f"real arm, {name}", lambda stage: _rig(stage).arm.spoil_with(spoil),
                     lambda stage: _rig(stage).arm.spoil_with(unspoilt),
                     **common, **rest)  # fmt: skip

    def clock(name: str, by_s: int) -> Fault:
        return Fault(f"real arm, wall clock set {name} by an hour",
                     lambda stage: _rig(stage).set_clock(by_s),
                     lambda stage: _rig(stage).set_clock(0), **common, **no_harm)  # fmt: skip

    return [
        *(signalled(NODE, number, f"real arm, {NODE}:", **common, **dead)
          for number in (SIGKILL, SIGSTOP, SIGTERM)),
        *(Fault(f"real arm, its relay: {number.name}", signal_to(RELAY, number), rests=True,
                **common)
          for number in (SIGKILL, SIGSTOP)),
        sends("joint_commands lost", lambda s: s.lost.add("joint_commands"), halts=True),
        sends("joint_states lost", lambda s: s.lost.add("joint_states"), halts=True),
        sends("the hand's frame lost", lambda s: s.tf.transforms.pop(0), halts=True),
        sends("joint_states of zeros", lambda s: _each(s.joints.position, 0.0), halts=True),
        sends("NaN in joint_states", lambda s: _each(s.joints.position, nan), halts=True),
        sends("NaN of another joint in joint_states", _another_joint, **no_harm),
        sends("NaN in detections", lambda s: setattr(_detected(s), "x", nan)),
        sends("NaN in the hand's frame",
              lambda s: setattr(s.tf.transforms[0].transform.translation, "x", nan), halts=True),
        sends("30,000 transforms in a message", _large(crowd(30_000))),
        sends("200 frames at 100 Hz", lambda s: s.more.extend(crowded), **no_harm),
        clock("back", -HOUR),
        clock("ahead", HOUR),
    ]  # fmt: skip


def _rig(stage: Stage) -> Rig:
    assert isinstance(stage, Rig)
    return stage


def _each(values: Any, value: float) -> None:
    values[:] = array("d", [value] * len(values))


def _another_joint(sent: Sent) -> None:
    sent.joints.name = [*sent.joints.name, "finger"]
    for values in (sent.joints.position, sent.joints.velocity):
        values.append(nan)


def _detected(sent: Sent) -> Any:
    return sent.detections.detections[0].results[0].pose.pose.position


def _large(message: bytes) -> Spoil:
    """Send a large message twice a second."""
    return lambda sent: sent.more.extend([] if sent.number % 25 else [message])
