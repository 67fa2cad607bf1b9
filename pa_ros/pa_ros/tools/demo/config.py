"""What a demonstration is asked for, and the parameters of its nodes."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar, Self

from pydantic import Field, model_validator

from pa_ros.arena import ArenaConfig, Design, design_named
from pa_ros.core.settings import Settings
from pa_ros.learning.folder import checkpoint_of
from pa_ros.tools.demo.scenes import FEWER, FULL
from pa_ros.tools.launch_params import Parameters, load_parameters, merged, packaged


class DemoConfig(Settings):
    """One demonstration."""

    SECTION: ClassVar[str] = "demo"

    design: Design
    arena: ArenaConfig
    folder: Path = Field(description="new or empty; everything is left in it")
    seed: int = Field(0, ge=0, description="of learning; scenes to execute in have another")
    minutes: float = Field(20.0, gt=0, description="give up learning after these")
    real_time_factor: float = Field(2.0, gt=0, description="while programs are executed")
    policy: str = Field("", description="that executes programs; empty: what was learned here")

    @model_validator(mode="after")
    def _has_its_folder(self) -> Self:
        if self.folder.exists() and (not self.folder.is_dir() or any(self.folder.iterdir())):
            raise ValueError(f"folder: expected a new or empty one, got {self.folder}")
        return self

    @property
    def scene_seed(self) -> int:
        """Of the scenes to execute in, none of which is trained in."""
        return self.seed + 1_000_000

    @property
    def checkpoint(self) -> Path:
        """Where the learner leaves what it learned."""
        return checkpoint_of(self.folder)

    def training(self) -> Parameters:
        """Parameters of the three nodes that learn."""
        arena, out = {**self._arena, "seed": self.seed}, str(self.folder.resolve())
        changes: dict[str, dict[str, Any]] = {
            "sim_node": arena,
            "agent_node": {"seed": self.seed},
            "learner_node": {"seed": self.seed, "out": out},
        }
        return merged(load_parameters(packaged("train_2l")), changes)

    @property
    def _arena(self) -> dict[str, Any]:
        return {"design": self.design.name, "arm": self.arena.arm, "preset": self.arena.preset}

    def execution(self) -> Parameters:
        """Parameters of the two nodes that execute."""
        arena = {
            **self._arena,
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
        return self.changed(design=design, folder=folder, policy=f"shipped:{design.name}")
