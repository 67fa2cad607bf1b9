"""What a demonstration is asked for, and the parameters of its nodes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pa_ros.arena import ArenaConfig, Design, design_named
from pa_ros.core.errors import ConfigError
from pa_ros.learning.protocols import usual_protocol
from pa_ros.tools.demo.scenes import FEWER, FULL
from pa_ros.tools.launch_params import Parameters, load_parameters, merged, packaged


@dataclass(frozen=True)
class DemoConfig:
    """One demonstration."""

    design: Design
    arena: ArenaConfig
    seed: int
    minutes: float
    folder: Path  # new or empty; everything is left in it
    real_time_factor: float = 2.0  # while programs are executed
    policy: str = ""  # checkpoint that executes programs; empty: what was learned here

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise ConfigError(f"demo --seed: expected at least 0, got {self.seed}")
        if not 0 < self.minutes < float("inf"):
            raise ConfigError(f"demo --minutes: expected a positive number, got {self.minutes}")
        if self.folder.exists() and (not self.folder.is_dir() or any(self.folder.iterdir())):
            raise ConfigError(f"demo --out: expected a new or empty folder, got {self.folder}")

    @property
    def scene_seed(self) -> int:
        """Of the scenes to execute in, none of which is trained in."""
        return self.seed + 1_000_000

    @property
    def checkpoint(self) -> Path:
        """Where the learner leaves what it learned."""
        return self.folder / "checkpoint"

    def training(self) -> Parameters:
        """Parameters of the three nodes that learn."""
        seed, protocol = self.seed, usual_protocol(self.arena.preset)
        arena = {"design": self.design.name, "preset": self.arena.preset, "seed": seed}
        changes: dict[str, dict[str, Any]] = {
            "sim_node": arena,
            "agent_node": {"seed": seed},
            "learner_node": {
                "seed": seed,
                "protocol": protocol,
                "out": str(self.folder.resolve()),
            },
        }
        return merged(load_parameters(packaged("train_2l")), changes)

    def execution(self) -> Parameters:
        """Parameters of the two nodes that execute."""
        arena = {
            "design": self.design.name,
            "preset": self.arena.preset,
            "seed": self.scene_seed,
            "condition": FULL,
            "eval_condition": FEWER,
            "real_time_factor": self.real_time_factor,
        }
        weights = {"checkpoint": self.policy or str(self.checkpoint.resolve())}
        changes: dict[str, dict[str, Any]] = {"sim_node": arena, "agent_node": weights}
        return merged(load_parameters(packaged("execute_3d")), changes)

    def of_shipped(self) -> DemoConfig:
        """The same for the policy that comes with the package, in a folder of its own."""
        design, folder = design_named("3-D"), self.folder / "shipped"
        return replace(self, design=design, folder=folder, policy=f"shipped:{design.name}")
