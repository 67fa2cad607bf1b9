"""Scalars for TensorBoard, read back by its own reader."""

import errno
import sys
from types import SimpleNamespace
from unittest.mock import Mock

import pytest

from pa_ros.core.errors import ConfigError
from pa_ros.learning.errors import LearningError
from pa_ros.learning.progress import Scalars


def read(folder):
    """Name to (frames, value) of each event."""
    accumulator = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    events = accumulator.EventAccumulator(str(folder))
    events.Reload()
    names = events.Tags()["scalars"]
    return {name: [(e.step, e.value) for e in events.Scalars(name)] for name in names}


def test_scalars_are_written_once_for_each_number_of_frames(tmp_path):
    pytest.importorskip("tensorboard")
    scalars = Scalars(tmp_path)
    scalars.add({"frames": 100.0, "critic_loss": 0.5, "updates": 10.0})
    scalars.add({"frames": 100.0, "critic_loss": 0.75, "updates": 10.0})
    scalars.add({"frames": 200.0, "critic_loss": 0.25, "updates": 20.0})
    scalars.close()
    assert read(tmp_path) == {
        "learner/critic_loss": [(100, 0.5), (200, 0.25)],
        "learner/updates": [(100, 10.0), (200, 20.0)],
    }


def test_without_the_package_the_error_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", None)
    with pytest.raises(ConfigError, match=r"tensorboard: expected .*make install-tens") as refused:
        Scalars(tmp_path)
    assert "\n" not in str(refused.value)


def test_a_full_disk_is_an_error_of_one_line(tmp_path, monkeypatch):
    full = Mock(add_scalar=Mock(side_effect=OSError(errno.ENOSPC, "No space left on device")))
    writer = SimpleNamespace(SummaryWriter=lambda _: full)
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", writer)
    with pytest.raises(LearningError, match="expected room for more: .*No space left"):
        Scalars(tmp_path).add({"frames": 50.0, "updates": 1.0})
