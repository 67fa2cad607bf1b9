"""What an agent does about a control step, without ROS: act greedily, or learn."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from agent_node.shelf import UNPUBLISHED, PolicyShelf, ShelfSchedule
from pa_ros.acting.actor import Actor
from pa_ros.acting.agent import LearningAgent
from pa_ros.acting.config import ActingConfig
from pa_ros.acting.exploration import ExplorationNoise
from pa_ros.acting.trajectories import TrajectoryBuilder
from pa_ros.core.experience import Float32, Observation, PolicySnapshot, Trajectory, Verdict
from pa_ros.networks.config import NetworkConfig, actor_config
from pa_ros.wire.records import PublishedPolicy


@dataclass(frozen=True, slots=True)
class Step:
    """One control step as it came from the wire."""

    observation: Observation
    program: str  # canonical text of the observation's program id
    evaluation: bool
    commanded_by: str
    verdict: Verdict | None  # None: not waited for
    ends_episode: bool  # nothing is to be done about it any more


class Outgoing(NamedTuple):
    """A trajectory to be sent, and the simulation time of its first row."""

    trajectory: Trajectory
    stamp_ns: int


class Driver(Protocol):
    """What the node asks of either kind of agent."""

    @property
    def ready(self) -> bool:
        """Whether it can take in steps: weights have come."""

    @property
    def version(self) -> int:
        """Of the weights in use; -1: none yet."""

    def offer(self, policy: PublishedPolicy) -> None:
        """Weights have come. Raises PolicyError or ConfigError if they cannot be used."""

    def observe(self, step: Step) -> Outgoing | None:
        """Take in a step; the trajectory that it completed, if it did."""

    def act(self) -> Float32 | None:
        """The action at the step observed last, [6]; None if it must wait, or has none."""


class GreedyDriver:
    """Acts with the newest weights on every step."""

    def __init__(self, snapshot: PolicySnapshot | None = None) -> None:
        self._actor = Actor.of(snapshot) if snapshot is not None else None
        self._step: Step | None = None

    @property
    def ready(self) -> bool:
        return self._actor is not None

    @property
    def version(self) -> int:
        return -1 if self._actor is None else self._actor.version

    def offer(self, policy: PublishedPolicy) -> None:
        if self._actor is None:
            self._actor = Actor.of(policy.snapshot)
        else:
            self._actor.load(policy.snapshot)

    def observe(self, step: Step) -> Outgoing | None:
        self._step = None if step.ends_episode else step
        return None

    def act(self) -> Float32 | None:
        step, actor = self._step, self._actor
        if step is None or actor is None:
            return None
        self._step = None
        return actor.act(step.observation, step.program)


class LearningDriver:
    """Explores under the synchronous protocol; greedy, and silent, in evaluation episodes."""

    def __init__(
        self, agent_id: str, config: ActingConfig, seed: int, first_sequence: int = 0
    ) -> None:
        self.agent_id = agent_id
        self._first_sequence = first_sequence
        self.shelf = PolicyShelf(agent_id)
        self.interrupted = 0  # runs broken off because the arm did not do as commanded
        self._config, self._seed = config, seed
        self._schedule = ShelfSchedule(config.schedule.policy_lag, self.shelf)
        self._network: NetworkConfig | None = None  # of the first weights
        self._control_period_s: float | None = None
        self._agent: LearningAgent | None = None  # once both are known
        self._step: Step | None = None
        self._stamps: dict[tuple[int, int], int] = {}  # by episode and step, of the run so far
        self._sent: deque[Outgoing] = deque(maxlen=config.schedule.versions_kept)

    @property
    def ready(self) -> bool:
        return self._agent is not None

    @property
    def version(self) -> int:
        return -1 if self._agent is None else self._agent.actor.version

    @property
    def waiting(self) -> bool:
        """Whether a step waits for weights."""
        return self._step is not None

    def offer(self, policy: PublishedPolicy) -> None:
        if self._network is None:
            self._network = actor_config(policy.snapshot.architecture)
            self._begin()
        sent = self._agent.builder.sequence if self._agent else self._first_sequence
        self.shelf.add(policy, sent)

    def meet(self, control_period_s: float) -> None:
        """The arena has described itself; until then the agent is not ready."""
        self._control_period_s = control_period_s
        self._begin()

    def observe(self, step: Step) -> Outgoing | None:
        agent, verdict = self._agent, step.verdict
        if verdict is None or agent is None:
            raise AssertionError("a learning agent observes verdicts, and only once it has weights")
        self._step = None if step.ends_episode or verdict.truncated else step
        if step.evaluation:
            return None
        goes_on = step.observation.step > 0 and not agent.builder.at_boundary
        if goes_on and step.commanded_by != self.agent_id:
            self.interrupted += 1
            self._stamps = {}
            agent.builder = self._make_builder(agent.actor.network, agent.builder.sequence)
        observation = step.observation
        self._stamps[observation.episode, observation.step] = observation.stamp_ns
        trajectory = agent.observe(observation, verdict, step.program)
        return None if trajectory is None else self._outgoing(trajectory, observation)

    def act(self) -> Float32 | None:
        step, agent = self._step, self._agent
        if step is None or agent is None or not self._load(agent):
            return None
        self._step = None
        if step.evaluation:
            return agent.actor.act(step.observation, step.program)
        return agent.act()

    def unaccounted(self) -> list[Outgoing]:
        """Trajectories sent that the newest policy does not account for."""
        newest = self.shelf.newest
        done = 0 if newest is None else self.shelf.accounted(newest)
        return [outgoing for outgoing in self._sent if outgoing.trajectory.sequence >= done]

    def _outgoing(self, trajectory: Trajectory, observation: Observation) -> Outgoing:
        outgoing = Outgoing(trajectory, self._stamps[trajectory.episode, trajectory.first_step])
        self._stamps = {(observation.episode, observation.step): observation.stamp_ns}
        self._sent.append(outgoing)
        return outgoing

    def _load(self, agent: LearningAgent) -> bool:
        """Load what the protocol requires now; whether it is there."""
        required = agent.required_version
        if required == UNPUBLISHED:
            return False
        if required is not None:
            found = self.shelf.for_trajectory(agent.builder.sequence, self._schedule.policy_lag)
            if found is None or found.snapshot.version != required:
                return False
            agent.load(found.snapshot)
        return True

    def _begin(self) -> None:
        config, period_s = self._config, self._control_period_s
        if self._agent is not None or self._network is None or period_s is None:
            return
        noise = ExplorationNoise(config.exploration, period_s, self._seed)
        actor = Actor(self._network, config.inference, noise)
        builder = self._make_builder(self._network, self._first_sequence)
        self._agent = LearningAgent(actor, builder, self._schedule)

    def _make_builder(self, network: NetworkConfig, sequence: int) -> TrajectoryBuilder:
        digest = network.vocabulary.digest
        steps = self._config.schedule.trajectory_steps
        return TrajectoryBuilder(self.agent_id, steps, digest, sequence)
