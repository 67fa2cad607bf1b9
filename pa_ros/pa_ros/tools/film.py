"""Six programs that show what an agent learned, scenes for them, and a film of their execution."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from math import inf
from pathlib import Path

from pa_ros.agents import TrainedAgent
from pa_ros.arena import ArenaConfig, Design, Episode, Kind, ReachTask, condition_named, generate
from pa_ros.arena.movie import Picture, captioned, check_movie, write_movie
from pa_ros.arena.render import draw
from pa_ros.arena.task import play
from pa_ros.core.errors import ConfigError
from pa_ros.evaluation.evaluate import pursuing
from pa_ros.language import ProgramError, parse, satisfying, stages
from pa_ros.perception import task_seen
from pa_ros.world.relation import RELATIONS

# Conditions of the scenes: as in training; and with fewer blocks, only one of each color.
FULL, FEWER = "eval", "only-color"
FULL_PUSHED, FEWER_PUSHED = "eval", "moved-only-color"  # where programs move blocks
FARTHEST_M = 0.40  # that a block is moved
SCENES_SEARCHED = 1000
# The hand starts at least this many thresholds of the relation away, so that the arm must move.
FARTHER = 2.0
HELD = 5  # a program has succeeded after so many satisfied steps
PAUSE = 8  # pictures for which a success is shown
LONGEST, LONGEST_PUSH = 60, 99  # steps of a program
REACHED, AWAY = "#1a7f37", "#57606a"  # colors of the verdict


@dataclass(frozen=True)
class DemoProgram:
    """A program to execute, and what is new about it."""

    kind: str
    text: str
    targets: int = 1  # objects of the scene that it names


@dataclass(frozen=True)
class DemoScene:
    """An episode in which a program can show something."""

    condition: str  # FULL or FEWER
    episode: Episode
    distance: float  # the relation's measure of the nearest named block, at the start


def demo_programs(design: Design) -> list[DemoProgram]:
    """Six programs of the design's first relation: one trained, five never trained.

    Raises ConfigError if the design holds nothing out.
    """
    if not design.held_out:
        raise ConfigError(f"demo: expected a design with held-out targets, got {design.name}")
    train, new = design.train, design.held_out[0]
    if design.vocabulary.moves_objects:  # a sphere rolls past where it is pushed
        train = tuple(kind for kind in train if "SPHERE" not in kind.words)
    known = train[0]
    first, last = [*design.values][0], [*design.values][-1]
    other = next(kind for kind in train if kind[last] == known[last] and kind != known)
    trained, held_out = known.conjunction, new.conjunction
    relation = design.vocabulary.relations[0]
    if design.vocabulary.moves_objects:
        return _pushing(relation, known, new, other, design.places)
    without = f"AND({', '.join([f'NOT({known[first]})', *[*other.values()][1:]])})"
    return [
        DemoProgram("trained", f"{relation}(HAND, {trained})"),
        DemoProgram("held out", f"{relation}(HAND, {held_out})"),
        DemoProgram(f"{first} alone", f"{relation}(HAND, {known[first]})"),
        DemoProgram(f"{last} alone", f"{relation}(HAND, {new[last]})"),
        DemoProgram("NOT", f"{relation}(HAND, {without})"),
        DemoProgram("OR of two", f"{relation}(HAND, OR({trained}, {held_out}))", targets=2),
    ]


def _pushing(
    relation: str, known: Kind, new: Kind, other: Kind, places: Sequence[Kind]
) -> list[DemoProgram]:
    """Programs that move blocks, and one that reaches."""
    trained, held_out, here = known.conjunction, new.conjunction, places[0].conjunction
    first = [*known][0]
    without = f"AND(NOT({known[first]}), {', '.join([*other.values()][1:])})"
    return [
        DemoProgram("trained", f"{relation}({trained}, {places[-1].conjunction})", targets=2),
        DemoProgram("held out", f"{relation}({held_out}, {here})", targets=2),
        DemoProgram("to a block", f"{relation}({trained}, {held_out})", targets=2),
        DemoProgram(f"{first} alone", f"{relation}({new[first]}, {here})", targets=2),
        DemoProgram("NOT", f"{relation}({without}, {here})", targets=2),
        DemoProgram("reach", f"{relation}(HAND, {held_out})"),
    ]


def find_scene(config: ArenaConfig, design: Design, seed: int, program: DemoProgram) -> DemoScene:
    """The first scene of a seed in which a program can show something.

    It names exactly as many blocks as it should, none of them nearer than FARTHER. Scenes as in
    training come first; where they cannot do (2 x 2 blocks and a color alone), one with fewer
    blocks. Raises ConfigError if no scene fits.
    """
    task = ReachTask(config, design, seed)
    parsed = parse(program.text, design.vocabulary)
    pushes, bodiless = not parsed.moves_hand, design.vocabulary.bodiless
    farther = FARTHER * task.scoring.threshold(parsed.relation, between=pushes)
    pushed = design.vocabulary.moves_objects
    for condition in (FULL_PUSHED, FEWER_PUSHED) if pushed else (FULL, FEWER):
        drawn_from = condition_named(condition, design)
        for index in range(SCENES_SEARCHED):
            episode = generate(config, design, drawn_from, seed, index)
            kinds = [block.kind.words for block in episode.blocks]
            if sum(satisfying(parsed, kinds, None, bodiless)) != program.targets:
                continue
            task.reset_to(episode)
            try:
                _, verdict = task.set_program(parsed)
            except ProgramError:  # all named objects are in one of its two sets
                continue
            if farther <= verdict.distance <= (FARTHEST_M if pushes else inf):
                return DemoScene(condition, episode, verdict.distance)
    raise ConfigError(
        f"demo: no scene of design {design.name} in which {program.text} names "
        f"{program.targets} object(s) at least {farther:g} {RELATIONS[parsed.relation].unit} away"
    )


def film_execution(
    agent: TrainedAgent, path: Path, seed: int, width: int, rendered: bool, condition: str = ""
) -> tuple[int, list[str]]:
    """Write a film of the six programs, one scene each, at the speed of the arena; or of the goal
    of a condition's first episode.

    Returns its number of pictures, and the programs that were not reached. Raises ConfigError for
    an unknown kind of file or condition, or a design that holds nothing out, RenderError for a file
    that cannot be written, or for `rendered` without OpenGL.
    """
    check_movie(path)
    period_s = agent.arena.control_period_s
    missed: list[str] = []
    if condition:
        pictures = _goal_pictures(agent, seed, width, rendered, condition, missed)
    else:
        pictures = _pictures(agent, seed, width, rendered, missed)
    return write_movie(path, pictures, period_s), missed


def _pictures(
    agent: TrainedAgent, seed: int, width: int, rendered: bool, missed: list[str]
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
    agent: TrainedAgent, seed: int, width: int, rendered: bool, condition: str, missed: list[str]
) -> Iterator[Picture]:
    """The first episode of a condition, until its goal holds or cannot hold any more."""
    task = task_seen(agent.arena, agent.design, seed, agent.perception)
    start = task.reset(0, condition)
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


def _executed(
    agent: TrainedAgent, task: ReachTask, program: DemoProgram
) -> Iterator[tuple[str, bool]]:
    """Execute a program; for each step its caption, and whether the target is reached."""
    parsed = parse(program.text, agent.design.vocabulary)
    steps = play(task, pursuing(task, agent.policy), task.set_program(parsed))
    held, unit = 0, RELATIONS[parsed.relation].unit
    longest = LONGEST if parsed.moves_hand else LONGEST_PUSH
    for step, (_, verdict) in enumerate(islice(steps, longest + 1)):
        held = held + 1 if verdict.satisfied else 0
        state = "reached" if verdict.satisfied else f"{verdict.distance:.2f} {unit} away"
        yield f"{program.kind}   step {step}   {state}", verdict.satisfied
        if held == HELD:
            return
