"""Policies that come with the package, and shipping one."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from helpers.pictures import opengl
from laboratory.studies import shipping
from laboratory.studies.scorer import Benchmark, Scorer
from laboratory.studies.shipping import ship
from pa_ros.agents import load_agent
from pa_ros.cli.main import main
from pa_ros.core.errors import ConfigError
from pa_ros.learning.checkpoint_files import SHIPPED, write_synced
from pa_ros.learning.checkpoints import load_policy, read_metadata
from pa_ros.learning.errors import CheckpointError

NAMES = sorted(path.parent.name for path in SHIPPED.glob("*/metadata.json"))


@pytest.mark.parametrize("name", NAMES)
def test_a_shipped_policy_executes_held_out_programs(name, tmp_path):
    agent = load_agent(f"shipped:{name}")
    card = read_metadata(Path(f"shipped:{name}"))["extra"]
    assert agent.design.name == card["design"] and "versions" in card
    if agent.perception:
        pytest.importorskip("cv2", reason="no OpenCV: install programmable-agents[camera]")
        opengl()
    scorer = Scorer(Benchmark(agent.design, agent.arena, 10), tmp_path)
    own, random = scorer.agent(agent, "eval"), scorer.reference("random", "eval")
    assert sum(score.success for score in own) >= 8 > 2 >= sum(score.success for score in random)


def test_an_unknown_name_is_rejected_with_the_known_ones():
    with pytest.raises(CheckpointError, match=r"'2-L', '3-D'.*\], got '9-Z'"):
        load_policy(Path("shipped:9-Z"))


def test_shipping_keeps_the_policy_and_little_else(tmp_path):
    source = Path("shipped:2-L")
    out = ship(source, "again", {"note": 1}, folder=tmp_path)
    first, second = load_policy(source), load_policy(out)
    assert first.version == second.version
    assert all(np.array_equal(first.tensors[k], second.tensors[k]) for k in first.tensors)
    assert read_metadata(out)["extra"]["note"] == 1
    with pytest.raises(ConfigError, match="expected a new one, got 'again', which exists"):
        ship(source, "again", {"note": 2}, folder=tmp_path)
    assert read_metadata(out)["extra"]["note"] == 1
    assert ship(source, "again", {"note": 2}, replaces=True, folder=tmp_path) == out
    assert read_metadata(out)["extra"]["note"] == 2
    with pytest.raises(ConfigError, match="expected letters, digits"):
        ship(source, "../out", {}, folder=tmp_path / "in")
    assert sum(file.stat().st_size for file in SHIPPED.rglob("*")) < 5_000_000


def test_a_policy_whose_replacing_was_interrupted_is_whole(tmp_path, monkeypatch):
    source = Path("shipped:2-L")
    out = ship(source, "again", {"note": 1}, folder=tmp_path)
    written = list[Path]()

    def killed(path, *content):
        if written:
            raise KeyboardInterrupt
        written.append(path)
        write_synced(path, *content)

    with monkeypatch.context() as dying:
        dying.setattr(shipping, "write_synced", killed)
        with pytest.raises(KeyboardInterrupt):
            ship(source, "again", {"note": 2}, replaces=True, folder=tmp_path)
    assert read_metadata(out)["extra"]["note"] == 1 and load_policy(out).tensors
    ship(source, "again", {"note": 2}, replaces=True, folder=tmp_path)
    assert read_metadata(out)["extra"]["note"] == 2
    assert [path.name for path in tmp_path.iterdir()] == ["again"]


def test_the_agent_of_a_run_has_its_design_and_arena(tmp_path):
    run = ["train", "--out", str(tmp_path), "--design", "3-D", "--frames", "100", "--eval-every"]
    assert main([*run, "0"]) == 0
    agent, same = load_agent(tmp_path), load_agent(tmp_path / "checkpoint", "2-L", "paper")
    assert (agent.design.name, agent.arena.preset) == ("3-D", "fast")
    assert (same.design.name, same.arena.preset) == ("2-L", "paper")
    assert agent.digest == same.digest and len(agent.digest) == 12
    reordered = dict(reversed(agent.snapshot.tensors.items()))
    assert replace(agent, snapshot=replace(agent.snapshot, tensors=reordered)).digest == same.digest
