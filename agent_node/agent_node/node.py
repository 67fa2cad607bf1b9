"""The agent as a ROS node: each callback decodes, makes one core call, encodes, publishes."""

from __future__ import annotations

import time
import uuid
from pathlib import Path

import numpy as np
from rclpy.node import Node

from agent_node.config import AgentConfig
from agent_node.programs import HeardByOthers, ProgramBook, vocabulary_of
from agent_node.steps import StepMatcher
from pa_ros.acting.agent import Agent, Step
from pa_ros.acting.answer import Answer, Load, Wait
from pa_ros.acting.learning_agent import LearningAgent
from pa_ros.acting.requests import ArenaFacts
from pa_ros.core.experience import AgentKey, Observation, PolicySnapshot
from pa_ros.core.published import LearnerInfo, PublishedPolicy
from pa_ros.language import Vocabulary
from pa_ros.learning.checkpoints import load_policy
from pa_ros.learning.protocols import protocol_named
from pa_ros.networks.parameters import initial_actor
from pa_ros.provenance.origins import origin
from pa_ros.ros import topics
from pa_ros.ros.executor import steady_timer
from pa_ros.ros.health import ERROR, OK, WARN, HealthReporter
from pa_ros.ros.parameters import settings_from_parameters
from pa_ros.ros.programs import judge
from pa_ros.ros.refusals import Refusals
from pa_ros.wire import codec
from pa_ros.wire.interfaces import Message
from pa_ros.wire.records import ArenaDescription, Command, ProgramRequest


