"""A run from pictures: trained, resumed and scored in one process."""

from pathlib import Path

import numpy as np
import pytest

from laboratory.studies.detectors import detector_table
from pa_ros.agents import load_agent
from pa_ros.cli import main as cli
from pa_ros.networks.config import actor_config

pytest.importorskip("cv2", reason="no OpenCV: install programmable-agents[camera]")
from pa_ros.perception.calibration import Cameras

TRAIN = ["train", "--design", "3-D", "--perception", "camera"]


@pytest.fixture(autouse=True)
def calibrated_before(calibration: Cameras, monkeypatch: pytest.MonkeyPatch) -> None:
    text = calibration.to_text()
    monkeypatch.setattr(
        "pa_ros.agents.calibrated", lambda *given: "" if given[2] == "told" else text
    )


def test_an_agent_trained_from_pictures_keeps_its_camera(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = [*TRAIN, "--out", str(tmp_path), "--eval-every", "0"]
    settings = ["--learner.replay.warmup_frames", "200", "--network.hidden", "16"]
    assert cli.main([*run, *settings, "--frames", "300"]) == 0
    agent = load_agent(tmp_path)
    world = actor_config(agent.snapshot.architecture).world
    assert agent.perception and not world.schema.tells_words
    assert cli.main([*run, *settings, "--frames", "400", "--resume"]) == 0
    assert load_agent(tmp_path).perception == agent.perception
    told = [*run[:3], *run[5:], *settings, "--resume"]  # its own camera is used
    assert cli.main([*told, "--frames", "500"]) == 0
    assert cli.main([*told, "--perception", "corner", "--frames", "600"]) == 2
    assert "expected camera, as the resumed run has, got corner" in capsys.readouterr().err
    scored = ["eval", "--checkpoint", str(tmp_path), "--condition", "blocks-3", "--episodes", "1"]
    scored += ["--pictures", "hard"]
    assert cli.main(scored) == 0
    assert ": 1 episode, " in capsys.readouterr().out


def test_an_agent_that_pushes_learns_and_is_scored_from_pictures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = ["train", "--design", "push-2", "--perception", "camera", "--out", str(tmp_path)]
    settings = ["--learner.replay.warmup_frames", "100", "--network.hidden", "16"]
    assert cli.main([*run, *settings, "--frames", "200", "--eval-every", "0"]) == 0
    scored = ["eval", "--checkpoint", str(tmp_path), "--condition", "pairs", "--episodes", "1"]
    assert cli.main(scored) == 0
    assert ": 1 episode, " in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "why"),
    [
        (["--from-bag", "bag"], "--perception: expected told with --from-bag"),
        (["--network", "canonical"], "family: expected one that learns what words mean"),
        (["--learner.relabeling.rule", "none"], "property_dropout: expected 0 without relabeling"),
    ],
)
def test_what_a_camera_cannot_do_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], why: str
) -> None:
    run = [*TRAIN, "--out", str(tmp_path / "run"), "--frames", "100", *options]
    assert cli.main(run) == 2
    assert why in capsys.readouterr().err


def test_words_of_seen_blocks_are_judged_by_the_blocks_that_they_are() -> None:
    agent = load_agent("shipped:camera")
    rows = [row for row in detector_table({700: agent}, 3) if row.seen]
    assert {row.word for row in rows} == set(agent.design.words)
    assert np.mean([row.right for row in rows]) > 0.95
    assert np.mean([row.separated for row in rows]) > 0.95
