"""A block is dragged by a handle of the page's own."""

from __future__ import annotations

from types import SimpleNamespace
from unittest.mock import MagicMock

import pytest

pytest.importorskip("viser", reason="the extra `console` is not installed")

from pa_ros.console.asked import attempt
from pa_ros.console.controls import Controls
from pa_ros.ros.refusals import Refusals
from pa_ros.world.schema import PAPER


def dragged(phase: str, x: float, y: float) -> SimpleNamespace:
    return SimpleNamespace(phase=phase, target=SimpleNamespace(position=(x, y, 0.1)))


def test_a_block_is_put_where_its_handle_is_let_go():
    client, desk = MagicMock(), MagicMock()
    desk.vocabulary.return_value = None
    desk.examples.return_value = desk.arenas.return_value = ()
    desk.blocks.return_value = (("RED CUBE", (0.1, 0.2, 0.03)), ("BLUE SPHERE", (0.3, 0.4, 0.03)))
    gui, handle = client.gui, client.scene.add_transform_controls.return_value
    block = MagicMock(value="none")
    gui.add_dropdown.side_effect = lambda label, *_, **__: (
        block if label == "Block" else MagicMock()
    )
    controls = Controls(client, desk)
    controls.refresh()
    assert block.options == ("none", "1: RED CUBE", "2: BLUE SPHERE")
    block.value = "2: BLUE SPHERE"
    block.on_update.call_args[0][0](SimpleNamespace(client=client))
    assert client.scene.add_transform_controls.call_args[1]["position"] == (0.3, 0.4, 0.03)
    pull = handle.on_update.call_args[0][0]
    handle.position = "where the hand has it"
    pull(dragged("start", 0.3, 0.4))
    pull(dragged("update", 0.4, 0.4))
    controls.refresh()
    desk.move.assert_not_called()
    assert handle.position == "where the hand has it"
    pull(dragged("end", 0.5, 0.4))
    desk.move.assert_called_once_with(1, 0.5, 0.4)
    controls.refresh()
    assert handle.position == (0.3, 0.4, 0.03)  # the arena has not moved it
    desk.blocks.return_value = (("RED CUBE", (0.1, 0.2, 0.03)),)  # another scene
    controls.refresh()
    handle.remove.assert_called_once()


@pytest.mark.parametrize("value", ["abc", "", "-3: RED CUBE", "0: RED CUBE", "7: RED CUBE", "1:"])
def test_a_block_that_was_not_offered_is_none(value: str):
    client, desk = MagicMock(), MagicMock()
    desk.do.side_effect = lambda act: act()
    desk.vocabulary.return_value = None
    desk.examples.return_value = desk.arenas.return_value = ()
    desk.blocks.return_value = (("RED CUBE", (0.1, 0.2, 0.03)),)
    block, put = MagicMock(value="none"), MagicMock()
    gui = client.gui
    gui.add_dropdown.side_effect = lambda label, *_, **__: (
        block if label == "Block" else MagicMock()
    )
    gui.add_button.side_effect = lambda label, **_: put if "Put" in label else MagicMock()
    gui.add_vector2.return_value.value = (0.3, 0.3)
    controls = Controls(client, desk)
    controls.refresh()
    block.value = value
    block.on_update.call_args[0][0](SimpleNamespace(client=client))
    put.on_click.call_args[0][0](None)
    controls.refresh()
    client.scene.add_transform_controls.assert_not_called()
    desk.move.assert_not_called()


@pytest.mark.parametrize("label", ["Time", "Speed", "Begin"])
@pytest.mark.parametrize("value", ["", "Go  on", "nan", "1e999", 7])
def test_a_button_that_was_not_offered_is_refused(label: str, value: object):
    client, desk = MagicMock(), MagicMock()
    desk.vocabulary.return_value = None
    groups = {name: MagicMock(value=value) for name in ("Words", "Time", "Speed", "Begin")}
    client.gui.add_button_group.side_effect = lambda label, *_, **__: groups[label]
    Controls(client, desk)
    groups[label].on_click.call_args[0][0](None)
    refused: list[str] = []
    refusals = Refusals(refused.append)
    attempt(refusals, "page", desk.do.call_args[0][0])
    desk.ask.assert_not_called()
    assert refusals.counts == {"console.page": 1}
    assert "expected a button of" in refused[0] and repr(value) in refused[0]


@pytest.mark.parametrize(
    ("label", "value", "asked"),
    [("Time", "Pause", ("pause", 1)), ("Speed", "0.5", ("speed", 0.5)),
     ("Begin", "Next scene", ("reset", -1))],
)  # fmt: skip
def test_a_button_asks_for_its_service(label: str, value: str, asked: tuple[str, float]):
    client, desk = MagicMock(), MagicMock()
    desk.do.side_effect = lambda act: act()
    groups = {name: MagicMock(value=value) for name in ("Words", "Time", "Speed", "Begin")}
    client.gui.add_button_group.side_effect = lambda label, *_, **__: groups[label]
    Controls(client, desk)
    groups[label].on_click.call_args[0][0](None)
    desk.ask.assert_called_once_with(*asked)


def test_a_text_is_read_again_when_an_arena_is_known():
    client, desk = MagicMock(), MagicMock()
    desk.examples.return_value = desk.arenas.return_value = desk.blocks.return_value = ()
    desk.vocabulary.return_value = None
    gui = client.gui
    text, reading = gui.add_text.return_value, gui.add_html.return_value
    controls = Controls(client, desk)
    text.value = "NEAR(HAND, AND(RED, CUBE))"
    text.on_update.call_args[0][0](None)
    assert "no arena is known yet" in reading.content
    desk.vocabulary.return_value = PAPER.vocabulary
    controls.refresh()
    assert "✓ NEAR(HAND, AND(RED, CUBE))" in reading.content
