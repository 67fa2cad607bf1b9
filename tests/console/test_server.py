"""The page is served on this machine alone, and says what it can't do."""

from __future__ import annotations

import socket

import pytest

pytest.importorskip("viser", reason="the extra `console` is not installed")

from pa_ros.cli.main import main
from pa_ros.console.server import ConsoleServer, ConsoleSettings, PortError
from pa_ros.core.errors import ConfigError


def test_a_port_in_use_is_refused():
    with socket.socket() as held:
        held.bind(("127.0.0.1", 0))
        held.listen()
        port = held.getsockname()[1]
        with pytest.raises(PortError, match=f"port {port} of 127.0.0.1 is in use.*--port"):
            ConsoleServer(ConsoleSettings(port=port))


def test_each_start_has_a_token_of_its_own(capsys):
    with (
        ConsoleServer(ConsoleSettings(port=0)) as one,
        ConsoleServer(ConsoleSettings(port=0)) as two,
    ):
        assert one.token != two.token and one.address.endswith(one.token)
        assert one.token not in one.watching and one.pages == 0
        assert one.viser.get_host() == "127.0.0.1"
        assert one.viser.request_share_url() is None
    assert capsys.readouterr().out == ""


def test_a_token_fits_into_an_address():
    for token in ("a/b?", "Schlüssel", "²"):
        with pytest.raises(ConfigError, match="token: expected ASCII letters"):
            ConsoleServer(ConsoleSettings(port=0, token=token))


def test_a_namespace_that_ros_refuses_is_refused(capsys):
    assert main(["console", "--namespace", "a b"]) == 2
    assert "expected a namespace such as lab/arm_1" in capsys.readouterr().err
