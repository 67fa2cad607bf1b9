"""The page is served on this machine only, and wrong settings are named."""

import socket

import pytest

pytest.importorskip("viser", reason="the extra `console` is not installed")

from pa_ros.cli.main import main
from pa_ros.console.server import ConsoleError, ConsoleServer
from pa_ros.console.settings import ConsoleSettings


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


def test_a_wrong_namespace_is_rejected(capsys):
    assert main(["console", "--namespace", "a b"]) == 2
    assert "expected a namespace such as lab/arm_1" in capsys.readouterr().err
