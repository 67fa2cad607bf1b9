"""What those who may send see besides: the program field, and the arena's switches.

Each such page has controls of its own, so that nobody else can type into them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Protocol

import viser

from pa_ros.console import markup
from pa_ros.console.asked import PageError
from pa_ros.console.page import ORDER
from pa_ros.language import Vocabulary

EXAMPLES = 6
NO_BLOCK = "none"
HANDLE_M = 0.25  # length of the arrows by which a block is dragged
SPEEDS = ("0.5", "1", "2", "5")


class Desk(Protocol):
    """What controls ask for. Called on viser's threads; returns at once."""

    def do(self, act: Callable[[], object]) -> None:
        """Have something done soon; what it raises is refused."""

    def vocabulary(self) -> Vocabulary | None:
        """The arena's words; None: no arena is known."""

    def examples(self) -> Sequence[str]:
        """Programs that make sense now."""

    def send(self, text: str) -> None:
        """Have a program executed."""

    def arenas(self) -> Sequence[str]:
        """Namespaces of arenas that are there."""

    def choose(self, namespace: str) -> None:
        """Show another arena to all."""

    def ask(self, service: str, value: float = 0.0) -> None:
        """Use a service of the arena: pause, step, speed or reset."""

    def blocks(self) -> Sequence[tuple[str, tuple[float, float, float]]]:
        """The blocks' names, and where each is (m)."""

    def move(self, block: int, x: float, y: float) -> None:
        """Put a block, by its place in `blocks`, elsewhere on the table (m)."""


