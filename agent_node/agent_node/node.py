"""The agent as a ROS node: each callback decodes, makes one core call, encodes, publishes."""

from __future__ import annotations

import time
import uuid
from collections.abc import Callable
from functools import partial

from agent_node.components import Components
from agent_node.config import AgentConfig
from agent_node.programs import Programs
from agent_node.steps import StepMatcher
from agent_node.watch import Watch
from agent_node.weights import agent_of, fixed, random_policy
from pa_ros.acting.agent import ArenaFacts, Step
from pa_ros.acting.learning_agent import LearningAgent
from pa_ros.core.errors import PaError
from pa_ros.core.experience import AgentKey, Observation
from pa_ros.language import Program, ProgramError
from pa_ros.networks.errors import NetworkError
from pa_ros.provenance.origins import origin
from pa_ros.ros import topics
from pa_ros.ros.arenas import Arenas
from pa_ros.ros.authority import Authority
from pa_ros.ros.executor import steady_timer
from pa_ros.ros.learners import LEARNER_ID, Learners
from pa_ros.ros.lifecycle import ManagedNode
from pa_ros.ros.listening import listening_clock
from pa_ros.wire import Message
from pa_ros.wire.arena import ArenaDescription, decode_arena_info
from pa_ros.wire.diagnostics import Health, encode_provenance
from pa_ros.wire.fields import header_stamp
from pa_ros.wire.learning import decode_learner_info, decode_weights, encode_trajectory
from pa_ros.wire.program import decode_program
from pa_ros.wire.step import (
    Command,
    StepMessages,
    arena_of,
    decode_context,
    decode_observation,
    decode_verdict,
    encode_command,
)

PARTS = {  # of a step
    "features": topics.OBJECT_FEATURES,
    "joints": topics.JOINT_STATES,
    "verdict": topics.VERDICT,  # who executes needs none
}


