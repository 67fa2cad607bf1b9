"""Sizes: blocks whose edge is a number, drawn for each of them."""

import numpy as np
import pytest

from pa_ros.arena import ReachTask, design_named, preset_named
from pa_ros.arena.rearranging import bodies, rearrange
from pa_ros.arena.render import top_view

DESIGN = design_named("sizes")


@pytest.fixture
def task() -> ReachTask:
    return ReachTask(preset_named("fast"), DESIGN, seed=0)


def test_the_simulated_block_the_feature_and_the_word_agree(task: ReachTask) -> None:
    seen = []
    for index, condition in ((0, "train"), (1, "train"), (2, "eval-unseen")):
        observation, _ = task.reset(index, condition)
        true = task.world.truth(observation.objects)[1:]
        for i, block in enumerate(task.episode.blocks):
            geom = task.simulation.model.geom(f"block{i}")
            np.testing.assert_allclose(geom.size[0], block.edge_m / 2)
            assert observation.objects[i + 1, -1] == pytest.approx(block.edge_m - 0.06, abs=1e-6)
            words = {DESIGN.vocabulary.words[k] for k in np.flatnonzero(true[i])}
            assert words == block.kind.words
            assert (block.kind["size"] == "LARGE") == (block.edge_m > 0.06)
            seen.append((condition, block.kind["size"], block.edge_m))
    assert len({edge for _, _, edge in seen}) == len(seen)  # no two are equal
    ranges = {(condition, size) for condition, size, _ in seen}
    for condition, size in ranges:
        edges = DESIGN.unseen_edges_m if condition == "eval-unseen" else DESIGN.edges_m
        low, high = edges[size]
        assert all(low <= e <= high for c, s, e in seen if (c, s) == (condition, size))


def test_blocks_of_any_size_stay_at_rest_and_are_drawn(task: ReachTask) -> None:
    task.reset(0)
    edges = [block.edge_m for block in task.episode.blocks]
    for _ in range(10):
        task.step(np.zeros(6))
    heights = task.simulation.positions[1:, 2]
    np.testing.assert_allclose(heights, np.array(edges) / 2, atol=3e-4)
    assert top_view(task, 120).shape == (120, 120, 3)


def test_a_block_that_is_moved_keeps_its_size(task: ReachTask) -> None:
    task.reset(0)
    before = task.episode.blocks
    rearrange(task, [block.kind for block in before], bodies(task)[1:], given=(0,))
    assert [block.edge_m for block in task.episode.blocks] == [block.edge_m for block in before]


@pytest.mark.parametrize(
    ("condition", "blocks", "compared"),
    [
        ("compare-size", 4, 2),
        ("compare-size-2", 2, 2),
        ("compare-size-8", 8, 4),
        ("compare-size-unseen", 8, 4),
    ],
)
def test_a_comparison_of_sizes_means_the_largest_or_smallest_of_its_set(
    task: ReachTask, condition: str, blocks: int, compared: int
) -> None:
    comparisons = set()
    for index in range(12):
        task.reset(index, condition)
        (target,) = task.verifier.targets
        named = task.verifier_of(task.program.sets_alone).targets
        edges = {i: task.episode.blocks[i - 1].edge_m for i in named}
        comparison = task.program.chosen[1]
        best = max(edges.values()) if comparison == "LARGEST" else min(edges.values())
        assert edges[target] == best and len(named) >= compared
        assert len(task.episode.blocks) <= blocks
        comparisons.add(comparison)
    assert comparisons == {"LARGEST", "SMALLEST"}


def test_nouns_of_compare_size_are_held_out(task: ReachTask) -> None:
    for index in range(6):
        task.reset(index, "compare-size")
        kinds = [task.episode.blocks[i - 1].kind for i in task.verifier.targets]
        assert set(kinds) <= set(DESIGN.held_out)
