"""Show what is on an arena's table, what the agent is asked to do, and what it could be asked."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import inf, isfinite
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data

from pa_ros.core.errors import PaError
from pa_ros.core.experience import Float64, Observation, Step
from pa_ros.core.text import printable
from pa_ros.language import HAND, parse, require_target
from pa_ros.ros.executor import steady_timer
from pa_ros.ros.refusals import Refusals
from pa_ros.ros.topics import ARENA_INFO, OBJECT_FEATURES, SAMPLES
from pa_ros.tools.monitor import GraphFigures
from pa_ros.wire import Message
from pa_ros.wire.arena import ArenaDescription, decode_arena_info
from pa_ros.wire.step import decode_step
from pa_ros.world.poses import places
from pa_ros.world.relation import at_stage, measured

MAX_SUGGESTIONS = 12
POLL_S = 0.5  # between two checks whether an arena publishes samples


@dataclass(frozen=True)
class Scene:
    """An arena's scene at one step, and the programs possible there; `print` shows it."""

    arena: ArenaDescription
    step: Step

    @property
    def observation(self) -> Observation:
        """What the arena observed."""
        return self.step.observation

    @property
    def blocks(self) -> tuple[str, ...]:
        """Names of the blocks, such as RED CUBE."""
        seen = self.observation
        hand, names = seen.hand_index, self.arena.world.schema.labels(seen.objects, seen.hand_index)
        return (*names[:hand], *names[hand + 1 :])

    @property
    def places(self) -> Float64:
        """Where the blocks are, [N - 1, 3] m in the base's frame."""
        seen = self.observation
        return np.delete(places(seen.hand_pose, seen.objects), seen.hand_index, axis=0)

    @property
    def episode(self) -> int:
        """The episode's number."""
        return self.observation.episode

    @property
    def program(self) -> str:
        """The program in force; empty: none."""
        return printable(self.step.program)

    @property
    def distance(self) -> float:
        """The measure of the program's relation, for NEAR in m; inf: nobody judged it."""
        return self.step.verdict.distance if self.step.verdict else inf

    @property
    def satisfied(self) -> bool:
        """Whether the program is satisfied now."""
        return self.step.verdict is not None and self.step.verdict.satisfied

    @property
    def programs(self) -> tuple[str, ...]:
        """Up to MAX_SUGGESTIONS programs that name something on the table."""
        measures = self.step.verdict.measures if self.step.verdict else None
        if measures is not None:  # nothing tells the blocks' words
            named = zip(self.arena.training_programs, measures, strict=True)
            return tuple(str(program) for program, m in named if isfinite(m))[:MAX_SUGGESTIONS]
        return suggested_programs(self.arena, self.blocks)

    def rows(self) -> list[tuple[str, str]]:
        """(label, text) for a table."""
        blocks, program = ", ".join(self.blocks), self.program or "none"
        return [("blocks", blocks), ("program", program), ("distance", self.shown_distance())]

    def line(self) -> str:
        """Program and distance in one line."""
        return f"{self.program or 'no program'}, {self.shown_distance()}"

    def __str__(self) -> str:
        return "\n".join([*(f"{label}: {text}" for label, text in self.rows()), self.suggested()])

    def suggested(self) -> str:
        """The programs that make sense, one a line."""
        return "\n  ".join(["programs that make sense now:", *self.programs])

    def picture(self, side_px: int = 480) -> Any:
        """The table from above, an RGB array [side, side, 3] of uint8, drawn from what the arena
        observed: the hand is a white ring, and objects that the program names have a black edge.
        Blocks whose properties are only seen are grey squares."""
        from pa_ros.arena.render import top_view
        from pa_ros.bags.film import RecordedScene

        scene = RecordedScene(self.arena, self.step)
        scene.show(self.step)
        return top_view(scene.task, side_px)

    def shown_distance(self) -> str:
        """The distance with its unit, and whether the program is satisfied."""
        if not isfinite(self.distance):
            return "-"
        stage = self.step.stage
        where = measured(self.program, self.distance, stage)
        at = at_stage(self.program, stage)
        return f"{where}{', satisfied' if self.satisfied else ''}{', ' if at else ''}{at}"


