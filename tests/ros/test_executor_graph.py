"""Spinning, and signals that come meanwhile."""

import os
import signal

import pytest

from helpers.waiting import DEADLINE_S
from pa_ros.core.signals import Interrupted, signals_interrupt
from pa_ros.ros.executor import spin_until, steady_timer
from pa_ros.tools.client import client_node

pytestmark = pytest.mark.graph


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
