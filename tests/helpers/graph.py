"""Running graphs with real nodes and real DDS, in the ROS domain of a test marked `graph`."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from lifecycle_msgs.msg import Transition, TransitionEvent
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import SetParameters
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.parameter import Parameter

from helpers.learners import ARENA, small
from helpers.waiting import DEADLINE_S
from learner_node.config import LearnerNodeConfig
from learner_node.worker import LearnerWorker, Sinks
from pa_ros.arena import ReachTask, world_of
from pa_ros.arena.designs import Kind
from pa_ros.arena.task import Verifier
from pa_ros.core.experience import Observation, PolicySnapshot, Verdict
from pa_ros.ros import topics
from pa_ros.ros.actions import EXECUTE_PROGRAM
from pa_ros.ros.environment import prepare_environment
from pa_ros.ros.executor import release, spin_until
from pa_ros.tools.client import client_node
from pa_ros.tools.graph import start_nodes, watch
from pa_ros.tools.launch_params import Parameters
from pa_ros.tools.launcher import Supervisor
from pa_ros.wire import Message
from pa_ros.wire.arena import ArenaDescription, decode_arena_info
from pa_ros.wire.diagnostics import Health, decode_diagnostics
from pa_ros.wire.learning import decode_weights
from pa_ros.wire.program import (
    GoalProgress,
    GoalResult,
    ProgramGoal,
    decode_goal_feedback,
    decode_goal_result,
    encode_goal,
)
from pa_ros.wire.services import Outcome, decode_outcome
from pa_ros.wire.simulator import SimState, encode_state_request
from pa_ros.world import Trajectory
from sim_node.session import Session

# Settings of a learner whose updates take little time, and the same as parameters of `graph`.
SMALL = small(20, 8, 16) | {"learner.schedule.trajectory_steps": 10}
SMALL_LEARNER = {f"learner_node__{name}": value for name, value in SMALL.items()}
# Parameters of an arena in real time, and of an agent that is trained for it.
SCENE = {"sim_node__design": "3-D", "sim_node__seed": 2, "sim_node__mode": "real_time"}
TRAINED = {"agent_node__weights": "checkpoint", "agent_node__checkpoint": "shipped:3-D"}
# A slow agent may answer a step twice, which the arena then repeated: the second answer is refused.
REPEATED = {"command.stale"}


class Probe(Node):
    """A node that subscribes to every topic, publishes on any, and calls services."""

    def __init__(self) -> None:
        super().__init__("probe")
        self.heard: dict[str, list[Any]] = {}
        self.health: dict[str, Health] = {}
        self.nodes: list[Any] = []
        for topic in vars(topics).values():
            if isinstance(topic, topics.Topic):
                self._listen(topic)

    def _listen(self, topic: topics.Topic) -> None:
        messages = self.heard[topic.name] = []

        def receive(message: Any) -> None:
            messages.append(message)
            if topic is topics.DIAGNOSTICS:
                self.health |= {h.name: h for h in decode_diagnostics(message)}

        self.create_subscription(topic.type, topic.name, receive, topic.reader)

    def until(self, condition: Callable[[], bool], timeout_s: float = DEADLINE_S) -> bool:
        """Spin all nodes of the graph until the condition is true; whether it became so in time."""
        return spin_until(self, condition, timeout_s, *self.nodes)

    def sees(self, condition: Callable[[], bool], send: Callable[[], None]) -> bool:
        """Send again and again until the condition is true; whether it became so in time.

        Nodes report a message only for seconds: on a busy machine that may be too short to see.
        """
        timer = self.create_timer(0.5, send)
        try:
            return self.until(condition)
        finally:
            self.destroy_timer(timer)

    def count(self, topic: topics.Topic) -> int:
        return len(self.heard[topic.name])

    def last(self, topic: topics.Topic) -> Any:
        return self.heard[topic.name][-1]

    def reaches(self, step: int) -> bool:
        """Wait for a step of the episode; whether the arena reached it in time."""
        features = topics.OBJECT_FEATURES
        return self.until(lambda: self.count(features) > 0 and self.last(features).step >= step)

    def value(self, node: str, key: str) -> str:
        """The last value that a node reported under a key; empty if it has not reported any."""
        health = self.health.get(f"/{node}")
        return health.values.get(key, "") if health else ""

    def message(self, node: str) -> str:
        """The last diagnostic message of a node; empty if it has not sent any."""
        health = self.health.get(f"/{node}")
        return health.message if health else ""

    def learns(self, frames: int = 100) -> bool:
        """Wait until the learner has learned from so many more frames; whether it did in time."""
        now = lambda: float(self.value("learner_node", "frames") or 0)  # noqa: E731
        before = now()
        return self.until(lambda: now() > before + frames)

    def speaker(self, topic: topics.Topic) -> Any:
        """A publisher that is already connected to the node under test."""
        publisher = self.create_publisher(topic.type, topic.name, topic.writer)
        wanted = 2  # the probe itself and the node under test
        assert self.until(lambda: publisher.get_subscription_count() >= wanted)
        return publisher

    def end(self, node: Any) -> None:
        """Close and destroy a node while the others continue."""
        self.nodes.remove(node)
        node.executor.remove_node(node)
        node.close()
        self.until(lambda: False, 0.1)  # the executor may have queued calls of the node's timers
        node.destroy_node()

    def pause(self, paused: bool = True) -> Outcome:
        """Pause simulation time, or let it continue."""
        state = SimState.PAUSED if paused else SimState.PLAYING
        return self.call(topics.SET_SIMULATION_STATE, encode_state_request(state))

    def call(self, service: tuple[str, Any], request: Any) -> Outcome:
        client = self.create_client(service[1], service[0])
        assert self.until(client.service_is_ready)
        future = client.call_async(request)
        assert self.until(future.done), f"{service[0]}: no answer"
        return decode_outcome(future.result())


@contextmanager
def graph(*makers: Callable[[], Node], remaps: Any = (), **parameters: object) -> Iterator[Probe]:
    """Start the nodes and a probe. Parameters are `node__name=value`; remaps are "from:=to" for
    all nodes, or "node:from:=to"."""
    prepare_environment()
    arguments = ["--ros-args", "--log-level", "error"]
    for rule in remaps:
        arguments += ["-r", rule]
    for key, value in parameters.items():
        node, _, name = key.partition("__")
        text = str(value).lower() if isinstance(value, bool) else str(value)
        arguments += ["-p", f"{node}:{name}:={text}"]
    rclpy.init(args=arguments)
    probe = Probe()
    try:
        for make in makers:
            probe.nodes.append(make())
        yield probe
    finally:
        try:
            # A test may have replaced nodes in the list, so close those that it contains now.
            for node in probe.nodes:
                node.close()
        finally:
            # Release the executor only now: a closing node still publishes its last messages.
            release(probe)
            for node in probe.nodes:
                node.destroy_node()
            rclpy.shutdown()


def learned_over_the_graph(
    folder: Path, given: Parameters, version: int, compose: bool = False
) -> tuple[PolicySnapshot, ArenaDescription]:
    """Run a graph of real processes until it publishes at least a version of the weights; the
    policy and the arena's description.

    The graph doesn't wait for this subscriber. On a busy machine a version may be published before
    the subscriber is discovered, so a later one is accepted too.
    """
    policies: list[PolicySnapshot] = []
    arenas: list[ArenaDescription] = []

    def receive(message: Message) -> None:
        snapshot = decode_weights(message).snapshot
        if snapshot.version >= version:
            policies.append(snapshot)

    with Supervisor(folder) as supervisor, client_node("watch") as node:
        topics.POLICY_WEIGHTS.subscribe(node, receive)
        topics.ARENA_INFO.subscribe(node, lambda m: arenas.append(decode_arena_info(m)))
        start_nodes(supervisor, given, folder, compose=compose)
        heard = lambda: bool(policies and arenas)  # noqa: E731
        assert watch(node, supervisor, lambda: None, heard, DEADLINE_S)
    return policies[0], arenas[0]


CONFIGURE, CLEANUP, ACTIVATE, DEACTIVATE, SHUTDOWN = (
    Transition.TRANSITION_CONFIGURE,
    Transition.TRANSITION_CLEANUP,
    Transition.TRANSITION_ACTIVATE,
    Transition.TRANSITION_DEACTIVATE,
    Transition.TRANSITION_ACTIVE_SHUTDOWN,
)


class GoalSender:
    """Sends goals to an agent and keeps their feedback."""

    def __init__(self, probe: Probe) -> None:
        self.probe = probe
        self.feedback: list[GoalProgress] = []
        self._client = ActionClient(probe, EXECUTE_PROGRAM[1], EXECUTE_PROGRAM[0])
        assert probe.until(self._client.server_is_ready)

    def send(self, text: str, time_limit_s: float = 0.0, hold_s: float = 1.0) -> Any:
        """The handle of an accepted goal."""
        goal = encode_goal(ProgramGoal(text, time_limit_s, hold_s))
        sent = self._client.send_goal_async(goal, feedback_callback=self._keep)
        assert self.probe.until(sent.done)
        assert sent.result().accepted
        return sent.result()

    def result(self, handle: Any) -> tuple[int, GoalResult]:
        """The status and the result of a goal that ends."""
        future = handle.get_result_async()
        assert self.probe.until(future.done)
        return future.result().status, decode_goal_result(future.result().result)

    def close(self) -> None:
        self._client.destroy()

    def _keep(self, message: Any) -> None:
        self.feedback.append(decode_goal_feedback(message))


@contextmanager
def goals_of(probe: Probe) -> Iterator[GoalSender]:
    sender = GoalSender(probe)
    yield sender
    sender.close()


class User:
    """Changes the state and parameters of a lifecycle node over its services."""

    def __init__(self, probe: Probe, node: Any) -> None:
        self.probe, self.node, name = probe, node, node.get_name()
        self._change = probe.create_client(ChangeState, f"{name}/change_state")
        self._state = probe.create_client(GetState, f"{name}/get_state")
        self._set = probe.create_client(SetParameters, f"{name}/set_parameters")
        self.events: list[str] = []
        heard = lambda event: self.events.append(event.goal_state.label)  # noqa: E731
        probe.create_subscription(TransitionEvent, f"{name}/transition_event", heard, 100)

    def ask(self, number: int = 0, label: str = "") -> tuple[bool, str]:
        """Request a transition; whether it succeeded, and the state after it."""
        wanted = ChangeState.Request(transition=Transition(id=number, label=label))
        changed = self._call(self._change, wanted).success
        return changed, self._call(self._state, GetState.Request()).current_state.label

    def set(self, name: str, value: Any) -> str:
        """Set a parameter; the reason if it was rejected, else an empty string."""
        return self._send(Parameter(name, value=value))

    def delete(self, name: str) -> str:
        """Delete a parameter; the reason if that was rejected, else an empty string."""
        return self._send(Parameter(name, Parameter.Type.NOT_SET))

    def _send(self, parameter: Parameter) -> str:
        request = SetParameters.Request(parameters=[parameter.to_parameter_msg()])
        (result,) = self._call(self._set, request).results
        return "" if result.successful else str(result.reason)

    def _call(self, client: Any, request: Any) -> Any:
        assert self.probe.until(client.service_is_ready)
        answer = client.call_async(request)
        assert self.probe.until(answer.done)
        return answer.result()


class Witness:
    """Records what moved the arm of a session, and replays it to check experience against."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._world = world_of(session.arena, session.task.design)
        self._moves: dict[int, list[Any]] = {}  # velocities, by episode
        self._kinds: dict[int, list[Kind]] = {}  # of the blocks, by episode
        advance, task = session.task.advance, session.task

        def recording(command: Any) -> tuple[Observation, Verdict]:
            assert task.episode is not None
            self._moves.setdefault(task.episode.index, []).append(np.array(command))
            self._kinds[task.episode.index] = [block.kind for block in task.episode.blocks]
            return advance(command)

        task.advance = recording  # type: ignore[method-assign]

    def false(self, trajectories: Iterable[Trajectory]) -> list[str]:
        """The transitions that never happened in the arena, by name."""
        happened = {episode: self._again(episode) for episode in self._moves}
        return [
            f"{one.key} {t}"
            for one in trajectories
            for t in range(len(one))
            if not self._happened(one, t, happened[one.episode])
        ]

    def _again(self, episode: int) -> list[Observation]:
        session = self._session
        task = ReachTask(session.arena, session.task.design, session.config.seed)
        first, _ = task.reset(episode)
        return [first, *(task.step(move)[0] for move in self._moves[episode])]

    def _happened(self, one: Trajectory, t: int, steps: list[Observation]) -> bool:
        first = one.first_step + t
        velocity = one.actions[t].astype(np.float64) * self._session.speed_limits
        before, after = steps[first], steps[first + 1]
        # Another arena may have sent the current program.
        verifier = Verifier(one.program, self._kinds[one.episode], self._session.task.scoring)
        return (
            np.array_equal(velocity, self._moves[one.episode][first])
            and np.array_equal(one.objects[t], before.objects)
            and np.array_equal(one.arm[t], self._world.arm(before))
            and np.array_equal(one.objects[t + 1], after.objects)
            and np.array_equal(one.arm[t + 1], self._world.arm(after))
            and one.rewards[t] == np.float32(verifier.score(after.objects, after.hand_pose).reward)
        )


def begin_run(config: LearnerNodeConfig) -> str:
    """Write a checkpoint of version 0 to the folder `config.out`; the run's id."""
    worker = LearnerWorker(config, ARENA, Sinks(lambda _: None, lambda *_: None, lambda _: None))
    worker.start()
    worker.close()
    return worker.run.info.run_id
