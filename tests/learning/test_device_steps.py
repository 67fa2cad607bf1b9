"""Queued updates: the same as immediate ones, without waiting; on the CPU, and on a GPU if any."""

from __future__ import annotations

import logging
from dataclasses import fields

import numpy as np
import pytest
import torch
from torch.utils._python_dispatch import TorchDispatchMode
from worlds import WORDS

from pa_ros.core.errors import ConfigError
from pa_ros.language import parse
from pa_ros.learning.algorithms.dpg.config import LearnerConfig
from pa_ros.learning.algorithms.dpg.device_steps import (
    SLOTS,
    WARM_UP_UPDATES,
    DeviceSteps,
    Replay,
    Staging,
)
from pa_ros.learning.algorithms.dpg.engine import Batch
from pa_ros.learning.algorithms.dpg.torch_engine import TorchEngine
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.parameters import initial_actor, initial_critic
from pa_ros.world.programs import ProgramTable

CPU = torch.device("cpu")
TEXTS = ("NEAR(HAND, AND(RED, CUBE))", "NEAR(HAND, AND(BLUE, SPHERE))")
GPUS = ["cuda"] if torch.cuda.is_available() else []


class Captures:
    """Stands for `capture_cuda`: counts, and replays by running."""

    def __init__(self) -> None:
        self.count = 0

    def __call__(self, run: Replay) -> Replay:
        self.count += 1
        return run


def tables(texts: tuple[str, ...] = TEXTS) -> ProgramTable:
    table = ProgramTable(WORDS)
    for text in texts:
        table.add(parse(text, WORDS))
    return table


def torch_engine(
    table: ProgramTable, capture=None, kind="programmable", device="cpu"
) -> TorchEngine:
    """Small networks, the same for each call; queued if there is a `capture`."""
    network = NetworkConfig(WORDS, kind, hidden=7, attention=5, canonical_hidden=9)
    rng = np.random.default_rng(0)
    initial = initial_actor(network, rng), initial_critic(network, rng)
    falling = {"action_l2": 0.1, "action_l2_decay": 0.5, "rates_fall_after": 2}
    falling |= {"geometry_decay": 0.1, "geometry_decay_after": 2}
    config = LearnerConfig(engine="torch", device=device, **falling)
    engine = TorchEngine(network, config, table, *initial)
    if capture is not None:
        engine._queued = DeviceSteps(engine._step_on, CPU, capture)
    return engine


def random_batch(rng: np.random.Generator, size: int, objects: int, k: int, rows: int) -> Batch:
    def normal(*shape: int) -> np.ndarray:
        return rng.normal(0, 0.5, shape).astype(np.float32)

    return Batch(
        objects=normal(size, objects, 16),
        arm=normal(size, 18),
        action=rng.uniform(-1, 1, (size, 6)).astype(np.float32),
        next_objects=normal(size, objects, 16),
        next_arm=normal(size, 18),
        program=rng.integers(rows, size=(size, k)).astype(np.int32),
        reward=rng.choice([-1.0, 1.0], (size, k)).astype(np.float32),
        discount=rng.choice([0.0, 0.99], size).astype(np.float32),
    )


def spoil(batch: Batch) -> None:
    for field in fields(batch):
        getattr(batch, field.name)[:] = 0


@pytest.mark.parametrize("kind", ["programmable", "distilled-critic", "canonical"])
def test_queued_updates_are_the_immediate_ones(kind) -> None:
    """Other shapes, programs that join and target copies between; arrays are free at once."""
    table, captures = tables(), Captures()
    direct, queued = torch_engine(table, kind=kind), torch_engine(table, captures, kind)
    rng = np.random.default_rng(2)
    shapes = [(8, 4, 1)] * (WARM_UP_UPDATES + 3) + [(5, 3, 2)] * (WARM_UP_UPDATES + 2)
    for size, objects, k in shapes:
        batch = random_batch(rng, size, objects, k, len(table))
        direct.update(batch)
        queued.update(batch)
        spoil(batch)
        assert queued.metrics() == direct.metrics()
    assert captures.count == 2
    table.add(parse("NEAR(HAND, AND(RED, SPHERE))", table.vocabulary))
    for engine in (direct, queued):
        engine.copy_targets()
    for _ in range(WARM_UP_UPDATES + 2):
        batch = random_batch(rng, 5, 3, 2, len(table))
        direct.update(batch)
        queued.update(batch)
    assert captures.count == 3
    expected = direct.tensors()
    for name, value in queued.tensors().items():
        np.testing.assert_array_equal(value, expected[name], err_msg=name)


