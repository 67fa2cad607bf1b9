"""The agent as a ROS node: each callback decodes, makes one core call, encodes, publishes."""

from __future__ import annotations

import time
import uuid
from dataclasses import replace
from pathlib import Path

import numpy as np

from agent_node.acting import ActingNode
from agent_node.config import AgentConfig
from agent_node.goals import ProgramGoals
from agent_node.outputs import ControllerOutput, RelevanceMarkers
from agent_node.status import AgentStatus
from pa_ros.acting.agent import Agent, ArenaFacts
from pa_ros.acting.learning_agent import LearningAgent
from pa_ros.core.clock import now_ns
from pa_ros.core.errors import PaError
from pa_ros.core.experience import (
    PERSON,
    AgentKey,
    LearnerInfo,
    PolicySnapshot,
    PublishedPolicy,
    Step,
)
from pa_ros.language import Goal, ProgramError, Vocabulary, logic_named
from pa_ros.learning.checkpoints import load_policy
from pa_ros.learning.recipes import LearningSettings
from pa_ros.networks.errors import NetworkError
from pa_ros.networks.parameters import initial_actor
from pa_ros.provenance import origin
from pa_ros.ros import topics
from pa_ros.ros.executor import steady_timer
from pa_ros.ros.health import LEARNER_ID
from pa_ros.ros.peers import PeerMonitor, is_restarted_learner
from pa_ros.ros.refusals import RateLimiter, answer_program
from pa_ros.wire import Message
from pa_ros.wire.arena import ArenaDescription, decode_arena_info
from pa_ros.wire.diagnostics import decode_diagnostics, encode_provenance
from pa_ros.wire.learning import decode_learner_info, decode_weights, encode_trajectory
from pa_ros.wire.program import ProgramRequest, decode_program, encode_program_status
from pa_ros.wire.program_book import ProgramBook
from pa_ros.wire.step import Command, arena_of, decode_step, encode_command
from pa_ros.world import Scoring
from pa_ros.world.world import World


