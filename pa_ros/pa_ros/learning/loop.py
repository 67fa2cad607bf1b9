"""The training loop: act, step, store, update, publish, evaluate, save, read from top to bottom.

Here agent, environment and learner run in one process, without ROS. Over the graph the same objects
take the same steps in the same order (docs/DESIGN.md, "The synchronous protocol"), so one seed
gives the same weights, bit for bit, either way.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from pa_ros.acting.executing import Actor
from pa_ros.acting.learning_agent import LearningAgent
from pa_ros.core.errors import ConfigError, PaError
from pa_ros.core.experience import Float64, PublishedPolicy, Step
from pa_ros.language import PRODUCT, Program
from pa_ros.learning.config import LearnerConfig, TrainConfig
from pa_ros.learning.errors import CheckpointError, DivergedError
from pa_ros.learning.folder import checkpoint_of, claim, holds_checkpoint
from pa_ros.learning.in_process import LearnerThread, joined_agent
from pa_ros.learning.interfaces import Environment, Evaluate, Log, Watcher
from pa_ros.learning.learner import Learner
from pa_ros.learning.records import Records, resume_from
from pa_ros.learning.run import LearningRun
from pa_ros.networks.config import NetworkConfig
from pa_ros.world import Trajectory


def train(
    config: TrainConfig,
    network: NetworkConfig,
    learner_config: LearnerConfig,
    environment: Environment,
    max_speed: Float64,
    training_programs: Sequence[Program],
    evaluate: Evaluate | None = None,
    resume: bool = False,
    run_log: Log | None = None,
    watcher: Watcher | None = None,
    stopped: Callable[[], bool] = lambda: False,
) -> Learner:
    """Train for `config.frames` control steps in whole episodes, or until `stopped`.

    Leaves progress.csv and `checkpoint/` under `config.out` and returns the learner. With `resume`
    it continues from the checkpoint there and ends where an uninterrupted run would have.

    :param max_speed: [J] rad/s; an action's velocity command is the action times it.
    :param evaluate: scores an actor every `config.evaluate_every_frames`.
    :raises ConfigError: for settings that do not work in one process.
    :raises PaError: for what ends the training; what was learned before is saved.
    :raises CheckpointError: if there is no checkpoint to resume from that fits the settings.
    :raises CheckpointError: if another run uses `config.out`, or left a checkpoint there and
        `resume` is false.
    """
    if learner_config.schedule.in_step == "free":
        raise ConfigError(
            "learner.schedule.in_step: expected 'arrival' or 'exact' in one process, got 'free': "
            "agents that never wait need a separate learner process"
        )
    # The learner is made first: settings that it rejects must leave no folder behind.
    learner = Learner(network, learner_config, training_programs, config.seed, environment.scoring)
    if resume and not holds_checkpoint(config.out):
        raise CheckpointError(
            f"checkpoint: expected one at {checkpoint_of(config.out)}, found none"
        )
    with claim(config.out, resume):
        resumed = resume_from(config, learner) if resume else {}
        run = LearningRun(learner, environment.control_period_s, resumed)
        if run_log is not None:
            run_log.begin(run)

        def learn(trajectory: Trajectory) -> PublishedPolicy:
            run.consume(trajectory)  # store it in the replay buffer, make the updates it is due
            policy = run.policy()  # publish the new weights
            if run_log is not None:
                run_log.add(trajectory, policy)
            return policy

        records = Records(config, run, resumed)
        agent = joined_agent(run, config.agent_id, config.seed)
        # With a policy lag the agent may act on one trajectory while the learner works on another.
        overlap = run.info.policy_lag > 0
        frames, episode = learner.counters.frames, learner.counters.episodes
        try:
            with LearnerThread(learn, overlap) as thread:
                while frames < config.frames and not stopped():
                    rewards = _episode(environment, episode, config, agent, thread, max_speed)
                    before, frames, episode = frames, frames + len(rewards), episode + 1
                    records.add_rewards(rewards)
                    if watcher is not None:
                        watcher.episode(frames, len(rewards), float(np.mean(rewards)))
                    if _crossed(before, frames, config.evaluate_every_frames):
                        thread.drain()  # the learner must be idle while its weights are read
                        row = records.row(frames) | _scores(learner, evaluate)
                        records.add(row)
                        if watcher is not None:
                            watcher.row(row)
                    if _crossed(before, frames, config.checkpoint_every_frames):
                        thread.drain()
                        records.save_if_there_is_room()
                thread.drain()
                records.finish()
        except PaError as error:  # such as a void episode, or a fault of an extension
            if not isinstance(error, DivergedError) or error.restored:
                records.save_if_there_is_room()
            raise
    return learner


def _episode(
    environment: Environment,
    index: int,
    config: TrainConfig,
    agent: LearningAgent,
    learner: LearnerThread,
    max_speed: Float64,
) -> list[float]:
    """Act for one episode, learning from each trajectory that it completes; its rewards."""
    rewards: list[float] = []
    observation, verdict = environment.reset(index, config.condition)
    while True:
        # As the arena executes every command unaltered, the last one led to this step.
        step = Step(observation, verdict, executed=agent.last_command)
        trajectory = agent.observe(step, environment.program)
        if trajectory is not None:
            learner.send(trajectory)
        if verdict.truncated:
            return rewards
        while agent.prepare() is not None:  # it waits for weights of a trajectory sent before
            agent.offer(learner.receive())
        velocity = agent.act().astype(np.float64) * max_speed
        observation, verdict = environment.step(velocity)
        rewards.append(verdict.reward)


def _scores(learner: Learner, evaluate: Evaluate | None) -> dict[str, float]:
    """Greedy scores of the newest weights."""
    if evaluate is None:
        return {}
    actor = Actor(learner.network, learner.config.inference, logic=PRODUCT)
    actor.load(learner.snapshot())
    return evaluate(actor)


def _crossed(before: int, after: int, every: int) -> bool:
    """Whether a multiple of `every` lies in (before, after]."""
    return every > 0 and after // every > before // every
