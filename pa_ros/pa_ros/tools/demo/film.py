"""A film of an agent that executes the six programs of the demonstration, in one process."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from pa_ros.arena import ReachTask
from pa_ros.arena.movie import Picture, captioned, check_movie, write_movie
from pa_ros.arena.render import draw
from pa_ros.evaluation.scoring.agents import TrainedAgent
from pa_ros.language import parse
from pa_ros.tools.demo.scenes import DemoProgram, demo_programs, find_scene
from pa_ros.world.relations import RELATIONS

EVERY = 2  # control steps for each picture
HELD = 8  # steps that a reached target is shown for
LONGEST = 60  # steps of a program


def film_execution(
    agent: TrainedAgent, path: Path, seed: int, side_px: int, rendered: bool, fast: float = 1.0
) -> tuple[int, list[str]]:
    """Write a GIF or MP4 of the six programs, one scene each; its number of pictures, and the
    programs that were not reached.

    `fast`: how much faster than the arena. ConfigError for a file of another kind or a design with
    nothing held out, RenderError for a file that can't be written or `rendered` without OpenGL.
    """
    check_movie(path)
    period_s = EVERY * agent.arena.control_period_ns / 1e9 / fast
    missed: list[str] = []
    pictures = _pictures(agent, seed, side_px, rendered, missed)
    return write_movie(path, pictures, period_s), missed


def _pictures(
    agent: TrainedAgent, seed: int, side_px: int, rendered: bool, missed: list[str]
) -> Iterator[Picture]:
    task = ReachTask(agent.arena, agent.design, seed)
    for program in demo_programs(agent.design):
        scene = find_scene(agent.arena, agent.design, seed, program)
        task.reset_to(scene.episode)
        reached = False
        for said, satisfied in _executed(agent, task, program):
            yield captioned(draw(task, side_px, rendered), (program.text, said))
            reached = satisfied
        if not reached:
            missed.append(program.text)


def _executed(
    agent: TrainedAgent, task: ReachTask, program: DemoProgram
) -> Iterator[tuple[str, bool]]:
    """What to say at each picture's step, the task being there, and whether it is reached."""
    parsed = parse(program.text, agent.design.vocabulary)
    observation, verdict = task.set_program(parsed)
    policy, held, unit = agent.policy, 0, RELATIONS[parsed.relation].unit
    for step in range(LONGEST + 1):
        held = held + 1 if verdict.satisfied else 0
        if step % EVERY == 0 or held == HELD:
            state = "reached" if verdict.satisfied else f"{verdict.distance:.2f} {unit} away"
            yield f"{program.kind}   step {step}   {state}", verdict.satisfied
        if held == HELD:
            return
        observation, verdict = task.step(policy(observation, parsed))
