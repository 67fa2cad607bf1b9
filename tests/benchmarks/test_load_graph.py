"""A learner under the load of many agents."""

import pytest

from pa_ros.benchmarks.load import bench_load, recorded

pytestmark = pytest.mark.graph


def test_recorded_trajectories_are_whole_episodes():
    first, second = recorded(2)
    assert len(first) == len(second) == 100 and first.ends_episode
    assert first.program != second.program or first.objects[0, 1, 0] != second.objects[0, 1, 0]


def test_nothing_that_many_agents_send_is_lost():
    report = bench_load(agents=40, seconds=5.0, updates_per_frame=0.01)
    assert report["load.agents"] == 40 and report["load.lost"] == 0
    assert 15 <= int(report["load.sent"]) <= 40  # half an episode's time of each agent
    assert float(report["load.weights_kb"]) > 100 and float(report["load.memory_mb_last"]) > 0
