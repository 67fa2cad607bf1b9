"""What follows from the number of updates made."""

from __future__ import annotations

import pytest
from worlds import dpg

from pa_ros.learning.algorithms.dpg.config import DPGConfig
from pa_ros.learning.schedule import values_after


def series(name: str, updates: tuple[int, ...], **options: object) -> list[float]:
    config = dpg(**options)
    return [getattr(values_after(n, config), name) for n in updates]


def test_nothing_changes_under_the_papers_settings_but_adams_corrections() -> None:
    first, later = (values_after(n, DPGConfig()) for n in (0, 10**6))
    assert (later.actor_rate, later.critic_rate) == (first.actor_rate, first.critic_rate)
    assert (first.actor_rate, first.critic_rate) == (1e-4, 3e-4)
    assert (later.discount, later.reward_scale) == (first.discount, first.reward_scale) == (0.99, 1)
    unused = ("action_l2", "detector_decay", "geometry_decay", "property_dropout")
    assert not any(getattr(values, name) for values in (first, later) for name in unused)


def test_adams_corrections_are_those_of_the_update_that_follows() -> None:
    options = {"optimizer__beta1": 0.5, "optimizer__beta2": 0.75}
    assert series("correction1", (0, 1, 2), **options) == [0.5, 0.75, 0.875]
    assert series("correction2", (0, 1), **options) == [0.25, 0.4375]


def test_both_rates_fall_as_one_over_t_or_never() -> None:
    options = {
        "optimizer__rates_fall_after": 10,
        "optimizer__actor_rate": 1.0,
        "optimizer__critic_rate": 2.0,
    }
    assert series("actor_rate", (0, 10, 20, 40), **options) == [1.0, 1.0, 0.5, 0.25]
    assert series("critic_rate", (0, 10, 20, 40), **options) == [2.0, 2.0, 1.0, 0.5]


@pytest.mark.parametrize(("decay", "prices"), [(0.9, (1.0, 0.55, 0.1, 0.1)), (0.0, (1.0,) * 4)])
def test_the_price_of_actions_falls_evenly_and_stays(decay, prices) -> None:
    options = {
        "actor__action_l2": 1.0,
        "actor__action_l2_decay": decay,
        "actor__action_l2_decay_updates": 10,
    }
    assert series("action_l2", (0, 5, 10, 50), **options) == pytest.approx(prices)


def test_detectors_decay_less_and_less() -> None:
    options = {"detectors__decay": 0.5, "detectors__decay_updates": 10}
    assert series("detector_decay", (0, 5, 10, 50), **options) == [0.5, 0.25, 0.0, 0.0]


@pytest.mark.parametrize(
    ("part", "name"), [("detectors", "geometry_decay"), ("relabeling", "property_dropout")]
)
def test_begin_when_so_many_updates_were_made(part, name) -> None:
    assert series(
        name, (0, 9, 10, 99), **{f"{part}__{name}": 0.3, f"{part}__{name}_after": 10}
    ) == [0, 0, 0.3, 0.3]


def test_the_horizon_grows_from_the_first_to_the_last_discount() -> None:
    options = {
        "updates__discount": 0.95,
        "updates__first_discount": 0.9,
        "updates__discount_rises_after": 10,
    }
    gammas = series("discount", (0, 10, 15, 20, 40), **options)
    assert [1 / (1 - gamma) for gamma in gammas] == pytest.approx([10, 10, 15, 20, 20])
    assert series("discount", (0,), updates__discount=0.8, updates__discount_rises_after=10) == [
        0.8
    ]


def test_rewards_are_scaled_so_that_the_bound_of_q_stays() -> None:
    options = {
        "updates__discount": 0.95,
        "updates__discount_rises_after": 10,
        "updates__reward_scale": 0.5,
    }
    scales, gammas = (series(x, (0, 15, 40), **options) for x in ("reward_scale", "discount"))
    bounds = [scale / (1 - gamma) for scale, gamma in zip(scales, gammas, strict=True)]
    assert bounds == pytest.approx([0.5 / (1 - 0.95)] * 3)
