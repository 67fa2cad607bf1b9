"""What a node logs of its state, and signals that come while it spins."""

import os
import signal
from collections.abc import Iterator

import pytest

from helpers.waiting import DEADLINE_S
from pa_ros.core.errors import ConfigError
from pa_ros.core.signals import Interrupted, signals_interrupt
from pa_ros.ros.executor import spin_until, steady_timer
from pa_ros.ros.health import NUMBERS, OK, WARN, HealthReporter
from pa_ros.ros.refusals import Refusals
from pa_ros.tools.client import Node, client_node

pytestmark = pytest.mark.graph


@pytest.fixture
def node() -> Iterator[Node]:
    with client_node("test") as made:
        yield made


def test_a_message_that_differs_only_in_a_number_is_logged_once(node: Node, monkeypatch):
    logged: list[str] = []
    monkeypatch.setattr(type(node.get_logger()), "info", lambda _, text: logged.append(text))
    says = iter(["waits for 2 s", "waits for 3.5 s", "learning", "waits for 2 s"])
    reporter = HealthReporter(node, Refusals(logged.append), lambda: (OK, next(says), {}), str)
    for _ in range(4):
        reporter.publish()
    assert logged == ["waits for 2 s", "learning", "waits for 2 s"]
    assert NUMBERS.sub("#", "a 1.5, b 22") == "a #, b #"


def test_a_node_that_waits_says_which_input_it_refused_last(node: Node, monkeypatch):
    logged: list[str] = []
    monkeypatch.setattr(type(node.get_logger()), "info", lambda _, text: logged.append(text))
    refusals = Refusals(str)

    def refuse(reason: str) -> None:
        raise ConfigError(reason)

    says = [(OK, "acts"), (WARN, "waits for tf"), (WARN, "holds: joints are 2.5 s old")]
    report = iter(says)
    reporter = HealthReporter(node, refusals, lambda: (*next(report), {}), str)
    refusals.guard("tf", refuse)("no frame_id")
    refusals.guard("commands", refuse)("joints are 0.3 s old")  # the state of the node itself
    for _ in says:
        reporter.publish()
    assert logged == [
        "acts",
        "waits for tf; refused: commands: joints are 0.3 s old",
        "holds: joints are 2.5 s old; refused: tf: no frame_id",
    ]


def test_a_signal_ends_spinning_after_the_current_callback() -> None:
    """Raised in a callback it could meet the executor's C++, which makes another error of it."""
    done: list[str] = []

    def called() -> None:
        if not done:
            os.kill(os.getpid(), signal.SIGTERM)
            done.append("the callback")

    with client_node("test") as node, signals_interrupt():
        steady_timer(node, 0.01, called)
        with pytest.raises(Interrupted):
            spin_until(node, lambda: False, DEADLINE_S)
        assert done == ["the callback"]
        assert spin_until(node, lambda: True, DEADLINE_S)  # it can be spun again