class AgentNode(Node):
    """One agent. It speaks only when spoken to: one command per observation, and none without."""

    def __init__(self) -> None:
        super().__init__("agent_node", automatically_declare_parameters_from_overrides=True)
        self.config = settings_from_parameters(self, AgentConfig)
        self.agent_id = self.config.agent_id or f"{self.get_name()}-{uuid.uuid4().hex[:8]}"
        self.refusals = Refusals(self.get_logger().warning)
        self.agent = self._make_agent()
        self._matcher = StepMatcher(("features", "joints", *(["verdict"] * self.config.learning)))
        self._arena: ArenaDescription | None = None
        self._book: ProgramBook | None = None
        self._early: list[ProgramRequest] = []  # programs heard before the arena was known
        self._elsewhere = HeardByOthers()
        self._learner: LearnerInfo | None = None  # the newest announced
        self._unread: dict[str, Message] | None = None  # newest step whose program is not known yet
        self._observation: Observation | None = None  # the newest step taken in
        self._handled = -1  # stamp of the newest step taken in
        self._command: Command | None = None  # the newest sent
        self._commands = self._trajectories = 0
        self._core_s = 0.0  # spent in the policy itself
        self._reported = (0, 0.0)  # commands and core_s at the last report
        self._heard_at = self._progress_at = time.monotonic()
        self._make_publishers()
        self._make_subscriptions()
        HealthReporter(self, self.refusals, self._collect)
        source = self.config.checkpoint or self.config.weights
        doing = "explores and learns" if self.config.learning else "executes programs"
        self.get_logger().info(f"agent {self.agent_id}: {doing}, with weights from {source}")
        if self.config.learning:
            steady_timer(self, self.config.resend_period_s, self._send_again)

    def close(self) -> None:
        """Nothing to save."""

    def _make_agent(self) -> Agent:
        key = AgentKey(self.agent_id, time.time_ns())
        if self.config.learning:
            return LearningAgent(key, self.config.seed)
        agent = Agent(key)
        if self.config.weights == "checkpoint":
            agent.offer(_fixed(load_policy(Path(self.config.checkpoint))))
        return agent  # random weights need the arena's vocabulary first

    def _make_publishers(self) -> None:
        self._commands_out = topics.JOINT_COMMANDS.publisher(self)
        self._transitions_out = topics.TRAJECTORIES.publisher(self)
        self._status_out = topics.PROGRAM_STATUS.publisher(self)
        self._provenance = topics.PROVENANCE.publisher(self)
        parameters, name = self.config.flat(), self.get_fully_qualified_name()
        account = origin(name, self.agent_id, self.config.seed, parameters=parameters)
        self._provenance.publish(codec.encode_provenance(account))

    def _make_subscriptions(self) -> None:
        callbacks = [
            (topics.ARENA_INFO, self._on_arena),
            (topics.OBJECT_FEATURES, lambda m: self._on_part("features", m)),
            (topics.JOINT_STATES, lambda m: self._on_part("joints", m)),
            (topics.PROGRAM, lambda m: self._on_program(codec.decode_program(m))),
            (topics.PROGRAM_STATUS, self._on_judgement),
        ]
        if self.config.learning:
            callbacks.append((topics.VERDICT, lambda m: self._on_part("verdict", m)))
            callbacks.append((topics.LEARNER_INFO, self._on_learner))
        if self.config.weights == "topic":
            callbacks.append((topics.POLICY_WEIGHTS, self._on_policy))
        for topic, callback in callbacks:
            topic.subscribe(self, self.refusals.guard(topic.name, callback))

    # What the arena says

    def _on_arena(self, message: Message) -> None:
        arena = codec.decode_arena_info(message)
        vocabulary = vocabulary_of(arena)
        restarted = self._arena is not None and self._arena.arena_id != arena.arena_id
        if self._book is None or self._book.vocabulary != vocabulary:
            self._book = ProgramBook(vocabulary)
        self._arena = arena
        if restarted:
            self._matcher.restart()
            self._handled, self._command, self._unread = -1, None, None
        if self.config.weights == "random" and not self.agent.has_weights:
            self.agent.offer(_fixed(_random_policy(vocabulary, self.config)))
        early, self._early = self._early, []
        for request in early:
            self._on_program(request)
        self._follow()

    def _on_part(self, part: str, message: Message) -> None:
        if self._arena is None:
            return  # arena_info is on its way; the arena repeats a step that nobody answers
        self._heard_at = time.monotonic()
        step = self._matcher.add(part, codec.header_stamp(message), message)
        if step is not None:
            self._on_step(step)

    def _on_step(self, parts: dict[str, Message]) -> None:
        assert self._arena is not None and self._book is not None
        observation = codec.decode_observation(
            parts["features"], parts["joints"], self._arena.joint_names
        )
        if observation.stamp_ns == self._handled:
            self._answer_again()
            return
        program = self._book.program_of(observation.program_id)
        if program is None:
            self._unread = parts
            self._recall(observation.program_id)
            return
        self._unread = None
        verdict = codec.decode_verdict(parts["verdict"]) if "verdict" in parts else None
        step = Step(
            observation,
            program,
            verdict,
            codec.is_evaluation(parts["features"]),
            codec.commanded_by(parts["features"]),
            ends_episode=observation.step >= self._arena.episode_steps,
        )
        started = time.perf_counter()
        trajectory = self.agent.observe(step)
        self._core_s += time.perf_counter() - started
        self._handled = observation.stamp_ns
        self._observation = observation
        if trajectory is not None:
            self._trajectories += 1
            self._transitions_out.publish(codec.encode_trajectory(trajectory))
        self._act()

    def _act(self) -> None:
        observation = self._observation
        started = time.perf_counter()
        while isinstance(answer := self.agent.answer(), Load):
            self.agent.load(answer.policy)
        if isinstance(answer, Wait) or observation is None:
            return
        action = self.agent.act()
        self._core_s += time.perf_counter() - started
        self._command = Command(
            observation.episode,
            observation.step,
            observation.stamp_ns,
            self.agent_id,
            self.agent.version,
            action,
        )
        self._commands += 1
        self._progress_at = time.monotonic()
        self._commands_out.publish(codec.encode_command(self._command))

    def _answer_again(self) -> None:
        """The arena repeats a step that was answered: the answer was lost."""
        if self._command is not None and self._command.stamp_ns == self._handled:
            self._commands_out.publish(codec.encode_command(self._command))

    def _retry(self) -> None:
        """Something that a step waited for has come."""
        if self._unread is not None:
            self._on_step(self._unread)
        else:
            self._act()

    # What people and the learner say

    def _on_program(self, request: ProgramRequest) -> None:
        if self._book is None:
            self._early = [*self._early[-31:], request]
            return
        name, stamp_ns = self.get_fully_qualified_name(), max(self._handled, 0)
        judgement = judge(request, name, stamp_ns, self._book.accept, self.refusals)
        self._status_out.publish(codec.encode_program_status(judgement))
        if judgement.accepted:
            self._retry()

    def _on_judgement(self, message: Message) -> None:
        judgement = codec.decode_program_status(message)
        if judgement.node == self.get_fully_qualified_name():
            return
        self._elsewhere.note(judgement)
        if self._unread is not None:
            self._retry()

    def _recall(self, program_id: str) -> None:
        """A program whose sender has gone: what the arena called it when it accepted it."""
        request = self._elsewhere.take(program_id)
        if request is not None:
            self._on_program(request)

    def _on_learner(self, message: Message) -> None:
        self._learner = codec.decode_learner_info(message)
        self._follow()

    def _follow(self) -> None:
        """Act for the learner in this arena, once both have announced themselves."""
        arena, learner = self._arena, self._learner
        if isinstance(self.agent, LearningAgent) and arena is not None and learner is not None:
            facts = arena.vocabulary_digest, arena.control_period, arena.near_threshold
            self.agent.follow(learner, ArenaFacts(*facts))
            self._retry()

    def _on_policy(self, message: Message) -> None:
        digest = self._book.vocabulary.digest if self._book else None
        self.agent.offer(codec.decode_weights(message, digest))
        self._retry()

    def _send_again(self) -> None:
        """Trajectories that the awaited weights should have taken in: perhaps none heard them."""
        late = time.monotonic() - self._progress_at > self.config.resend_period_s
        if isinstance(self.agent, LearningAgent) and self.agent.waiting and late:
            for trajectory in self.agent.unaccounted:
                self._transitions_out.publish(codec.encode_trajectory(trajectory))

    # Health

    def _collect(self) -> tuple[int, str, dict[str, str]]:
        now, (commands, core_s) = time.monotonic(), self._reported
        self._reported = (self._commands, self._core_s)
        core_us = (self._core_s - core_s) * 1e6 / max(self._commands - commands, 1)
        values = {
            "agent_id": self.agent_id,
            "policy_version": str(self.agent.version) if self.agent.has_weights else "none",
            "commands": str(self._commands),
            "core_us": f"{core_us:.1f}",
            "trajectories": str(self._trajectories),
            "observation_age_s": f"{now - self._heard_at:.2f}",
        }
        if isinstance(self.agent, LearningAgent):
            values["interrupted"] = str(self.agent.interrupted)
            values["lost_trajectories"] = str(self.agent.lost)
        return *self._state(now), values

    def _state(self, now: float) -> tuple[int, str]:
        """Level and message: what the agent is doing, or waits for."""
        agent, answer = self.agent, self.agent.answer()
        if isinstance(agent, LearningAgent) and agent.refusal:
            return ERROR, f"does not act for the learner: {agent.refusal}"
        if self._arena is None:
            return WARN, f"waits for an arena ({topics.ARENA_INFO.name})"
        if not agent.has_weights:
            return WARN, f"no weights yet{_reason(answer)}"
        stuck = now - self._progress_at > self.config.stuck_after_s
        if isinstance(agent, LearningAgent) and agent.waiting and stuck:
            return ERROR, f"policy version stuck at {agent.version}{_reason(answer)}"
        if now - self._heard_at > 1.0:
            return WARN, f"waits for observations ({topics.OBJECT_FEATURES.name})"
        return OK, "acting"


def _reason(answer: Answer) -> str:
    return f": waits for {answer.reason}" if isinstance(answer, Wait) else ""


def _fixed(snapshot: PolicySnapshot) -> PublishedPolicy:
    """Weights that no learner published here."""
    return PublishedPolicy(snapshot, "")


def _random_policy(vocabulary: Vocabulary, config: AgentConfig) -> PolicySnapshot:
    network = protocol_named("ours").network_config(vocabulary, config.network)
    tensors = initial_actor(network, np.random.default_rng(config.seed))
    return PolicySnapshot(0, network.architecture, vocabulary.digest, tensors)
