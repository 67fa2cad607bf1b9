"""`Arm.steer`, `scatter` and `scattered`: what a person asks of a robot that learns."""

from typing import Any
from unittest.mock import MagicMock

import pytest

from pa_ros import Arm
from pa_ros.core.errors import ConfigError, PaError
from pa_ros.tools.client import ArenaClient, NoAnswerError
from pa_ros.wire.robot import decode_takeover


def made(heard_by: int = 1) -> tuple[Arm, MagicMock]:
    """An arm without a graph, and the publisher of its takeover."""
    graph = MagicMock()
    graph.call.side_effect = lambda act: act()
    graph.until.side_effect = lambda condition, *_: condition()
    publisher = graph.node.create_publisher.return_value
    publisher.get_subscription_count.return_value = heard_by
    return Arm(graph=graph), publisher


def test_the_hand_moves_as_long_as_a_person_says() -> None:
    arm, publisher = made()
    arm.steer(0.1, 0.0, -0.05, seconds=0.12)
    sent = [decode_takeover(call.args[0]) for call in publisher.publish.call_args_list]
    assert 2 <= len(sent) <= 4
    for frame, linear, angular in sent:
        assert (frame, linear.tolist(), angular.tolist()) == ("", [0.1, 0.0, -0.05], [0.0] * 3)


@pytest.mark.parametrize("given", [(float("nan"), 0, 0), (0, 0, 0, 60.0), (0, 0, 0, 0.0)])
def test_what_is_no_velocity_or_lasts_too_long_is_refused(given: tuple[float, ...]) -> None:
    arm, publisher = made()
    with pytest.raises(ConfigError, match="steer: expected finite velocities, for up to 5 s"):
        arm.steer(*given)
    publisher.publish.assert_not_called()


def test_an_arena_that_cannot_be_steered_is_named() -> None:
    arm, _ = made(heard_by=0)
    with pytest.raises(NoAnswerError, match="no robot_node hears it"):
        arm.steer(0.1, 0.0, 0.0)


def test_what_the_robot_answers_is_passed_on() -> None:
    node: Any = MagicMock()
    answer = node.create_client.return_value.call_async.return_value
    client = ArenaClient(node, 1.0, spin=lambda condition, _: bool(condition()) or True)
    answer.result.return_value = MagicMock(success=True, message="continues")
    assert client.scattered() == "continues"
    answer.result.return_value = MagicMock(success=False, message="expected 4 objects")
    with pytest.raises(PaError, match="scatter: rejected: expected 4 objects"):
        client.scatter()
