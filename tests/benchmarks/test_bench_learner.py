"""The learner's benchmark: its counts, its rounds, and what it compares with."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils.flop_counter import flop_registry

from helpers.worlds import PROGRAMS, WORLD, PointWorld, dpg
from pa_ros.benchmarks import design
from pa_ros.benchmarks import learner as bench
from pa_ros.benchmarks.cost import Cost, Rates, Sizes, floor_us, update_cost
from pa_ros.benchmarks.machine import aligned, elementwise, measure_rates, product
from pa_ros.benchmarks.rounds import Contender, Slice, measure
from pa_ros.benchmarks.training import bench_train
from pa_ros.native import library as fused_library
from pa_ros.native.errors import FusedError
from pa_ros.networks.config import NetworkConfig

NETWORK = NetworkConfig(world=WORLD, hidden=6, attention=4, canonical_hidden=8)
CONFIG = dpg(relabeling__rule="all-goals", replay__capacity_frames=3000)
PAPER = NetworkConfig(world=WORLD)


class Products(TorchDispatchMode):
    """Counts the operations of torch's matrix products."""

    def __init__(self) -> None:
        super().__init__()
        self.flops = 0

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        out = func(*args, **(kwargs or {}))
        if func.overloadpacket in flop_registry:
            self.flops += flop_registry[func.overloadpacket](*args, **(kwargs or {}), out_val=out)
        return out


@pytest.mark.parametrize("kind", ["programmable", "distilled-critic", "canonical"])
@pytest.mark.parametrize("sizes", [Sizes(), Sizes(32, 9, 1), Sizes(64, 5, 4)])
def test_counts_are_what_torch_counts_at_most(kind, sizes) -> None:
    """Torch's products do not share the arm, nor spare ∂Q/∂a what it does not need."""
    network = PAPER.changed(kind=kind)
    config = dpg(
        CONFIG,
        replay__batch_size=sizes.transitions,
        relabeling__programs_per_transition=sizes.programs,
    )
    learner = bench.random_learner(network, config, PROGRAMS, sizes)
    engine = bench.engine_of(learner, name="torch")
    (batch,) = learner.batches(1)
    with Products() as products:
        engine.update(batch)
    moments = [t for name, t in engine.tensors().items() if ".m." in name]
    parameters = sum(t.size for t in moments)
    cost = update_cost(network, sizes)
    elementwise = 12 * parameters + 12 * cost.pair_tanhs * (1 + sizes.programs) + 20 * cost.tanhs
    assert 0.6 * products.flops < cost.flops < products.flops + elementwise
    assert cost.bytes > 4 * 10 * parameters


def test_counts_grow_as_they_must() -> None:
    one, half = update_cost(PAPER, Sizes(64)), update_cost(PAPER, Sizes(32))
    none = one + (one + half * -1.0) * -2.0  # what does not depend on the batch: Adam
    assert none.flops == pytest.approx(12 * none.bytes / 40)
    assert (none.tanhs, none.exponentials, none.pair_tanhs) == (0, 0, 0)
    assert one.pair_tanhs == 4 * 64 * 25 * (150 + 64)
    more = update_cost(PAPER, Sizes(64, 5, 2))
    assert more.pair_tanhs == one.pair_tanhs  # shared by the programs
    assert one.flops < more.flops < 2 * one.flops


def test_the_floor_adds_arithmetic_and_overlaps_memory() -> None:
    rates = Rates(flops=10, exponentials=5, tanhs=2, pair_tanhs=4, bytes=1)
    assert floor_us(Cost(100, 10, 4, 8, 3), rates) == 10 + 2 + 2 + 2
    assert floor_us(Cost(100, 10, 4, 8, 99), rates) == 99


def test_rates_are_those_of_the_fastest_way() -> None:
    rates = measure_rates(1e5, repeats=2)
    assert rates.flops > 100 and rates.tanhs > 10 and rates.bytes > 100
    assert rates.pair_tanhs > rates.tanhs  # else e^2x and e^2y would not be worth it


def test_functions_are_accurate() -> None:
    x = np.linspace(-30, 30, 16 * 500).astype(np.float32)
    y = np.roll(x, 1234)
    exact = x.astype(np.float64)
    np.testing.assert_allclose(elementwise("EXPONENTIAL", x, x)(), np.exp(exact), rtol=3e-6)
    np.testing.assert_allclose(elementwise("TANH", x, x)(), np.tanh(exact), rtol=0, atol=3e-7)
    e, f = np.exp(2 * exact) / 2, np.exp(2 * y.astype(np.float64))
    sums = elementwise("TANH_OF_SUM", e.astype(np.float32), f.astype(np.float32), repeats=2)()
    np.testing.assert_allclose(sums, np.tanh(exact + y), rtol=0, atol=3e-7)


