"""Bags of episodes to look into: two that were acted, one in which blocks come and go."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from pa_ros.arena import ARMS, ReachTask, design_named, preset_named
from pa_ros.arena.rearranging import bodies, rearrange
from pa_ros.bags.contents import reliable_qos, topic
from pa_ros.bags.writer import BagWriter
from pa_ros.core.body import Body
from pa_ros.core.experience import Observation, Verdict
from pa_ros.language import Program, parse
from pa_ros.provenance.origins import describe
from pa_ros.wire import codec
from pa_ros.wire.definitions import installed_types, message_type, to_cdr
from pa_ros.wire.records import Command, ProgramRequest, StepContext

STEPS = 30
Step = tuple[Observation, Verdict, Command | None, Program, bool]
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])
ARENA, DESIGN = preset_named("fast"), design_named("2-L")


def rearranged() -> list[Step]:
    """An episode in which the first block is removed, and two others are put down later."""
    task, found = ReachTask(ARENA, DESIGN, 3), list[Step]()
    observation, verdict = task.reset(7)
    kinds = [block.kind for block in task.episode.blocks]
    for step in range(9):
        if step == 3:
            rearrange(task, kinds[1:], bodies(task)[2:])
        if step == 6:
            corners = [Body.at_rest(np.array([x, -0.4, 0.0]), UPRIGHT) for x in (-0.4, -0.3)]
            spare = kinds[0].but(color="GREEN")
            rearrange(task, [*kinds[1:], kinds[0], spare], [*bodies(task)[1:], *corners])
        found.append((observation, verdict, None, task.program, False))
        observation, verdict = task.step(np.full(6, 0.2))
    return found


def acted() -> list[Step]:
    """Two short episodes: training 7, evaluation 7; with the commands that led on."""
    task, rng, found = ReachTask(ARENA, DESIGN, 3), np.random.default_rng(0), []
    for evaluation in (False, True):
        observation, verdict = task.reset(7, "eval" if evaluation else "train")
        for step in range(STEPS + 1):
            action = rng.uniform(-1, 1, 6).astype(np.float32)
            stamp = observation.stamp_ns
            command = Command(7, step, stamp, "a", 4, action) if step < STEPS else None
            found.append((observation, verdict, command, task.program, evaluation))
            if command is not None:
                observation, verdict = task.step(action * np.array(ARENA.joint_speed_limits))
    return found


def recorded(folder: Path, steps: list[Step]) -> Path:
    store = installed_types()
    with BagWriter(folder) as bag:
        clock = iter(range(10**18, 10**18 + 10**9, 1000))
        declared: set[str] = set()

        def write(name: str, message: Any) -> None:
            if name not in declared:
                declared.add(name)
                kind = message_type(type(message))
                bag.add(topic(store, name, kind, [reliable_qos(100)]))
            bag.write(name, to_cdr(store, message), next(clock))

        about = describe(ARENA, DESIGN, 3, [parse("NEAR(HAND, RED)", DESIGN.vocabulary)], "x")
        write("/arena_info", codec.encode_arena_info(about))
        for i, (observation, verdict, command, program, evaluation) in enumerate(steps):
            if observation.step == 0:
                request = ProgramRequest(observation.program_id, str(program))
                write("/program", codec.encode_program(request))
            features, joints = codec.encode_observation(
                observation, ARMS["jaco"].joint_names, StepContext(evaluation=evaluation)
            )
            parts = [
                ("/joint_states", joints),
                ("/object_features", features),
                ("/verdict", codec.encode_verdict(verdict, evaluation)),
            ]
            if command is not None:
                parts.append(("/joint_commands", codec.encode_command(command)))
            for name, message in parts if i % 2 else reversed(parts):
                write(name, message)
            if i == 5:
                write("/object_features", features)
    return folder
