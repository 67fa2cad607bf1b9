"""Scalars for TensorBoard, read back by its own reader."""

from __future__ import annotations

import errno
import sys
import threading
from functools import partial
from types import SimpleNamespace
from typing import Any, cast
from unittest.mock import Mock

import pytest

from learner_node.node import LearnerNode
from pa_ros.core.errors import ConfigError
from pa_ros.learning.errors import LearningError
from pa_ros.learning.progress import Scalars
from pa_ros.ros.refusals import Refusals


def read(folder):
    """Name to (frames, value) of each event."""
    accumulator = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    events = accumulator.EventAccumulator(str(folder))
    events.Reload()
    names = events.Tags()["scalars"]
    return {name: [(e.step, e.value) for e in events.Scalars(name)] for name in names}


def test_scalars_stand_over_frames_and_only_while_there_are_more(tmp_path):
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


def test_what_a_resumed_run_adds_is_read_with_what_was_there(tmp_path):
    pytest.importorskip("tensorboard")
    for frames in (100.0, 200.0):
        scalars = Scalars(tmp_path)
        scalars.add({"frames": frames, "updates": frames})
        scalars.close()
    assert read(tmp_path) == {"learner/updates": [(100, 100.0), (200, 200.0)]}


def test_without_the_package_it_is_refused_in_one_line_that_says_what_to_install(
    tmp_path, monkeypatch
):
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", None)
    with pytest.raises(ConfigError, match=r"tensorboard: expected .*make install-tens") as refused:
        Scalars(tmp_path)
    assert "\n" not in str(refused.value)


def test_a_folder_that_cannot_be_is_refused(tmp_path):
    pytest.importorskip("tensorboard")
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match="tensorboard: expected a folder"):
        Scalars(tmp_path / "file" / "events")


class Full:
    """A writer on a disk without room."""

    def __init__(self, *_: object) -> None:
        self.closed = 0
        self.file_writer = self

    def add_scalar(self, *_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    def close(self) -> None:
        self.closed += 1
        raise OSError(errno.ENOSPC, "No space left on device")


def test_a_full_disk_costs_scalars_and_no_learner(tmp_path, monkeypatch, capsys):
    full = Full()
    monkeypatch.setitem(
        sys.modules, "torch.utils.tensorboard", SimpleNamespace(SummaryWriter=lambda _: full)
    )
    scalars = Scalars(tmp_path)
    metrics = {"frames": 100.0, "updates": 1.0}
    with pytest.raises(LearningError, match="expected room for more"):
        scalars.add({**metrics, "frames": 50.0})
    node = SimpleNamespace(
        _scalars=scalars, worker=SimpleNamespace(metrics=metrics), refusals=Refusals(print)
    )
    for _ in range(2):
        cast(Any, LearnerNode).draw(node)
    assert node.refusals.counts == {"learning.tensorboard": 1} and full.closed == 1
    assert "No space left" in capsys.readouterr().out


def test_a_learner_that_is_cleaned_up_leaves_no_thread_of_a_writer(tmp_path):
    pytest.importorskip("tensorboard")
    before = set(threading.enumerate())
    for worker in (None, Mock(metrics={"frames": 10.0, "updates": 1.0}, trouble="")):
        node = Mock(_scalars=Scalars(tmp_path), worker=worker)
        node.draw = partial(cast(Any, LearnerNode).draw, node)
        assert set(threading.enumerate()) - before
        cast(Any, LearnerNode).cleanup(node)
        assert set(threading.enumerate()) == before
    assert read(tmp_path) == {"learner/updates": [(10, 1.0)]}
