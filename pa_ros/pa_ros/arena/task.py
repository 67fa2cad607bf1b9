"""The reaching task: episodes, programs, time limit and reward on top of the simulation."""

from __future__ import annotations

from dataclasses import replace

from pa_ros.arena.appearance import check_looks
from pa_ros.arena.conditions import condition_named
from pa_ros.arena.config import ArenaConfig
from pa_ros.arena.designs import Design
from pa_ros.arena.episodes import Episode, generate
from pa_ros.arena.errors import EpisodeError
from pa_ros.arena.features import HAND_INDEX
from pa_ros.arena.simulation import Simulation
from pa_ros.arena.verifier import Verifier
from pa_ros.core.experience import Float64, Observation, Verdict
from pa_ros.language import Program
from pa_ros.world import Reward, Scoring
from pa_ros.world.world import World


def world_of(config: ArenaConfig, design: Design) -> World:
    """The world that an arm and a design make."""
    return World(design.schema, design.vocabulary, joints=config.joints)


def scoring_of(config: ArenaConfig, design: Design, reward: Reward | None = None) -> Scoring:
    """The rule of an arena's rewards; the paper's ±1 unless another reward is given."""
    return Scoring.of(design.vocabulary.relations, config.thresholds, reward)


class ReachTask:
    """Reach for what the program names (paper, section "Programmable reaching environment").

    An episode has `config.episode_steps` actions; then `Verdict.truncated` is set and the next
    call must be a reset. Nothing ever terminates. Stamps grow by one control period with each
    observation, resets included, from one control period at the first reset.
    """

    def __init__(
        self,
        config: ArenaConfig,
        design: Design,
        seed: int,
        n_blocks: int | None = None,
        reward: Reward | None = None,
    ) -> None:
        """`seed` and an episode's index fix it; `n_blocks` replaces the design's number, `reward`
        the paper's ±1. ConfigError for a value that looks like nothing (`arena.appearance`)."""
        check_looks(design.values)
        check_looks({group: [value] for group, value in design.novel.items()})
        self.config = config
        self.scoring = scoring_of(config, design, reward)
        self.design = design if n_blocks is None else replace(design, n_blocks=n_blocks)
        self.seed = seed
        self.simulation = Simulation(config, self.design.schema)
        self._episode: Episode | None = None
        self._stamp_ns, self._period_ns = 0, config.control_period_ns
        self._step = 0

    @property
    def world(self) -> World:
        """What agents and learners of this task have to agree on."""
        return world_of(self.config, self.design)

    @property
    def control_period_s(self) -> float:
        """Simulation time of one control step."""
        return self.config.control_period_s

    def reset(self, episode_index: int, condition: str = "train") -> tuple[Observation, Verdict]:
        """Start episode `episode_index` of a condition. ConfigError if the condition is unknown."""
        drawn_from = condition_named(condition, self.design)
        return self.reset_to(
            generate(self.config, self.design, drawn_from, self.seed, episode_index)
        )

    def reset_to(self, episode: Episode) -> tuple[Observation, Verdict]:
        """Start a given episode, its program included."""
        verifier = self._verifier(episode, episode.program)
        self.simulation.place(episode)
        self._episode, self.verifier = episode, verifier
        self._step, self._programs = 0, 0
        self.program_id = f"{episode.index}.0"
        self._stamp_ns += self._period_ns
        return self._observe()

    def set_program(
        self, program: Program, program_id: str | None = None
    ) -> tuple[Observation, Verdict]:
        """Score by another program from now on; returns the present step under it.

        Raises ProgramError if it names no block that is present; then nothing changes. The id
        defaults to one that this episode has not used.
        """
        episode = self.episode
        self.verifier = self._verifier(episode, program)
        self._programs += 1
        self.program_id = program_id or f"{episode.index}.{self._programs}"
        return self._observe()

    def rearranged(self, episode: Episode, poses: Float64, twists: Float64) -> None:
        """Go on with other blocks in other places, as `Simulation.rearrange` has it; the program,
        the step and the time stay as they are. It may name nothing now."""
        self.simulation.rearrange(episode, poses, twists)
        kinds = [block.kind for block in episode.blocks]
        self._episode = episode
        self.verifier = Verifier(self.program, kinds, self.scoring, may_name_nothing=True)

    @property
    def program(self) -> Program:
        """The program that the verifier scores by now."""
        return self.verifier.program

    def step(self, joint_velocity: Float64) -> tuple[Observation, Verdict]:
        """Act for one control period with joint velocities in rad/s [J], clamped to the limits.

        Raises CommandError for a command that is mis-sized or not finite, EpisodeError before
        the first reset and after the time limit; either way nothing moves.
        """
        if self.episode and self._step >= self.config.episode_steps:
            raise EpisodeError(f"the episode was truncated at step {self._step}: expected a reset")
        observation = self.advance(self.simulation.checked(joint_velocity))
        return observation, self.judge(observation)

    def advance(self, joint_velocity: Float64) -> Observation:
        """Act with joint velocities that are known to be finite and within the limits.

        The verdict isn't computed: call `judge` before anything else happens in the arena.
        """
        self.simulation.advance(joint_velocity)
        self._step += 1
        self._stamp_ns += self._period_ns
        return self._observation()

    def judge(self, observation: Observation) -> Verdict:
        """What the verifier says of the present step, under the program in force."""
        score = self.verifier.score(observation.objects, observation.hand_pose)
        return Verdict(
            episode=observation.episode,
            step=observation.step,
            stamp_ns=observation.stamp_ns,
            program_id=observation.program_id,
            reward=float(score.reward),
            satisfied=bool(score.satisfied),
            distance=float(score.measure),
            truncated=observation.step >= self.config.episode_steps,
        )

    def _verifier(self, episode: Episode, program: Program) -> Verifier:
        kinds = [block.kind for block in episode.blocks]
        return Verifier(program, kinds, self.scoring)

    @property
    def episode(self) -> Episode:
        """The episode on the table; EpisodeError before the first reset."""
        if self._episode is None:
            raise EpisodeError("expected a reset before the first step")
        return self._episode

    def _observe(self) -> tuple[Observation, Verdict]:
        observation = self._observation()
        return observation, self.judge(observation)

    def _observation(self) -> Observation:
        return Observation(
            episode=self.episode.index,
            step=self._step,
            stamp_ns=self._stamp_ns,
            objects=self.simulation.objects(),
            joint_position=self.simulation.joint_position,
            joint_velocity=self.simulation.joint_velocity,
            hand_index=HAND_INDEX,
            program_id=self.program_id,
            hand_pose=self.simulation.hand_pose,
        )
