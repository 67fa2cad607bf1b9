"""What those who may send see besides: the program field, and the arena's switches.

Each such page has controls of its own, so that nobody else can type into them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import viser

from pa_ros.console import markup
from pa_ros.console.page import ORDER
from pa_ros.language import Vocabulary

EXAMPLES = 6
SPEEDS = ("0.5", "1", "2", "5")


class Desk(Protocol):
    """What controls ask for. Called on viser's threads; returns at once."""

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


class Controls:
    """The controls of one page."""

    def __init__(self, client: viser.ClientHandle, desk: Desk) -> None:
        self._client, self._desk = client, desk
        self._shown: tuple[Any, ...] = ()
        self._program()
        self._arena()

    def refresh(self) -> None:
        """Offer what makes sense now."""
        examples, arenas = tuple(self._desk.examples()), tuple(self._desk.arenas())
        if (examples, arenas) == self._shown:
            return
        self._shown = examples, arenas
        self._examples.visible = bool(examples)
        if examples:
            self._examples.options = examples
        self._choice.options = arenas or ("none",)
        self._choice.visible = len(arenas) > 1

    def _program(self) -> None:
        gui = self._client.gui
        with gui.add_form("Program", order=ORDER["Program"]) as form:
            text = gui.add_text("Text", "", hint="Enter sends it")
            reading = gui.add_html(markup.quiet("type a program, or choose an example"))
            words = gui.add_button_group("Words", ("AND(",), visible=False)
            send = gui.add_button("Send")
            self._examples = gui.add_dropdown("Examples", ("",), visible=False)

        def read(_: Any = None) -> None:
            vocabulary = self._desk.vocabulary()
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

    def _arena(self) -> None:
        gui, ask = self._client.gui, self._desk.ask
        with gui.add_folder("Arena", order=ORDER["Arena"]):
            self._choice = gui.add_dropdown("Which", ("none",), visible=False)
            pause = gui.add_button_group("Time", ("Pause", "Go on", "Step"))
            speed = gui.add_button_group("Speed", SPEEDS, hint="times real time")
            episode = gui.add_number("Scene", 0, min=0, step=1, hint="number of an episode")
            reset = gui.add_button_group("Begin", ("This scene", "Next scene"))
        self._choice.on_update(_by_hand(lambda: self._desk.choose(self._choice.value)))
        act: dict[str, Callable[[], None]] = {
            "Pause": lambda: ask("pause", 1),
            "Go on": lambda: ask("pause", 0),
            "Step": lambda: ask("step", 1),
            "This scene": lambda: ask("reset", episode.value),
            "Next scene": lambda: ask("reset", -1),
        }
        pause.on_click(lambda _: act[pause.value]())
        reset.on_click(lambda _: act[reset.value]())
        speed.on_click(lambda _: ask("speed", float(speed.value)))


def _by_hand(act: Callable[[], None]) -> Callable[[Any], None]:
    """A callback for what a person chose: other options choose their first one by themselves."""

    def called(event: Any) -> None:
        if event.client is not None:
            act()

    return called
