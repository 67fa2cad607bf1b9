"""Programmable Agents (Denil et al. 2017): a robot arm that executes declarative programs.

    import pa_ros

    arena = pa_ros.make_arena("3-D", seed=2)
    agent = pa_ros.load_agent("shipped:3-D")
    result = arena.execute(agent, "NEAR(HAND, AND(RED, CUBE))")
    print(result.success, result.distance)

This runs in one process, without ROS. The same arena is a Gymnasium environment
(`pa_ros.arena.ReachEnv`) and a ROS 2 node; `pa_ros --help` lists the commands.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pa_ros.evaluation.agents import TrainedAgent
    from pa_ros.tools.arm import Arm

# Functions import what they need, so that `import pa_ros` stays quick.

__version__ = "0.2.0"
__all__ = ["Arena", "Arm", "Result", "load_agent", "make_arena"]

HOLD_STEPS = 5


@dataclass(frozen=True)
class Result:
    """The outcome of one program."""

    program: str  # canonical text
    success: bool  # satisfied at the end, for long enough
    distance: float  # of the relation at the end; for NEAR in m, to the nearest named object
    reached_s: float | None  # simulation time until it was satisfied for good; None: never
    reason: str = ""  # why it was not reached
    code: str = ""  # of the reason, such as goal.time_limit


def make_arena(design: str = "3-D", *, arm: str = "jaco", preset: str = "", seed: int = 0) -> Arena:
    """A simulated arena with a first scene.

    `design` says which blocks exist (2-C, 2-L, 3-C, 3-D; push-2 and push-3D, whose blocks can be
    moved), `arm` is jaco or panda, `preset` is fast or paper, or push for the designs of that name;
    by default the design's. The same seed gives the same scenes. Raises ConfigError for unknown
    names.
    """
    return Arena(design, arm, preset, seed)


def load_agent(checkpoint: str | Path = "shipped:3-D") -> TrainedAgent:
    """A trained agent: a shipped one (shipped:2-L, shipped:3-D) or the folder of a training run.

    Raises PaError (its subclass CheckpointError) if there is no usable checkpoint.
    """
    from pa_ros.evaluation.agents import load_agent as load

    return load(checkpoint)


class Arena:
    """A table with an arm and blocks, where agents execute programs.

    Programs run one after another in the same scene: each starts where the previous one ended.
    `task` is the underlying `pa_ros.arena.ReachTask`.
    """

    def __init__(self, design: str, arm: str, preset: str, seed: int) -> None:
        from pa_ros.arena import ReachTask, design_named, preset_named

        blocks = design_named(design)
        self.task = ReachTask(preset_named(preset or blocks.preset, arm), blocks, seed)
        self.reset()

    def reset(self, scene: int = 0, condition: str = "train") -> None:
        """Start a scene, chosen by its number. The condition "eval" has held-out targets."""
        self.task.reset(scene, condition)

    @property
    def objects(self) -> tuple[str, ...]:
        """The blocks on the table, such as "RED CUBE"."""
        return tuple(str(block.kind) for block in self.task.episode.blocks)

    def execute(self, agent: TrainedAgent, program: str, max_steps: int = 100) -> Result:
        """Let an agent execute a program until it has been satisfied for HOLD_STEPS steps.

        Raises ProgramError for a wrong program or one that names no present object, ActingError for
        an agent of another arm or design.
        """
        from pa_ros.evaluation.agents import greedy
        from pa_ros.language import parse

        parsed = parse(program, self.task.world.vocabulary)
        act = greedy(agent.snapshot, self.task.config, agent.logic)
        observation, verdict = self.task.set_program(parsed)
        steps = satisfied = 0
        while steps < max_steps and satisfied < HOLD_STEPS:
            # `advance` has no time limit, unlike `step`: a scene may last for many programs.
            observation, verdict = self.task.advance(act(observation, parsed))
            steps, satisfied = steps + 1, satisfied + 1 if verdict.satisfied else 0
        if satisfied < HOLD_STEPS:
            reason = f"not satisfied for {HOLD_STEPS} steps within {max_steps}"
            return Result(str(parsed), False, verdict.distance, None, reason, "goal.time_limit")
        reached_s = (steps - HOLD_STEPS) * self.task.control_period_s
        return Result(str(parsed), True, verdict.distance, reached_s)

    def picture(self, side_px: int = 480) -> Any:
        """The table from above, an RGB array [side, side, 3] of uint8; needs no OpenGL."""
        from pa_ros.arena.render import top_view

        return top_view(self.task, side_px)


def __getattr__(name: str) -> Any:
    """Import `Arm` when it is first used: only it needs ROS."""
    if name != "Arm":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        import rclpy  # noqa: F401
    except ImportError as error:
        raise ImportError(
            "pa_ros.Arm: expected ROS 2 (rclpy), from `make install` or from your ROS "
            f"installation's setup.bash; got: {error}"
        ) from error
    from pa_ros.tools.arm import Arm

    return Arm


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
