"""What a node logs of its state: what changed in kind, not every number."""

from collections.abc import Iterator

import pytest

from pa_ros.ros.health import NUMBERS, OK, HealthReporter
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