class SceneMonitor:
    """Follows an arena by its samples, four times a second, while `node` is spun.

    A robot's driver publishes no samples. Then the steps themselves are read, best effort, so that
    the driver never waits for this reader.
    """

    def __init__(self, node: Node, namespace: str = "") -> None:
        """`namespace` is below the node's; with a slash, anywhere."""
        self.arena: ArenaDescription | None = None
        self.scene: Scene | None = None  # the newest; None: no sample or step has arrived
        self.stepped_at = time.monotonic()  # when the arena's time was last seen to advance
        self._node = node
        self._step_reader: Any = None
        guard = Refusals(lambda _: None).guard  # the graph's nodes report what can't be decoded
        self._receive = guard(OBJECT_FEATURES.name, self._on_step)
        self._samples = SAMPLES.within(namespace)
        ARENA_INFO.within(namespace).subscribe(node, guard(ARENA_INFO.name, self._on_arena))
        self._samples.subscribe(node, self._receive)
        self._steps = replace(OBJECT_FEATURES.within(namespace), reader=qos_profile_sensor_data)
        steady_timer(node, POLL_S, self._choose_source)

    def _choose_source(self) -> None:
        """Read whole steps only where an arena publishes no samples."""
        wanted = self.arena is not None and not self._node.count_publishers(self._samples.name)
        if wanted and self._step_reader is None:
            self._step_reader = self._steps.subscribe(self._node, self._receive)
        elif not wanted and self._step_reader is not None:
            self._node.destroy_subscription(self._step_reader)
            self._step_reader = None

    def _on_arena(self, message: Message) -> None:
        self.arena = decode_arena_info(message)

    def _on_step(self, message: Message) -> None:
        if self.arena is None:
            return
        world = self.arena.world
        before, step = self.scene, decode_step(message, world.joints, world.object_features)
        if before is None or step.observation.stamp_ns != before.step.observation.stamp_ns:
            self.stepped_at = time.monotonic()
        self.scene = Scene(self.arena, step)


class SceneFigures:
    """A graph's figures together with the scenes of its arenas."""

    def __init__(self, node: Node, figures: GraphFigures, arenas: Sequence[str]) -> None:
        """`arenas` are namespaces below the node's; empty: one arena in the node's own."""
        self._figures = figures
        self._monitors = {arena: SceneMonitor(node, arena) for arena in arenas or ("",)}

    def rows(self) -> list[tuple[str, str]]:
        """(label, text): the scene of a single arena, or a line for each of several."""
        scenes = {name: monitor.scene for name, monitor in self._monitors.items()}
        if list(scenes) == [""]:
            shown = scenes[""].rows() if scenes[""] else []
        else:
            shown = [(f"/{name}: at", one.line() if one else "") for name, one in scenes.items()]
        return self._figures.rows(shown)

    def line(self) -> str:
        """One plain line, with the scene of a single arena."""
        monitor = self._monitors.get("")
        scene = monitor.scene if monitor else None
        return "  ".join(filter(None, [self._figures.line(), scene.line() if scene else ""]))


def suggested_programs(arena: ArenaDescription, names: Iterable[str]) -> tuple[str, ...]:
    """Up to MAX_SUGGESTIONS programs that name some of the blocks with these names.

    Where blocks can be moved, programs that move one come first.
    """
    vocabulary, blocks = arena.world.vocabulary, [set(name.split()) for name in names]
    whole, parts = [], []
    groups, near = vocabulary.by_group.values(), vocabulary.relations[0]
    for block in blocks:
        words = [next((w for w in group if w in block), "") for group in groups]
        known = [word for word in words if word]
        if len(known) == len(words) > 1:
            whole.append(f"AND({', '.join(reversed(known))})")
        parts += [f"{near}(HAND, {word})" for word in known]
        # One negation of each block is enough to show that there are such programs.
        parts += [f"{near}(HAND, NOT({word}))" for word in known[:1]]
    # In a scene blocks come before places: each of these moves one to the next.
    pushes = [f"{near}({one}, {other})" for one, other in pairwise(whole)]
    pushes += [str(program) for program in arena.training_programs if HAND not in program.sets]
    reaches = [f"{near}(HAND, {one})" for one in whole]
    found: dict[str, None] = {}
    for text in (*pushes, *reaches, *map(str, arena.training_programs), *parts):
        try:
            require_target(parse(text, vocabulary), blocks, None, vocabulary.bodiless)
        except PaError:
            continue
        found[text] = None
    return tuple(found)[:MAX_SUGGESTIONS]
