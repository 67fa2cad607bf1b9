"""What README and RESULTS state is what the committed tables say: each sentence is made anew."""

from __future__ import annotations

import json
import re
from math import isfinite
from statistics import fmean, median

import pytest

from helpers.stated import (
    README,
    RESULTS,
    TABLES,
    check_stated,
    column,
    frames,
    rows,
    short_of,
    solved,
    span,
    summary,
)

KNOWN = (
    "eval", "only-color", "only-shape", "not-color", "not-shape",
    "blocks-2", "blocks-3", "blocks-5", "blocks-6", "blocks-8",
)  # fmt: skip
NEW = ("reach-new-shape", "reach-new-color", "reach-new-both")
SCORED = (*KNOWN, "ignore-new", *NEW, *(f"depth-{depth}" for depth in range(3, 7)))


def score(condition: dict[str, float]) -> str:
    return f"{condition['normalized']:.2f} [{condition['low']:.2f}, {condition['high']:.2f}]"


def both(conditions: list[dict[str, float]], field: str, between: str = ", ") -> str:
    return between.join(f"{condition[field]:.2f}" for condition in conditions)


def largest(name: str, field: str, *laws: str) -> float:
    """Of the differences that equal programs make."""
    return max(abs(float(row[field])) for row in rows(name) if row["law"] in laws)


def equal_programs() -> dict[str, str]:
    """What the laws cost by min and max."""
    rounded, none = ("double negation", "De Morgan"), "excluded middle"
    lattice = (
        "idempotent AND",
        "idempotent OR",
        "distributive AND",
        "distributive OR",
        "absorption",
    )
    order = ("commuted", "associated AND", "associated OR")
    ours = "equalities"
    for field in ("p", "action", "score"):
        assert largest(ours, field, *order, *lattice) == 0
        assert field != "score" or largest(ours, field, *rounded) == 0
    return {
        "laws": f"double negation and De Morgan change p by at most "
        f"{largest(ours, 'p', *rounded):.0e}, the action by at most "
        f"{largest(ours, 'action', *rounded):.0e} and no episode's reward",
        "excluded middle": f"changes p by at most {largest(ours, 'p', none):.3f}, and an agent's "
        f"mean reward per step by at most {largest(ours, 'mean_score', none):.3f}",
    }


def learned(name: str, end: str) -> str:
    """How many seeds of a table were solved at the end, and when."""
    seeds = [int(float(row["seed"])) for row in rows(f"{name}-seeds")]
    (trained,) = set(column(f"{name}-seeds", "frames"))
    assert f"{trained:,.0f}" == end
    held = span(column(f"{name}-seeds", "final_held_out"), ".2f")
    return (
        f"{solved(name)} of {len(seeds)} fresh seeds ({seeds[0]}–{seeds[-1]}) solved at the end of "
        f"{end} frames, held out {held}; median {median(frames(name)):,.0f} frames "
        f"({span(frames(name))})"
    )


def zero_shot(table: dict[str, dict[str, float]]) -> dict[str, str]:
    """What RESULTS says of one arm's conditions."""
    new = [table[name] for name in NEW]
    known = [table[name] for name in KNOWN if name != "eval"]
    deep = [table[f"depth-{n}"] for n in range(3, 7)]
    return {
        "known": f"{span([c['normalized'] for c in known], '.2f')} in each of 9 conditions (of the "
        f"agents in each, the worst {min(c['worst_seed'] for c in known):.2f})",
        "new distractors": f"{score(table['ignore-new'])}, worst agent "
        f"{table['ignore-new']['worst_seed']:.2f}; the best reference that ignores the program "
        f"gets {table['ignore-new']['blind_normalized']:.2f}",
        "new": f"{', '.join(map(score, new))}; worst agent {both(new, 'worst_seed')}; the best "
        f"reference that ignores the program gets {both(new, 'blind_normalized')}",
        "deep": f"{both(deep, 'normalized')} (ten agents; the worst "
        f"{min(c['worst_seed'] for c in deep):.2f})",
    }


def by_logic(arm: str) -> str:
    """What executing by sharper degrees and min and max changes, over all conditions."""
    ours, products = summary(arm), summary(f"{arm}.product")
    gains = [ours[name]["normalized"] - products[name]["normalized"] for name in SCORED]
    return (
        f"by {min(gains):+.3f} to {max(gains):+.3f} (the worst agent's, of any, from "
        f"{min(products[n]['worst_seed'] for n in SCORED):.2f} to "
        f"{min(ours[n]['worst_seed'] for n in SCORED):.2f})"
    )


