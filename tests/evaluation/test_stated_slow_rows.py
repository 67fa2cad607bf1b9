"""What RESULTS says below the slow arm's rows is what their committed tables say."""

from __future__ import annotations

from statistics import median

import pytest

from helpers.stated import check_stated, frames, short_of, span, summary

TABLE, NEW = "programmable-3D.paper-arm", "reach-new-both"


def new(tag: str) -> dict[str, float]:
    """Of blocks whose shape and color are both new."""
    return summary(f".paper-arm.{tag}")[NEW]


def later(tag: str) -> str:
    """Frames to solve, beyond those of the recipe."""
    return f"{median(frames(f'{TABLE}.{tag}')) - median(frames(TABLE)):,.0f} frames later"


def sentences() -> dict[str, str]:
    found = {"nothing": (
        f"after 100,000 frames, score {summary('.paper-arm')[NEW]['normalized']:.2f} in reaching"
    )}  # fmt: skip
    slept = short_of(f"{TABLE}.self-weight-1")
    assert [*slept] == [601, 602, 603, 606]
    found["attention to itself"] = (
        f"601 and 603 are at {slept[601]:.2f} and {slept[603]:.2f}, and 602 and 606 at "
        f"{slept[602]:.2f} and {slept[606]:.2f}, as if"
    )
    far = short_of(f"{TABLE}.discount-0.99")
    assert [*far] == [600, 601, 602, 604, 605, 606, 607, 609]
    assert sorted(far.values())[-1] == far[604] > 0.89
    found["horizon"] = f"but 603 and 608 ({min(far.values()):.2f} to just below 0.9)"
    even = short_of(f"{TABLE}.detector-gain-1")
    assert [*even] == [603] and new("detector-gain-1")["seeds_above_0_9"] == 8
    found["detectors' rate"] = (
        f"With one rate for all 603 is not ({even[603]:.2f}), {later('detector-gain-1')}, and 603 "
        f"and 606 reach new kinds below 0.9 (the worst {new('detector-gain-1')['worst_seed']:.2f})"
    )
    assert not short_of(f"{TABLE}.position-scale-5")
    found["positions"] = f"With coarser positions all ten are, {later('position-scale-5')}."
    quiet = short_of(f"{TABLE}.noise-0.3")
    assert list(quiet) == [601, 602, 603, 605, 606, 608] and quiet.pop(606) > 0.89
    found["noise"] = f"601 to 603, 605 and 608 are at {span([*quiet.values()], '.2f', ' to ')}"
    told, dense, biased = "relations-see-properties", "no-sparsity", "biases"
    short = {tag: short_of(f"{TABLE}.{tag}") for tag in (told, dense, biased)}
    assert [[*short[tag]] for tag in (told, dense, biased)] == [[601, 607], [609], []]
    found["one-hots, sparsity"] = (
        f"(601 and 607 at {short[told][601]:.2f} and {short[told][607]:.2f}; 609 at "
        f"{short[dense][609]:.2f})"
    )
    assert [new(tag)["seeds_above_0_9"] for tag in (told, dense, biased)] == [8, 8, 9]
    found["one-hots, sparsity, biases"] = (
        "two, two and one of the ten below 0.9 (the worst "
        f"{new(told)['worst_seed']:.2f}, {new(dense)['worst_seed']:.2f} and "
        f"{new(biased)['worst_seed']:.2f})"
    )
    own = short_of(f"{TABLE}.no-relabel")
    assert [*own] == [600, 601, 605, 606, 608] and new("no-relabel")["seeds_above_0_9"] == 6
    found["relabeling"] = (
        f"600, 601, 605, 606 and 608 are at {span([*own.values()], '.2f', ' to ')}, and four of "
        f"the ten reach new kinds below 0.9 (the worst {new('no-relabel')['worst_seed']:.2f})"
    )
    hurried = new("full-rates")
    assert hurried["seeds"] - hurried["seeds_above_0_9"] == 2
    found["rates"] = f"by two of the ten (600 and 605, the worst {hurried['worst_seed']:.2f})"
    found["missed least"] = (
        f"Without hidden properties all ten are solved, {later('no-dropout')}, and the worst of "
        f"them reaches new kinds at {new('no-dropout')['worst_seed']:.2f}; with an early first "
        f"update all ten are, {later('warmup-1000')}, the worst at "
        f"{new('warmup-1000')['worst_seed']:.2f}."
    )
    pair = "no-dropout.warmup-1000"
    assert new(pair)["seeds_above_0_9"] == 8
    found["both of these"] = (
        f"Without both all ten are solved, {later(pair)}, but two of them (601 and 608) reach new "
        f"kinds at {new(pair)['worst_seed']:.2f} and"
    )
    return found


@pytest.mark.parametrize(("name", "sentence"), sentences().items(), ids=list(sentences()))
def test_results_state_what_the_slow_arms_rows_say(name: str, sentence: str) -> None:
    check_stated(name, sentence)
