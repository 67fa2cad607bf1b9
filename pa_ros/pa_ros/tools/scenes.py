"""What stands on an arena's table, what is asked of it, and what could be asked now."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data

from pa_ros.core.errors import PaError
from pa_ros.core.experience import Float32, Verdict
from pa_ros.core.text import printable
from pa_ros.language import Vocabulary, parse, require_target
from pa_ros.ros.executor import steady_timer
from pa_ros.ros.topics import ARENA_INFO, OBJECT_FEATURES, SAMPLES, VERDICT
from pa_ros.tools.monitor import GraphFigures
from pa_ros.wire import Message
from pa_ros.wire.arena import ArenaDescription, decode_arena_info
from pa_ros.wire.step import decode_objects, decode_step_mark, decode_verdict
from pa_ros.world.world import World

SUGGESTED = 12
LOOK_S = 0.5  # how often it is asked whether an arena shows samples
ENDING = 2  # rows of figures that stand last: refusals and alarms

Block = frozenset[str]
"""The true words of a block."""


class Scene:
    """Follows an arena by its samples, four times a second, for as long as `node` is spun.

    Of one that shows none, as a robot's driver, it takes the steps themselves, and those best
    effort, so that nothing waits for it.
    """

    def __init__(self, node: Node, namespace: str = "") -> None:
        """`namespace`: below the node's; or, with a slash, anywhere."""
        self.arena: ArenaDescription | None = None
        self.unreadable = ""  # why the newest description of an arena could not be read
        self.blocks: tuple[Block, ...] = ()
        self.episode, self.program = -1, ""
        self.verdict: Verdict | None = None
        self._node = node
        self._steps: list[Any] = []  # readers of whole steps
        features, verdict = (
            partial(_tolerant, receive) for receive in (self._on_features, self._on_verdict)
        )
        self._samples, shown = (SAMPLES[part].within(namespace) for part in ("features", "verdict"))
        ARENA_INFO.within(namespace).subscribe(node, partial(_tolerant, self._on_arena))
        self._samples.subscribe(node, features)
        shown.subscribe(node, verdict)
        self._whole = tuple(
            (replace(topic.within(namespace), reader=qos_profile_sensor_data), receive)
            for topic, receive in ((OBJECT_FEATURES, features), (VERDICT, verdict))
        )
        steady_timer(node, LOOK_S, self._attend)

    @property
    def known(self) -> bool:
        """Whether a sample has come."""
        return bool(self.blocks)

    def suggestions(self) -> tuple[str, ...]:
        """Programs that name one of the blocks."""
        if self.arena is None:
            return ()
        return sensible(self.arena, self.arena.world.vocabulary, self.blocks)

    def rows(self) -> list[tuple[str, str]]:
        """Label and text, for a table; nothing before a sample has come."""
        if not self.known:
            return []
        named = ", ".join(self.names())
        return [("blocks", named), ("program", self.program or "none"), ("distance", self._far())]

    def line(self) -> str:
        """The same in short, without the blocks."""
        return f"{self.program or 'no program'}, {self._far()}" if self.known else ""

    def names(self) -> list[str]:
        """The blocks by their words, as programs mostly say them."""
        row = self.arena.world.vocabulary.row if self.arena else {}
        return [name_of(block, row) for block in self.blocks]

    def _far(self) -> str:
        if self.verdict is None or not np.isfinite(self.verdict.distance):
            return "-"
        return f"{self.verdict.distance:.2f} m{', satisfied' if self.verdict.satisfied else ''}"

    def _attend(self) -> None:
        """Listen to whole steps where an arena shows no samples, and there alone."""
        if self.arena is None or self._node.count_publishers(self._samples.name):
            while self._steps:
                self._node.destroy_subscription(self._steps.pop())
        elif not self._steps:
            self._steps = [topic.subscribe(self._node, take) for topic, take in self._whole]

    def _on_arena(self, message: Message) -> None:
        try:
            self.arena, self.unreadable = decode_arena_info(message), ""
        except PaError as error:
            self.unreadable = str(error)
            raise

    def _on_features(self, message: Message) -> None:
        if self.arena is None:
            return
        world = self.arena.world
        objects, hand = decode_objects(message, world.object_features)
        mark = decode_step_mark(message)
        self.blocks = blocks_of(objects, hand, world)
        self.program, self.episode = printable(mark.program), mark.episode

    def _on_verdict(self, message: Message) -> None:
        self.verdict = decode_verdict(message)


class SceneFigures:
    """A graph's figures, and what stands on its arenas' tables."""

    def __init__(self, node: Node, figures: GraphFigures, arenas: Sequence[str]) -> None:
        """`arenas`: namespaces of a fleet's, below the node's; none: it is not one."""
        self._figures = figures
        self._scenes = {arena: Scene(node, arena) for arena in arenas or ("",)}

    def rows(self) -> list[tuple[str, str]]:
        """Label and text: of one arena its scene, of each of a fleet what it is at."""
        figures = self._figures.rows()
        if list(self._scenes) == [""]:
            shown = self._scenes[""].rows()
        else:
            shown = [(f"/{name}: at", one.line()) for name, one in self._scenes.items()]
        return [*figures[:-ENDING], *shown, *figures[-ENDING:]]

    def line(self) -> str:
        """In one plain line, without blocks; a fleet's has the figures alone."""
        scene = self._scenes.get("")
        return "  ".join(filter(None, [self._figures.line(), scene.line() if scene else ""]))


def _tolerant(receive: Callable[[Message], None], message: Message) -> None:
    """Who only looks passes over what it cannot read; the graph's nodes refuse and count it."""
    try:
        receive(message)
    except PaError:
        return


def blocks_of(objects: Float32, hand_index: int, world: World) -> tuple[Block, ...]:
    """The words of what each object but the hand is, [N, F]; also those that programs lack."""
    schema, found = world.schema, []
    has = schema.has(np.delete(objects, hand_index, axis=0))
    for i in range(len(objects) - 1):
        values = [
            value
            for group, rows in zip(schema, has, strict=True)
            for value, is_so in zip(group.features.values, rows[i], strict=True)
            if is_so
        ]
        found.append(frozenset(map(str, values)))
    return tuple(found)


def name_of(words: Collection[str], row: Mapping[str, int]) -> str:
    """`RED CUBE`: as programs mostly say it, words of the last group first."""
    return " ".join(sorted(words, key=lambda word: (-row.get(word, len(row)), word)))


def sensible(
    arena: ArenaDescription, vocabulary: Vocabulary, blocks: Sequence[Collection[str]]
) -> tuple[str, ...]:
    """Up to SUGGESTED programs that name one of the blocks."""
    texts = [str(program) for program in arena.training_programs]
    groups, near = vocabulary.by_group.values(), vocabulary.relations[0]
    for block in blocks:
        words = [next((w for w in group if w in block), "") for group in groups]
        known = [word for word in words if word]
        if len(known) == len(words) > 1:
            texts.insert(0, f"{near}(HAND, AND({', '.join(reversed(known))}))")
        texts += [f"{near}(HAND, {word})" for word in known]
        texts += [f"{near}(HAND, NOT({word}))" for word in known[:1]]
    present = [set(block) for block in blocks]
    found: dict[str, None] = {}
    for text in texts:
        try:
            require_target(parse(text, vocabulary), present, None)
        except PaError:
            continue
        found[text] = None
    return tuple(found)[:SUGGESTED]