class Controls:
    """The controls of one page."""

    def __init__(self, client: viser.ClientHandle, desk: Desk) -> None:
        self._client, self._desk = client, desk
        self._shown: tuple[Any, ...] = ()
        self._read_with: Vocabulary | None = None
        self._read = self._program()
        self._arena()
        self._handle: Any = None  # by which a block is dragged
        self._dragging = False
        self._blocks()

    def refresh(self) -> None:
        """Offer what makes sense now; a handle stays with its block."""
        self._follow()
        if self._desk.vocabulary() is not self._read_with:  # what was typed may mean something else
            self._read()
        examples, arenas = tuple(self._desk.examples()), tuple(self._desk.arenas())
        blocks = tuple(f"{i + 1}: {name}" for i, (name, _) in enumerate(self._desk.blocks()))
        if (examples, arenas, blocks) == self._shown:
            return
        if (blocks,) != self._shown[2:]:
            self._let_go()
            self._block.options = (NO_BLOCK, *blocks)
        self._shown = examples, arenas, blocks
        self._examples.visible = bool(examples)
        if examples:
            self._examples.options = examples
        self._choice.options = arenas or ("none",)
        self._choice.visible = len(arenas) > 1

    def _program(self) -> Callable[[], None]:
        """The form; returned is what reads its text again."""
        gui = self._client.gui
        with gui.add_form("Program", order=ORDER["Program"]) as form:
            text = gui.add_text("Text", "", hint="Enter sends it")
            reading = gui.add_html(markup.quiet("type a program, or choose an example"))
            words = gui.add_button_group("Words", ("AND(",), visible=False)
            send = gui.add_button("Send")
            self._examples = gui.add_dropdown("Examples", ("",), visible=False)

        def read(_: Any = None) -> None:
            vocabulary = self._read_with = self._desk.vocabulary()
            if vocabulary is None:
                reading.content = markup.quiet("no arena is known yet")
                return
            reading.content = markup.reading(text.value, vocabulary)
            found = markup.completions(text.value, vocabulary)
            words.visible = bool(found)
            if found:
                words.options = found

        def put(value: str) -> None:
            text.value = value
            read()

        text.on_update(read)
        words.on_click(lambda _: put(markup.completed(text.value, words.value)))
        self._examples.on_update(_by_hand(lambda: put(self._examples.value)))
        send.on_click(lambda _: form.submit())
        form.on_submit(lambda _: self._desk.send(text.value))
        return read

    def _arena(self) -> None:
        gui, ask = self._client.gui, self._desk.ask
        with gui.add_folder("Arena", order=ORDER["Arena"]):
            self._choice = gui.add_dropdown("Which", ("none",), visible=False)
            pause = gui.add_button_group("Time", ("Pause", "Go on", "Step"))
            speed = gui.add_button_group("Speed", SPEEDS, hint="times real time")
            episode = gui.add_number("Scene", 0, min=0, step=1, hint="number of an episode")
            reset = gui.add_button_group("Begin", ("This scene", "Next scene"))
        self._choice.on_update(_by_hand(lambda: self._desk.choose(self._choice.value)))
        self._switch(
            pause,
            {
                "Pause": lambda: ask("pause", 1),
                "Go on": lambda: ask("pause", 0),
                "Step": lambda: ask("step", 1),
            },
        )
        self._switch(
            reset,
            {
                "This scene": lambda: ask("reset", episode.value),
                "Next scene": lambda: ask("reset", -1),
            },
        )
        self._switch(speed, {times: partial(ask, "speed", float(times)) for times in SPEEDS})

    def _switch(self, group: Any, acts: Mapping[str, Callable[[], None]]) -> None:
        """What each button of a group does; a page may say another one than it was offered."""

        def press(chosen: object) -> None:
            if not isinstance(chosen, str) or chosen not in acts:
                raise PageError(f"expected a button of {list(acts)}, got {chosen!r}")
            acts[chosen]()

        group.on_click(lambda _: self._desk.do(partial(press, group.value)))

    def _blocks(self) -> None:
        """Which block is dragged: by its handle in the scene, or to a place that is typed."""
        gui = self._client.gui
        with gui.add_folder("Move a block", order=ORDER["Arena"], expand_by_default=False):
            self._block = gui.add_dropdown("Block", (NO_BLOCK,), hint="then drag it in the scene")
            to = gui.add_vector2("To, m", (0.3, 0.3), step=0.01, hint="from the arm's base")
            put = gui.add_button("Put it there")
        self._block.on_update(_by_hand(self._take_hold))

        def put_there() -> None:
            if (number := self._chosen()) is not None:
                x, y = map(float, to.value)
                self._desk.move(number, x, y)

        put.on_click(lambda _: self._desk.do(put_there))

    def _chosen(self) -> int | None:
        """The chosen block's place; None: none, or one that is not offered."""
        offered = self._shown[2] if self._shown else ()
        return offered.index(self._block.value) if self._block.value in offered else None

    def _take_hold(self) -> None:
        """A handle on the chosen block, of this page alone."""
        self._let_go()
        number, places = self._chosen(), self._desk.blocks()
        if number is None or number >= len(places):
            return
        self._handle = self._client.scene.add_transform_controls(
            "/move", scale=HANDLE_M, active_axes=(True, True, False), disable_rotations=True,
            depth_test=False, position=places[number][1],
        )  # fmt: skip

        def dragged(event: Any) -> None:
            self._dragging = event.phase != "end"
            if not self._dragging:
                x, y, _ = map(float, event.target.position)
                self._desk.move(number, x, y)

        self._handle.on_update(dragged)

    def _follow(self) -> None:
        """The block has been put elsewhere, or the scene is another."""
        number, places = self._chosen(), self._desk.blocks()
        held = self._handle is not None and not self._dragging
        if held and number is not None and number < len(places):
            self._handle.position = places[number][1]

    def _let_go(self) -> None:
        self._dragging = False
        if self._handle is not None:
            self._handle.remove()
            self._handle = None


def _by_hand(act: Callable[[], None]) -> Callable[[Any], None]:
    """A callback for what a person chose: other options choose their first one by themselves."""

    def called(event: Any) -> None:
        if event.client is not None:
            act()

    return called
