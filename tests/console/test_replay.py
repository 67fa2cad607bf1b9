"""A recording is shown with the weights of each moment."""

from __future__ import annotations

import pytest
from recorded_runs import rewritten, train

pytest.importorskip("viser", reason="the extra `console` is not installed")

from pa_ros.bags.errors import BagError, ProvenanceError
from pa_ros.bags.reader import Bag
from pa_ros.cli.main import main
from pa_ros.console.replay import Replay


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
            assert moment.look is not None and moment.look.tree, moment.why_blind
            versions.append(moment.look.version)
            assert moment.look.version <= episode.rows[3].policy_version
        assert versions == sorted(versions) and versions[-1] > versions[0]


def test_without_an_arena_it_is_refused(recorded, tmp_path):
    copy = without("arena_info", recorded, tmp_path)
    with Bag(copy) as bag, pytest.raises(ProvenanceError, match="an arena's description"):
        Replay(bag)


def test_without_weights_it_says_so(recorded, tmp_path):
    copy = without("policy_weights", recorded, tmp_path)
    with Bag(copy) as bag:
        moment = Replay(bag).moment(0, 0)
        assert moment.look is None and "no weights" in moment.why_blind


def test_a_damaged_bag_is_one_line(recorded, tmp_path, capsys):
    (tmp_path / "bag").mkdir()
    for file in recorded.iterdir():
        (tmp_path / "bag" / file.name).write_bytes(file.read_bytes()[: file.stat().st_size // 3])
    assert main(["console", "--bag", str(tmp_path / "bag"), "--port", "0"]) == 2
    error = capsys.readouterr().err
    assert error.startswith("pa_ros console: bag:") and "Traceback" not in error
    with pytest.raises(BagError):
        Bag(tmp_path / "none")
