"""Managed nodes: transitions, rejections, parameters, and what cleanup destroys."""

import signal
import subprocess
import sys
from collections.abc import Iterator

import pytest
from action_msgs.msg import GoalStatus
from pydantic import Field
from rclpy.action import ActionClient
from std_srvs.srv import SetBool

from helpers.graph import ACTIVATE, CLEANUP, CONFIGURE, DEACTIVATE, User, graph
from pa_ros.core.errors import ConfigError, PaError
from pa_ros.ros import topics
from pa_ros.ros.actions import EXECUTE_PROGRAM, GoalServer
from pa_ros.ros.executor import steady_timer
from pa_ros.ros.health import OK, WARN
from pa_ros.ros.lifecycle import ManagedNode
from pa_ros.ros.settings import NodeSettings

pytestmark = pytest.mark.graph

BURST = 20
SPEAKER = f"""
import sys
from pa_ros.ros.settings import NodeSettings
from pa_ros.ros import topics
from pa_ros.ros.lifecycle import ManagedNode
from pa_ros.ros.node_main import run_node

class Speaker(ManagedNode):
    def __init__(self):
        super().__init__("speaker", NodeSettings)

    def configure(self):
        self.out = topics.TRAJECTORIES.publisher(self)

    def cleanup(self):
        large = topics.TRAJECTORIES.type(objects=[0.0] * 400_000)
        for _ in range({BURST}):
            self.out.publish(large)

    def collect(self):
        return 0, "at work", {{}}

sys.exit(run_node("speaker", Speaker))
"""


class Config(NodeSettings):
    number: int = Field(1, ge=1, le=9, description="13 can't be configured, nor can 7 be activated")
    name: str = Field("none", description="anything")


class MissingError(PaError):
    code = "test.missing"


class Small(ManagedNode):
    """Has one entity of each kind, and remembers the steps it was asked for."""

    config: Config

    def __init__(self) -> None:
        self.asked: list[str] = []
        self.ticks = self.commands = 0
        self.bug = ""  # in which step there is one
        super().__init__("small", Config)

    def configure(self) -> None:
        self._step("configure")
        self._out = topics.OBJECT_FEATURES.publisher(self)
        topics.JOINT_COMMANDS.subscribe(self, lambda _: self._count())
        self.create_service(SetBool, "pause", lambda _, answer: answer)
        GoalServer(self, self.refusals, EXECUTE_PROGRAM, lambda _: None, lambda _: None)
        steady_timer(self, 0.001, self._tick)
        if self.config.number == 9:
            raise MissingError("checkpoint: expected one, found none")

    def activate(self) -> None:
        self._step("activate")
        if self.config.number == 7:
            raise MissingError("arm: expected one, found none")

    def deactivate(self) -> None:
        self._step("deactivate")

    def cleanup(self) -> None:
        self._step("cleanup")

    def collect(self) -> tuple[int, str, dict[str, str]]:
        return OK, "at work", {"ticks": str(self.ticks)}

    def _step(self, name: str) -> None:
        self.asked.append(name)
        if self.bug == name:
            raise KeyError("a bug")

    def _tick(self) -> None:
        self.ticks += 1
        self._out.publish(topics.OBJECT_FEATURES.type())  # fails if this is destroyed first

    def _count(self) -> None:
        self.commands += 1

    @property
    def entities(self) -> int:
        kinds = self.publishers, self.subscriptions, self.services
        return sum(len([*kind]) for kind in kinds)  # timers: the executor has one, too


@pytest.fixture
def user(request: pytest.FixtureRequest) -> Iterator[User]:
    """Of a node; parametrized indirectly with its parameters."""
    with graph(Small, **getattr(request, "param", {})) as probe:
        yield User(probe, probe.nodes[0])


WAITING = pytest.mark.parametrize("user", [{"small__autostart": False}], indirect=True)


@WAITING
def test_without_autostart_a_node_waits_and_reports_it(user: User) -> None:
    assert (user.node.state, user.node.asked) == ("unconfigured", [])
    assert user.probe.until(lambda: user.probe.value("small", "lifecycle") == "unconfigured")
    health = user.probe.health["/small"]
    assert health.level == WARN and "ros2 lifecycle set /small configure" in health.message
    assert user.ask(label="configure") == (True, "inactive")
    assert user.ask(label="activate") == (True, "active")


def test_cleanup_destroys_what_configure_made_and_a_new_life_can_begin(user: User) -> None:
    node, probe, begun = user.node, user.probe, user.node.entities
    speaker = topics.JOINT_COMMANDS.publisher(probe)
    steady_timer(probe, 0.002, lambda: speaker.publish(topics.JOINT_COMMANDS.type()))
    for _ in range(3):
        assert probe.until(lambda: node.commands > 0 and node.ticks > 0)
        assert user.ask(DEACTIVATE) == (True, "inactive") and not node.active
        assert user.ask(CLEANUP) == (True, "unconfigured")
        assert node.entities == begun - 3
        node.ticks = node.commands = 0
        probe.until(lambda: False, 0.05)
        assert node.ticks == node.commands == 0
        assert user.ask(CONFIGURE) == (True, "inactive")
        assert user.ask(ACTIVATE) == (True, "active") and node.entities == begun
    assert node.asked[-4:] == ["deactivate", "cleanup", "configure", "activate"]
    assert probe.until(lambda: user.events[-2:] == ["activating", "active"])
    assert node.refusals.total == 0


