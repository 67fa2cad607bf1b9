"""The codec's benchmark reports what it promises."""

from __future__ import annotations

from pa_ros.benchmarks.codec import bench_codec


def test_bench_reports_a_positive_cost_for_every_message():
    report = bench_codec(repeats=1, calls=20)
    costs = {name: value for name, value in report.items() if name.startswith("codec.")}
    assert {"codec.encode_us", "codec.decode_us"} <= set(costs)
    assert len(costs) == 25
    assert float(costs["codec.trajectory_bytes"]) > 40_000
    assert all(float(cost) > 0 for cost in costs.values())
