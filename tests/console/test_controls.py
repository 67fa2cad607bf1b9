"""The controls of a page: the program field, the arena's buttons, and the handle of a block."""

from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock, call, create_autospec

import pytest

pytest.importorskip("viser", reason="the extra `console` is not installed")

from pa_ros.console.controls import SPEEDS, Controls
from pa_ros.tools.arm import Arm

BLOCKS = (("RED CUBE", (0.1, 0.2, 0.03)), ("BLUE SPHERE", (0.3, 0.4, 0.03)))


class Made:
    """Controls on a stand-in page; `parts` are the page's inputs by their labels."""

    def __init__(self) -> None:
        self.client, self.live = MagicMock(), MagicMock(examples=(), arenas=(), blocks=BLOCKS)
        self.live.vocabulary = self.live.speed = None
        self.arm = create_autospec(Arm, instance=True)
        self.live.ask.side_effect = lambda _, act: act(self.arm)
        self.parts: dict[str, MagicMock] = {}
        gui = self.client.gui
        for add in (gui.add_dropdown, gui.add_button_group, gui.add_button, gui.add_text):
            add.side_effect = self._add
        gui.add_vector2.return_value.value = (0.3, 0.3)
        self.controls = Controls(self.client, self.live)
        self.controls.refresh()

    def _add(self, label: str, *_: object, **__: object) -> MagicMock:
        return self.parts.setdefault(label, MagicMock(value="none"))

    def choose(self, label: str, value: str) -> None:
        self.parts[label].value = value
        self.parts[label].on_update.call_args[0][0](SimpleNamespace(client=self.client))

    def press(self, label: str, value: str = "") -> None:
        self.parts[label].value = value
        self.parts[label].on_click.call_args[0][0](None)


def dragged(phase: str, x: float, y: float) -> SimpleNamespace:
    return SimpleNamespace(phase=phase, target=SimpleNamespace(position=(x, y, 0.1)))


def test_a_block_is_moved_to_where_its_handle_is_released():
    made = Made()
    handle = made.client.scene.add_transform_controls.return_value
    assert made.parts["Block"].options == ("none", "1: RED CUBE", "2: BLUE SPHERE")
    made.choose("Block", "2: BLUE SPHERE")
    assert made.client.scene.add_transform_controls.call_args[1]["position"] == BLOCKS[1][1]
    pull = handle.on_update.call_args[0][0]
    handle.position = "under the mouse"
    pull(dragged("update", 0.4, 0.4))
    made.controls.refresh()
    made.arm.move.assert_not_called()
    assert handle.position == "under the mouse"
    pull(dragged("end", 0.5, 0.4))
    made.arm.move.assert_called_once_with(1, 0.5, 0.4)
    made.controls.refresh()
    assert handle.position == BLOCKS[1][1]  # the arena has not moved it
    made.live.blocks = BLOCKS[:1]  # another scene
    made.controls.refresh()
    handle.remove.assert_called_once()


@pytest.mark.parametrize(("chosen", "calls"), [("2: BLUE SPHERE", 1), ("none", 0), ("7: X", 0)])
def test_only_a_chosen_block_is_put_at_a_typed_place(chosen: str, calls: int):
    made = Made()
    made.choose("Block", chosen)
    made.press("Put it there")
    assert made.arm.move.call_count == calls


def test_the_current_speed_is_marked_and_all_can_be_pressed():
    made = Made()
    for speed, shown in ((2.06, ("0.5", "1", "● 2", "5")), (None, SPEEDS)):
        made.live.speed = speed
        made.controls.refresh()
        assert made.parts["Speed"].options == shown
    made.press("Speed", "● 2")
    made.arm.set_speed.assert_called_once_with(2.0)


@pytest.mark.parametrize(
    ("label", "value", "method", "asked"),
    [("Time", "Pause", "pause", call()), ("Time", "Resume", "resume", call()),
     ("Time", "Step", "step", call()), ("Speed", "0.5", "set_speed", call(0.5)),
     ("Begin", "Next scene", "reset", call()), ("Blocks", "Scatter", "scatter", call()),
     ("Blocks", "Scattered", "scattered", call()), ("Hand", "-y", "steer", call(0, -0.1, 0))],
)  # fmt: skip
def test_a_button_asks_the_arm(label: str, value: str, method: str, asked: Any):
    made = Made()
    made.press(label, value)
    made.live.ask.assert_called_once()
    assert made.arm.mock_calls == [getattr(call, method)(*asked.args)]
