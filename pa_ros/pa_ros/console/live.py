"""A running graph on the page: draws its steps, and has `pa_ros.Arm` do what the controls ask."""

from __future__ import annotations

import os
import queue
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import count
from math import nan
from typing import Any

from rclpy.node import Node

from pa_ros.acting.insight import explained
from pa_ros.console import markup
from pa_ros.console.history import History
from pa_ros.console.moment import Moment
from pa_ros.console.page import Page
from pa_ros.console.server import ConsoleError, attempt
from pa_ros.console.sources import DEPTH, Sampler
from pa_ros.core.errors import PaError
from pa_ros.language import Vocabulary, parse_goal
from pa_ros.ros.refusals import Refusals
from pa_ros.ros.topics import ARENA_INFO, CAMERA_TRACKS, OBJECT_FEATURES, PROGRAM_STATUS, SAMPLES
from pa_ros.tools.arm import Arm
from pa_ros.tools.client import namespaces_of_arenas
from pa_ros.tools.monitor import GraphFigures, watch_diagnostics
from pa_ros.tools.weights import AgentWeights
from pa_ros.wire import Message
from pa_ros.wire.arena import ArenaDescription, Mode, decode_arena_info
from pa_ros.wire.program import decode_program_status
from pa_ros.wire.step import decode_step
from pa_ros.wire.views import decode_image

SURVEY_S = 2.0  # how often arenas are looked for
FIGURES_S = 1.0  # how often curves and alarms are updated
LOCKSTEP_S = 0.5  # in lockstep, learning needs every core: the page is drawn twice a second
LOCKSTEP_DEPTH = 4
PATIENCE_S = 5.0  # for answers to what a page asks
REQUESTS = 4  # that wait for their answers at the same time
RATE = "real_time_factor"  # in the diagnostics of an arena


