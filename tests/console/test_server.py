"""The page is served on this machine only; its scene frees what it no longer shows."""

import gc
import socket
import weakref
from typing import Any

import numpy as np
import pytest

from helpers.waiting import DEADLINE_S

pytest.importorskip("viser", reason="the extra `console` is not installed")
from pa_ros.arena import ReachTask, design_named, preset_named
from pa_ros.bags.film import RecordedScene
from pa_ros.cli.main import main
from pa_ros.console import scene
from pa_ros.console.moment import Moment
from pa_ros.console.scene import ArenaScene, label_heights
from pa_ros.console.server import ConsoleError, ConsoleServer
from pa_ros.console.settings import ConsoleSettings
from pa_ros.core.experience import Step
from pa_ros.provenance.arena import describe


def test_a_port_in_use_is_rejected():
    with socket.socket() as held:
        held.bind(("127.0.0.1", 0))
        held.listen()
        port = held.getsockname()[1]
        with pytest.raises(ConsoleError, match=f"port {port} of 127.0.0.1 is in use.*--port"):
            ConsoleServer(ConsoleSettings(port=port))


def test_each_start_has_a_new_token(capsys):
    with (
        ConsoleServer(ConsoleSettings(port=0)) as one,
        ConsoleServer(ConsoleSettings(port=0)) as two,
    ):
        control, view = one.addresses
        assert one.token != two.token and control.endswith(one.token)
        assert one.token not in view and one.pages == 0
        assert one.viser.get_host() == "127.0.0.1"
        assert one.viser.request_share_url() is None
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(("host", "served"), [("{}", True), ("example.com", False)])
def test_a_page_from_elsewhere_reads_nothing(host, served):
    """Any page that a browser on this machine shows may connect; it says where it is from."""
    import viser
    from websockets.exceptions import ConnectionClosedError
    from websockets.sync.client import connect

    with ConsoleServer(ConsoleSettings(port=0)) as server:
        here = f"127.0.0.1:{server.viser.get_port()}"
        headers: Any = {"origin": f"http://{host.format(here)}"}
        headers |= {"subprotocols": [f"viser-v{viser.__version__}"]}
        with connect(f"ws://{here}/", **headers) as page:
            if served:
                assert page.recv(timeout=DEADLINE_S)
            else:
                with pytest.raises(ConnectionClosedError, match="expected a page of this server"):
                    page.recv(timeout=DEADLINE_S)


def test_a_wrong_namespace_is_rejected(capsys):
    assert main(["console", "--namespace", "a b"]) == 2
    assert "expected a namespace such as lab/arm_1" in capsys.readouterr().err


ARENA, DESIGN = preset_named("fast"), design_named("3-D")


@pytest.fixture
def no_collector():
    """Reference cycles are not freed in this test."""
    gc.disable()
    yield
    gc.enable()


def moments(count: int):
    """The beginnings of episodes, each with other blocks."""
    task, about = ReachTask(ARENA, DESIGN, 2), describe(ARENA, DESIGN, 2, (), "arena")
    for episode in range(count):
        observation, _ = task.reset(episode)
        yield Moment(about, Step(observation))


def test_old_scenes_are_freed_at_once(no_collector, monkeypatch):
    """A page that is open while an arena learns shows another scene every second."""
    made: list[weakref.ref] = []

    class Remembered(RecordedScene):
        def __init__(self, *given):
            super().__init__(*given)
            made.extend((weakref.ref(self), weakref.ref(self.task.simulation)))

    monkeypatch.setattr(scene, "RecordedScene", Remembered)
    with ConsoleServer(ConsoleSettings(port=0)) as server:
        shown = ArenaScene(server.viser)
        for moment in moments(8):
            shown.show(moment)
        assert len(made) == 16 and [ref() is None for ref in made] == [True] * 14 + [False] * 2


def test_labels_of_close_blocks_have_different_heights_the_far_one_the_greater():
    """Else the label of the near block would be in front of that of the far one."""
    places = [np.array(place) for place in ((0, 0, 0), (0.2, -0.2, 0), (0.4, -0.4, 0), (1, 1, 0))]
    far, middle, near, alone = label_heights(places)
    assert middle > near == far == alone
    far, near = label_heights(places[:2])
    assert far > near
