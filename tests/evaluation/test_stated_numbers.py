"""What README and RESULTS state is what the committed tables say: each sentence is made anew."""

from __future__ import annotations

import csv
import json
import re
from math import inf, isfinite
from pathlib import Path
from statistics import fmean, median

import pytest

ROOT = Path(__file__).parents[2]
TABLES = ROOT / "docs/results"
RESULTS, README = (ROOT / "RESULTS.md").read_text(), (ROOT / "README.md").read_text()
KNOWN = (
    "eval", "only-color", "only-shape", "not-color", "not-shape",
    "blocks-2", "blocks-3", "blocks-5", "blocks-6", "blocks-8",
)  # fmt: skip
NEW = ("reach-new-shape", "reach-new-color", "reach-new-both")
SCORED = (*KNOWN, "ignore-new", *NEW, *(f"depth-{depth}" for depth in range(3, 7)))


def rows(name: str) -> list[dict[str, str]]:
    with (TABLES / f"{name}.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def column(name: str, field: str) -> list[float]:
    return [float(row[field]) for row in rows(name)]


def solved(name: str) -> int:
    """Seeds that are at 0.9 at the end, on the episodes used for nothing else."""
    return sum(score >= 0.9 for score in column(f"{name}-seeds", "final_held_out"))


def frames(name: str) -> list[float]:
    return [
        inf if value != value else value for value in column(f"{name}-seeds", "frames_to_solve")
    ]


def seconds(name: str) -> str:
    spent = [s for s in column(f"{name}-seeds", "wall_s_to_solve") if isfinite(s)]
    return f"{min(spent):.0f}–{max(spent):.0f} s"


def span(values: list[float], form: str = ",.0f", between: str = "–") -> str:
    found = [value for value in values if isfinite(value)]
    return f"{min(found):{form}}{between}{max(found):{form}}"


def summary(arm: str = "") -> dict[str, dict[str, float]]:
    found = rows(f"generalization-summary{arm}")
    return {
        row["condition"]: {k: float(v) for k, v in row.items() if k not in ("condition", "blind")}
        for row in found
    }


def score(condition: dict[str, float]) -> str:
    return f"{condition['normalized']:.2f} [{condition['low']:.2f}, {condition['high']:.2f}]"


def both(conditions: list[dict[str, float]], field: str, between: str = ", ") -> str:
    return between.join(f"{condition[field]:.2f}" for condition in conditions)


def largest(name: str, field: str, *laws: str) -> float:
    """Of the differences that equal programs make."""
    return max(abs(float(row[field])) for row in rows(name) if row["law"] in laws)


def equal_programs() -> dict[str, str]:
    """What the laws cost by min and max, and by products."""
    rounded, none = ("double negation", "De Morgan"), "excluded middle"
    lattice = (
        "idempotent AND",
        "idempotent OR",
        "distributive AND",
        "distributive OR",
        "absorption",
    )
    order = ("commuted", "associated AND", "associated OR")
    ours, products = "equalities", "equalities.product"
    for field in ("p", "action", "score"):
        assert largest(ours, field, *order, *lattice) == 0
        assert field != "score" or largest(ours, field, *rounded) == 0
    mean = [largest(products, "mean_score", law) for law in lattice]
    return {
        "laws": f"double negation and De Morgan change p by at most "
        f"{largest(ours, 'p', *rounded):.0e}, the action by at most "
        f"{largest(ours, 'action', *rounded):.0e} and no episode's reward",
        "excluded middle": f"changes p by at most {largest(ours, 'p', none):.2f}, and an agent's "
        f"mean reward per step by at most {largest(ours, 'mean_score', none):.2f}",
        "laws by products": "double negation, De Morgan, order and grouping change p by at most "
        f"{largest(products, 'p', *rounded, *order):.0e}; idempotence, distribution and absorption "
        f"change p by at most {largest(products, 'p', *lattice):.2f}, and an agent's mean reward "
        f"per step by at most {mean[0]:.2f} (`AND(e, e)`, which squares p), {mean[1]:.2f} "
        f"(`OR(e, e)`), {max(mean[2:4]):.2f} and {mean[4]:.2f}",
    }


def sentences() -> dict[str, str]:
    """Sentences with their numbers, as they must stand in RESULTS."""
    two, three = "programmable-2L", "programmable-3D"
    fast, slow = summary(), summary(".paper-arm.product")
    by_products = summary(".product")
    gains = [fast[name]["normalized"] - by_products[name]["normalized"] for name in SCORED]
    new, slow_new = [fast[name] for name in NEW], [slow[name] for name in NEW]
    known = [fast[name] for name in KNOWN if name != "eval"]
    slow_known = [slow[name] for name in KNOWN if name != "eval"]
    exact = frames("programmable-3D-exact")
    found = equal_programs() | {
        "2-L": f"{solved(two)} of 10 fresh seeds solved, median {median(frames(two)):,.0f} frames "
        f"({span(frames(two))}), {seconds(two)} each",
        "3-D": f"{solved(three)} of 10 fresh seeds (90–99) solved at the end of 100,000 frames, "
        f"median {median(frames(three)):,.0f} frames (nine from "
        f"{span(frames(three), ',.0f', ' to ')}, {seconds(three)} each; ",
        "3-D, seed 95": f"ends at {column(f'{three}-seeds', 'final_held_out')[5]:.2f})",
        "exact": f"solved after {span(exact, ',.0f', ' to ')} frames",
        "new distractors": f"{score(fast['ignore-new'])}, worst agent "
        f"{fast['ignore-new']['worst_seed']:.2f}; the best reference that ignores the program "
        f"gets {fast['ignore-new']['blind_normalized']:.2f}",
        "new": f"{', '.join(map(score, new))}; worst agent {both(new, 'worst_seed')}; the best "
        f"reference that ignores the program gets {both(new, 'blind_normalized')}",
        "known": f"{span([c['normalized'] for c in known], '.2f')} in each of 9 conditions (of the "
        f"agents in each, the worst {min(c['worst_seed'] for c in known):.2f})",
        "known, slow": f"{span([c['normalized'] for c in slow_known], '.2f')} in the 9 known "
        f"conditions (of the agents in each, the worst "
        f"{min(c['worst_seed'] for c in slow_known):.2f}); new kinds as distractors "
        f"{score(slow['ignore-new'])}; new shape {score(slow_new[0])}, color "
        f"{score(slow_new[1])}, both {score(slow_new[2])}, worst agent "
        f"{both(slow_new, 'worst_seed')}",
        "logic": f"change the mean of a condition by {min(gains):+.3f} to {max(gains):+.3f} "
        f"(the worst agent's, of any, from {min(by_products[n]['worst_seed'] for n in SCORED):.2f} "
        f"to {min(fast[n]['worst_seed'] for n in SCORED):.2f})",
        "deep": "programs of depth 3 to 6 score "
        f"{both([fast[f'depth-{n}'] for n in range(3, 7)], 'normalized')} (ten agents; the worst "
        f"{min(fast[f'depth-{n}']['worst_seed'] for n in range(3, 7)):.2f})",
        "deep, slow": "On the slow arm "
        f"{both([slow[f'depth-{n}'] for n in range(3, 7)], 'normalized')} (the worst "
        f"{min(slow[f'depth-{n}']['worst_seed'] for n in range(3, 7)):.2f})",
    }
    for name, arm in ((two, "2-L"), (three, "3-D")):
        table = f"{name}.paper-arm"
        held = span(column(f"{table}-seeds", "final_held_out"), ".2f")
        found[f"{arm}, slow"] = (
            f"{solved(table)} of 10 fresh seeds (120–129) solved at the end of 150,000 frames, "
            f"held out {held}; median {median(frames(table)):,.0f} frames ({span(frames(table))})"
        )
    for design in ("2C", "3C"):
        held = span(column(f"canonical-{design}-seeds", "final_held_out"), ".2f")
        found[f"canonical {design}"] = f"after 40,000 frames {held}"
    canonical = "canonical-2L-seeds"
    found["canonical 2L"] = (
        f"train {span(column(canonical, 'final_train'), '.2f')}, held out "
        f"{span(column(canonical, 'final_held_out'), '.2f')}"
    )
    distilled = {frames_ for frames_ in frames("distilled-3D")}
    found["distilled"] = (
        f"2-L after {span(frames('distilled-2L'), ',.0f', ' to ')} frames, 3-D after "
        f"{distilled.pop():,.0f} each; without distillation the medians of ten seeds are "
        f"{median(frames(two)):,.0f} and {median(frames(three)):,.0f}"
    )
    for other in ("panda", "td3"):
        table = f"{two}.{other}"
        found[other] = (
            f"{solved(table)} of 3 seeds solved, after "
            f"{', '.join(f'{value:,.0f}' for value in frames(table))} of 30,000 frames, held out "
            f"{span(column(f'{table}-seeds', 'final_held_out'), '.2f')} at the end"
        )
    long = rows("programmable-3D.paper-protocol-seeds")[0]
    found["paper 3-D"] = (
        f"to {float(long['frames']) / 1e6:.2f}M of 5M frames, where the hours ended: train "
        f"{float(long['final_train']):.2f}, held out {float(long['final_held_out']):.2f}"
    )
    return found


@pytest.mark.parametrize(("name", "sentence"), sentences().items(), ids=list(sentences()))
def test_results_state_what_the_tables_say(name, sentence):
    assert sentence in " ".join(RESULTS.split()), f"{name}: the tables say: {sentence}"


def test_readme_states_what_the_tables_say():
    two, three = "programmable-2L", "programmable-3D"
    for line in (
        f"{solved(two)} of 10, median {median(frames(two)):,.0f} frames, {seconds(two)} each",
        f"{solved(three)} of 10, median {median(frames(three)):,.0f} frames, nine of them in "
        f"{seconds(three)}",
    ):
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


def test_what_matters_has_a_row_for_each_variant_with_its_numbers():
    variants = [
        row for row in rows("programmable-3D-variants") if not re.search(r"\.k\d", row["label"])
    ]
    stated = table_below("## What matters")
    assert sorted(shown(row) for row in variants) == sorted(row[1:] for row in stated)


def test_the_table_of_programs_for_each_transition():
    stated = {row[0]: row[1:] for row in table_below("Programs for each transition")}
    one = {"1": "one-program", "2": "", "4": "k4", "8": "k8"}
    for place, (design, first) in enumerate((("2L", "k1"), ("3D", "one-program"))):
        variants = {row["label"]: row for row in rows(f"programmable-{design}-variants")}
        for programs, tag in {**one, "1": first}.items():
            row = variants[f"programmable-{design}{'.' * bool(tag)}{tag}"]
            expected = f"{', '.join(shown(row)[:2])}, {float(row['wall_s_to_solve']):.0f} s"
            assert stated[programs][place] == expected


@pytest.mark.parametrize("design", ["2-L", "3-D"])
@pytest.mark.parametrize("arm", ["fast", "slow"])
def test_the_small_recipes_rows_are_those_of_its_seeds(design, arm):
    name = f"programmable-{design.replace('-', '')}.small-protocol"
    name += ".paper-arm" if arm == "slow" else ""
    found = [row for row in table_below("It was chosen on") if row[:2] == [design, arm]]
    assert (TABLES / f"{name}-seeds.csv").exists() == bool(found)
    for row in found:
        assert [float(value["seed"]) for value in rows(f"{name}-seeds")] == [*range(400, 410)]
        (trained,) = {float(value["frames"]) for value in rows(f"{name}-seeds")}
        assert row[2:] == [
            f"{trained:,.0f}",
            f"{solved(name)} of 10",
            f"{median(frames(name)):,.0f} ({span(frames(name))})",
            span(column(f"{name}-seeds", "final_held_out"), ".2f"),
        ]


def test_variants_are_made_of_the_seeds_tables():
    for row in rows("programmable-3D-variants"):
        held = column(f"{row['label']}-seeds", "held_out_at_end")
        if len(held) == int(row["seeds"]) and float(row["frames"]) == float(
            rows(f"{row['label']}-seeds")[0]["frames"]
        ):
            assert fmean(held) == pytest.approx(float(row["held_out"]), abs=2e-6), row["label"]


def test_the_summary_is_of_these_tables():
    stated = json.loads((TABLES / "summary.json").read_text())
    for design, name in (("2-L", "programmable-2L"), ("3-D", "programmable-3D")):
        for arm, table in (("", name), (".paper-arm", f"{name}.paper-arm")):
            assert stated[f"solved.{design}{arm}"] == solved(table)
            assert stated[f"frames_to_solve.{design}{arm}.median"] == median(frames(table))


def test_the_learners_rates_are_those_of_its_table():
    stated = json.loads((TABLES / "learner.json").read_text())
    figures = re.search(r"\| ([\d,]+); straightforward PyTorch (\d+), [^|]*DDPG (\d+) \|", README)
    rounded = {f"{value:,.0f}" for value in stated.values() if isinstance(value, float)}
    assert set(figures.groups()) <= rounded, f"the table has {sorted(rounded)}"