class LiveConsole:
    """What controls use, on any thread, and what draws the pages, in the thread of `node`."""

    def __init__(self, node: Node, sampled: Node, page: Page, namespace: str) -> None:
        """`sampled` is a node that nobody spins (see Sampler)."""
        self._node, self._sampled, self._page = node, sampled, page
        # What controls asked for, to be done in the node's thread.
        self._todo: queue.SimpleQueue[Callable[[], object]] = queue.SimpleQueue()
        self._refusals = Refusals(node.get_logger().warning)
        self._figures, self._history = GraphFigures(), History()
        watch_diagnostics(node, self._figures)
        self._serial, self._began = count(), time.monotonic()
        self._surveyed = self._plotted = self._drawn = -SURVEY_S
        self._samplers: tuple[Sampler, ...] = ()  # of steps and of pictures; empty: at rest
        self._open: list[Any] = []  # subscriptions in the arena's namespace
        self._weights: AgentWeights
        self._arms: dict[str, Arm] = {}  # by namespace
        self._joining = threading.Lock()
        self._joined = set[str]()  # namespaces that were joined, or are being joined
        self._requests = ThreadPoolExecutor(REQUESTS, "console")
        self.asked = ""  # the last request, and what became of it
        self.vocabulary: Vocabulary | None = None  # the arena's words; None: no arena is known
        self.speed: float | None = None  # times real time; None: in lockstep, or not known
        self.examples: tuple[str, ...] = ()  # programs that name something in the scene
        self.arenas: tuple[str, ...] = ()  # namespaces of the arenas that are running
        self._follow(namespace)

    @property
    def blocks(self) -> tuple[tuple[str, tuple[float, float, float]], ...]:
        """The blocks' names, and where each is (m)."""
        return self._page.scene.places

    def ask(self, name: str, act: Callable[[Arm], object]) -> None:
        """Send a request to the arena from another thread; `asked` shows its outcome."""
        self.asked = f"{name}: not answered yet"
        self._requests.submit(self._ask, name, act, self._namespace)

    def join(self) -> None:
        """Join the arena's graph, so that the first request does not have to wait for that."""
        if self._arena is not None and self._namespace not in self._joined:
            self._joined.add(self._namespace)
            self._requests.submit(self._arm, self._namespace)

    def close(self) -> None:
        """Leave the graph."""
        self._requests.shutdown(cancel_futures=True)
        for arm in self._arms.values():
            arm.close()

    def read(self, text: str) -> str:
        """The canonical form of a program. Raises PaError for one that this agent cannot execute
        here."""
        if self.vocabulary is None:
            raise ConsoleError("no arena is known yet")
        goal = parse_goal(text, self.vocabulary)
        self._weights.check(goal)
        if self._moment is not None:
            seen = self._moment.observation
            self._moment.arena.world.require_possible(goal, seen.objects, seen.hand_index)
        return str(goal)

    def send(self, text: str) -> None:
        """Send a program."""
        self._todo.put(lambda: self._send(text))

    def choose(self, namespace: str) -> None:
        """Show another arena on all pages."""
        self._todo.put(lambda: self._choose(namespace))

    def tick(self, pages: int) -> None:
        """Do what controls asked for, then draw the newest step if a page is open."""
        while not self._todo.empty():
            attempt(self._refusals, "page", self._todo.get())
        now = time.monotonic()
        if now - self._surveyed > SURVEY_S:
            self._surveyed = now
            self._survey()
        # Nobody looks, so the arena need not send its steps to this process.
        if not pages and not self._history.pending:
            self._rest()
            return
        lockstep = self._arena is not None and self._arena.mode is Mode.LOCKSTEP
        if lockstep and now - self._drawn < LOCKSTEP_S:
            return
        self._drawn = now
        self._weights.refresh()
        if not self._samplers:
            self._subscribe(lockstep)
        steps, pictures = self._samplers
        self._draw(steps.take())
        for message in pictures.take():
            self._refusals.guard("picture", self._show_picture)(message)
        asked = markup.quiet(self.asked) if self.asked else ""
        self._page.set_panel("History", self._history.html() + asked)
        if now - self._plotted > FIGURES_S:
            self._plotted = now
            self._page.plot(now - self._began, self._figures.value)
            self._page.set_panel("Alarms", markup.pairs(self._figures.rows()[-2:], "Alarms"))

    def _survey(self) -> None:
        """Look for arenas; follow another one if the one asked for is not there."""
        before, self.arenas = self.arenas, namespaces_of_arenas(self._node)
        missing = self._arena is None and f"/{self._namespace}" not in self.arenas
        # An arena must be seen twice, because the one asked for may be discovered last.
        if missing and self.arenas and self.arenas == before:
            self._follow(self.arenas[0])

    def _subscribe(self, lockstep: bool) -> None:
        """Subscribe to steps; in lockstep to the few that the arena samples, if it does."""
        samples = SAMPLES.within(f"/{self._namespace}").name
        sampled = lockstep and self._node.count_publishers(samples) > 0
        steps = (LOCKSTEP_DEPTH, SAMPLES) if sampled else (DEPTH, OBJECT_FEATURES)
        self._samplers = tuple(
            Sampler(self._sampled, self._namespace, depth, topic)
            for depth, topic in (steps, (1, CAMERA_TRACKS))
        )

    def _rest(self) -> None:
        """Unsubscribe from everything that is large or frequent."""
        for sampler in self._samplers:
            sampler.close()
        self._samplers = ()
        self._weights.rest()

    def _choose(self, namespace: str) -> None:
        if namespace not in self.arenas:
            raise ConsoleError(f"expected an arena of {list(self.arenas)}, got {namespace!r}")
        self._follow(namespace)

    def _follow(self, namespace: str) -> None:
        """Show the arena of a namespace from now on."""
        if self._open:
            self._rest()
            for subscription in self._open:
                self._node.destroy_subscription(subscription)
            self._weights.close()
        self._namespace = namespace.strip("/")
        self._arena: ArenaDescription | None = None
        self._moment: Moment | None = None  # the newest that was drawn
        self.vocabulary, self.examples, self.speed = None, (), None
        self._weights = AgentWeights(self._node, self._namespace, self._refusals)
        self._open = [
            topic.within(f"/{self._namespace}").subscribe(
                self._node, self._refusals.guard(topic.name, callback)
            )
            for topic, callback in ((ARENA_INFO, self._on_arena), (PROGRAM_STATUS, self._on_status))
        ]
        self._page.set_panel("State", "")

    def _arm(self, namespace: str) -> Arm:
        with self._joining:
            if namespace not in self._arms:
                domain = self._node.context.get_domain_id()
                self._arms[namespace] = Arm(namespace, patience=PATIENCE_S, domain=domain)
            return self._arms[namespace]

    def _ask(self, name: str, act: Callable[[Arm], object], namespace: str) -> None:
        try:
            act(self._arm(namespace))
            said = "done"
        except PaError as error:
            said = str(error)
        except Exception as error:  # nobody else would report it
            said = f"{type(error).__name__}: {error}"
        self.asked = f"{name}: {said}"

    def _on_arena(self, message: Message) -> None:
        arena = decode_arena_info(message)
        if self._arena is None or self._arena.mode is not arena.mode:
            self._rest()  # steps are subscribed to again, as the mode requires
        self.vocabulary, self._arena = arena.world.vocabulary, arena

    def _on_status(self, message: Message) -> None:
        self._history.add_status(decode_program_status(message))

    def _send(self, text: str) -> None:
        """Publish a program; a text that is none is only noted in the history."""
        program_id = f"console-{os.getpid()}-{next(self._serial)}"
        try:
            program = self.read(text)
        except PaError as error:
            self._history.add(program_id, text, note=str(error).partition("\n")[0])
            return
        self._history.add(program_id, program)
        self.ask("send", lambda arm: arm.send(program, program_id))

    def _show_picture(self, message: Message) -> None:
        """Show what an arena that sees, or camera_node, found in a picture."""
        _, picture = decode_image(message)
        self._page.show_picture(picture)

    def _draw(self, messages: list[Message]) -> None:
        """Follow executions through all steps, and draw the newest."""
        arena, vocabulary = self._arena, self.vocabulary
        if arena is None or vocabulary is None:
            where = self._namespace or "/"
            self._page.set_panel("State", markup.quiet(f"no arena in the namespace {where} yet"))
            return
        if not messages:
            if self._moment is not None:
                self._page.show_state(self._moment, self._time_runs())
            return
        try:
            sizes = arena.world.joints, arena.world.object_features
            steps = [decode_step(message, *sizes) for message in messages]
        except PaError as error:
            self._refusals.refuse("step", error)
            return
        self._history.observe(steps)
        newest = steps[-1]
        asked = newest.observation, newest.program, vocabulary, newest.stage
        explanation, why = explained(self._weights.insight, *asked)
        reward = newest.verdict.reward if newest.verdict is not None else nan
        self._moment = moment = Moment(arena, newest, reward, explanation, self._weights.why or why)
        self._page.show(moment, self._time_runs())
        self.examples = moment.programs

    def _time_runs(self) -> str:
        """How fast the arena's time passes, in words; also sets `speed`."""
        node = f"/{self._namespace}/sim_node".replace("//", "/")
        if self._figures.is_paused(node):
            return ", paused"
        factor = self._figures.value(node, RATE)
        real_time = self._arena is not None and self._arena.mode is Mode.REAL_TIME
        self.speed = factor if real_time else None
        return "" if factor is None else f", {factor:.1f} times real time"
