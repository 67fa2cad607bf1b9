"""Do two builds learn the same bits? `make same-results BASE=COMMIT`.

Hashes depend on the processor, so none are stored: both builds run here. Their weights are compared
after short runs in one process, and version by version after a short run of a graph. A build is
known by its `pa_ros` command only; this file needs nothing but the standard library.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import product, starmap
from pathlib import Path
from typing import NamedTuple


class Case(NamedTuple):
    """Options of `pa_ros train`; empty: its default."""

    design: str
    recipe: str = ""
    preset: str = ""
    network: str = ""
    arm: str = ""
    perception: str = ""

    @property
    def given(self) -> dict[str, str]:
        """The options that are not empty, by name."""
        return {name: value for name, value in self._asdict().items() if value}


CASES = (
    *starmap(Case, product(("2-L", "3-D"), ("paper", "ours"), ("fast", "paper"))),
    *(Case("2-L", network=name) for name in ("distilled-critic", "canonical")),
    Case("2-L", arm="panda"),
    Case("push-2"),
    Case("3-D-avoid"),
    Case("2-L", perception="camera"),
)
FRAMES, WARMUP_FRAMES = 1500, 300  # so that most of the frames have an update
GRAPH_S = 40.0  # of a graph that learns, its start included
FEWEST_VERSIONS = 20  # that both graphs must publish
STOP_S = 60.0

# Run by each build's own Python.
HASH_CHECKPOINT = """
import hashlib, sys
from pathlib import Path
from safetensors.numpy import load_file
folder, digest, count = Path(sys.argv[1]), hashlib.sha256(), 0
for path in sorted((folder / (folder / "LATEST").read_text().strip()).glob("*.safetensors")):
    for name, value in sorted(load_file(path).items()):
        if name.startswith(("actor.", "critic.", "target_", "adam.")):
            digest.update(name.encode() + value.tobytes())
            count += 1
assert count, "no weights"
print(digest.hexdigest()[:16])
"""
HASH_BAG = """
import hashlib, sys
from pathlib import Path
from rosbags.highlevel import AnyReader
with AnyReader([Path(sys.argv[1])]) as bag:
    topics = [c for c in bag.connections if c.topic.endswith("policy_weights")]
    for connection, _, raw in bag.messages(connections=topics):
        message = bag.deserialize(raw, connection.msgtype)
        payload, digest = message.payload.tobytes(), hashlib.sha256()
        tensors = sorted(message.tensors, key=lambda tensor: tensor.offset)
        ends = [tensor.offset for tensor in tensors[1:]] + [len(payload)]
        parts = {t.name: payload[t.offset:end] for t, end in zip(tensors, ends)}
        for name, part in sorted(parts.items()):
            digest.update(name.encode() + part)
        print(message.version, digest.hexdigest()[:16])
"""


class Build:
    """An environment with a `pa_ros` command."""

    def __init__(self, environment: Path) -> None:
        self._bin = environment / "bin"

    def weights(self, case: Case) -> str:
        """The hash of networks, targets and moments after a run in one process with seed 0."""
        with tempfile.TemporaryDirectory() as folder:
            options = {self._name_of(name): value for name, value in case.given.items()}
            options |= {"seed": "0", "frames": str(FRAMES), "eval-every": "0", "out": folder}
            options["learner.replay.warmup_frames"] = str(WARMUP_FRAMES)
            given = [word for name, value in options.items() for word in (f"--{name}", value)]
            self._run("pa_ros", "train", *given)
            return self._run("python", "-c", HASH_CHECKPOINT, f"{folder}/checkpoint").strip()

    def _name_of(self, option: str) -> str:
        """An option's name in this build: older ones call the recipe the protocol."""
        if option == "recipe" and "--recipe" not in self._run("pa_ros", "train", "--help"):
            return "protocol"
        return option

    def versions(self, domain: int) -> dict[str, str]:
        """The hash of every version that a graph with design 2-L publishes within GRAPH_S."""
        with tempfile.TemporaryDirectory() as folder:
            command = [
                str(self._bin / "pa_ros"),
                "launch",
                "--params",
                "train_2l",
                "--record",
                "bag",
            ]
            environment = _environment() | {"ROS_DOMAIN_ID": str(domain), "ROS_LOG_DIR": folder}
            graph = subprocess.Popen(
                command, cwd=folder, env=environment, stdout=subprocess.DEVNULL
            )
            try:
                graph.wait(GRAPH_S)
            except subprocess.TimeoutExpired:
                graph.send_signal(signal.SIGINT)
            if graph.wait(STOP_S):
                raise SystemExit(f"{command}: expected to end with 0, got {graph.returncode}")
            lines = self._run("python", "-c", HASH_BAG, f"{folder}/bag").splitlines()
        pairs = (line.split() for line in lines)
        return {version: digest for version, digest in pairs}

    def _run(self, program: str, *arguments: str) -> str:
        command = [str(self._bin / program), *arguments]
        done = subprocess.run(command, capture_output=True, text=True, env=_environment())
        if done.returncode:
            raise SystemExit(f"{command}: {done.stderr[-2000:]}")
        return done.stdout


def _environment() -> dict[str, str]:
    """The environment without what another build's wheels have set."""
    left_out = ("LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE", "AMENT_PREFIX_PATH")
    kept = {name: value for name, value in os.environ.items() if name not in left_out}
    return kept | {"OMP_NUM_THREADS": "1"}


def compare(builds: tuple[Build, Build]) -> Iterator[tuple[str, str, str]]:
    """Yield what was run, and the hash of each build."""
    with ThreadPoolExecutor(2) as pool:
        for case in CASES:
            ours, base = pool.map(partial(Build.weights, case=case), builds)
            yield f"{FRAMES} frames of {' '.join(case.given.values())}", ours, base
    domains = random.SystemRandom().sample(range(1, 102), 2)
    ours_versions, base_versions = map(Build.versions, builds, domains)
    common = sorted(set(ours_versions) & set(base_versions), key=int)
    if len(common) < FEWEST_VERSIONS:
        raise SystemExit(f"graph: expected {FEWEST_VERSIONS} versions of both, got {len(common)}")
    wrong = [version for version in common if ours_versions[version] != base_versions[version]]
    shown = wrong[0] if wrong else common[-1]
    yield f"graph, {len(common)} versions, {shown}", ours_versions[shown], base_versions[shown]


def main() -> int:
    """Exit status 1 if any weights differ."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("ours", type=Path, help="virtual environment of one build")
    parser.add_argument("base", type=Path, help="of the other")
    options = parser.parse_args()
    builds = Build(options.ours.absolute()), Build(options.base.absolute())
    differ = 0
    for name, ours, base in compare(builds):
        print(f"{name:<35} {ours} {base} {'equal' if ours == base else 'DIFFERENT'}", flush=True)
        differ += ours != base
    print("EQUAL" if not differ else f"{differ} DIFFER")
    return bool(differ)


if __name__ == "__main__":
    sys.exit(main())