class AgentNode(ActingNode):
    """One agent: it answers each observation with one command, and sends none without.

    While inactive it still follows arena and learner, but takes in no step.
    """

    def __init__(self) -> None:
        self._drawn_id = uuid.uuid4().hex[:8]  # kept after a cleanup: still the same agent
        super().__init__("agent_node", AgentConfig)

    def configure(self) -> None:
        config = self.config
        self.agent_id = config.agent_id or f"{self.get_name()}-{self._drawn_id}"
        self.agent = make_agent(config, AgentKey(self.agent_id, now_ns()))
        self.book = ProgramBook(Vocabulary(()), self.agent.check_program)  # until an arena is known
        self.seen, self.given_up = None, ""
        self._handled_ns = self._commanded_ns = -1  # stamps of the newest step taken in, answered
        self._command = topics.JOINT_COMMANDS.type()  # filled again for each command
        self._commands = self._trajectories = 0
        self._core_s = 0.0  # spent in the policy itself
        self._reported = (0, 0.0)  # commands and core_s at the last report
        self._arenas = PeerMonitor[ArenaDescription]("arena", self._bind_to_arena)
        self._learners = PeerMonitor[LearnerInfo](
            "learner", lambda learner: self._follow(), is_restarted_learner
        )
        self._status = AgentStatus(config.stuck_after_s)
        self._program_rate = RateLimiter()

        self._commands_out = self.advertise(topics.JOINT_COMMANDS)
        self._trajectories_out = self.advertise(topics.TRAJECTORIES.within(config.learner))
        self._programs_out = self.advertise(topics.PROGRAM_STATUS)
        self._provenance_out = self.advertise(topics.PROVENANCE)
        self._controller = ControllerOutput(self) if config.controller != "none" else None
        self._goals = None if config.learning else ProgramGoals(self)
        RelevanceMarkers(self)

        self.subscribe(topics.ARENA_INFO, self._on_arena)
        self.subscribe(topics.PROGRAM, self._on_program)
        self.subscribe(topics.OBJECT_FEATURES, self._on_step)
        if config.weights == "topic":
            self.subscribe(topics.LEARNER_INFO.within(config.learner), self._on_learner)
            self.subscribe(topics.POLICY_WEIGHTS.within(config.learner), self._on_weights)
            self.subscribe(topics.DIAGNOSTICS, self._on_diagnostics)
        if config.learning:
            steady_timer(self, config.resend_period_s, self._resend)

        parameters, name = config.flat(), self.get_fully_qualified_name()
        provenance = origin(name, self.agent_id, config.seed, parameters=parameters)
        self._provenance_out.publish(encode_provenance(provenance))
        source = config.checkpoint or config.weights
        doing = "explores and learns" if config.learning else "executes programs"
        self.get_logger().info(f"agent {self.agent_id}: {doing}, with weights from {source}")

    def activate(self) -> None:
        """Answer the step that waited. The arena repeats a step that was missed."""
        self._status.restart()
        self._act()

    def deactivate(self) -> None:
        if self._goals is not None:
            self._goals.abandon()
        if self._controller is not None:
            self._controller.rest()

    def cleanup(self) -> None:
        if self._controller is not None:
            self._controller.stop()

    @property
    def arena(self) -> ArenaDescription | None:
        """The arena that is followed."""
        return self._arenas.current

    # A control step: observation in, command out

    def _on_step(self, message: Message) -> None:
        if not self.active or not self._arenas.received(arena_of(message)):
            return
        status = self._status
        status.observed_at = time.monotonic()
        try:
            self._take_in(decode_step(message, self._joints, self._object_width))
            status.step_at, status.step_refusal = time.monotonic(), ""
        except PaError as error:
            status.step_refusal = str(error)
            raise

    def _take_in(self, step: Step) -> None:
        observation = step.observation
        if observation.stamp_ns < self._handled_ns:
            raise PaError(
                f"object_features: expected a stamp of at least {self._handled_ns} ns, got "
                f"{observation.stamp_ns}",
                code="observation.stale",
            )
        if self._goals is not None:
            self._goals.observe(self._judged(step))
        if observation.stamp_ns == self._handled_ns:
            self._answer_again()
            return
        executed = step.executed
        other = executed.command.agent_id if executed is not None else self.agent_id
        if other not in (self.agent_id, PERSON):
            self._status.warn(f"the arm obeys the agent {other!r}, too: stop one of the two")
        self._status.has_program = bool(step.program)
        if not step.program:
            return
        program = self.book.named(observation.program_id, step.program)
        if program is None:
            program = self._accept_in_force(observation.program_id, step.program)
        started = time.perf_counter()
        trajectory = self.agent.observe(step, program)
        self._core_s += time.perf_counter() - started
        self._handled_ns, self.seen = observation.stamp_ns, (step, program)
        if trajectory is not None:
            self._trajectories += 1
            self._trajectories_out.publish(encode_trajectory(trajectory))
        self._act()

    def _judged(self, step: Step) -> Step:
        """A step with the agent's own verdict where no verifier judged it."""
        goal = self.book.named(step.observation.program_id, step.program)
        if step.verdict is not None or goal is None:
            return step
        try:
            return replace(step, verdict=self.agent.verdict(step, goal))
        except PaError:  # its networks don't judge
            return step

    def _act(self) -> None:
        """Answer the newest step, if that is still to be done and its weights are there."""
        if not self.active:
            return
        started = time.perf_counter()
        if self.agent.prepare() is not None or self.seen is None:
            return
        observation = self.seen[0].observation
        try:
            if observation.program_id == self.given_up:
                self.agent.hold()
            else:
                self.agent.act()
        except (NetworkError, ProgramError) as error:
            self.refusals.refuse("program", error)
            self._status.warn(f"holds the arm, and learns nothing: {error}")
            self.agent.hold()
        self._core_s += time.perf_counter() - started
        sent = self.agent.last_command
        assert sent is not None
        answered = observation.episode, observation.step, observation.stamp_ns
        made = self.agent_id, self.agent.version, sent.action
        command = Command(*answered, *made, sent.command.incarnation, sent.command.number)
        self._commands_out.publish(encode_command(command, self._command))
        self._commanded_ns = observation.stamp_ns
        self._commands += 1
        self._status.commanded_at = time.monotonic()
        if self._controller is not None:
            self._controller.send(sent.action, observation.joint_position)

    def _answer_again(self) -> None:
        """Answer a step that the arena repeats: the command was lost, or there was none."""
        if self._commanded_ns == self._handled_ns:
            self._commands_out.publish(self._command)
        else:
            self._act()

    # Arena, learner, programs

    def _on_arena(self, message: Message) -> None:
        arena = decode_arena_info(message)
        self._arenas.described(arena.arena_id, arena)

    def _bind_to_arena(self, arena: ArenaDescription) -> None:
        """Forget the arena that was followed before."""
        self.agent.scoring = Scoring.of(arena.world.relations, arena.thresholds)
        self._joints, self._object_width = len(arena.joint_names), arena.world.object_features
        self._handled_ns = self._commanded_ns = -1
        self.seen = None
        if self.book.vocabulary != arena.world.vocabulary:
            self.book = ProgramBook(arena.world.vocabulary, self.agent.check_program)
        if self._controller is not None:
            self._controller.bind(arena)
        if self.config.weights == "random" and not self.agent.has_weights:
            self.agent.offer(PublishedPolicy(random_policy(arena.world, self.config), run_id=""))
        self.get_logger().info(f"arena {arena.arena_id}: design {arena.design}, {arena.preset}")
        self._follow()

    def _on_learner(self, message: Message) -> None:
        learner = decode_learner_info(message)
        self._learners.described(learner.learner_id, learner)

    def _on_diagnostics(self, message: Message) -> None:
        # A learner publishes no weights while it waits for trajectories; its diagnostics show that
        # it is alive. Those of other namespaces arrive, too.
        for entry in decode_diagnostics(message):
            learner = entry.values.get(LEARNER_ID)
            if learner is not None and self._learners.knows(learner):
                self._learners.received(learner)

    def _on_weights(self, message: Message) -> None:
        digest = self.arena.world.digest if self.arena is not None else None
        policy = decode_weights(message, digest)
        self._learners.received(policy.learner_id)
        self.agent.offer(policy)
        self._act()

    def _follow(self) -> None:
        """Act for the followed learner in the followed arena, once both are known."""
        arena, learner = self._arenas.current, self._learners.current
        if arena is None or learner is None:
            return
        facts = arena.world.digest, arena.control_period, arena.thresholds, arena.reward
        self.agent.follow(learner, ArenaFacts(*facts))
        self.get_logger().info(
            f"follows learner {learner.learner_id}, run {learner.run_id}; acts by "
            f"{self.agent.backend or 'its weights'}"
        )
        self._act()

    def _on_program(self, message: Message) -> None:
        request = decode_program(message)
        if self.active and self.arena is not None:  # else it is answered once it is in force
            self._program_rate.check()
            self._answer(request)

    def _accept_in_force(self, program_id: str, text: str) -> Goal:
        """Answer a program that the agent learns of by a step. Raises ProgramError."""
        self.book.name(program_id, text)  # the arena decides what an id means
        self._answer(ProgramRequest(program_id, text))
        return self.book.program(text)

    def _answer(self, request: ProgramRequest) -> None:
        name, stamp_ns = self.get_fully_qualified_name(), max(self._handled_ns, 0)
        status = answer_program(request, name, stamp_ns, self.book.accept, self.refusals)
        self._programs_out.publish(encode_program_status(status))

    def _resend(self) -> None:
        """Send trajectories again that the awaited weights should account for."""
        if self.active and isinstance(self.agent, LearningAgent):
            late = self._status.idle_s > self.config.resend_period_s
            for trajectory in self.agent.overdue(late):
                self._trajectories_out.publish(encode_trajectory(trajectory))

    # Health

    def collect(self) -> tuple[int, str, dict[str, str]]:
        commands, core_s = self._reported
        self._reported = (self._commands, self._core_s)
        core_us = (self._core_s - core_s) * 1e6 / max(self._commands - commands, 1)
        values = {
            "agent_id": self.agent_id,
            "policy_version": str(self.agent.version) if self.agent.has_weights else "none",
            "commands": str(self._commands),
            "core_us": f"{core_us:.1f}",
            "trajectories": str(self._trajectories),
        }
        if isinstance(self.agent, LearningAgent):
            values["interrupted"] = str(self.agent.interrupted)
            values["lost_trajectories"] = str(self.agent.lost)
        level, message = self._status.state(self.agent, self._arenas, self._learners)
        return level, message, values


def make_agent(config: AgentConfig, key: AgentKey) -> Agent:
    """An agent, with weights if they come from a checkpoint. Raises CheckpointError."""
    if config.learning:
        return LearningAgent(key, config.seed)
    agent = Agent(key, logic_named(config.logic))
    if config.weights == "checkpoint":
        agent.offer(PublishedPolicy(load_policy(Path(config.checkpoint)), run_id=""))
    return agent  # random weights need the arena's vocabulary first


def random_policy(world: World, config: AgentConfig) -> PolicySnapshot:
    """The weights that a learner of the configured network would begin with."""
    network = LearningSettings().network.for_world(world)
    tensors = initial_actor(network, np.random.default_rng(config.seed))
    return PolicySnapshot(0, network.architecture, world.digest, tensors)
