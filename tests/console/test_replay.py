"""A recording is shown with the weights of each moment."""

from itertools import groupby
from unittest.mock import MagicMock

import numpy as np
import pytest

from helpers.recordings import columns, rewritten, train
from pa_ros.arena.appearance import look_of
from pa_ros.bags.episodes import RecordedEpisode, Row
from pa_ros.bags.errors import ProvenanceError
from pa_ros.bags.film import Stage
from pa_ros.bags.reader import Bag
from pa_ros.cli.main import main
from pa_ros.console.replay import Replay, Timeline
from pa_ros.language import MIN_MAX, PRODUCT, parse, relevance


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recorded")
    assert train(folder / "run", "--record", folder / "bag") == 0
    return folder / "bag"


def without(topic, recorded, folder):
    """A bag that lacks a topic."""
    return rewritten(recorded, folder / "bag", lambda name, m: [] if name.endswith(topic) else [m])


def test_moments_have_the_weights_that_acted(recorded):
    with Bag(recorded) as bag:
        replay = Replay(bag)
        assert len(replay.episodes) >= 4
        versions = []
        for place, episode in enumerate(replay.episodes):
            moment = replay.moment(place, 3)
            assert moment.observation.step == 3 and moment.program == episode.rows[3].program
            assert moment.explanation is not None and moment.explanation.tree, moment.unexplained
            versions.append(moment.explanation.version)
        assert versions == [episode.rows[3].policy_version for episode in replay.episodes]
        assert versions == sorted(versions) and versions[-1] > versions[0]


def test_of_weights_that_were_not_recorded_the_version_before_is_shown(recorded, tmp_path):
    def lose(name, message):
        return [] if name.endswith("policy_weights") and message.version in (2, 3) else [message]

    with Bag(rewritten(recorded, tmp_path / "bag", lose)) as bag:
        replay = Replay(bag)
        acted = [episode.rows[3].policy_version for episode in replay.episodes]
        shown = [replay.moment(i, 3).explanation.version for i in range(len(acted))]
    assert 2 in acted and shown == [1 if version in (2, 3) else version for version in acted]


def test_p_is_what_the_agent_acted_on(recorded):
    """An agent that learns joins degrees by products."""
    with Bag(recorded) as bag:
        replay = Replay(bag)
        moment = replay.moment(0, 3)
    found, vocabulary = moment.explanation, replay.arena.world.vocabulary
    program = parse(moment.program, vocabulary)
    hand = moment.observation.hand_index
    expected = relevance(program, found.phi.tolist(), vocabulary.row, hand, PRODUCT)
    other = relevance(program, found.phi.tolist(), vocabulary.row, hand, MIN_MAX)
    assert found.p.tolist() == expected != other


def test_a_bag_without_an_arena_is_rejected(recorded, tmp_path):
    copy = without("arena_info", recorded, tmp_path)
    with Bag(copy) as bag, pytest.raises(ProvenanceError, match="an arena's description"):
        Replay(bag)


def test_a_fleets_learner_is_found_outside_the_arenas_namespace(recorded, tmp_path):
    def rename(name: str) -> str:
        return name if name == "/policy_weights" else f"/arena1{name}"

    with Bag(rewritten(recorded, tmp_path / "bag", lambda _, m: [m], rename)) as bag:
        assert Replay(bag, "arena1").moment(0, 3).explanation is not None


def test_a_bag_without_weights_is_shown_without_explanation(recorded, tmp_path):
    copy = without("policy_weights", recorded, tmp_path)
    with Bag(copy) as bag:
        moment = Replay(bag).moment(0, 0)
        assert moment.explanation is None and "not known here" in moment.unexplained


def test_a_slider_of_a_longer_episode_shows_the_last_step():
    replay, page, client = MagicMock(), MagicMock(), MagicMock()
    rows = [Row(step, 0, np.zeros((1, 16), np.float32), 0, "") for step in range(2)]
    replay.episodes = [RecordedEpisode(number, False, rows) for number in range(2)]
    episode, step = MagicMock(value=1), MagicMock(value=99)
    client.gui.add_slider.side_effect = [episode, step]
    timeline = Timeline(replay, page)
    timeline.add_controls(client)
    step.on_update.call_args[0][0](None)
    timeline.tick(pages=1)
    replay.moment.assert_called_once_with(1, 1)


def test_a_file_for_rerun_contains_what_was_recorded(recorded, tmp_path, capsys):
    pytest.importorskip("rerun", reason="the extra `rerun` is not installed")
    path = tmp_path / "run.rrd"
    assert main(["bag", "export", str(recorded), "--rerun", str(path), "--episodes", "0", "2"]) == 0
    assert "2 episodes in" in capsys.readouterr().out
    told = columns(path)
    with Bag(recorded) as bag:
        replay = Replay(bag)
        wanted = [(place, e) for place, e in enumerate(replay.episodes) if e.number in (0, 2)]
        rows = [row for _, episode in wanted for row in episode.rows]
        rewards = [row.reward for row in rows if np.isfinite(row.reward)]
        assert [value for _, (value,) in told["/reward Scalars:scalars"]] == rewards
        hand = told["/world/arm/hand Transform3D:translation"]
        assert [time for time, _ in hand] == pytest.approx(0.1 * np.arange(len(rows)))
        texts = [text for _, (text,) in told["/program TextDocument:text"]]
        assert texts == [key for key, _ in groupby(row.program for row in rows)]
        for start, (place, episode) in zip((0, len(wanted[0][1].rows)), wanted, strict=True):
            the_blocks_are_as_recorded(told, replay, place, episode, start)
    assert main(["bag", "export", str(recorded), "--rerun", str(path)]) == 2
    assert "already exists" in capsys.readouterr().err


def the_blocks_are_as_recorded(told, replay, place, episode, start):
    """Poses, shapes, colors, and p in curves and labels, at an episode's step 7."""
    stage, moment = Stage(episode, replay.arena), replay.moment(place, 7)
    stage.show(episode.rows[7])
    at = pytest.approx(0.1 * (start + 7))
    for i, block in enumerate(stage.task.episode.blocks, start=1):
        words = sorted(block.kind.words, key=replay.arena.world.vocabulary.row.get, reverse=True)
        name, p = "_".join(words).lower(), moment.explanation.p[i]
        (pose,) = [v for t, v in told[f"/world/blocks/{name} Transform3D:translation"] if t == at]
        assert pose[0] == pytest.approx(stage.task.simulation.positions[i].tolist(), abs=1e-6)
        shape = {"CUBE": "Boxes3D", "SPHERE": "Ellipsoids3D"}[words[1]]
        (label,) = [v for t, v in told[f"/world/blocks/{name} {shape}:labels"] if t == at]
        assert label == [f"{' '.join(words)}  p {p:.2f}"]
        (curve,) = [v for t, v in told[f"/p/{name} Scalars:scalars"] if t == at]
        assert curve == [pytest.approx(p)]
        rgba = told[f"/world/blocks/{name} {shape}:colors"][0][1][0].to_bytes(4, "big")
        assert list(rgba[:3]) == [round(255 * c) for c in look_of(block.kind).rgb]
