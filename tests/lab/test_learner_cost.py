"""The learner's benchmark: operation counts, timing in rounds, and the report."""

from functools import partial

import numpy as np
import pytest
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils.flop_counter import flop_registry

from laboratory.benchmarks import learner as bench
from laboratory.benchmarks.cost import Cost, Rates, Sizes, floor_us, update_cost
from laboratory.benchmarks.machine import elementwise, measure_rates, product
from laboratory.benchmarks.timing import Contender, Slice, measure

NETWORK, CONFIG = bench.setting("programmable")


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


@pytest.mark.parametrize("kind", ["programmable", "distilled-critic"])
@pytest.mark.parametrize("sizes", [Sizes(), Sizes(64, 5, 4)])
def test_counts_are_at_most_what_torch_counts(kind, sizes) -> None:
    """Torch's products repeat the arm's share, and compute parts of ∂Q/∂a that nobody needs.

    They also multiply weights that stay zero, so here all weights count.
    """
    network = NETWORK.changed(family=kind, relations_see_properties=True)
    config = CONFIG.changed(
        **{
            "replay.batch_size": sizes.transitions,
            "relabeling.programs_per_transition": sizes.programs,
        }
    )
    learner = bench.random_learner(network, config, sizes)
    engine = bench.engine_of(learner, name="torch")
    (batch,) = learner.batches(1)
    with Products() as products:
        engine.update(batch)
    parameters = sum(t.size for name, t in engine.tensors().items() if ".m." in name)
    cost = update_cost(network, sizes)
    elsewhere = 12 * parameters + 12 * cost.pair_tanhs * (1 + sizes.programs) + 20 * cost.tanhs
    assert 0.6 * products.flops < cost.flops < products.flops + elsewhere


def test_weights_that_stay_zero_are_not_counted() -> None:
    """Forward four times, backward twice; each multiplication has an addition."""
    b, n, hidden, attention = 64, 5, NETWORK.hidden, NETWORK.attention
    properties = NETWORK.world.schema.width - 7
    seeing = update_cost(NETWORK.changed(relations_see_properties=True), Sizes(b, n))
    blind = update_cost(NETWORK.changed(relations_see_properties=False), Sizes(b, n))
    weights = (3 * hidden + 2 * attention) * properties
    assert seeing.flops - blind.flops == 6 * 2 * b * n * weights


def test_the_lower_bound_adds_arithmetic_and_overlaps_memory() -> None:
    rates = Rates(flops=10, exponentials=5, tanhs=2, pair_tanhs=4, bytes=1)
    assert floor_us(Cost(100, 10, 4, 8, 3), rates) == 10 + 2 + 2 + 2
    assert floor_us(Cost(100, 10, 4, 8, 99), rates) == 99


def test_rates_are_measured() -> None:
    rates = measure_rates(1e5, repeats=2)
    assert rates.flops > 100 and rates.tanhs > 10 and rates.bytes > 100


def test_the_native_functions_are_accurate() -> None:
    x = np.linspace(-30, 30, 16 * 500).astype(np.float32)
    y = np.roll(x, 1234)
    exact = x.astype(np.float64)
    np.testing.assert_allclose(elementwise("EXPONENTIAL", x, x)(), np.exp(exact), rtol=3e-6)
    np.testing.assert_allclose(elementwise("TANH", x, x)(), np.tanh(exact), rtol=0, atol=3e-7)
    e, f = np.exp(2 * exact) / 2, np.exp(2 * y.astype(np.float64))
    sums = elementwise("TANH_OF_SUM", e.astype(np.float32), f.astype(np.float32), repeats=2)()
    np.testing.assert_allclose(sums, np.tanh(exact + y), rtol=0, atol=3e-7)


@pytest.mark.parametrize("shape", [(1, 1, 16), (7, 33, 48), (64, 150, 160), (6, 4, 96)])
def test_the_native_product_is_accurate(shape) -> None:
    rows, depth, columns = shape
    rng = np.random.default_rng(0)
    a, b = (rng.normal(size=s).astype(np.float32) for s in ((rows, depth), (depth, columns)))
    exact = a.astype(np.float64) @ b.astype(np.float64)
    np.testing.assert_allclose(product(a, b)(), exact, rtol=0, atol=1e-6 * depth)


def contender(slices: list[Slice], **fields: object) -> Contender:
    return Contender("x", lambda calls: None, slices=slices, **fields)  # type: ignore[arg-type]


def test_one_thread_is_timed_by_its_processor_time() -> None:
    slices = [Slice(100, wall_s=2.0, cpu_s=cpu) for cpu in (1.0, 1.25, 2.0)]
    assert contender(slices).rate == 80
    assert contender(slices[:1] * 4).spread == 0


def test_several_threads_are_timed_by_the_clock_in_undisturbed_slices() -> None:
    quiet, busy = Slice(100, 1.0, 1.96), Slice(100, 4.0, 3.0)
    assert contender([busy] * 5 + [quiet] * 3, threads=2, wall=True).rate == 100
    assert contender([busy] * 5 + [quiet] * 2, threads=2, wall=True).rate == 25


def test_contenders_take_turns() -> None:
    turns: list[str] = []

    def run(name: str, calls: int) -> None:
        turns.append(name)
        sum(range(1000 * calls))

    contenders = [Contender(name, partial(run, name)) for name in "ab"]
    measure(contenders, rounds=3, slice_s=1e-4)
    assert turns[-6:] == ["a", "b"] * 3
    assert all(len(one.slices) == 3 and one.rate > 0 for one in contenders)


def test_the_report_compares_ours_with_the_others_and_the_lower_bound() -> None:
    peer = Contender(bench.SB3, lambda n: sum(range(2000 * n)))
    network = NETWORK.changed(hidden=6, attention=4)
    report = bench.bench_learner(network, CONFIG, [peer], Sizes(8, 3, 1), 2, 0.002)
    found = {name: float(v) for name, v in report.items() if not isinstance(v, str)}
    bound = found["learner.update_us"] / found["learner.floor_us"]
    assert found["learner.floor_ratio"] == pytest.approx(bound)
    ratio = found[bench.SAMPLED] / found[bench.SB3]
    assert found["learner.ratio_to_sb3_ddpg"] == pytest.approx(ratio)
    assert {bench.EAGER, bench.STRAIGHTFORWARD, bench.TWO_THREADS} <= found.keys()
    assert 0 < found["actor.inference_us"] < 1e4
