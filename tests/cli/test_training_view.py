"""What `pa_ros train` shows while it learns."""

import io
import math
import shlex
from types import SimpleNamespace

import pytest

from pa_ros.cli import training_view
from pa_ros.cli.main import main
from pa_ros.cli.training_view import TrainingView

ROW = {
    "frames": 10_000.0,
    "wall_s": 12.4,
    "updates": 9_000.0,
    "behaviour.reward_per_step": -0.5,
    "critic_loss": math.nan,
    "mean_q": -3.25,
    "train_greedy.normalized": 0.75,
}


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_rows_stand_under_their_titles_and_what_is_not_known_is_a_dash():
    stream = io.StringIO()
    with TrainingView(50_000, stream) as view:
        view.row(ROW)
        view.row(ROW | {"frames": 20_000.0})
    legend, titles, first, second = stream.getvalue().splitlines()
    assert "0 random, 1 scripted" in legend
    assert "held out" not in titles, "a design without held-out programs"
    assert [len(line) for line in (first, second)] == [len(titles)] * 2 and len(titles) <= 80
    assert first.split() == ["10,000", "12", "s", "9,000", "-0.500", "–", "-3.250", "0.75"]
    assert second.split()[0] == "20,000"


def test_without_a_terminal_a_line_says_now_and_then_how_far_it_is(monkeypatch):
    clock = iter([0.0, 1.0, 6.0, 7.0, 12.0])
    ours = SimpleNamespace(monotonic=lambda: next(clock))  # not the whole process's
    monkeypatch.setattr(training_view, "time", ours)
    stream = io.StringIO()
    with TrainingView(2_000, stream) as view:
        for episode in range(1, 5):  # a resumed run: it begins at 1,000
            view.episode(1_000 + 100 * episode, 100, -episode / 10)
    first, second = stream.getvalue().splitlines()
    assert first.startswith("1,200 of 2,000 frames  33/s  reward/step -0.150  24 s left")
    assert second.startswith("1,400 of 2,000 frames  33/s  reward/step -0.250")


def test_in_a_terminal_the_line_is_renewed_in_place_and_rows_stay(monkeypatch):
    monkeypatch.setattr(training_view, "REFRESH_S", 0.0)
    monkeypatch.setenv("TERM", "xterm")
    stream = Terminal()
    with TrainingView(2_000, stream) as view:
        view.episode(100, 100, -1.0)
        view.row(ROW)
        view.episode(200, 100, -1.0)
    text = stream.getvalue()
    assert "100 of 2,000 frames" in text and "200 of 2,000 frames" in text
    assert "\x1b[2K" in text and "10,000" in text


@pytest.mark.parametrize("resumed", [False, True])
def test_a_run_tells_its_evaluations_and_what_comes_next(tmp_path, capsys, resumed):
    out = tmp_path / "it's a run"
    run = ["train", "--out", str(out), "--eval-every", "100", "--eval-episodes", "1"]
    assert main([*run, "--frames", "200"]) == 0
    if resumed:
        capsys.readouterr()
        assert main([*run, "--frames", "400", "--resume"]) == 0
    *_, before, last, note, then = capsys.readouterr().out.splitlines()
    frames = (300, 400) if resumed else (100, 200)
    assert [int(line.split()[0]) for line in (before, last)] == list(frames)
    assert note.startswith("no update was made: the first one needs more than 5,000 frames")
    command = shlex.split(then.rpartition("next: ")[2])
    assert command == ["pa_ros", "eval", "--checkpoint", str(out)]