def sentences() -> dict[str, str]:
    """Sentences with their numbers, as they must stand in RESULTS."""
    two, three = "programmable-2L", "programmable-3D"
    exact = frames("programmable-3D-exact")
    found = equal_programs() | {
        "2-L": learned(two, "30,000"),
        "3-D": learned(three, "60,000"),
        "2-L, slow": learned(f"{two}.paper-arm", "60,000"),
        "3-D, slow": learned(f"{three}.paper-arm", "100,000"),
        "exact": f"solved after {span(exact, ',.0f', ' to ')} frames",
        "logic": by_logic(""),
        "logic, slow": by_logic(".paper-arm"),
    }
    for arm in ("", ".paper-arm"):
        found |= {f"{name}{arm}": text for name, text in zero_shot(summary(arm)).items()}
    for design in ("2C", "3C"):
        held = span(column(f"canonical-{design}-seeds", "final_held_out"), ".2f")
        found[f"canonical {design}"] = f"after 40,000 frames {held}"
    canonical = "canonical-2L-seeds"
    found["canonical 2L"] = (
        f"train {span(column(canonical, 'final_train'), '.2f')}, held out "
        f"{span(column(canonical, 'final_held_out'), '.2f')}"
    )
    found["distilled"] = (
        f"2-L after {span(frames('distilled-2L'), ',.0f', ' to ')} frames, 3-D after "
        f"{span(frames('distilled-3D'), ',.0f', ' to ')}; without distillation the medians of ten "
        f"seeds are {median(frames(two)):,.0f} and {median(frames(three)):,.0f}"
    )
    later = [row for row in rows("forgetting") if float(row["frames"]) >= 100_000]
    kept = [(float(r["frames"]), float(r["train_greedy.normalized"])) for r in later]
    found["forgetting"] = (
        f"training programs {span([v for at, v in kept if at == 100_000], '.2f')} at the switch "
        f"and at least {min(v for _, v in kept):.2f} at any time after it, "
        f"{span([v for at, v in kept if at == 200_000], '.2f')} at the end"
    )
    table = f"{two}.panda"
    found["panda"] = (
        f"{solved(table)} of 3 seeds solved, after "
        f"{', '.join(f'{value:,.0f}' for value in frames(table))} of 30,000 frames, held out "
        f"{span(column(f'{table}-seeds', 'final_held_out'), '.2f')} at the end"
    )
    alone = short_of(f"{three}.no-relabel")
    assert list(alone) == [600, 601, 602, *range(606, 610)]
    found["relabeling"] = (
        f"600 to 602 and 606 to 609 are at {span([*alone.values()], '.2f', ' to ')}"
    )
    dull = short_of(f"{three}.detector-gain-1")
    assert list(dull) == [601, *range(603, 609)]
    found["detectors' rate"] = f"601 and 603 to 608 are at {span([*dull.values()], '.2f', ' to ')}"
    far, loud, coarse = (
        short_of(f"{three}.{tag}") for tag in ("discount-0.99", "noise-0.3", "position-scale-5")
    )
    assert (list(far), list(loud), list(coarse)) == ([607, 609], [605], [606])
    assert far[609] > 0.89 and loud[605] > 0.89
    found["short of it"] = (
        f"607 and 609 end below 0.9 ({far[607]:.2f} and just below), with its noise 605 (just "
        f"below), with coarser positions 606 ({coarse[606]:.2f})"
    )
    worst = summary(".no-sparsity")["reach-new-both"]["worst_seed"]
    found["new, not sparse"] = f"and {worst:.2f})"
    pair = rows("canonical-2L.paper-protocol-seeds")
    assert [row["frames"] for row in pair] == ["2e+06", "2e+06"]
    trained, held = (
        " and ".join(f"{float(row[of]):.2f}".replace("-", "−") for row in pair)
        for of in ("final_train", "final_held_out")
    )
    found["paper, canonical 2-L"] = f"all 2M frames: train {trained}, held out {held} | holds"
    long, second = rows("programmable-3D.paper-protocol-seeds")
    found["paper 3-D, second seed"] = (
        f"Seed 1, to {float(second['frames']) / 1e6:.2f}M: train {float(second['final_train']):.2f}"
        f", held out {float(second['final_held_out']):.2f}; first at 0.9, to stay, after "
        f"{float(second['frames_to_solve']):,.0f} frames"
    )
    table = "canonical-2C.paper-protocol"
    each = []
    for seed in rows(f"{table}-seeds"):
        good = [
            float(row["frames"]) for row in rows(table)
            if row["seed"] == seed["seed"] and float(row["train_greedy.normalized"]) >= 0.9
        ]  # fmt: skip
        each.append((float(seed["final_held_out"]), good[0], float(seed["frames_to_solve"])))
    (end, first, stays), (end_1, first_1, stays_1) = each
    found["paper 2-C"] = (
        f"all 2M frames: seed 0, {end:.2f} on 100 fresh episodes, first at 0.9 after "
        f"{first / 1e6:.2f}M frames, to stay after {stays / 1e6:.1f}M; seed 1, {end_1:.2f}, first "
        f"at 0.9 after {first_1 / 1e6:.2f}M, to stay after {stays_1 / 1e6:.1f}M | holds |"
    )
    found["paper 3-D"] = (
        f"to {float(long['frames']) / 1e6:.2f}M of 5M frames, where the hours ended: train "
        f"{float(long['final_train']):.2f}, held out {float(long['final_held_out']):.2f}"
    )
    return found


