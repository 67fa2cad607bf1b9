"""The agent as a ROS node: each callback decodes, makes one core call, encodes, publishes."""

from __future__ import annotations

import time
import uuid
from pathlib import Path

from rclpy.node import Node

from agent_node.components import Components
from agent_node.config import AgentConfig
from agent_node.programs import ProgramBook
from agent_node.steps import StepMatcher
from agent_node.watch import Watch
from agent_node.weights import fixed, random_policy
from pa_ros.acting.agent import Agent, Step
from pa_ros.acting.answer import Load, Wait
from pa_ros.acting.learning_agent import LearningAgent
from pa_ros.acting.requests import ArenaFacts
from pa_ros.core.experience import AgentKey, Observation
from pa_ros.language import Program, logic_named
from pa_ros.learning.checkpoints import load_policy
from pa_ros.networks.slots import UnsupportedProgramError
from pa_ros.provenance.origins import origin
from pa_ros.ros import topics
from pa_ros.ros.arenas import Arenas
from pa_ros.ros.authority import Authority
from pa_ros.ros.executor import steady_timer
from pa_ros.ros.health import HealthReporter
from pa_ros.ros.learners import LEARNER_ID, Learners
from pa_ros.ros.parameters import settings_from_parameters
from pa_ros.ros.programs import Pace, judge
from pa_ros.ros.refusals import Refusals
from pa_ros.wire import codec
from pa_ros.wire.interfaces import JointCommand, Message
from pa_ros.wire.records import ArenaDescription, Command, Health, ProgramRequest


