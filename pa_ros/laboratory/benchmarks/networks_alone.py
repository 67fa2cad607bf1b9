"""What networks have learned: how often they execute programs without the rules of executing
(docs/language.md), which agents of `pa_ros eval` follow. The episodes are the same."""

from __future__ import annotations

import argparse

from pa_ros.acting.policy import Policy
from pa_ros.agents import TrainedAgent, load_agent
from pa_ros.core.experience import Float32, Observation
from pa_ros.evaluation.evaluate import EPISODES_SEED, policy_of, pursuing, run_episodes
from pa_ros.language import Program
from pa_ros.perception import task_seen


class NetworksAlone(Policy):
    """The networks' own actions, with all objects of a scene before them."""

    def act(self, observation: Observation, program: Program) -> Float32:
        """The networks' action, [J] in [-1, 1]. Raises what `infer` raises."""
        return self.infer(observation, program.sets_alone)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the benchmark's options."""
    parser.add_argument("agents", nargs="+", help="checkpoints, or folders of runs")
    parser.add_argument("--condition", nargs="+", default=["eval", "pairs-eval", "tower-3"])
    parser.add_argument("--episodes", type=int, default=100, help="of each (%(default)s)")


def run(options: argparse.Namespace) -> dict[str, float]:
    """Shares of the episodes that succeed at the end, and ever, by agent and condition."""
    report: dict[str, float] = {}
    for path in options.agents:
        agent = load_agent(path)
        for condition in options.condition:
            ended, ever = score(agent, condition, options.episodes)
            print(f"{path}, {condition}: {ended:.2f}, ever {ever:.2f}", flush=True)
            report |= {f"{path}.{condition}.success": ended, f"{path}.{condition}.ever": ever}
    return report


def score(agent: TrainedAgent, condition: str, episodes: int) -> tuple[float, float]:
    """The share of the episodes that succeed at the end, and the share that ever do."""
    networks = NetworksAlone.of(agent.snapshot)
    policy = policy_of(networks, networks.network.world, agent.arena)
    task = task_seen(agent.arena, agent.design, EPISODES_SEED, agent.perception)
    ended = list(run_episodes(task, pursuing(task, policy), condition, episodes))
    return sum(s.success for s in ended) / episodes, sum(s.ever for s in ended) / episodes