@pytest.mark.parametrize("shape", [(1, 1, 16), (7, 33, 48), (64, 150, 160), (5, 3, 80), (6, 4, 96)])
def test_products_are_accurate(shape) -> None:
    rows, depth, columns = shape
    rng = np.random.default_rng(0)
    a, b = (rng.normal(size=s).astype(np.float32) for s in ((rows, depth), (depth, columns)))
    exact = a.astype(np.float64) @ b.astype(np.float64)
    np.testing.assert_allclose(product(a, b)(), exact, rtol=0, atol=1e-6 * depth)
    assert aligned(rows).ctypes.data % 64 == 0


def contender(slices: list[Slice], **fields: object) -> Contender:
    return Contender("x", lambda calls: None, slices=slices, **fields)  # type: ignore[arg-type]


def test_one_thread_is_timed_by_its_own_time() -> None:
    slices = [Slice(100, wall_s=2.0, cpu_s=cpu) for cpu in (1.0, 1.25, 2.0)]
    assert contender(slices).rate == 80
    assert contender(slices).share == 0.625
    assert contender(slices[:1] * 4).spread == 0


def test_several_threads_are_timed_by_the_wall_where_nothing_disturbed_them() -> None:
    quiet, busy = Slice(100, 1.0, 1.96), Slice(100, 4.0, 3.0)
    assert contender([busy] * 5 + [quiet] * 3, threads=2, wall=True).rate == 100
    assert contender([busy] * 5 + [quiet] * 2, threads=2, wall=True).rate == 25


def test_rounds_interleave() -> None:
    heard: list[str] = []

    def hear(name: str, calls: int) -> None:
        heard.extend([name] * calls)

    def one_by_one(run: Callable[[int], object], calls: int) -> None:
        for _ in range(calls):
            run(1)

    contenders = [Contender(name, partial(hear, name)) for name in "ab"]
    for one in contenders:
        one.run = partial(one_by_one, one.run)
    measure(contenders, rounds=3, slice_s=1e-5)
    assert all(len(one.slices) == 3 and one.rate > 0 for one in contenders)
    calls = {one.name: one.slices[0].calls for one in contenders}
    last = calls["a"] + calls["b"]
    assert heard[-last:] == ["a"] * calls["a"] + ["b"] * calls["b"]


@pytest.mark.parametrize("kind", ["programmable", "canonical"])
def test_the_report(kind) -> None:
    calls: list[int] = []
    peer = Contender(bench.SB3, lambda n: calls.append(sum(range(2000 * n))))
    report = bench.bench_learner(
        NETWORK.changed(kind=kind), CONFIG, PROGRAMS, Sizes(8, 3, 1), [peer], 2, 0.002
    )
    assert report["learner.network"] == kind
    assert float(report[bench.OURS]) > float(report[bench.EAGER]) * 0.3
    assert report["learner.floor_ratio"] == pytest.approx(
        float(report["learner.update_us"]) / float(report["learner.floor_us"])
    )
    ratio = float(report[bench.SAMPLED]) / float(report[bench.SB3])
    assert report["learner.ratio_to_sb3_ddpg"] == pytest.approx(ratio)
    assert (bench.STRAIGHTFORWARD in report) == (kind == "programmable")
    assert 0 < float(report["actor.inference_us"]) < 1e4
    assert calls


def test_the_loop_beside_bare_updates() -> None:
    world = PointWorld()
    report = bench_train(NETWORK, CONFIG, PROGRAMS, world, np.ones(6), 2, 60, 0.002)
    assert world.episode == 8  # nine episodes of twenty steps: a part not counted, and two
    names = ("frames_per_s_low", "frames_per_s", "frames_per_s_high", "bare_updates_per_s")
    low, rate, high, bare = (float(report[f"train.{name}"]) for name in names)
    assert 0 < low <= rate <= high
    share = rate / bare
    assert report["train.share_of_bare"] == pytest.approx(share)


def test_without_the_library_it_says_so(monkeypatch) -> None:
    def absent() -> str:
        raise FusedError("fused update: expected a library _fused.so: none")

    monkeypatch.setattr(fused_library, "level", absent)
    with pytest.raises(FusedError, match="expected a library"):
        bench.bench_learner(NETWORK, CONFIG, PROGRAMS, Sizes(8, 3, 1), rounds=1, slice_s=0.001)


def test_libraries_that_are_missing_are_left_out_with_a_message(monkeypatch, capsys) -> None:
    for name in ("stable_baselines3", "sbx"):
        monkeypatch.setitem(sys.modules, name, None)
    peers, facts = design.installed_peers()
    assert peers == []
    assert facts == {"learner.sb3": "not installed", "learner.sbx": "not installed"}
    told = capsys.readouterr().err
    assert "stable-baselines3 is left out" in told and "sbx-rl is left out" in told