def test_loaded_tensors_reach_a_captured_step() -> None:
    """What a capture reads stays where it is when a checkpoint is loaded."""
    table = tables()
    direct, queued = torch_engine(table), torch_engine(table, Captures())
    rng = np.random.default_rng(3)
    for _ in range(WARM_UP_UPDATES + 1):
        queued.update(random_batch(rng, 4, 3, 1, 2))
    queued.load_tensors(direct.tensors())
    batch = random_batch(rng, 4, 3, 1, 2)
    direct.update(batch)
    queued.update(batch)
    expected = direct.tensors()
    for name, value in queued.tensors().items():
        np.testing.assert_array_equal(value, expected[name], err_msg=name)


def test_goes_on_if_nothing_can_be_captured(caplog) -> None:
    def refuse(run: Replay) -> Replay:
        raise RuntimeError("operation not permitted when stream is capturing")

    table = tables()
    direct, queued = torch_engine(table), torch_engine(table, refuse)
    rng = np.random.default_rng(4)
    for _ in range(WARM_UP_UPDATES + 2):
        batch = random_batch(rng, 4, 3, 1, 2)
        direct.update(batch)
        queued.update(batch)
    assert [record.levelno for record in caplog.records] == [logging.WARNING]
    assert "not permitted when stream is capturing" in caplog.text
    assert queued.metrics() == direct.metrics()


class Waits(TorchDispatchMode):
    """Collects operations whose answer the host needs, or that copy from its ordinary memory."""

    NAMES = ("_local_scalar_dense", "nonzero", "masked_select", "equal", "lift_fresh", "unique")

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        name = func.overloadpacket.__name__.rstrip("_")
        if any(name == waiting.rstrip("_") for waiting in self.NAMES):
            self.found.append(name)
        return func(*args, **(kwargs or {}))


@pytest.mark.parametrize("kind", ["programmable", "distilled-critic", "canonical"])
def test_nothing_in_an_update_waits_for_the_device(kind) -> None:
    engine = torch_engine(tables(), Captures(), kind)
    batch = random_batch(np.random.default_rng(5), 4, 3, 1, 2)
    engine.update(batch)  # brings the programs to the device
    with Waits() as waits:
        engine.update(batch)
    assert waits.found == []
    with waits:
        float(torch.zeros(1))
    assert waits.found == ["_local_scalar_dense"]


@pytest.mark.parametrize("device", ["cpu", *GPUS])
def test_staging_keeps_values_types_and_addresses(device) -> None:
    batch = random_batch(np.random.default_rng(6), 5, 3, 2, 4)
    arrays = {field.name: getattr(batch, field.name) for field in fields(batch)}
    staging = Staging(arrays, torch.device(device))
    addresses = {name: tensor.data_ptr() for name, tensor in staging.tensors.items()}
    for turn in range(2 * SLOTS + 1):
        given = {name: array + array.dtype.type(turn) for name, array in arrays.items()}
        expected = {name: array.copy() for name, array in given.items()}
        staging.put(given)
        for array in given.values():
            array[:] = -1
        for name, tensor in staging.tensors.items():
            np.testing.assert_array_equal(tensor.cpu().numpy(), expected[name], strict=True)
    assert {k: tensor.data_ptr() for k, tensor in staging.tensors.items()} == addresses


def test_staging_refuses_to_cast() -> None:
    staging = Staging({"x": np.zeros(3, np.float32)}, CPU)
    with pytest.raises(TypeError, match="cast"):
        staging.put({"x": np.zeros(3, np.float64)})


@pytest.mark.parametrize("device", ["cpu", *GPUS])
def test_other_devices_update_as_the_cpu_does(device) -> None:
    table = tables()
    here, there = torch_engine(table), torch_engine(table, device=device)
    rng = np.random.default_rng(7)
    for update in range(100):
        batch = random_batch(rng, 16, 5, 2, 2)
        here.update(batch)
        there.update(batch)
        if update == 50:
            here.copy_targets()
            there.copy_targets()
    expected = here.tensors()
    for name, value in there.tensors().items():
        np.testing.assert_allclose(value, expected[name], rtol=1e-3, atol=1e-5, err_msg=name)


def test_a_device_that_is_not_there_is_refused() -> None:
    with pytest.raises(ConfigError, match="expected one that torch has here, got 'cuda:99'"):
        torch_engine(tables(), device="cuda:99")
