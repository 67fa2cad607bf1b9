"""What a long run is judged by."""

from __future__ import annotations

from pathlib import Path

import pytest

from pa_ros.benchmarks.endurance import EnduranceError, Sample, summary
from pa_ros.benchmarks.endurance_figure import draw_endurance

CAPACITY = 1000


def samples(leak_mb: float = 0.0, handles: int = 0) -> list[Sample]:
    """A hundred samples, the replay buffer wrapping after ten; growth is per sample."""
    return [
        Sample(5.0 * i, 100.0 * i, 50.0, {"learner_node": 300 + leak_mb * i},
               {"learner_node": 20 + handles * i})
        for i in range(1, 101)
    ]  # fmt: skip


def test_what_does_not_grow_is_said_not_to():
    report = summary(samples(), CAPACITY)
    assert report["endurance.learner_node.mb_grown"] == 0
    assert report["endurance.learner_node.handles_grown"] == 0
    assert report["endurance.steps_per_s_first"] == report["endurance.steps_per_s_last"] == 50
    assert report["endurance.minutes"] == pytest.approx(500 / 60)
    assert report["endurance.times_wrapped"] == pytest.approx(10.0)


def test_what_grows_is_seen():
    report = summary(samples(leak_mb=0.5, handles=1), CAPACITY)
    assert report["endurance.learner_node.mb_grown"] == pytest.approx(0.5 * 72, abs=2)
    assert report["endurance.learner_node.handles_grown"] == pytest.approx(72, abs=2)


def test_a_run_that_was_too_short_is_refused():
    with pytest.raises(EnduranceError, match="expected 1000 frames well before the end, got 1000"):
        summary(samples()[:10], CAPACITY)


def test_a_picture_is_drawn(tmp_path: Path):
    draw_endurance(tmp_path / "x" / "endurance.png", samples(), CAPACITY)
    assert (tmp_path / "x" / "endurance.png").stat().st_size > 10_000
