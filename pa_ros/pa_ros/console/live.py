"""A running graph on the page: it is listened to, sent programs, and asked through services."""

from __future__ import annotations

import os
import queue
import time
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import count
from typing import Any

from rclpy.node import Node

from pa_ros.console import markup
from pa_ros.console.asked import PageError, attempt
from pa_ros.console.history import History
from pa_ros.console.moment import Moment, looked
from pa_ros.console.page import Page
from pa_ros.console.sampler import DEPTH, PARTS, Sampler, within
from pa_ros.console.services import ArenaServices
from pa_ros.console.weights import AgentWeights
from pa_ros.core.errors import PaError
from pa_ros.language import Vocabulary, parse
from pa_ros.ros.refusals import Refusals
from pa_ros.ros.topics import ARENA_INFO, PROGRAM, PROGRAM_STATUS, SAMPLES
from pa_ros.tools.client import namespaces_of_arenas
from pa_ros.tools.monitor import GraphFigures, watch_diagnostics
from pa_ros.tools.scenes import suggested_programs
from pa_ros.wire import Message
from pa_ros.wire.arena import ArenaDescription, Mode, decode_arena_info
from pa_ros.wire.program import ProgramRequest, decode_program_status, encode_program
from pa_ros.wire.step import decode_context, decode_observation, decode_verdict

REMEMBERED = 256  # programs by id
SURVEY_S = 2.0  # how often arenas are looked for
FIGURES_S = 1.0
LOCKSTEP_S = 0.5  # learning takes every core: the arena's own samples are looked at
LOCKSTEP_DEPTH = 4


