"""Settings that every learning algorithm has, in parts; its own are added by a subclass.

The paper gives batch size, discount, replay capacity and one update per action; it says nothing of
the rest, which is a choice of ours (docs/DESIGN.md, "What our recipe changes, and why").
"""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar, Literal, Self

from pydantic import Field, model_validator

from pa_ros.acting.config import ExplorationConfig, Schedule
from pa_ros.core.settings import Settings


class ReplayConfig(Settings):
    """The replay buffer."""

    capacity_frames: int = Field(1_000_000, ge=2, le=10**8, description="observations kept (paper)")
    warmup_frames: int = Field(1000, ge=0, description="frames before the first update")
    batch_size: int = Field(64, ge=1, le=65_536, description="transitions in each update (paper)")


class UpdatesConfig(Settings):
    """How many updates, and what return they aim at."""

    per_frame: float = Field(1.0, ge=0, le=1000, description="updates for each transition (paper)")
    discount: float = Field(0.99, ge=0, lt=1, description="γ per control step (paper)")
    published: float = Field(
        1.0,
        gt=0,
        le=1,
        description="share of the newest actor in the weights that are published after each "
        "trajectory; below 1 they are a running mean, which swings less",
    )


class OptimizerConfig(Settings):
    """Adam, of actor and critic."""

    actor_rate: float = Field(1e-4, gt=0, description="learning rate, as in Lillicrap et al.")
    critic_rate: float = Field(
        3e-4, gt=0, description="learning rate; 1e-3 lets the critic forget the action"
    )
    half_life: float = Field(
        0.0, ge=0, description="updates in which both rates become half as large; 0: they stay"
    )
    # The defaults of Adam's paper (Kingma and Ba 2015), which nobody needed to change.
    beta1: ClassVar[float] = 0.9  # decay of the first moment
    beta2: ClassVar[float] = 0.999  # decay of the second moment
    epsilon: ClassVar[float] = 1e-8  # added to the second moment's root

    def share(self, updates: int) -> float:
        """The factor of both learning rates after so many updates."""
        return float(0.5 ** (updates / self.half_life)) if self.half_life else 1.0


class DetectorsConfig(Settings):
    """Settings of the detectors' learning."""

    gain: float = Field(1.0, gt=0, description="factor of both learning rates, for the detectors")
    sparsity: float = Field(
        0.0,
        ge=0,
        description="how far a step draws weights to zero: rate × this × max(0, 1 − |w|/free_from) "
        "(Zhang 2010), so that a word depends on few features",
    )
    free_from: float = Field(1.0, gt=0, description="size of a weight that is no longer drawn")


class HindsightConfig(Settings):
    """Places moved in stored transitions, where programs move objects."""

    moved: float = Field(
        0.5,
        ge=0,
        le=1,
        description="share of transitions from episodes in which a block moved, with programs "
        "about that block",
    )
    future: float = Field(
        0.8, ge=0, le=1, description="share with the place moved to where the moved block later was"
    )
    cross: float = Field(
        0.2, ge=0, le=1, description="share of these with it moved to where another block later was"
    )
    either: float = Field(
        0.2,
        ge=0,
        le=1,
        description="share under programs in which one argument is an OR of two training ones",
    )
    in_air: bool = Field(
        False,
        description="whether a moved place is as high as the block was, where blocks may end in "
        "the air",
    )
    spread: ClassVar[float] = 0.03  # m, deviation of a moved place


class RelabelingConfig(Settings):
    """Programs and scenes other than those that acted."""

    rule: Literal["none", "all-goals", "entries"] = Field(
        "none",
        description="none is the paper's; all-goals draws other training programs, and moves "
        "places where programs move objects; entries draws those of what the hand came to later",
    )
    programs_per_transition: int = Field(
        1,
        ge=1,
        le=64,
        description="K programs for each sampled transition; 1 where programs move objects",
    )
    property_dropout: float = Field(
        0.0, ge=0, le=1, description="share of transitions where a block's properties are hidden"
    )

    @model_validator(mode="after")
    def _several_need_relabeling(self) -> Self:
        count = self.programs_per_transition
        if count > 1 and self.rule == "none":
            raise ValueError(f"programs_per_transition: expected 1 without relabeling, got {count}")
        return self


class EngineConfig(Settings):
    """The engine of the updates, and its device."""

    name: Literal["auto", "fused", "torch"] = Field(
        "auto", description="auto is the fused CPU update where it applies, else torch"
    )
    device: str = Field("cpu", description="of torch: cpu, cuda, cuda:1")
    dtype: Literal["float32", "float64"] = Field("float32", description="of torch's numbers")
    threads: int = Field(1, ge=1, le=256, description="of the engine")


class LearnerConfig(Settings):
    """The parts that algorithms share; a subclass names its algorithm and adds its own."""

    SECTION: ClassVar[str] = "learner"
    ALGORITHM: ClassVar[str]  # its name in pa_ros.learning.algorithms.ALGORITHMS

    starts_from: str = Field(
        "",
        description="a run's folder, or shipped:NAME, whose networks are the initial ones; empty: "
        "random ones",
    )
    schedule: Schedule = Schedule()
    exploration: ExplorationConfig = ExplorationConfig()
    replay: ReplayConfig = ReplayConfig()
    updates: UpdatesConfig = UpdatesConfig()
    optimizer: OptimizerConfig = OptimizerConfig()
    detectors: DetectorsConfig = DetectorsConfig()
    relabeling: RelabelingConfig = RelabelingConfig()
    hindsight: HindsightConfig = HindsightConfig()
    engine: EngineConfig = EngineConfig()

    @property
    def inference(self) -> str:
        """How agents evaluate networks: by torch, or "auto", by fused code where it applies."""
        return "torch" if self.engine.name == "torch" else "auto"

    @model_validator(mode="after")
    def _trajectories_fit(self) -> Self:
        steps, capacity = self.schedule.trajectory_steps, self.replay.capacity_frames
        if steps >= capacity:
            raise ValueError(
                f"replay.capacity_frames: expected more than schedule.trajectory_steps = {steps}, "
                f"got {capacity}"
            )
        return self


class TrainConfig(Settings):
    """One training run, in an environment that the caller makes."""

    SECTION: ClassVar[str] = "train"

    out: Path = Field(description="folder for curve and checkpoint")
    seed: int = Field(0, ge=0, description="of episodes, exploration and weights")
    frames: int = Field(100_000, ge=1, description="control steps to train for, whole episodes")
    environment: dict[str, str] = Field(
        {},
        description="names of its design, preset and arm, kept in checkpoints; a run is resumed in "
        "the same one",
    )
    condition: str = Field("train", description="that episodes are drawn from")
    agent_id: ClassVar[str] = "agent"  # there is one agent
    evaluate_every_frames: int = Field(
        10_000, ge=0, description="frames between evaluations, rows of progress.csv; 0: never"
    )
    evaluation_episodes: int = Field(20, ge=1, description="episodes of each evaluation")
    checkpoint_every_frames: int = Field(
        50_000, ge=0, description="frames between checkpoints; 0: only at the end"
    )
