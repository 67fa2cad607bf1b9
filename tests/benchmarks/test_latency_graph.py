"""How soon programs are obeyed and steps are answered."""

import pytest

from pa_ros.benchmarks.latency import Latencies, bench_latency


def test_a_command_is_timed_from_the_step_that_it_answers():
    times = Latencies()
    times.observed(100, "a", 1.0)
    times.observed(100, "a", 1.5)  # sent again
    assert not times.commanded(100, 2.0) and times.steps == [1.0]
    assert not times.commanded(200, 3.0) and times.steps == [1.0]  # a step nobody saw


def test_a_program_is_timed_until_a_command_answers_a_step_under_it():
    times = Latencies()
    times.observed(100, "a", 1.0)
    times.asked("b", 1.2)
    assert not times.commanded(100, 1.3)  # still under the one before
    times.observed(200, "b", 2.0)
    assert times.commanded(200, 2.2) and times.programs == pytest.approx([1.0])
    times.observed(300, "b", 3.0)
    assert not times.commanded(300, 3.1) and len(times.programs) == 1


def test_figures_are_percentiles_in_milliseconds():
    times = Latencies(steps=[0.001 * i for i in range(1, 1002)], programs=[0.5])
    found = times.figures()
    assert found["step_p50_ms"] == pytest.approx(501) and found["step_p99_ms"] == pytest.approx(991)
    assert found["program_p999_ms"] == 500 and found["steps"] == 1001 and found["programs"] == 1


@pytest.mark.graph
def test_a_graph_is_measured_at_both_rates():
    report = bench_latency(share=0.04, conditions=("",))
    found = {name: float(value) for name, value in report.items()}
    for rate in ("", "fast."):
        for name in ("program", "step"):
            middle, rare = (found[f"latency.{rate}{name}_{p}_ms"] for p in ("p50", "p999"))
            assert 0 < middle <= rare and found[f"latency.{rate}{name}s"] >= 3
