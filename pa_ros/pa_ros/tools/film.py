"""Six programs that show what an agent learned, scenes for them, and a film of their execution."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from pa_ros.agents import TrainedAgent
from pa_ros.arena import ArenaConfig, Design, Episode, ReachTask, condition_named, generate
from pa_ros.arena.movie import Picture, captioned, check_movie, write_movie
from pa_ros.arena.render import draw
from pa_ros.arena.skills import DemoProgram
from pa_ros.arena.task import play
from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Observation, Verdict
from pa_ros.evaluation.evaluate import pursuing
from pa_ros.language import ProgramError, parse_goal, satisfying, stages
from pa_ros.perception import task_seen
from pa_ros.world.relation import RELATIONS, measured

SCENES_SEARCHED = 1000
# The hand starts at least this many thresholds of the relation away, so that the arm must move.
FARTHER = 2.0
HELD = 5  # a program has succeeded after so many satisfied steps
PAUSE = 8  # pictures for which a success is shown
REACHED, AWAY = "#1a7f37", "#57606a"  # colors of the verdict


@dataclass(frozen=True)
class DemoScene:
    """An episode in which a program can show something."""

    condition: str  # one of the skill's `demo_conditions`
    episode: Episode
    distance: float  # the relation's measure of the nearest named block, at the start


def demo_programs(design: Design) -> list[DemoProgram]:
    """Six programs of the design's first relation: one trained, five never trained.

    Raises ConfigError if the design holds nothing out.
    """
    if not design.held_out:
        raise ConfigError(f"demo: expected a design with held-out targets, got {design.name}")
    return design.skill.demo(design)


def find_scene(config: ArenaConfig, design: Design, seed: int, program: DemoProgram) -> DemoScene:
    """The first scene of a seed in which a program can show something.

    It names exactly as many blocks as it should, none of them nearer than FARTHER. Scenes as in
    training come first; where they cannot do (2 x 2 blocks and a color alone), one with fewer
    blocks. Raises ConfigError if no scene fits.
    """
    task = ReachTask(config, design, seed)
    goal, bodiless = parse_goal(program.text, design.vocabulary), design.vocabulary.bodiless
    first = stages(goal)[0]
    farther = FARTHER * task.scoring.threshold_of(first)
    for condition in design.skill.demo_conditions:
        drawn_from = condition_named(condition, design)
        for index in range(SCENES_SEARCHED):
            episode = generate(config, design, drawn_from, seed, index)
            kinds = [block.kind.words for block in episode.blocks]
            named = [satisfying(one, kinds, None, bodiless) for one in stages(goal)]
            if sum(map(any, zip(*named, strict=True))) != program.targets:
                continue
            task.reset_to(episode)
            try:
                _, verdict = task.set_program(goal)
            except ProgramError:  # all named objects are in one of its two sets
                continue
            if farther <= verdict.distance <= program.farthest:
                return DemoScene(condition, episode, verdict.distance)
    raise ConfigError(
        f"demo: no scene of design {design.name} in which {program.text} names "
        f"{program.targets} object(s) at least {farther:g} {RELATIONS[first.relation].unit} away"
    )


def film_execution(
    agent: TrainedAgent,
    path: Path,
    seed: int,
    width: int,
    rendered: bool | None = None,
    condition: str = "",
    program: str = "",
) -> tuple[int, list[str]]:
    """Write a film of the six programs, one scene each, at the speed of the arena; or of one goal,
    in the first scene of a condition in which it can hold.

    Returns its number of pictures, and the programs that were not reached. Raises ConfigError for
    an unknown kind of file or condition, or a design that holds nothing out, ProgramError for a
    wrong program, RenderError for a file that cannot be written, or for `rendered` without OpenGL.

    :param rendered: in perspective; None: if there is OpenGL.
    :param program: the goal's text; empty: that of the condition's first episode.
    """
    check_movie(path)
    period_s = agent.arena.control_period_s
    missed: list[str] = []
    if condition or program:
        pictures = _goal_pictures(agent, seed, width, rendered, condition, program, missed)
    else:
        pictures = _pictures(agent, seed, width, rendered, missed)
    return write_movie(path, pictures, period_s), missed


def _pictures(
    agent: TrainedAgent, seed: int, width: int, rendered: bool | None, missed: list[str]
) -> Iterator[Picture]:
    task = task_seen(agent.arena, agent.design, seed, agent.perception)
    for program in demo_programs(agent.design):
        scene = find_scene(agent.arena, agent.design, seed, program)
        task.reset_to(scene.episode)
        reached = False
        for caption, satisfied in _executed(agent, task, program):
            color = REACHED if satisfied else AWAY
            picture = captioned(draw(task, width, rendered), (program.text, caption), color)
            yield picture
            reached = satisfied
        if reached:
            yield from [picture] * PAUSE
        else:
            missed.append(program.text)


def _goal_pictures(
    agent: TrainedAgent, seed: int, width: int, rendered: bool | None, condition: str,
    program: str, missed: list[str],
) -> Iterator[Picture]:  # fmt: skip
    """An episode of a condition, until its goal holds or cannot hold any more."""
    task = task_seen(agent.arena, agent.design, seed, agent.perception)
    start = _first_scene(task, condition, program) if program else task.reset(0, condition)
    count = len(stages(task.goal))
    for _, verdict in play(task, pursuing(task, agent.policy), start):
        state = "violated" if verdict.violated else "done" if verdict.satisfied else "to do"
        caption = f"{verdict.stage + 1} of {count}   {state}"
        if task.program.avoided is not None:
            caption += f"   avoids {task.program.avoided}"
        lines = str(task.program.relation_alone), caption
        color = REACHED if verdict.satisfied else AWAY
        picture = captioned(draw(task, width, rendered), lines, color)
        yield picture
        if verdict.satisfied or verdict.violated:
            break
    yield from [picture] * PAUSE
    if not verdict.satisfied:
        missed.append(str(task.goal))


def _first_scene(task: ReachTask, condition: str, program: str) -> tuple[Observation, Verdict]:
    """Begin the first scene of a condition in which a program can hold and does not yet."""
    goal = parse_goal(program, task.design.vocabulary)
    for index in range(SCENES_SEARCHED):
        task.reset(index, condition or "train")
        with suppress(ProgramError):  # it names nothing here
            observation, verdict = task.set_program(goal)
            if not verdict.satisfied:
                return observation, verdict
    raise ConfigError(f"film: {program}: expected a design with a scene for it, got none")


def _executed(
    agent: TrainedAgent, task: ReachTask, program: DemoProgram
) -> Iterator[tuple[str, bool]]:
    """Execute a program; for each step its caption, and whether the target is reached."""
    goal = parse_goal(program.text, agent.design.vocabulary)
    steps, held = play(task, pursuing(task, agent.policy), task.set_program(goal)), 0
    for step, (_, verdict) in enumerate(islice(steps, program.steps + 1)):
        held = held + 1 if verdict.satisfied else 0
        away = measured(program.text, verdict.distance, verdict.stage)
        state = "reached" if verdict.satisfied else f"{away} away"
        yield f"{program.kind}   step {step}   {state}", verdict.satisfied
        if held == HELD:
            return
