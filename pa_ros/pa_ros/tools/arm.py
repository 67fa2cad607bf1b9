"""`pa_ros.Arm`: use a running graph from Python, or start one, without touching ROS."""

from __future__ import annotations

import time
import weakref
from collections import deque
from collections.abc import Callable, Iterator
from functools import partial
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pa_ros.acting.execution import ENDED, HOLD_S, Result, window_s
from pa_ros.core.errors import ConfigError, PaError
from pa_ros.language import parse, parse_goal
from pa_ros.ros.topics import TAKEOVER
from pa_ros.tools.client import NoAnswerError
from pa_ros.tools.connection import Connection, Lease
from pa_ros.tools.domain import DomainClaim
from pa_ros.tools.launch_params import acting, load_parameters, merged, packaged
from pa_ros.tools.scenes import Scene
from pa_ros.tools.send import Answers, ProgramSender
from pa_ros.wire.arena import ArenaDescription
from pa_ros.wire.program import (
    GoalProgress,
    GoalResult,
    ProgramGoal,
    decode_goal_feedback,
    decode_goal_result,
    encode_goal,
)
from pa_ros.wire.robot import encode_takeover
from pa_ros.wire.services import ResetRequest, decode_outcome
from pa_ros.wire.simulator import encode_steps_goal

if TYPE_CHECKING:
    from pa_ros.acting.insight import Explanation

PATIENCE_S = 10.0
STARTING_S = 60.0  # for nodes to start on a busy machine
OFFER_S = 5.0  # for an agent that takes goals to be discovered
CANCEL_S = 5.0
RETRY_S = 0.5
STEER_S, STEERED_S = 5.0, 0.05  # longest steering, and time between two messages of it
UNREAD = 1000  # feedback kept for a caller that does not read it
UNREADY, REJECTED = "goal.unready", "goal.rejected"
NO_GOALS = (
    "the agent takes no goals now: is it configured and active? (ros2 lifecycle get, with its name)"
)
NO_AGENT = (
    "no agent that takes goals: start one (`pa_ros launch` starts an arena and an agent); agents "
    "that learn take none"
)


