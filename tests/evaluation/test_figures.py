"""Learning curves and pictures of detectors."""

from pathlib import Path

import matplotlib.image
import numpy as np

from pa_ros.arena import ReachTask, design_named, preset_named
from pa_ros.evaluation.pictures.drawing import draw_detectors, learning_curve


def test_learning_curve_with_gaps(tmp_path):
    path = tmp_path / "new" / "curve.png"
    learning_curve(
        path, [1, 2, 3], [-0.9, 0.1, 0.6], [np.nan, 0.0, 0.5], "2-L", references=(-0.97, 0.88)
    )
    assert matplotlib.image.imread(path)[..., :3].std() > 0.01


def test_detectors_are_drawn_beside_the_arena(tmp_path):
    task = ReachTask(preset_named("fast"), design_named("3-D"), seed=0)
    pictures = []
    for episode in range(2):
        seen, _ = task.reset(episode)
        path = tmp_path / f"{episode}.png"
        draw_detectors(path, Path("shipped:3-D"), task, seen, "NEAR(HAND, RED)")
        pictures.append(matplotlib.image.imread(path))
    assert np.abs(pictures[0] - pictures[1]).mean() > 0.002