def test_cleanup_aborts_the_goal_and_goals_are_rejected_until_configured(user: User):
    probe = user.probe
    client = ActionClient(probe, EXECUTE_PROGRAM[1], EXECUTE_PROGRAM[0])
    assert probe.until(client.server_is_ready)

    def sent():
        answer = client.send_goal_async(EXECUTE_PROGRAM[1].Goal())
        assert probe.until(answer.done)
        return answer.result()

    under_way = sent()
    assert under_way.accepted
    result = under_way.get_result_async()
    user.ask(DEACTIVATE)
    assert user.ask(CLEANUP) == (True, "unconfigured")
    assert probe.until(result.done) and result.result().status == GoalStatus.STATUS_ABORTED
    assert not sent().accepted
    assert user.ask(CONFIGURE) == (True, "inactive")
    assert sent().accepted
    client.destroy()


def test_a_node_starts_itself_and_rejects_and_counts_impossible_transitions(user: User) -> None:
    assert user.node.asked == ["configure", "activate"]
    assert user.probe.until(lambda: user.probe.value("small", "lifecycle") == "active")
    assert user.probe.health["/small"].level == OK
    assert user.ask(ACTIVATE) == user.ask(99) == user.ask(label="activated") == (False, "active")
    assert user.node.refusals.counts == {"lifecycle.transition": 3}
    assert user.ask(DEACTIVATE) == (True, "inactive")


def test_parameters_can_be_set_only_while_a_node_is_unconfigured(user: User) -> None:
    assert "read-only" in user.set("number", 2)
    user.ask(DEACTIVATE)
    assert "read-only" in user.set("number", 2)
    user.ask(CLEANUP)
    assert "expected an integer in [1, 9], got 10" in user.set("number", 10)
    assert user.set("number", 2) == ""
    assert user.ask(CONFIGURE) == (True, "inactive")
    assert user.node.config.number == 2 and "read-only" in user.set("number", 3)


@pytest.mark.parametrize(
    "user", [{"small__autostart": False, "small__number": number} for number in (9, 13)],
    indirect=True,
)  # fmt: skip
def test_a_configuration_that_failed_can_be_corrected(user: User) -> None:
    node, begun = user.node, user.node.entities
    assert user.ask(CONFIGURE) == (False, "unconfigured")
    assert sum(node.refusals.counts[code] for code in ("test.missing", "config")) == 1
    assert node.entities == begun
    assert user.set("number", 3) == ""
    assert user.ask(CONFIGURE) == (True, "inactive") and node.config.number == 3


@pytest.mark.parametrize(("number", "error"), [(13, ConfigError), (7, MissingError)])
def test_a_failure_at_the_start_is_raised(number: int, error: type[PaError]) -> None:
    with graph(small__number=number), pytest.raises(error):
        Small()


def test_an_active_node_deactivates_and_cleans_up_when_it_is_closed(user: User) -> None:
    assert user.node.close() == 0 and user.node.state == "finalized"
    assert user.node.asked[-2:] == ["deactivate", "cleanup"]


def test_what_a_node_publishes_as_it_ends_arrives() -> None:
    """A process that has ended sends nothing again."""
    with graph() as probe, subprocess.Popen([sys.executable, "-c", SPEAKER]) as speaker:
        assert probe.until(lambda: "/speaker" in probe.health)
        probe.until(lambda: False, 0.5)  # so that it has discovered all of the probe's readers
        speaker.send_signal(signal.SIGINT)
        assert probe.until(lambda: probe.count(topics.TRAJECTORIES) == BURST)


def test_a_bug_in_a_transition_ends_the_node_which_saves_what_it_can(user: User) -> None:
    user.node.bug = "deactivate"
    with pytest.raises(KeyError, match="a bug"):
        user.ask(DEACTIVATE)
    assert user.node.asked[-1] == "cleanup" and user.node.state == "unconfigured"


def test_a_node_keeps_following_the_clock_after_cleanup_and_configure(user: User) -> None:
    node, out = user.node, topics.ROS_CLOCK.publisher(user.probe)
    tick = topics.ROS_CLOCK.type()
    steady_timer(user.probe, 0.05, lambda: out.publish(tick))
    follows = lambda: node.get_clock().now().nanoseconds == tick.clock.sec * 10**9  # noqa: E731
    tick.clock.sec = 7
    assert user.set("use_sim_time", True) == "" and user.probe.until(follows)
    begun = node.entities
    for number, state in ((DEACTIVATE, "inactive"), (CLEANUP, "unconfigured")):
        assert user.ask(number) == (True, state)
    assert user.ask(CONFIGURE) == (True, "inactive") and node.entities == begun
    tick.clock.sec = 9
    assert user.probe.until(follows)
    assert user.set("use_sim_time", False) == "" and node.entities == begun - 1