class LiveConsole:
    """`Desk` of the pages, and what draws them: `tick` in the thread that serves `node`."""

    def __init__(self, node: Node, sampled: Node, page: Page, namespace: str) -> None:
        """`sampled` is served by no executor (see Sampler)."""
        self._node, self._sampled, self._page = node, sampled, page
        self._todo: queue.SimpleQueue[Callable[[], object]] = queue.SimpleQueue()
        self._refusals = Refusals(node.get_logger().warning)
        self.figures, self.history = GraphFigures(), History()
        watch_diagnostics(node, self.figures)
        self._serial, self._began = count(), time.monotonic()
        self._surveyed = self._plotted = self._looked = -SURVEY_S
        self._arenas: tuple[str, ...] = ()
        self._sampler: Sampler | None = None
        self._examples: tuple[str, ...] = ()
        self._open: list[Any] = []
        self._attend(namespace)

    # What controls ask for, on any thread

    def do(self, act: Callable[[], object]) -> None:
        self._todo.put(act)

    def vocabulary(self) -> Vocabulary | None:
        return self._vocabulary

    def examples(self) -> Sequence[str]:
        return self._examples

    def arenas(self) -> Sequence[str]:
        return self._arenas

    def send(self, text: str) -> None:
        self._todo.put(lambda: self._send(text))

    def choose(self, namespace: str) -> None:
        self._todo.put(lambda: self._choose(namespace))

    def ask(self, service: str, value: float = 0.0) -> None:
        self._todo.put(lambda: self._services.ask(service, value))

    def blocks(self) -> Sequence[tuple[str, tuple[float, float, float]]]:
        return self._page.scene.places

    def move(self, block: int, x: float, y: float) -> None:
        self._todo.put(lambda: self._services.move(block, x, y))

    # In the thread of the node

    def tick(self, pages: int) -> None:
        """Do what was asked; renew the page if one is open, else rest."""
        while not self._todo.empty():
            attempt(self._refusals, "page", self._todo.get())
        now = time.monotonic()
        if now - self._surveyed > SURVEY_S:
            before, self._arenas = self._arenas, namespaces_of_arenas(self._node)
            self._surveyed = now
            lacks = self._arena is None and f"/{self._namespace}" not in self._arenas
            if lacks and self._arenas and self._arenas == before:  # the one asked for isn't to come
                self._attend(self._arenas[0])
        if not pages and not self.history.pending:
            self._rest()
            return
        lockstep = self._arena is not None and self._arena.mode is Mode.LOCKSTEP
        if lockstep and now - self._looked < LOCKSTEP_S:
            return
        self._looked = now
        if self._sampler is None:
            name = within(self._namespace, SAMPLES["features"])
            thin = lockstep and self._node.count_publishers(name) > 0
            taken = (LOCKSTEP_DEPTH, SAMPLES) if thin else (DEPTH, PARTS)
            self._sampler = Sampler(self._sampled, self._namespace, *taken)
        self._weights.attend()
        self._look(self._sampler.take())
        self._page.say("History", self.history.html() + self._services.html())
        if now - self._plotted > FIGURES_S:
            self._plotted = now
            self._page.plot(now - self._began, self.figures.value)
            self._page.say("Alarms", _alarms(self.figures))

    def _rest(self) -> None:
        self._listen_no_more()
        self._weights.rest()

    def _listen_no_more(self) -> None:
        if self._sampler is not None:
            self._sampler.close()
            self._sampler = None

    def _choose(self, namespace: str) -> None:
        if namespace not in self._arenas:
            raise PageError(f"expected an arena of {list(self._arenas)}, got {namespace!r}")
        self._attend(namespace)

    def _attend(self, namespace: str) -> None:
        """Turn to the arena of a namespace."""
        self._leave()
        self._namespace = namespace.strip("/")
        self._arena: ArenaDescription | None = None
        self._vocabulary: Vocabulary | None = None
        self._texts: OrderedDict[str, str] = OrderedDict()
        self._examples = ()
        self._services = ArenaServices(self._node, self._namespace)
        self._weights = AgentWeights(self._node, self._namespace, self._refusals)
        self._publisher = _named(PROGRAM, self._namespace).publisher(self._node)
        self._open = [
            _named(topic, self._namespace).subscribe(
                self._node, self._refusals.guard(topic.name, callback)
            )
            for topic, callback in ((ARENA_INFO, self._on_arena), (PROGRAM_STATUS, self._on_status))
        ]
        self._page.say("State", "")

    def _leave(self) -> None:
        """Hold nothing of the arena that was attended to."""
        self._listen_no_more()
        if not self._open:
            return
        for entity in self._open:
            self._node.destroy_subscription(entity)
        self._node.destroy_publisher(self._publisher)
        self._services.close()
        self._weights.close()

    def _on_arena(self, message: Message) -> None:
        arena = decode_arena_info(message)
        if self._arena is None or self._arena.mode is not arena.mode:
            self._rest()
        self._vocabulary, self._arena = arena.world.vocabulary, arena

    def _on_status(self, message: Message) -> None:
        judgement = decode_program_status(message)
        self.history.judge(judgement)
        if judgement.accepted:
            self._texts[judgement.program_id] = judgement.canonical
            while len(self._texts) > REMEMBERED:
                self._texts.popitem(last=False)

    def _send(self, text: str) -> None:
        """A text that is no program goes nowhere; whether it names something, the arena says."""
        program_id = f"console-{os.getpid()}-{next(self._serial)}"
        try:
            if self._vocabulary is None:
                raise PaError("no arena is known yet")
            request = ProgramRequest(program_id, str(parse(text, self._vocabulary)))
        except PaError as error:
            self.history.add(program_id, text, note=str(error).partition("\n")[0])
            return
        self.history.add(program_id, request.text)
        self._publisher.publish(encode_program(request))

    def _look(self, steps: list[dict[str, Message]]) -> None:
        """Take in all steps that came, and show the newest."""
        arena = self._arena
        if arena is None or self._vocabulary is None:
            where = self._namespace or "/"
            self._page.say("State", markup.quiet(f"waits for an arena in the namespace {where}"))
            return
        try:
            self.history.observe([decode_verdict(step["verdict"]) for step in steps])
            if not steps:
                return
            newest = steps[-1]
            seen = decode_observation(newest["features"], len(arena.joint_names))
            verdict = decode_verdict(newest["verdict"])
            context = decode_context(newest["features"])
        except PaError as error:
            self._refusals.refuse("step", error)
            return
        text = context.program or self._texts.get(seen.program_id, "")
        look, why = looked(self._weights.insight, seen, text, self._vocabulary)
        moment = Moment(
            arena, seen, context.evaluation, text, verdict.reward,
            verdict.distance, verdict.satisfied, look, self._weights.why or why,
        )  # fmt: skip
        self._page.show(moment, self._speed())
        self._examples = self._sensible(arena)

    def _speed(self) -> str:
        factor = self.figures.value("sim_node", "real_time_factor")
        return "" if factor is None else f", {factor:.1f} times real time"

    def _sensible(self, arena: ArenaDescription) -> tuple[str, ...]:
        """Programs that name something in this scene: trained ones, and some that are not."""
        if self._vocabulary is None:
            return ()
        return suggested_programs(
            arena, self._vocabulary, [set(n.split()) for n in self._page.scene.names]
        )


def _named(topic: Any, namespace: str) -> Any:
    return replace(topic, name=within(namespace, topic))


def _alarms(figures: GraphFigures) -> str:
    return markup.pairs(figures.rows()[-2:], "Alarms")
