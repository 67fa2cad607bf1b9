"""The controls of a page that may send: the program field, the arena's buttons, moving blocks.

Each such page has its own controls, so that no other page can type into them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from operator import methodcaller
from typing import Any

import viser

from pa_ros.console import markup
from pa_ros.console.live import LiveConsole
from pa_ros.console.page import ORDER
from pa_ros.language import Vocabulary
from pa_ros.tools.arm import Arm

NO_BLOCK = "none"
HANDLE_M = 0.25  # length of the arrows by which a block is dragged
SPEEDS = ("0.5", "1", "2", "5")
STEER_MPS = {  # velocity of the hand for half a second, in the base's frame, by button
    sign + axis: tuple((0.1 if sign == "+" else -0.1) * (other == axis) for other in "xyz")
    for axis in "xyz"
    for sign in "-+"
}
NOW = "● "  # before the current speed


class Controls:
    """The controls of one page."""

    def __init__(self, client: viser.ClientHandle, live: LiveConsole) -> None:
        self._client, self._live = client, live
        self._offered: tuple[tuple[str, ...], ...] = ((), (), ())  # examples, arenas, blocks
        self._read_with: Vocabulary | None = None
        self._read = self._add_program()
        self._add_arena()
        self._handle: Any = None  # in the scene, by which a block is dragged
        self._dragging = False
        self._add_blocks()

    def refresh(self) -> None:
        """Offer what can be chosen now; keep the handle on its block."""
        live = self._live
        live.join()
        self._follow_block()
        now = live.speed or 0.0
        speeds = tuple(NOW + one if abs(now - float(one)) < 0.1 * now else one for one in SPEEDS)
        if speeds != self._speed.options:
            self._speed.options = speeds
        if live.vocabulary is not self._read_with:  # what was typed may mean something else now
            self._read()
        blocks = tuple(f"{i + 1}: {name}" for i, (name, _) in enumerate(live.blocks))
        offered = (tuple(live.examples), tuple(live.arenas), blocks)
        if offered == self._offered:
            return
        if blocks != self._offered[2]:
            self._remove_handle()
            self._block.options = (NO_BLOCK, *blocks)
        self._offered = examples, arenas, _ = offered
        self._examples.visible = bool(examples)
        if examples:
            self._examples.options = examples
        self._arenas.options = arenas or ("none",)
        self._arenas.visible = len(arenas) > 1

    def _add_program(self) -> Callable[[], None]:
        """Add the form; return the function that reads its text again."""
        gui = self._client.gui
        with gui.add_form("Program", order=ORDER["Program"]) as form:
            text = gui.add_text("Text", "", hint="Enter sends it")
            reading = gui.add_html(markup.quiet("no arena is known yet"))
            words = gui.add_button_group("Words", ("AND(",), visible=False)
            send = gui.add_button("Send")
            self._examples = gui.add_dropdown("Examples", ("",), visible=False)

        def read(_: Any = None) -> None:
            vocabulary = self._read_with = self._live.vocabulary
            if vocabulary is None:
                reading.content = markup.quiet("no arena is known yet")
                return
            reading.content = markup.reading(text.value, self._live.read)
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
        form.on_submit(lambda _: self._live.send(text.value))
        return read

    def _add_arena(self) -> None:
        gui, live = self._client.gui, self._live
        with gui.add_folder("Arena", order=ORDER["Arena"]):
            self._arenas = gui.add_dropdown("Which", ("none",), visible=False)
            time = gui.add_button_group("Time", ("Pause", "Resume", "Step"))
            self._speed = gui.add_button_group("Speed", SPEEDS, hint="times real time")
            episode = gui.add_number("Scene", 0, min=0, step=1, hint="number of an episode")
            begin = gui.add_button_group("Begin", ("This scene", "Next scene"))
            hint = "of a robot that learns: it stops, and continues with the blocks where they are"
            blocks = gui.add_button_group("Blocks", ("Scatter", "Scattered"), hint=hint)
            hand = gui.add_button_group("Hand", (*STEER_MPS,), hint="of a robot: move it yourself")
        self._arenas.on_update(_by_hand(lambda: live.choose(self._arenas.value)))
        self._connect(time, {
            "Pause": lambda arm: arm.pause(),
            "Resume": lambda arm: arm.resume(),
            "Step": lambda arm: arm.step(),
        })  # fmt: skip
        self._connect(begin, {
            "This scene": lambda arm: arm.reset(int(episode.value)),
            "Next scene": lambda arm: arm.reset(),
        })  # fmt: skip
        self._connect(blocks, {
            "Scatter": lambda arm: arm.scatter(),
            "Scattered": lambda arm: arm.scattered(),
        })  # fmt: skip
        steer = {name: methodcaller("steer", *mps) for name, mps in STEER_MPS.items()}
        self._connect(hand, steer)
        speeds = {times: methodcaller("set_speed", float(times)) for times in SPEEDS}
        self._connect(self._speed, speeds)

    def _connect(self, group: Any, acts: Mapping[str, Callable[[Arm], object]]) -> None:
        """Connect each button of a group to a request."""

        def press(_: Any) -> None:
            name = group.value.removeprefix(NOW)
            self._live.ask(name.lower(), acts[name])

        group.on_click(press)

    def _add_blocks(self) -> None:
        """Add the choice of a block, which is dragged in the scene or put at a typed place."""
        gui = self._client.gui
        with gui.add_folder("Move a block", order=ORDER["Arena"], expand_by_default=False):
            self._block = gui.add_dropdown("Block", (NO_BLOCK,), hint="then drag it in the scene")
            to = gui.add_vector2("To, m", (0.3, 0.3), step=0.01, hint="from the arm's base")
            put = gui.add_button("Put it there")
        self._block.on_update(_by_hand(self._add_handle))
        put.on_click(lambda _: self._move(*map(float, to.value)))

    def _move(self, x: float, y: float) -> None:
        number = self._chosen()
        if number is not None:
            name = f"move {self._block.value.partition(': ')[2]}"
            self._live.ask(name, lambda arm: arm.move(number, x, y))

    def _chosen(self) -> int | None:
        """The chosen block's number; None if none is chosen."""
        blocks = self._offered[2]
        return blocks.index(self._block.value) if self._block.value in blocks else None

    def _add_handle(self) -> None:
        """Put a handle on the chosen block, visible on this page only."""
        self._remove_handle()
        number, blocks = self._chosen(), self._live.blocks
        if number is None or number >= len(blocks):
            return
        self._handle = self._client.scene.add_transform_controls(
            "/move", scale=HANDLE_M, active_axes=(True, True, False), disable_rotations=True,
            depth_test=False, position=blocks[number][1],
        )  # fmt: skip

        def dragged(event: Any) -> None:
            self._dragging = event.phase != "end"
            if not self._dragging:
                x, y, _ = map(float, event.target.position)
                self._move(x, y)

        self._handle.on_update(dragged)

    def _follow_block(self) -> None:
        """Move the handle to where its block is now, unless it is being dragged."""
        number, blocks = self._chosen(), self._live.blocks
        held = self._handle is not None and not self._dragging
        if held and number is not None and number < len(blocks):
            self._handle.position = blocks[number][1]

    def _remove_handle(self) -> None:
        self._dragging = False
        if self._handle is not None:
            self._handle.remove()
            self._handle = None


def _by_hand(act: Callable[[], None]) -> Callable[[Any], None]:
    """A callback for choices of a person; viser also calls it when the options change."""

    def called(event: Any) -> None:
        if event.client is not None:
            act()

    return called