class Arm:
    """An arm that executes programs: that of the running graph, or with `Arm.simulated()` its own.

        with Arm() as arm:
            print(arm.scene())
            result = arm.execute("NEAR(HAND, AND(RED, CUBE))", timeout=10)
            print(result.success, result.distance)

    Methods block until they have an answer and may be called from any thread. They raise PaError:
    ProgramError for a wrong program, NoAnswerError if nobody answers. `close()`, or the end of the
    `with` block, cancels what is being executed and ends everything that this object started. An
    arm that no variable holds any more is closed, too.
    """

    def __init__(
        self,
        namespace: str = "",
        *,
        patience: float = PATIENCE_S,
        domain: int | None = None,
        graph: Connection | None = None,
    ) -> None:
        """Join the running graph.

        :param namespace: of the arena.
        :param patience: longest wait for an answer or a sign of life, seconds of wall time.
        :param domain: the ROS domain; None: ROS_DOMAIN_ID, or 0.
        :param graph: a connection that was made before, which this object closes.
        :raises NoAnswerError: if there is no arena within `patience`.
        :raises ConfigError: if there is one, but in another namespace.
        """
        self.graph = graph or Connection(namespace, patience, domain)
        self.goal: GoalHandle | None = None
        self._made_sender: ProgramSender | None = None
        self._takeover: Any = None  # publisher
        try:
            self.graph.join()
        except BaseException:
            self.graph.close()
            raise
        self._lease = Lease(self.graph)

    @classmethod
    def simulated(
        cls,
        agent: str | Path = "3-D",
        *,
        seed: int = 2,
        speed: float = 1.0,
        record: str | Path | None = None,
        logs: str | Path | None = None,
        domain: int | None = None,
        **arena: Any,
    ) -> Arm:
        """Start an arena and an agent in another process, and join them.

        :param agent: a shipped one ("3-D") or the folder of a training run. Design, arm and preset
            are those of its training.
        :param seed: of the scenes.
        :param speed: times real time.
        :param record: a new folder for a recording of all messages.
        :param logs: for parameters and logs; None: a temporary folder.
        :param domain: the ROS domain; None: one that nobody uses on this machine.
        :param arena: other parameters of `sim_node`, such as `condition="only-color"`.
        :raises ChildError: if the process ends by itself; the text has the end of its log.
        """
        own = {"seed": seed, "real_time_factor": float(speed), **arena}
        like_its_training = acting(load_parameters(packaged("execute_3d")), agent)
        parameters = merged(like_its_training, {"sim_node": own})
        graph = Connection("", STARTING_S, DomainClaim() if domain is None else domain)
        try:
            graph.start(parameters, record, logs)
        except BaseException:
            graph.close()
            raise
        return cls(graph=graph)

    # The scene

    @property
    def arena(self) -> ArenaDescription:
        """Facts about the arena, or the robot in its place: words, joints, limits."""
        return self.scene().arena

    def scene(self) -> Scene:
        """The scene now: blocks, the current program, and programs that make sense."""
        assert self.graph.monitor.scene is not None  # the constructor waited for it
        return self.graph.monitor.scene

    def check(self, program: str) -> str:
        """The program in canonical form.

        Raises ProgramError, whose text shows the place, unless it can be executed in this scene by
        this agent; where blocks are only seen, the arena alone knows whether it names one.
        """
        scene = self.scene()
        world, seen = scene.arena.world, scene.step.observation
        parsed = parse_goal(program, world.vocabulary)
        world.require_possible(parsed, seen.objects, seen.hand_index)
        weights = self.graph.weights
        self.graph.discovered(lambda: bool(weights.architecture))
        weights.check(parsed)
        return str(parsed)

    def explain(self, program: str = "") -> Explanation:
        """Φ and p of the objects on the table, by the weights that the agent acts with.

        Φ says to what degree each word describes each object, p how well it fits the program;
        without a program there is no p. Raises PaError if the weights are not known here.
        """
        scene, graph, weights = self.scene(), self.graph, self.graph.weights
        parsed = parse(program, scene.arena.world.vocabulary) if program else None
        graph.call(weights.forget)
        until = time.monotonic() + graph.patience
        while weights.insight is None and not weights.why and time.monotonic() < until:
            graph.call(weights.refresh)
            graph.until(lambda: weights.insight is not None, RETRY_S)
        graph.call(weights.rest)
        if weights.insight is None:
            why = weights.why or "neither a checkpoint nor a learner's weights became known"
            raise PaError(f"explain: expected the agent's weights, got none: {why}", "arm.weights")
        return weights.insight.explain(scene.step.observation, parsed)

    # Programs

    def execute(
        self,
        program: str,
        timeout: float | None = None,
        hold: float = HOLD_S,
        progress: Callable[[GoalProgress], None] = lambda _: None,
    ) -> Result:
        """Execute a program until it has been satisfied for `hold`, or for `timeout`.

        Both are seconds of the arena's time; by default the timeout is 10 s for each program of a
        goal. Missing the target is a result, not an error. If no agent takes goals (agents that
        learn, other controllers), the program is published, and the arena's verdicts are watched.
        Ctrl-C cancels it.

        :param progress: receives distance and p of each object, five times a second.
        """
        if self.graph.until(self.graph.goals.server_is_ready, min(OFFER_S, self.graph.patience)):
            return self.start(program, timeout, hold).result(progress)
        graph, patience = self.graph, self.graph.patience
        sender = graph.call(lambda: ProgramSender(graph.node, graph.until))
        try:
            for status in sender.send(program, patience, timeout, hold).refused:
                raise PaError(f"{status.node}: {status.reason}", status.code)
            found = sender.wait(patience)
        except NoAnswerError as error:
            raise NoAnswerError(f"{error}: {graph.standstill()}", error.code) from error
        finally:
            graph.call(sender.close)
        code, reason = ("", "") if found.satisfied else ENDED[found.ended]
        return Result(program, found.satisfied, found.distance, found.reached_s, reason, code)

    def start(self, program: str, timeout: float | None = None, hold: float = HOLD_S) -> GoalHandle:
        """Begin to execute a program as `execute` does, and return at once.

        A timeout of 0 is none. Raises NoAnswerError if no agent takes goals.
        """
        text = str(parse_goal(program, self.arena.world.vocabulary))
        if not self.graph.until(self.graph.goals.server_is_ready):
            raise NoAnswerError(f"execute: {NO_AGENT}", code="arm.no_agent")
        given = window_s(text) if timeout is None else timeout
        self.goal = GoalHandle(self.graph, ProgramGoal(text, given, hold), self._lease)
        return self.goal

    def cancel(self) -> None:
        """Cancel what `start` or `execute` began; the arm holds. Without that, do nothing."""
        if self.goal is not None:
            self.goal.cancel()

    def send(self, program: str, program_id: str = "") -> Answers:
        """Publish a program, and return the answers of all nodes.

        It stays in force until another one comes. Raises NoAnswerError if one of them is silent.

        :param program_id: a new one of your own, by which the arena's steps name the program.
        """
        return self._sender.send(program, self.graph.patience, program_id=program_id)

    @property
    def answers(self) -> Answers:
        """The answers to the latest `send`, also if it failed."""
        return self._sender.answers

    # The arena's time and scenes

    def reset(self, episode: int | None = None, evaluation: bool = False) -> Scene:
        """Begin the next scene, or the scene of an episode, and return it."""
        if episode is not None and not (isinstance(episode, Integral) and 0 <= episode < 2**64):
            raise ConfigError(f"reset: expected the number of an episode, got {episode!r}")
        began = self.graph.services.reset(ResetRequest(episode, "", evaluation))

        def arrived() -> bool:
            seen = self.scene().step.observation
            return seen.episode == began.episode and seen.stamp_ns >= began.stamp_ns

        if not self.graph.until(arrived):
            raise NoAnswerError(f"reset: no step of episode {began.episode} arrived")
        return self.scene()

    def pause(self) -> None:
        """Stop the arena's time."""
        self.graph.services.pause(True)

    def resume(self) -> None:
        """Let the arena's time go on."""
        self.graph.services.pause(False)

    def scatter(self) -> str:
        """Let a robot that learns stop, so that you can scatter its blocks; what it says."""
        return self.graph.services.scatter()

    def scattered(self) -> str:
        """Let it continue to learn with the blocks as they are now; what it says."""
        return self.graph.services.scattered()

    def steer(self, x: float, y: float, z: float, seconds: float = 0.5) -> None:
        """Move a robot's hand in the agent's place, at a velocity in the base's frame (m/s), for a
        time of at most STEER_S. It then obeys the agent again."""
        velocity = np.array([x, y, z], np.float64)
        if not np.isfinite(velocity).all() or not 0 < seconds <= STEER_S:
            raise ConfigError(
                f"steer: expected finite velocities, for up to {STEER_S:g} s, got "
                f"{velocity.tolist()} for {seconds!r} s"
            )
        graph, until = self.graph, time.monotonic() + seconds
        if self._takeover is None:
            self._takeover = graph.call(partial(TAKEOVER.publisher, graph.node))
        if not graph.until(lambda: self._takeover.get_subscription_count() > 0):
            raise NoAnswerError("steer: no robot_node hears it; arenas do not", code="arena.silent")
        while time.monotonic() < until:
            graph.call(partial(self._takeover.publish, encode_takeover(velocity)))
            time.sleep(STEERED_S)

    def step(self, steps: int = 1) -> Scene:
        """Let a paused arena make control steps in which the agent acts, and return the scene then.

        Waits up to the arm's patience for each step. Raises PaError if the arena is not paused.
        """
        graph, before = self.graph, self.scene()
        then_ns = before.step.observation.stamp_ns + steps * round(1e9 * self.arena.control_period)
        if not graph.until(graph.steps.server_is_ready):
            raise NoAnswerError("step: no arena offers it; robots do not", code="arena.silent")
        sent = graph.call(partial(graph.steps.send_goal_async, encode_steps_goal(steps)))
        accepted = graph.until(sent.done) and sent.result().accepted
        ended = graph.call(sent.result().get_result_async) if accepted else sent
        if not accepted or not graph.until(ended.done, steps * graph.patience):
            raise NoAnswerError("step: no answer: does the agent act?", code="arena.silent")
        outcome = decode_outcome(ended.result().result)
        if not outcome.success:
            raise PaError(outcome.reason, "arena.service")
        if not graph.until(lambda: self.scene().step.observation.stamp_ns >= then_ns):
            raise NoAnswerError("step: its observation did not arrive", code="arena.silent")
        return self.scene()

    def set_speed(self, times: float) -> None:
        """Change the speed of an arena in real time, times real time."""
        self.graph.services.set_speed(times)

    def move(self, block: int, x: float, y: float) -> None:
        """Put a block, by its number in `scene().blocks` (the first is 0), somewhere on the table
        (m)."""
        scene = self.scene()
        places = scene.places if scene.arena.perception else None
        self.graph.services.move(block, float(x), float(y), places)

    def close(self) -> None:
        """Cancel the goal, leave the graph, and end what `simulated` started."""
        try:
            self.cancel()
        finally:
            self.goal = None
            self.graph.close()

    def __enter__(self) -> Arm:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def _sender(self) -> ProgramSender:
        graph = self.graph
        if self._made_sender is None:
            make = partial(ProgramSender, graph.node, graph.until, follow=False)
            self._made_sender = graph.call(make)
        return self._made_sender


