"""Steps put together and info: what is told is what was recorded."""

from __future__ import annotations

import numpy as np
import pytest

from helpers.recordings import STEPS, acted, rewritten
from pa_ros.bags.episodes import episodes
from pa_ros.bags.reader import Bag
from pa_ros.cli.main import main

pytestmark = pytest.mark.xdist_group("looking into bags")  # their recordings are made once


def test_steps_are_put_together_as_they_were(stepped):
    with Bag(stepped) as bag:
        found = list(episodes(bag))
    assert [(e.number, e.evaluation, len(e.rows), e.missing) for e in found] == [
        (7, False, STEPS + 1, 0), (7, True, STEPS + 1, 0),
    ]  # fmt: skip
    rows = [row for episode in found for row in episode.rows]
    for row, (observation, verdict, command, program, _) in zip(rows, acted(), strict=True):
        assert (row.step, row.program) == (observation.step, str(program))
        np.testing.assert_array_equal(row.objects, observation.objects)
        np.testing.assert_array_equal(row.joint_position, observation.joint_position)
        np.testing.assert_array_equal(row.joint_velocity, observation.joint_velocity)
        assert (row.reward, row.distance) == (verdict.reward, verdict.distance)
        if command is None:
            assert len(row.action) == 0 and row.policy_version == -1
        else:
            np.testing.assert_array_equal(row.action, command.action)
            assert row.policy_version == 4


def test_info_tells_of_episodes_versions_and_provenance(learned, stepped, capsys):
    assert main(["bag", "info", str(learned)]) == 0
    out = capsys.readouterr().out
    assert "3 trajectories of transitions, no gaps" in out
    assert "weights: versions 0 to 3" in out and "3 training episodes, 300 steps" in out
    assert "2-L, jaco, fast, seed 5" in out and "from scratch" in out
    assert main(["bag", "info", str(stepped)]) == 0
    out = capsys.readouterr().out
    assert "1 training episodes, 30 steps, reward per step" in out
    assert "1 evaluation episodes, 30 steps" in out and "acted by versions 4 to 4" in out


def test_info_names_gaps(learned, stepped, tmp_path, capsys):
    def drop(name, message):
        gone = name == "/trajectories" and message.sequence == 1
        return [] if gone or (name == "/policy_weights" and message.version == 2) else [message]

    assert main(["bag", "info", str(rewritten(learned, tmp_path / "a", drop))]) == 0
    out = capsys.readouterr().out
    assert "2 trajectories of transitions; GAPS: 1 missing of agent" in out
    assert "versions 0 to 3, 1 of them not recorded" in out

    def lose(name, message):
        gone = name == "/object_features" and message.step in (4, 5, 6)
        return [] if gone and not message.evaluation else [message]

    assert main(["bag", "info", str(rewritten(stepped, tmp_path / "b", lose))]) == 0
    assert "GAPS: 3 steps between others are not recorded" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("topic", "field", "damaged", "reason"),
    [
        ("/object_features", "object_count", 7, "object_features.features"),
        ("/joint_states", "position", np.zeros(3), "joint_states.position"),
        ("/verdict", "distance", -1.0, "verdict.distance"),
    ],
)
def test_steps_that_are_not_what_they_promise_are_refused(
    stepped, tmp_path, capsys, topic, field, damaged, reason
):
    def damage(name, message):
        if name == topic:
            setattr(message, field, damaged)
        return [message]

    bag = rewritten(stepped, tmp_path / "damaged", damage)
    assert main(["bag", "info", str(bag)]) == 1
    assert f"not readable: {reason}" in capsys.readouterr().out
    assert main(["bag", "export", str(bag), "--out", str(tmp_path / "out")]) == 2
    assert reason in capsys.readouterr().err