class AgentNode(ManagedNode):
    """One agent. It speaks only when spoken to: one command per observation, and none without.

    Inactive it goes on hearing who is there, and what weights account for, but takes in no step.
    """

    config: AgentConfig

    def __init__(self) -> None:
        super().__init__("agent_node", AgentConfig)

    def configure(self) -> None:
        self.agent_id = self.config.agent_id or f"{self.get_name()}-{uuid.uuid4().hex[:8]}"
        self._authority = Authority(self, self.config)
        self.agent = agent_of(self.config, AgentKey(self.agent_id, time.time_ns()))
        self._parts = [part for part in PARTS if part != "verdict" or self.config.learning]
        self._matcher = StepMatcher(self._parts)
        clock = listening_clock(self)
        self._arenas = Arenas(clock)
        self._learners, self._followed = Learners(clock), ""
        self._watch = Watch(self.config.stuck_after_s)
        self.seen: tuple[Observation, Program] | None = None  # the newest step taken in
        self._handled = -1  # stamp of the newest step taken in
        self._command: Command | None = None  # the newest sent
        self._sent = StepMessages()  # filled again for each command
        self._commands = self._trajectories = 0
        self._core_s = 0.0  # spent in the policy itself
        self._reported = (0, 0.0)  # commands and core_s at the last report
        self._programs = Programs(self, self, lambda: self._handled)
        self._make_publishers()
        self._make_subscriptions()
        self._components = Components(self, self)
        source = self.config.checkpoint or self.config.weights
        doing = "explores and learns" if self.config.learning else "executes programs"
        self.get_logger().info(f"agent {self.agent_id}: {doing}, with weights from {source}")
        if self.config.learning:
            steady_timer(self, self.config.resend_period_s, self._send_again)

    def activate(self) -> None:
        """A step that waits may be acted on by now; one that was missed, the arena repeats."""
        self._watch.heard()
        self._watch.progress()
        self._watch.took_in()
        self._act()

    def deactivate(self) -> None:
        self._components.rest()

    def cleanup(self) -> None:
        self._components.close()

    def alone(self) -> tuple[topics.Topic, str]:
        return topics.JOINT_COMMANDS, f"{self.agent_id}/{self.agent.key.incarnation}"

    def _make_publishers(self) -> None:
        self._commands_out = self._authority.publisher(topics.JOINT_COMMANDS)
        trajectories = topics.TRAJECTORIES.within(self.config.learner)
        self._transitions_out = self._authority.publisher(trajectories)
        self._provenance = topics.PROVENANCE.publisher(self)
        parameters, name = self.config.flat(), self.get_fully_qualified_name()
        account = origin(name, self.agent_id, self.config.seed, parameters=parameters)
        self._provenance.publish(encode_provenance(account))

    def _make_subscriptions(self) -> None:
        callbacks: list[tuple[topics.Topic, Callable[[Message], None]]] = [
            (topics.ARENA_INFO, self._on_arena),
            (topics.PROGRAM, self._on_program),
            *((PARTS[part], partial(self._on_part, part)) for part in self._parts),
        ]
        if self.config.weights == "topic":
            of_learner = self.config.learner
            callbacks.append((topics.LEARNER_INFO.within(of_learner), self._on_learner))
            callbacks.append((topics.POLICY_WEIGHTS.within(of_learner), self._on_policy))
        for topic, callback in callbacks:
            checked = self._authority.checked(topic, callback)
            topic.subscribe(self, self.refusals.guard(topic.name, checked))

    # What the arena says

    def _on_arena(self, message: Message) -> None:
        arena = decode_arena_info(message)
        before = self._arenas.current
        if self._arenas.announce(arena):
            self._belong(before)

    def _belong(self, before: ArenaDescription | None) -> None:
        """Another arena counts than before, or the same describes itself anew."""
        arena = self._arenas.current
        assert arena is not None
        if before is None or before.arena_id != arena.arena_id:
            self._matcher.restart()
            self._handled, self._command, self.seen = -1, None, None
            self.get_logger().info(f"arena {arena.arena_id}: design {arena.design}, {arena.preset}")
        if self.config.weights == "random" and not self.agent.has_weights:
            self.agent.offer(fixed(random_policy(arena.world, self.config)))
        self._programs.belong(arena)
        self._follow()

    def _on_part(self, part: str, message: Message) -> None:
        if not self.active:
            return
        before = self._arenas.current
        if self._arenas.step(arena_of(message)):
            self._belong(before)
        if before is None:
            return  # arena_info is on its way; the arena repeats a step that nobody answers
        self._watch.heard()
        try:
            step = self._matcher.add(part, header_stamp(message), message)
            if step is not None:
                self._on_step(step)
                self._watch.took_in()
        except PaError as error:
            self._watch.refused(str(error))
            raise

    def _on_step(self, parts: dict[str, Message]) -> None:
        arena = self._arenas.current
        assert arena is not None
        observation = decode_observation(
            parts["features"], parts["joints"], arena.joint_names, arena.world.object_features
        )
        if observation.stamp_ns == self._handled:
            self._answer_again()
            return
        context = decode_context(parts["features"], len(arena.joint_names))
        self._watch.idle = not context.program
        self._watch.executed(context.executed, self.agent.key)
        if not context.program:
            return  # nothing is to be done yet
        program = self._programs.in_force(observation.program_id, context.program)
        verdict = decode_verdict(parts["verdict"]) if "verdict" in parts else None
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
            self._transitions_out.publish(encode_trajectory(trajectory))
        self._act()

    def _act(self) -> None:
        """Answer the step that stands, if there is one and its weights are there."""
        if not self.active:
            return
        started = time.perf_counter()
        if self.agent.prepare() is not None or self.seen is None:
            return
        observation = self.seen[0]
        self._choose(observation.program_id)
        self._core_s += time.perf_counter() - started
        sent = self.agent.last_command
        assert sent is not None
        answered = observation.episode, observation.step, observation.stamp_ns
        made = self.agent_id, self.agent.version, sent.action
        self._command = Command(*answered, *made, sent.command.incarnation, sent.command.number)
        self._commands += 1
        self._watch.progress()
        self._commands_out.publish(encode_command(self._command, self._sent.command))
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
        except (NetworkError, ProgramError) as error:
            self.refusals.refuse("program", error)
            self._watch.held(str(error))
            self.agent.hold()

    def _answer_again(self) -> None:
        """The arena repeats a step: the answer was lost, or there was none."""
        if self._command is not None and self._command.stamp_ns == self._handled:
            self._commands_out.publish(encode_command(self._command))
        else:
            self._act()

    # What people and the learner say

    def _on_program(self, message: Message) -> None:
        if self.active:  # else the step that is under it will say so
            self._programs.hear(decode_program(message))

    @property
    def arena(self) -> ArenaDescription | None:
        """The one that counts now."""
        return self._arenas.current

    def _on_learner(self, message: Message) -> None:
        if self._learners.announce(decode_learner_info(message)):
            self._follow()

    def hear(self, health: Health) -> None:
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
        policy = decode_weights(message, digest)
        if self._learners.weights(policy.learner_id):
            self._follow()
        self.agent.offer(policy)
        self._act()

    def _send_again(self) -> None:
        """What the awaited weights should have taken in: perhaps none heard it."""
        late = self._watch.idle_s > self.config.resend_period_s
        if self.active and isinstance(self.agent, LearningAgent):
            for trajectory in self.agent.overdue(late):
                self._transitions_out.publish(encode_trajectory(trajectory))

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
            "observation_age_s": f"{self._watch.observation_age_s:.2f}",
        }
        if isinstance(self.agent, LearningAgent):
            values["interrupted"] = str(self.agent.interrupted)
            values["lost_trajectories"] = str(self.agent.lost)
        lacking = [PARTS[part].name for part in self._matcher.lacking]
        return *self._watch.state(self.agent, self._arenas, self._learners, lacking), values
