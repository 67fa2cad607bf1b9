"""A recording is shown with the weights of each moment."""

from unittest.mock import MagicMock

import pytest

from helpers.messages import judged
from helpers.recordings import rewritten, train
from pa_ros.bags.episodes import RecordedEpisode, Row
from pa_ros.bags.errors import ProvenanceError
from pa_ros.bags.reader import Bag
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
        replay = Replay.read(bag)
        assert len(replay.episodes) >= 4
        versions = []
        for place, episode in enumerate(replay.episodes):
            moment = replay.moment(place, 3)
            assert moment.observation.step == 3 and moment.program == episode.rows[3].step.program
            assert moment.explanation is not None and moment.explanation.tree, moment.unexplained
            versions.append(moment.explanation.version)
        assert versions == [episode.rows[3].policy_version for episode in replay.episodes]
        assert versions == sorted(versions) and versions[-1] > versions[0]


def test_of_weights_that_were_not_recorded_the_version_before_is_shown(recorded, tmp_path):
    def lose(name, message):
        return [] if name.endswith("policy_weights") and message.version in (2, 3) else [message]

    with Bag(rewritten(recorded, tmp_path / "bag", lose)) as bag:
        replay = Replay.read(bag)
        acted = [episode.rows[3].policy_version for episode in replay.episodes]
        shown = [replay.moment(i, 3).explanation.version for i in range(len(acted))]
    assert 2 in acted and shown == [1 if version in (2, 3) else version for version in acted]


def test_p_is_what_the_agent_acted_on(recorded):
    """An agent that learns joins degrees by products."""
    with Bag(recorded) as bag:
        replay = Replay.read(bag)
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
        Replay.read(bag)


def test_a_fleets_learner_is_found_outside_the_arenas_namespace(recorded, tmp_path):
    def rename(name: str) -> str:
        return name if name == "/policy_weights" else f"/arena1{name}"

    with Bag(rewritten(recorded, tmp_path / "bag", lambda _, m: [m], rename)) as bag:
        assert Replay.read(bag, "arena1").moment(0, 3).explanation is not None


def test_a_bag_without_weights_is_shown_without_explanation(recorded, tmp_path):
    copy = without("policy_weights", recorded, tmp_path)
    with Bag(copy) as bag:
        moment = Replay.read(bag).moment(0, 0)
        assert moment.explanation is None and "not known here" in moment.unexplained


def test_a_slider_of_a_longer_episode_shows_the_last_step():
    replay, page, client = MagicMock(), MagicMock(), MagicMock()
    rows = [Row(judged(number, False, 0), -1.0) for number in range(2)]
    replay.episodes = [RecordedEpisode(number, False, rows) for number in range(2)]
    episode, step = MagicMock(value=1), MagicMock(value=99)
    client.gui.add_slider.side_effect = [episode, step]
    timeline = Timeline(replay, page)
    timeline.add_controls(client)
    step.on_update.call_args[0][0](None)
    timeline.tick(pages=1)
    replay.moment.assert_called_once_with(1, 1)
