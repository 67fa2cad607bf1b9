"""A recording is shown with the weights of each moment."""

from __future__ import annotations

import sys
from itertools import groupby
from unittest.mock import MagicMock

import numpy as np
import pytest

from helpers.recordings import columns, rewritten, train
from pa_ros.arena.appearance import look_of
from pa_ros.bags.episodes import RecordedEpisode, Row
from pa_ros.bags.errors import BagError, ProvenanceError
from pa_ros.bags.film import Stage
from pa_ros.bags.reader import Bag
from pa_ros.cli.main import main
from pa_ros.console.insight import logic_of
from pa_ros.console.recorded import Replay
from pa_ros.console.replay import Timeline
from pa_ros.console.serve import serve_bag
from pa_ros.console.server import ConsoleSettings
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
            assert moment.look is not None and moment.look.tree, moment.why_blind
            versions.append(moment.look.version)
            assert moment.look.version <= episode.rows[3].policy_version
        assert versions == sorted(versions) and versions[-1] > versions[0]


def test_p_is_what_the_agent_acted_on(recorded):
    """One that learns acts by products."""
    with Bag(recorded) as bag:
        replay = Replay(bag)
        moment = replay.moment(0, 3)
    look, vocabulary = moment.look, replay.arena.world.vocabulary
    program = parse(moment.program, vocabulary)
    hand = moment.observation.hand_index
    expected = relevance(program, look.phi.tolist(), vocabulary.row, hand, PRODUCT)
    other = relevance(program, look.phi.tolist(), vocabulary.row, hand, MIN_MAX)
    assert look.p.tolist() == expected != other


@pytest.mark.parametrize(
    ("parameters", "logic"),
    [
        ({"learning": True, "logic": "min_max"}, PRODUCT),
        ({"learning": False, "logic": "min_max"}, MIN_MAX),
        ({"learning": False, "logic": "product"}, PRODUCT),
        ({"learning": False}, PRODUCT),  # recorded before there was a choice
        ({}, PRODUCT),
    ],
)
def test_an_agents_logic_follows_from_what_it_says_of_itself(parameters, logic):
    assert logic_of(parameters) == logic


def test_without_an_arena_it_is_refused(recorded, tmp_path):
    copy = without("arena_info", recorded, tmp_path)
    with Bag(copy) as bag, pytest.raises(ProvenanceError, match="an arena's description"):
        Replay(bag)


def test_without_weights_it_says_so(recorded, tmp_path):
    copy = without("policy_weights", recorded, tmp_path)
    with Bag(copy) as bag:
        moment = Replay(bag).moment(0, 0)
        assert moment.look is None and "no weights" in moment.why_blind


def test_a_damaged_bag_is_one_line(recorded, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("os.nice", lambda _: 0)  # the page is polite for good
    (tmp_path / "bag").mkdir()
    for file in recorded.iterdir():
        (tmp_path / "bag" / file.name).write_bytes(file.read_bytes()[: file.stat().st_size // 3])
    assert main(["console", "--bag", str(tmp_path / "bag"), "--port", "0"]) == 2
    error = capsys.readouterr().err
    assert error.startswith("pa_ros console: bag:") and "Traceback" not in error
    with pytest.raises(BagError):
        Bag(tmp_path / "none")


@pytest.mark.parametrize("wish", [-1000, -1, 2, 1000, float("nan"), float("inf"), float("-inf")])
def test_a_slider_beyond_its_ends_stands_at_one(wish):
    replay, page, client = MagicMock(), MagicMock(), MagicMock()
    rows = [Row(step, 0, np.zeros((1, 16), np.float32), 0, "") for step in range(2)]
    replay.episodes = [RecordedEpisode(number, False, rows) for number in range(2)]
    episode, step = MagicMock(value=wish), MagicMock(value=0)
    client.gui.add_slider.side_effect = [episode, step]
    timeline = Timeline(replay, page)
    timeline.controls(client)
    episode.on_update.call_args[0][0](None)
    step.value = wish
    step.on_update.call_args[0][0](None)
    timeline.tick(pages=1)
    replay.moment.assert_called_once_with(*[1 if wish > 0 else 0] * 2)


def test_a_page_that_cannot_be_drawn_ends_nothing(recorded, monkeypatch, capsys):
    ticks = iter(range(3))

    def tick(timeline, pages):
        if next(ticks) == 0:
            raise IndexError("no such row")

    monkeypatch.setattr(Timeline, "tick", tick)
    settings = ConsoleSettings(port=0, rate_hz=30.0)
    finished = iter([False, False, True])
    serve_bag(recorded, settings, None, lambda: next(finished), lambda *_: None)
    assert "refused: timeline: [console.page] IndexError: no such row" in capsys.readouterr().err


def test_without_its_extra_rerun_is_one_line(recorded, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    assert main(["bag", "export", str(recorded), "--rerun", str(tmp_path / "a.rrd")]) == 2
    assert "expected the extra rerun (pip install" in capsys.readouterr().err
    assert not (tmp_path / "a.rrd").exists()


@pytest.mark.parametrize("given", [[], ["--out", "a", "--rerun", "b.rrd"]])
def test_an_export_goes_to_one_place(recorded, capsys, given):
    assert main(["bag", "export", str(recorded), *given]) == 2
    assert "expected one of --out DIR and --rerun FILE.rrd" in capsys.readouterr().err


def test_a_file_for_rerun_says_what_is_recorded(recorded, tmp_path, capsys):
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
    assert "exists already" in capsys.readouterr().err


def the_blocks_are_as_recorded(told, replay, place, episode, start):
    """Poses, shapes, colors, and p in curves and labels, at an episode's step 7."""
    stage, moment = Stage(episode, replay.arena), replay.moment(place, 7)
    stage.show(episode.rows[7])
    at = pytest.approx(0.1 * (start + 7))
    for i, block in enumerate(stage.task.episode.blocks, start=1):
        words = sorted(block.kind.words, key=replay.arena.world.vocabulary.row.get, reverse=True)
        name, p = "_".join(words).lower(), moment.look.p[i]
        (pose,) = [v for t, v in told[f"/world/blocks/{name} Transform3D:translation"] if t == at]
        assert pose[0] == pytest.approx(stage.task.simulation.positions[i].tolist(), abs=1e-6)
        shape = {"CUBE": "Boxes3D", "SPHERE": "Ellipsoids3D"}[words[1]]
        (label,) = [v for t, v in told[f"/world/blocks/{name} {shape}:labels"] if t == at]
        assert label == [f"{' '.join(words)}  p {p:.2f}"]
        (curve,) = [v for t, v in told[f"/p/{name} Scalars:scalars"] if t == at]
        assert curve == [pytest.approx(p)]
        rgba = told[f"/world/blocks/{name} {shape}:colors"][0][1][0].to_bytes(4, "big")
        assert list(rgba[:3]) == [round(255 * c) for c in look_of(block.kind).rgb]


def test_a_file_that_cannot_be_is_one_line(recorded, tmp_path, capsys):
    pytest.importorskip("rerun", reason="the extra `rerun` is not installed")
    for name, said in (("a.txt", "ends in .rrd"), ("none/a.rrd", "No such file")):
        assert main(["bag", "export", str(recorded), "--rerun", str(tmp_path / name)]) == 2
        error = capsys.readouterr().err
        assert said in error and "Traceback" not in error