class AgentNode(Node):
    """One agent. It speaks only when spoken to: one command per observation, and none without."""

    def __init__(self) -> None:
        super().__init__("agent_node", automatically_declare_parameters_from_overrides=True)
        self.config = settings_from_parameters(self, AgentConfig)
        self.agent_id = self.config.agent_id or f"{self.get_name()}-{uuid.uuid4().hex[:8]}"
        self.refusals = Refusals(self.get_logger().warning)
        self._authority = Authority(self, self.config)
        self.agent = self._make_agent()
        self._matcher = StepMatcher(("features", "joints", *(["verdict"] * self.config.learning)))
        self._arenas = Arenas()
        self._book: ProgramBook | None = None
        self._early: list[ProgramRequest] = []  # programs heard before the arena was known
        self._learners, self._followed = Learners(), ""
        self._pace = Pace()
        self._watch = Watch(self.config.stuck_after_s)
        self.seen: tuple[Observation, Program] | None = None  # the newest step taken in
        self._handled = -1  # stamp of the newest step taken in
        self._command: Command | None = None  # the newest sent
        self._message = JointCommand()  # filled anew for each
        self._commands = self._trajectories = 0
        self._core_s = 0.0  # spent in the policy itself
        self._reported = (0, 0.0)  # commands and core_s at the last report
        self._make_publishers()
        self._make_subscriptions()
        self._components = Components(self, self)
        alone = topics.JOINT_COMMANDS, f"{self.agent_id}/{self.agent.key.incarnation}"
        HealthReporter(self, self.refusals, self._collect, alone, hear=self._on_health)
        source = self.config.checkpoint or self.config.weights
        doing = "explores and learns" if self.config.learning else "executes programs"
        self.get_logger().info(f"agent {self.agent_id}: {doing}, with weights from {source}")
        if self.config.learning:
            steady_timer(self, self.config.resend_period_s, self._send_again)

    def close(self) -> None:
        """There is nothing to save."""
        self._components.close()

    def _make_agent(self) -> Agent:
        key = AgentKey(self.agent_id, time.time_ns())
        if self.config.learning:
            return LearningAgent(key, self.config.seed)
        agent = Agent(key, logic_named(self.config.logic))
        if self.config.weights == "checkpoint":
            agent.offer(fixed(load_policy(Path(self.config.checkpoint))))
        return agent  # random weights need the arena's vocabulary first

    def _make_publishers(self) -> None:
        self._commands_out = self._authority.publisher(topics.JOINT_COMMANDS)
        trajectories = topics.TRAJECTORIES.within(self.config.learner)
        self._transitions_out = self._authority.publisher(trajectories)
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
        ]
        if self.config.learning:
            callbacks.append((topics.VERDICT, lambda m: self._on_part("verdict", m)))
        if self.config.weights == "topic":
            of_learner = self.config.learner
            callbacks.append((topics.LEARNER_INFO.within(of_learner), self._on_learner))
            callbacks.append((topics.POLICY_WEIGHTS.within(of_learner), self._on_policy))
        for topic, callback in callbacks:
            checked = self._authority.checked(topic, callback)
            topic.subscribe(self, self.refusals.guard(topic.name, checked))

    # What the arena says

    def _on_arena(self, message: Message) -> None:
        arena = codec.decode_arena_info(message)
        before = self._arenas.current
        if self._arenas.announce(arena):
            self._belong(before)

    def _belong(self, before: ArenaDescription | None) -> None:
        """Another arena counts than before, or the same describes itself anew."""
        arena = self._arenas.current
        assert arena is not None
        vocabulary = arena.world.vocabulary
        if self._book is None or self._book.vocabulary != vocabulary:
            self._book = ProgramBook(vocabulary, self.agent.check_program)
        if before is None or before.arena_id != arena.arena_id:
            self._matcher.restart()
            self._handled, self._command = -1, None
            self.get_logger().info(f"arena {arena.arena_id}: design {arena.design}, {arena.preset}")
        if self.config.weights == "random" and not self.agent.has_weights:
            self.agent.offer(fixed(random_policy(arena.world, self.config)))
        early, self._early = self._early, []
        for request in early:
            self._on_program(request)
        self._follow()

    def _on_part(self, part: str, message: Message) -> None:
        before = self._arenas.current
        if self._arenas.step(codec.arena_of(message)):
            self._belong(before)
        if before is None:
            return  # arena_info is on its way; the arena repeats a step that nobody answers
        self._watch.heard()
        step = self._matcher.add(part, codec.header_stamp(message), message)
        if step is not None:
            self._on_step(step)

    def _on_step(self, parts: dict[str, Message]) -> None:
        arena, book = self._arenas.current, self._book
        assert arena is not None and book is not None
        observation = codec.decode_observation(
            parts["features"], parts["joints"], arena.joint_names, arena.world.object_features
        )
        if observation.stamp_ns == self._handled:
            self._answer_again()
            return
        context = codec.decode_context(parts["features"], len(arena.joint_names))
        self._watch.idle = not context.program
        self._watch.executed(context.executed, self.agent.key)
        if not context.program:
            return  # nothing is to be done yet
        program = self._in_force(book, observation.program_id, context.program)
        verdict = codec.decode_verdict(parts["verdict"]) if "verdict" in parts else None
        step = Step(
            observation,
            program,
            verdict,
            context.evaluation,
            context.executed,
            ends_episode=observation.step >= arena.episode_steps,
        )
        started = time.perf_counter()
        trajectory = self.agent.observe(step)
        self._core_s += time.perf_counter() - started
        self._handled = observation.stamp_ns
        self.seen = observation, program
        if trajectory is not None:
            self._trajectories += 1
            self._transitions_out.publish(codec.encode_trajectory(trajectory))
        self._act()

    def _in_force(self, book: ProgramBook, program_id: str, text: str) -> Program:
        """The program that the arena says is in force; judged if it wasn't heard of before."""
        if book.stands_for(program_id) != text:
            book.note(program_id, text)
            self._judge(book, ProgramRequest(program_id, text))
        return book.program(text)

    def _act(self) -> None:
        started = time.perf_counter()
        while isinstance(answer := self.agent.answer(), Load):
            self.agent.load(answer.policy)
        if isinstance(answer, Wait) or self.seen is None:
            return
        observation = self.seen[0]
        self._choose(observation.program_id)
        self._core_s += time.perf_counter() - started
        sent = self.agent.sent
        assert sent is not None
        answered = observation.episode, observation.step, observation.stamp_ns
        made = self.agent_id, self.agent.version, sent.action
        self._command = Command(*answered, *made, sent.command.incarnation, sent.command.number)
        self._commands += 1
        self._watch.progress()
        self._commands_out.publish(codec.encode_command(self._command, self._message))
        if self._components.adapter is not None:
            self._components.adapter.send(sent.action, self.seen[0])

    def _choose(self, program_id: str) -> None:
        """Decide on the next command: to hold still, if the program was given up as a goal, or
        can't be acted on."""
        if self._components.gave_up(program_id):
            self.agent.hold()
            return
        try:
            self.agent.act()
        except UnsupportedProgramError as error:
            self.refusals.refuse("program", error)
            self._watch.held(str(error))
            self.agent.hold()

    def _answer_again(self) -> None:
        """The arena repeats a step that was answered: the answer was lost."""
        if self._command is not None and self._command.stamp_ns == self._handled:
            self._commands_out.publish(codec.encode_command(self._command))

    # What people and the learner say

    def _on_program(self, request: ProgramRequest) -> None:
        arena, book = self._arenas.current, self._book
        if arena is None or book is None:
            self._early = [*self._early[-31:], request]
        elif not request.program_id.startswith(f"{arena.arena_id}/"):  # its own come with steps
            self._pace.check()
            self._judge(book, request)

    def _judge(self, book: ProgramBook, request: ProgramRequest) -> None:
        name, stamp_ns = self.get_fully_qualified_name(), max(self._handled, 0)
        judgement = judge(request, name, stamp_ns, book.accept, self.refusals)
        self._status_out.publish(codec.encode_program_status(judgement))

    @property
    def arena(self) -> ArenaDescription | None:
        """The one that counts now."""
        return self._arenas.current

    def _on_learner(self, message: Message) -> None:
        if self._learners.announce(codec.decode_learner_info(message)):
            self._follow()

    def _on_health(self, health: Health) -> None:
        if self._learners.heard(health.values.get(LEARNER_ID, "")):
            self._follow()

    def _follow(self) -> None:
        """Act for the learner in this arena, once both have announced themselves."""
        arena, learner = self._arenas.current, self._learners.current
        if arena is not None and learner is not None:
            facts = arena.world.digest, arena.control_period, arena.thresholds, arena.reward
            self.agent.follow(learner, ArenaFacts(*facts))
            if learner.learner_id != self._followed:
                self._followed, run = learner.learner_id, learner.run_id
                by = self.agent.backend or "its weights"
                self.get_logger().info(f"follows learner {self._followed}, run {run}; acts by {by}")
            self._act()

    def _on_policy(self, message: Message) -> None:
        arena = self._arenas.current
        digest = arena.world.digest if arena is not None else None
        policy = codec.decode_weights(message, digest)
        if self._learners.weights(policy.learner_id):
            self._follow()
        self.agent.offer(policy)
        self._act()

    def _send_again(self) -> None:
        """What the awaited weights should have taken in: perhaps none heard it."""
        late = self._watch.idle_s > self.config.resend_period_s
        if isinstance(self.agent, LearningAgent):
            for trajectory in self.agent.overdue(late):
                self._transitions_out.publish(codec.encode_trajectory(trajectory))

    # Health

    def _collect(self) -> tuple[int, str, dict[str, str]]:
        commands, core_s = self._reported
        self._reported = (self._commands, self._core_s)
        core_us = (self._core_s - core_s) * 1e6 / max(self._commands - commands, 1)
        values = {
            "agent_id": self.agent_id,
            "policy_version": str(self.agent.version) if self.agent.has_weights else "none",
            "commands": str(self._commands),
            "core_us": f"{core_us:.1f}",
            "trajectories": str(self._trajectories),
            "observation_age_s": f"{self._watch.observation_age_s:.2f}",
        }
        if isinstance(self.agent, LearningAgent):
            values["interrupted"] = str(self.agent.interrupted)
            values["lost_trajectories"] = str(self.agent.lost)
        return *self._watch.state(self.agent, self._arenas, self._learners), values
