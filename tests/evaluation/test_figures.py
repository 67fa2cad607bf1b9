"""Pictures are drawn from what they are given."""

import matplotlib.image
import numpy as np
import pytest

from pa_ros.arena import Kind
from pa_ros.core.errors import ConfigError
from pa_ros.evaluation.pictures.drawing import learning_curve, phi_picture


def test_learning_curve_with_gaps(tmp_path):
    path = tmp_path / "new" / "curve.png"
    learning_curve(
        path, [1, 2, 3], [-0.9, 0.1, 0.6], [np.nan, 0.0, 0.5], "2-L", references=(-0.97, 0.88)
    )
    assert matplotlib.image.imread(path)[..., :3].std() > 0.01


def test_phi_shows_what_it_is_given(tmp_path):
    kinds = [Kind(color="RED", shape="CUBE"), Kind(color="BLUE", shape="SPHERE")]
    blocks = [(kinds[0], 0.3, 0.2), (kinds[1], -0.4, 0.3)]
    words = ("CUBE", "SPHERE", "RED", "BLUE")
    pictures = []
    for value in (0.0, 1.0):
        path = tmp_path / f"{value}.png"
        phi_picture(path, blocks, (0.2, 0.3), np.full((4, 3), value), np.full(3, value), words, "P")
        pictures.append(matplotlib.image.imread(path))
    assert pictures[0].shape == pictures[1].shape
    assert np.abs(pictures[0] - pictures[1]).mean() > 0.02


def test_phi_refuses_words_that_do_not_fit(tmp_path):
    with pytest.raises(ConfigError, match=r"expected Φ \(1, 1\)"):
        phi_picture(tmp_path / "x.png", [], (0, 0), np.zeros((4, 1)), np.zeros(2), ("RED",), "P")
