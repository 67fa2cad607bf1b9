"""How cost grows: every point is measured, and the docs show what the command found."""

from __future__ import annotations

import json
from pathlib import Path

from helpers.worlds import PROGRAMS, WORLD, dpg
from pa_ros.benchmarks.cost import Sizes
from pa_ros.benchmarks.growth import AXES, Axis, bench_growth, markdown_table, series
from pa_ros.benchmarks.growth_figure import growth_figure
from pa_ros.benchmarks.learner import EAGER, GPU, OURS, SAMPLED, SB3, STRAIGHTFORWARD, TWO_THREADS
from pa_ros.networks.config import NetworkConfig

DOCS = Path(__file__).parents[2] / "docs"


def test_points_differ_in_one_size() -> None:
    blocks, batch, programs = AXES
    assert blocks.sizes(4) == batch.sizes(64) == programs.sizes(1) == Sizes()
    assert blocks.sizes(8) == Sizes(objects=9)
    assert batch.sizes(128) == Sizes(transitions=128)
    assert programs.sizes(8) == Sizes(programs=8)


def test_measures_every_point() -> None:
    network = NetworkConfig(world=WORLD, hidden=6, attention=4)
    config = dpg(relabeling__rule="all-goals", replay__capacity_frames=3000)
    axes = (Axis("blocks", "blocks", (1, 6)), Axis("programs", "programs", (1, 3)))
    report = bench_growth(network, config, PROGRAMS, axes, rounds=1, slice_s=0.001)
    assert len(report) == 12
    assert all(float(value) > 0 for value in report.values())
    for axis in axes:
        one, more = series(report, axis, "floor")
        assert one < more
    rows = markdown_table(report, axes).splitlines()
    assert len(rows) == 6
    assert rows[2].startswith(f"| blocks | 1 | {report['growth.blocks.1.fused_us']:.0f} |")


def markdown_counts(report: dict) -> str:
    """What one update must compute, at this machine's rates, as a table."""
    rows = (
        ("floating-point operations", "learner.mflop", 1e6, "machine.gflop_per_s", 1e3),
        ("exponentials", "learner.exponentials", 1.0, "machine.exponentials_per_us", 1.0),
        ("tanh", "learner.tanhs", 1.0, "machine.tanhs_per_us", 1.0),
        ("tanh of a sum, given e^2x, e^2y", "learner.pair_tanhs", 1.0,
         "machine.pair_tanhs_per_us", 1.0),
        ("bytes", "learner.bytes", 1.0, "machine.copied_gb_per_s", 1e3),
    )  # fmt: skip
    lines = ["| | count (millions) | per µs, one thread | µs |", "|---|---|---|---|"]
    for title, count, unit, rate, per_us in rows:
        operations, speed = unit * float(report[count]), per_us * float(report[rate])
        lines.append(
            f"| {title} | {operations / 1e6:.2f} | {speed:,.0f} | {operations / speed:.0f} |"
        )
    return "\n".join(lines)


def markdown_rates(report: dict) -> str:
    """Medians and ratios as a table."""
    rows = (
        ("fused", OURS, ""),
        ("fused, batches drawn from the replay buffer", SAMPLED, ""),
        ("fused, two threads", TWO_THREADS, "learner.ratio_2_threads"),
        ("torch", EAGER, "learner.ratio_to_eager"),
        ("the formulas in torch as they stand", STRAIGHTFORWARD,
         "learner.ratio_to_straightforward"),
        ("Stable-Baselines3 DDPG, 400-400 MLPs", SB3, "learner.ratio_to_sb3_ddpg"),
        ("torch on a GPU", GPU, "learner.ratio_to_gpu"),
    )  # fmt: skip
    lines = ["| | updates/s | spread | ratio |", "|---|---|---|---|"]
    for title, name, ratio in rows:
        if name in report:
            rate, spread = float(report[name]), float(report[f"{name}_spread"])
            shown = f"{float(report[ratio]):.2f}" if ratio else ""
            lines.append(f"| {title} | {rate:.0f} | {spread:.0%} | {shown} |")
    return "\n".join(lines)


def test_the_docs_show_what_was_measured(tmp_path) -> None:
    shown = (DOCS / "learner-cost.md").read_text()
    for name in ("learner", "learner-canonical"):
        measured = json.loads((DOCS / f"results/{name}.json").read_text())
        assert markdown_counts(measured) in shown
        assert markdown_rates(measured) in shown
    report = json.loads((DOCS / "results/learner-growth.json").read_text())
    assert markdown_table(report) in shown
    growth_figure(tmp_path / "growth.png", report)
    assert (tmp_path / "growth.png").read_bytes()[:4] == b"\x89PNG"
