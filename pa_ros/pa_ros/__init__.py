"""Programmable Agents (Denil et al. 2017): a robot arm that executes declarative programs.

On a ROS 2 graph, with an arena and an agent in processes of their own or on a robot:

    from pa_ros import Arm

    with Arm.simulated() as arm:  # starts an arena and an agent; Arm() joins a running graph
        print(arm.scene())  # the blocks, and programs that make sense
        result = arm.execute("NEAR(HAND, AND(RED, CUBE))", timeout=10)
        print(result.success, result.distance)

In one process, without ROS:

    import pa_ros

    arena, agent = pa_ros.make_arena("3-D", seed=2), pa_ros.load("3-D")
    print(arena.execute(agent, "NEAR(HAND, SPHERE)"))
    agent.act(arena.observation, "NEAR(HAND, SPHERE)")  # joint velocities, rad/s
    agent.explain(arena.observation, "NEAR(HAND, SPHERE)")  # what each word means to the agent
    mine = pa_ros.train("2-L", out="runs/mine", frames=30_000)
    pa_ros.evaluate(mine, ["NEAR(HAND, AND(BLUE, SPHERE))"], episodes=20)

The arena is a Gymnasium environment (`pa_ros.arena.ReachEnv`) and a ROS 2 node, too.
docs/starting.md has more; `pa_ros --help` lists the commands.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pa_ros.core import __version__

if TYPE_CHECKING:
    from pa_ros.acting.execution import Result
    from pa_ros.agents import TrainedAgent
    from pa_ros.core.experience import Observation, Verdict
    from pa_ros.evaluation.evaluate import ProgramRow
    from pa_ros.tools.arm import Arm

# Functions import what they need, so that `import pa_ros` stays quick.

__all__ = ["Arena", "Arm", "Result", "__version__", "evaluate", "load", "make_arena", "train"]

HOLD_STEPS = 5


def make_arena(
    design: str = "3-D", *, arm: str = "", preset: str = "", seed: int = 0, perception: str = ""
) -> Arena:
    """A simulated arena with a first scene.

    `design` says which blocks exist (2-C, 2-L, 3-C, 3-D; push-2 and push-3D, whose blocks can be
    moved), `arm` is jaco or panda, `preset` is fast or paper, or push for the designs of that name;
    by default the design's preset with that preset's arm. The same seed gives the same scenes. An
    agent that sees blocks through a camera needs an arena with its `perception`. Raises ConfigError
    for unknown names.
    """
    return Arena(design, arm, preset, seed, perception)


def load(agent: str | Path = "3-D") -> TrainedAgent:
    """A trained agent, of a run's folder or shipped (2-L, 3-D, push, stack, avoid, camera).

    Raises PaError (its subclass CheckpointError) if there is no usable checkpoint.
    """
    from pa_ros.agents import checkpoint_named, load_agent

    return load_agent(checkpoint_named(agent))


def train(
    design: str = "2-L",
    *,
    out: str | Path,
    frames: int = 30_000,
    seed: int = 0,
    arm: str = "",
    preset: str = "",
    resume: bool = False,
    evaluate_every: int = 10_000,
    progress: Callable[[int, float], object] | None = None,
    **settings: Any,
) -> TrainedAgent:
    """Train an agent as `pa_ros train` does, and return it; `out` is a new folder for all results.

    The same seed gives the same weights. `preset` is as in `make_arena`. `evaluate_every` is the
    number of frames between two rows of scores in OUT/progress.csv. `progress` is called after each
    episode with the frames so far and the episode's reward per step; without it, lines are printed
    that say how far the training is. `settings` are other ones by
    their dotted names, such as `**{"learner.updates.discount": 0.9}`, `algorithm="td3"`,
    `recipe="paper"`. Raises ConfigError for settings that cannot be, CheckpointError if `out`
    contains a run and `resume` is false.
    """
    from pa_ros.agents import train_agent
    from pa_ros.arena import ArenaChoice
    from pa_ros.cli.training_view import Telling, TrainingView
    from pa_ros.learning.config import TrainConfig
    from pa_ros.learning.recipes import LearningSettings, recipe_for

    chosen = ArenaChoice(design=design, arm=arm, preset=preset)
    blocks = chosen.design_of()
    recipe = {"recipe": recipe_for(blocks.vocabulary)}
    learning = LearningSettings(**(recipe | settings))
    config = TrainConfig(
        out=Path(out), seed=seed, frames=frames, evaluate_every_frames=evaluate_every
    )
    with nullcontext(Telling(progress)) if progress else TrainingView(frames) as watcher:
        train_agent(chosen.arena_config(), blocks, learning, config, resume=resume, watcher=watcher)
    return load(Path(out).resolve())


def evaluate(
    agent: TrainedAgent, programs: Sequence[str], episodes: int = 20, condition: str = "eval"
) -> list[ProgramRow]:
    """Success rate and reward per step of an agent for each program, in fresh scenes.

    Scenes are drawn from a condition; those in which a program names nothing are passed over.
    Raises ProgramError for a wrong program, ConfigError for one that names something too rarely.
    """
    from pa_ros.evaluation.evaluate import evaluate_programs

    return evaluate_programs(
        agent.arena,
        agent.design,
        agent.policy,
        [programs] if isinstance(programs, str) else programs,
        episodes,
        condition=condition,
        perception=agent.perception,
    )


class Arena:
    """A table with an arm and blocks, where agents execute programs.

    Programs run one after another in the same scene: each starts where the previous one ended.
    `observation` and `verdict` are those of the current step; `task` is the underlying
    `pa_ros.arena.ReachTask`.
    """

    observation: Observation
    verdict: Verdict

    def __init__(self, design: str, arm: str, preset: str, seed: int, perception: str) -> None:
        from pa_ros.arena import design_named, preset_for
        from pa_ros.core.experience import ENDLESS
        from pa_ros.perception import task_seen

        blocks = design_named(design)
        # A scene may last for many programs.
        config = preset_for(blocks, preset, arm).changed(episode_steps=ENDLESS)
        self.task = task_seen(config, blocks, seed, perception)
        self.reset()

    def reset(self, scene: int = 0, condition: str = "train") -> None:
        """Start a scene, chosen by its number. The condition "eval" has held-out targets."""
        self.observation, self.verdict = self.task.reset(scene, condition)

    def begin(self, program: str) -> Observation:
        """Set the program by which steps are judged from now on; the current observation.

        Raises ProgramError for a wrong program or one that names no present object.
        """
        from pa_ros.language import parse_goal

        parsed = parse_goal(program, self.task.world.vocabulary)
        self.observation, self.verdict = self.task.set_program(parsed)
        return self.observation

    def step(self, velocity: Any) -> Observation:
        """Move the arm for one control period, 0.1 s, with joint velocities [J] in rad/s.

        Returns the observation that follows; `verdict` says how the program stands. Commands are
        clamped to the arm's limits. Raises ArenaError unless they are J finite numbers.
        """
        self.observation, self.verdict = self.task.step(velocity)
        return self.observation

    @property
    def objects(self) -> tuple[str, ...]:
        """The blocks on the table, such as "RED CUBE"."""
        return tuple(str(block.kind) for block in self.task.episode.blocks)

    def execute(self, agent: TrainedAgent, program: str, max_steps: int = 100) -> Result:
        """Let an agent execute a program until it has been satisfied for HOLD_STEPS steps.

        A goal over time has `max_steps` for each of its programs. Raises ProgramError for a wrong
        program or one that names no present object, ActingError for an agent of another arm or
        design.
        """
        from pa_ros.acting.execution import ENDED, Result
        from pa_ros.agents import greedy
        from pa_ros.language import stages

        self.begin(program)
        act = greedy(agent.snapshot, self.task.config, agent.logic)  # at this arm's speeds
        text, steps, satisfied = str(self.task.goal), 0, 0
        max_steps *= len(stages(self.task.goal))
        while steps < max_steps and satisfied < HOLD_STEPS and not self.verdict.violated:
            self.step(act(self.observation, self.task.program))
            steps, satisfied = steps + 1, satisfied + 1 if self.verdict.satisfied else 0
        verdict = self.verdict
        if verdict.violated:
            code, reason = ENDED["violated"]
            return Result(text, False, verdict.distance, None, reason, code)
        if satisfied < HOLD_STEPS:
            reason = f"not satisfied for {HOLD_STEPS} steps within {max_steps}"
            return Result(text, False, verdict.distance, None, reason, "goal.time_limit")
        reached_s = (steps - HOLD_STEPS) * self.task.control_period_s
        return Result(text, True, verdict.distance, reached_s)

    def picture(self, side_px: int = 480) -> Any:
        """The table from above, an RGB array [side, side, 3] of uint8; needs no OpenGL."""
        from pa_ros.arena.render import top_view

        return top_view(self.task, side_px)


def __getattr__(name: str) -> Any:
    """Import `Arm` and `Result` when they are first used: only `Arm` needs ROS."""
    if name == "Result":
        from pa_ros.acting.execution import Result

        return Result
    if name != "Arm":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from pa_ros.core.errors import ConfigError
    from pa_ros.ros.environment import require_ros

    try:
        require_ros()
    except ConfigError as error:
        raise ImportError(f"pa_ros.Arm: {error}") from error
    from pa_ros.tools.arm import Arm

    return Arm


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