class GoalHandle:
    """A program that an agent executes. Iterate over it for its progress; `result()` waits."""

    def __init__(self, graph: Connection, wanted: ProgramGoal, lease: Lease | None = None) -> None:
        """Send the goal. An agent that knows no arena or weights yet is asked again."""
        self.program = wanted.text
        self.graph, self._wanted, self._lease = graph, wanted, lease
        self._unread: deque[GoalProgress] = deque(maxlen=UNREAD)
        self._heard_at = self._began = time.monotonic()
        self._handle: Any = None
        self._ended: Any = None
        while self._attempt() and time.monotonic() < self._began + graph.patience:
            time.sleep(RETRY_S)

    @property
    def done(self) -> bool:
        """Whether it has ended."""
        return bool(self._ended.done())

    def __iter__(self) -> Iterator[GoalProgress]:
        """Yield distance, satisfaction and p of each object, five times a second, to the end.

        Raises NoAnswerError, and cancels the goal, if agent or arena stand still for the arm's
        patience.
        """
        while True:
            self.graph.until(lambda: bool(self._unread) or self.done, RETRY_S)
            if self._unread:
                yield self._unread.popleft()
            elif self.done:
                return
            self._check_alive()

    def result(self, progress: Callable[[GoalProgress], None] = lambda _: None) -> Result:
        """Wait for the end. An exception meanwhile cancels the goal.

        Raises PaError if the agent takes no goals, or if the arena rejects the program.
        """
        try:
            for one in self:
                progress(one)
        finally:
            # The arm must not pursue a goal that nobody waits for any more.
            self.cancel()
        ended = self._result()
        # Goals that were accepted end with other codes of this kind.
        if not ended.success and (ended.code == UNREADY or not ended.code.startswith("goal.")):
            # An agent that is cleaned up meanwhile aborts its goal without a word.
            raise PaError(ended.reason or NO_GOALS, ended.code or REJECTED)
        outcome = ended.success, ended.final_distance, ended.time_to_reach_s
        return Result(self.program, *outcome, ended.reason, ended.code)

    def cancel(self) -> None:
        """Cancel it, if it has not ended; the arm holds."""
        if not self.done:
            asked = self.graph.call(self._handle.cancel_goal_async)
            self.graph.until(lambda: bool(asked.done()) and self.done, CANCEL_S)

    def _attempt(self) -> bool:
        """Send the goal; whether it ended at once because the agent is not ready yet."""
        graph = self.graph
        message, feed = encode_goal(self._wanted), weakref.WeakMethod(self._on_feedback)

        def on_feedback(feedback: Any) -> None:
            # The graph must not hold this object, and with it the lease.
            if (receive := feed()) is not None:
                receive(feedback)

        sent = graph.call(
            partial(graph.goals.send_goal_async, message, feedback_callback=on_feedback)
        )
        if not graph.until(sent.done):
            raise NoAnswerError(f"no agent accepted the goal within {graph.patience:g} s")
        self._handle = sent.result()
        if not self._handle.accepted:
            raise PaError(NO_GOALS, REJECTED)
        self._ended = graph.call(self._handle.get_result_async)
        graph.until(lambda: self.done or bool(self._unread))
        return self.done and self._result().code == UNREADY

    def _on_feedback(self, message: Any) -> None:
        self._heard_at = time.monotonic()
        self._unread.append(decode_goal_feedback(message))

    def _result(self) -> GoalResult:
        return decode_goal_result(self._ended.result().result)

    def _check_alive(self) -> None:
        """Raise NoAnswerError if the agent is silent, or the arena's time stands still."""
        graph, now = self.graph, time.monotonic()
        silent_s = now - self._heard_at
        still_s = now - max(self._began, graph.monitor.stepped_at)
        if max(silent_s, still_s) < graph.patience:
            return
        what = "the agent fell silent: does its node still run?"
        if silent_s < graph.patience:
            what = f"the arena's time stands still: {graph.standstill()}"
        raise NoAnswerError(f"no progress for {graph.patience:g} s: {what}", code="arm.stalled")