@pytest.mark.parametrize(("name", "sentence"), sentences().items(), ids=list(sentences()))
def test_results_state_what_the_tables_say(name, sentence):
    check_stated(name, sentence)


def test_readme_states_what_the_tables_say():
    for name in ("programmable-2L", "programmable-3D"):
        for arm in ("", ".paper-arm"):
            table = f"{name}{arm}"
            line = f"| {solved(table)} of 10 | {median(frames(table)):,.0f} |"
            assert line in README, f"the tables say: {line}"


def cells(text: str) -> list[list[str]]:
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines()]


def table_below(heading: str) -> list[list[str]]:
    """The first table below a line that begins so, without its head."""
    after = RESULTS[RESULTS.index(heading) :]
    lines = re.search(r"(?:^\|.*\n)+", after, re.M)
    return cells(lines[0].rstrip())[2:]


def shown(row: dict[str, str]) -> list[str]:
    """Solved, median and held out of a row of variants, as RESULTS writes them."""
    frames_ = float(row["frames_to_solve"])
    return [
        f"{row['solved']} of {row['seeds']}",
        f"{frames_:,.0f}" if isfinite(frames_) else "–",
        f"{float(row['held_out']):.2f}",
    ]


SIX_DIGITS = 1e-5  # as tables have numbers

VARIANTS = {
    "## What matters": "programmable-3D",
    "### On the slow arm": "programmable-3D.paper-arm",
}


@pytest.mark.parametrize(("heading", "name"), VARIANTS.items(), ids=list(VARIANTS.values()))
def test_what_matters_has_a_row_for_each_variant_with_its_numbers(heading, name):
    expected = []
    for row in rows(f"{name}-variants"):
        of = row["label"].removeprefix("programmable-3D")
        changed = row["label"] != name
        new = summary(of)["reach-new-both"]["normalized"] if changed else None
        expected.append([*shown(row), f"{new:.2f}" if changed else "–"])
    assert sorted(expected) == sorted(row[1:] for row in table_below(heading))


@pytest.mark.parametrize("name", VARIANTS.values())
def test_variants_are_made_of_the_seeds_tables(name):
    for row in rows(f"{name}-variants"):
        held = column(f"{row['label']}-seeds", "held_out_at_end")
        if len(held) == int(row["seeds"]) and float(row["frames"]) == float(
            rows(f"{row['label']}-seeds")[0]["frames"]
        ):
            stated = float(row["held_out"])
            assert fmean(held) == pytest.approx(stated, rel=SIX_DIGITS), row["label"]


def test_other_libraries_have_the_rows_that_were_measured():
    stated = json.loads((TABLES / "peers.json").read_text())
    names = [key.split(".")[1] for key in stated if key.endswith(".seeds")]

    def successes(row: str) -> str:
        at = f"peers.{row}"
        return f"{stated[f'{at}.train_success']:.0%}, {stated[f'{at}.held_out_success']:.0%}"

    expected = [
        [
            name,
            successes(f"{name}.at_15000"),
            successes(f"{name}.in_time") if f"peers.{name}.in_time.frames" in stated else "–",
            successes(name),
            f"{stated[f'peers.{name}.seconds']:,.0f}",
        ]
        for name in names
    ]
    assert sorted(expected) == sorted(table_below("## Beside other libraries"))
    assert f"in the {stated['peers.ours.at_15000.seconds']:.0f} s" in RESULTS


def test_the_summary_is_of_these_tables():
    stated = json.loads((TABLES / "summary.json").read_text())
    for design, name in (("2-L", "programmable-2L"), ("3-D", "programmable-3D")):
        for arm, table in (("", name), (".paper-arm", f"{name}.paper-arm")):
            assert stated[f"solved.{design}{arm}"] == solved(table)
            assert stated[f"frames_to_solve.{design}{arm}.median"] == median(frames(table))
