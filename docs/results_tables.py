"""Fill the tables of RESULTS.md and README.md from docs/results, and write the model cards of the
shipped agents: `make results`.

A table lies between `<!-- results: NAME -->` and `<!-- end -->`; NAME is one of TABLES.
"""

from __future__ import annotations

import csv
import json
import math
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from statistics import fmean, median
from typing import Any

import numpy as np

from laboratory.studies.cards import model_card, read_report
from laboratory.studies.detectors import Accuracy
from laboratory.studies.equalities import Difference
from laboratory.studies.experiments import SeedSummary
from laboratory.studies.generalization import Summary
from laboratory.studies.generalization_figures import in_words
from laboratory.studies.tables import read_rows
from laboratory.studies.variants import Variant
from laboratory.studies.zones import CONDITIONS as ZONE_CONDITIONS
from laboratory.studies.zones import NUMBERED, TracesRow
from pa_ros.arena import design_named
from pa_ros.evaluation.conditions import CONDITIONS
from pa_ros.evaluation.pushing import EndsRow
from pa_ros.learning.checkpoint_files import SHIPPED
from pa_ros.perception import VIEWS

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "docs/results"
PAGES = (ROOT / "RESULTS.md", ROOT / "README.md")

# Tables of seeds by what they show; the words are the first cell.
SEEDS = {
    "programmable-2L": "2-L, fast arm",
    "programmable-2L.paper-arm": "2-L, slow arm",
    "programmable-2L.panda": "2-L, Panda (7 joints)",
    "programmable-3D": "3-D, fast arm",
    "programmable-3D.paper-arm": "3-D, slow arm",
    "programmable-3D-exact": "3-D without spare words",
    "relations-3D": "3-D, six relations",
    "relations-3D.paper-arm": "3-D, six relations, slow arm",
    "camera-2L": "2-L, seen by a camera",
    "camera-3D": "3-D, seen by a camera",
    "corner-3D": "3-D, seen from a corner",
    "both-3D": "3-D, seen from above and a corner",
    "distilled-2L": "2-L, distilled critic",
    "distilled-3D": "3-D, distilled critic",
    "canonical-2L": "2-L, canonical",
    "canonical-2C": "2-C, canonical",
    "canonical-3C": "3-C, canonical",
    "programmable-2L.paper-recipe": "2-L, `paper`",
    "programmable-3D.paper-recipe": "3-D, `paper`",
    "canonical-2L.paper-recipe": "2-L, canonical, `paper`",
    "canonical-2C.paper-recipe": "2-C, canonical, `paper`",
    "push-2": "push-2",
    "push-3D": "push-3D",
    "push-2-pairs": "push-2, also trained on pairs of blocks",
    "push-2-sides": "push-2, five relations",
    "push-2.push-joints-arm": "push-2, joint velocities",
    "push-2.push-slow-arm.longer": "push-2, slow arm",
    "stack-2": "stack-2",
}
HEADLINES = {  # on the front page: design and arm
    "programmable-2L": ("2-L: 2 shapes × 2 colors, one pair held out", "fast"),
    "programmable-3D": ("3-D: 3 × 3, the diagonal held out", "fast"),
    "programmable-2L.paper-arm": ("2-L", "slow"),
    "programmable-3D.paper-arm": ("3-D", "slow"),
    "push-2": ("push-2: blocks are pushed to disks", "fast"),
    "stack-2": ("stack-2: blocks are taken, and put on disks and on blocks", "fast"),
}
ARMS = {"": "fast", ".paper-arm": "slow"}
METHODS = {  # methods of the benchmark `baselines`
    "ours": "ours",
    "true-properties": "true properties in place of detectors (upper bound)",
    "film-transformer": "Transformer, the program by FiLM",
    "deep-sets": "DeepSets, one-hot goal",
    "canonical": "canonical (paper)",
    "sac": "SAC, one-hot goal",
}
FACED = {  # conditions of the benchmark `baselines`
    "train": "trained",
    "eval": "held out",
    "word-1": "one word, one block",
    "word-2": "two blocks",
    "word-3": "three",
    "ignore-new": "new kinds beside it",
    "reach-new-both": "new kind",
    "depth-6": "6 deep",
}
ONE_PROPERTY = (
    *(f"{role}-{way}" for role in ("moved", "target") for way in (
        "only-color", "only-shape", "not-color", "not-shape", "or")),
    "depth-3",
)  # fmt: skip
NEW = tuple(f"{role}-new-{group}" for role in ("moved", "target") for group in ("color", "shape"))
BETWEEN = tuple(f"pairs-{side}" for side in ("left-of", "right-of", "behind", "in-front-of"))
BLOCKS = tuple(f"blocks-{count}" for count in (2, 3, 4, 5, 6))
CLAIMS = (  # in words, aim, table, conditions
    ("trained pairs", 0.97, "push-2", ("train",)),
    ("held-out pairs", 0.95, "push-2", ("eval",)),
    ("to another block, trained on places alone", 0.85, "push-2", ("pairs",)),
    ("to another block, trained too: held-out pairs", 0.93, "push-2-pairs", ("pairs-eval",)),
    ("one property, NOT, OR in either argument, depth 3", 0.9, "push-2", ONE_PROPERTY),
    ("3 and 4 blocks on the table", 0.85, "push-2", BLOCKS),
    ("reaching, of the script's score", 0.95, "push-2", ("reach", "reach-eval")),
    ("trained pairs, 3 × 3 kinds", 0.97, "push-3D", ("train",)),
    ("held-out pairs, 3 × 3 kinds", 0.95, "push-3D", ("eval",)),
    ("to another block, 3 × 3 kinds", 0.85, "push-3D", ("pairs",)),
    ("one property, NOT, OR, depth 3, 3 × 3 kinds", 0.9, "push-3D", ONE_PROPERTY),
    ("3 to 6 blocks on the table", 0.85, "push-3D", BLOCKS),
    ("new shape or color in either argument", 0.8, "push-3D", NEW),
    ("other relations between blocks", 0.85, "push-2-sides", BETWEEN),
    ("joint velocities, to places", 0.9, "push-2.push-joints-arm", ("eval",)),
    ("joint velocities, to blocks", 0.85, "push-2.push-joints-arm", ("pairs",)),
    ("slow arm", 0.85, "push-2.push-slow-arm.longer", ("eval",)),
)
STACKING = (  # likewise
    ("a training block on a place or block", 0.97, "stack-2", ("train",)),
    ("a held-out block on a place", 0.97, "stack-2", ("eval",)),
    ("any block on a place", 0.98, "stack-2", ("place",)),
    ("a training block on another", 0.97, "stack-2", ("pairs-train",)),
    ("a held-out block on another", 0.95, "stack-2", ("pairs-eval",)),
    ("one property, NOT, OR in either argument, depth 3", 0.9, "stack-2", ONE_PROPERTY),
    ("2 to 4 blocks on the table (of 3 × 3 kinds: 2 to 6)", 0.9, "stack-2", BLOCKS),
    ("a tower of three, never trained", 0.93, "stack-2", ("tower-3",)),
    ("a tower of four, never trained", 0.75, "stack-2", ("tower-4",)),
    ("a tower taken down, and built in another order", 0.85, "stack-2", ("rebuild-3",)),
    ("a table sorted by color", 0.85, "stack-2", ("sort-3",)),
    ("a held-out block in the hand", 0.95, "stack-2", ("hold-eval",)),
    ("reaching, of the script's score", 0.95, "stack-2", ("reach", "reach-eval")),
)
STACKING_ARMS = {
    "stack-2": "fast",
    "stack-3D": "fast, 3 × 3 kinds",
    "stack-2.hold-slow-arm": "slow",
    "stack-2.panda": "Panda",
}
NETWORKS_ALONE = (  # in words, condition
    ("a held-out block on a place", "eval"),
    ("a held-out block on another", "pairs-eval"),
    ("a tower of three", "tower-3"),
)
ZONES = (  # in words, aim, conditions
    ("any zone", 0.99, ("reach",)),
    ("one zone in the way, trained pairs", 0.0, ("blocked",)),
    ("one zone in the way, held-out pairs", 0.97, ("blocked-pairs",)),
    ("formulas", 0.98, NUMBERED),
    ("formulas, blocked", 0.96, [one for one in ZONE_CONDITIONS if one.endswith("-blocked")]),
    *((f"formula {one.removeprefix('formula-')}", 0.0, (one,)) for one in NUMBERED),
    ("the better of two first", 0.0, ("non-myopic",)),
)
KEPT, LOWEST = ("train", "eval"), 6  # conditions on a card, and how many of the others
NOTHING = "–"  # not measured


def table(head: Sequence[str], rows: Iterable[Sequence[str]], missing: Sequence[str] = ()) -> str:
    """A table in Markdown, and a line with the rows that are not measured yet."""
    found = list(rows)
    lines = [head, ["---"] * len(head), *found] if found else []
    text = "".join(f"| {' | '.join(cells)} |\n" for cells in lines)
    gap = "\n" if found and missing else ""
    return text + gap + (f"Not measured yet: {'; '.join(missing)}.\n" if missing else "")


def span(values: Sequence[float], form: str) -> str:
    """The smallest and the largest value; one value if they look alike."""
    low, high = f"{min(values):{form}}", f"{max(values):{form}}"
    text = low if low == high else f"{low} to {high}"
    return text.replace("-0.00 ", "0.00 ").replace("-", "−")


def share_interval(successes: int, count: int) -> tuple[float, float]:
    """The 95 % interval of a share of independent trials (Clopper and Pearson 1934)."""

    def at_most(k: int, p: float) -> float:
        return sum(math.comb(count, i) * p**i * (1.0 - p) ** (count - i) for i in range(k + 1))

    def where(tail: Callable[[float], float]) -> float:
        """Where a falling function of the share is 0.025."""
        low, high = 0.0, 1.0
        for _ in range(50):
            middle = (low + high) / 2
            low, high = (middle, high) if tail(middle) > 0.025 else (low, middle)
        return low

    lowest = 1.0 - where(lambda p: at_most(count - successes, p)) if successes else 0.0
    highest = where(lambda p: at_most(successes, p)) if successes < count else 1.0
    return lowest, highest


def solved_of(seeds: Sequence[SeedSummary]) -> str:
    """How many seeds are solved, with the interval of the share."""
    solved, count = sum(s.solved for s in seeds), len(seeds)
    low, high = share_interval(solved, count)
    return f"{solved} of {count} ({low:.0%} to {high:.0%})"


def seeds_of(label: str) -> list[SeedSummary]:
    return read_rows(RESULTS / f"{label}-seeds.csv", SeedSummary)


def solve_frames(label: str) -> str:
    """Median and range of the frames to solve; a seed that is not solved counts as infinite."""
    frames = [math.inf if math.isnan(s.frames_to_solve) else s.frames_to_solve
              for s in seeds_of(label)]  # fmt: skip
    if len(frames) < 3 or not math.isfinite(median(frames)):
        known = sorted(f for f in frames if math.isfinite(f))
        return ", ".join(f"{f:,.0f}" for f in known) or NOTHING
    return f"{median(frames):,.0f} ({span(frames, ',.0f')})".replace("inf", "never")


def seeds() -> str:
    rows = [(words, *_of_seeds(label)) for label, words in SEEDS.items()]
    return table(("", "Solved", "Frames", "Frames to solve", "Held out", "Trained"), rows)


def _of_seeds(label: str) -> list[str]:
    own = seeds_of(label)
    held_out = design_named(json.loads((RESULTS / f"{label}.json").read_text())["design"]).held_out
    return [
        solved_of(own),
        span([s.frames for s in own], ",.0f"),
        solve_frames(label),
        span([s.final_held_out for s in own], ".2f") if held_out else NOTHING,
        span([s.final_train for s in own], ".2f"),
    ]


def headline() -> str:
    rows = []
    for label, (design, arm) in HEADLINES.items():
        frames = solve_frames(label).partition(" ")[0]
        rows.append((design, arm, solved_of(seeds_of(label)), frames))
    return table(("Design", "Arm", "Solved", "Median frames until solved"), rows)


def summaries(suffix: str) -> dict[str, Summary]:
    rows = read_rows(RESULTS / f"generalization-summary{suffix}.csv", Summary)
    return {row.condition: row for row in rows}


def measured(tables: Sequence[dict[str, Summary]]) -> list[str]:
    """Conditions that all of these tables have, in their usual order."""
    return [name for name in CONDITIONS if all(name in found for found in tables)]


def conditions() -> str:
    """Agents of 3-D by arm, and those that see."""
    arms = [summaries(suffix) for suffix in (*ARMS, ".camera-3D")]
    rows = []
    for name in measured(arms[: len(ARMS)]):
        cells = [in_words(name)]
        for arm in arms:
            row = arm.get(name)
            score = row and f"{row.normalized:.2f} [{row.low:.2f}, {row.high:.2f}]"
            cells += [score or NOTHING, f"{row.worst_seed:.2f}" if row else NOTHING]
        rows.append([cell.replace("-0.", "−0.") for cell in cells])
    head = [""]
    for arm_name in (*(f"{name} arm" for name in ARMS.values()), "camera"):
        head += [arm_name, "worst agent"]
    return table(head, rows)


def views() -> str:
    """Agents that see, by what they see through: the conditions that all of them have."""
    found, rows = {name: summaries(f".{name}-3D") for name in VIEWS}, []
    for condition in measured(list(found.values())):
        cells = [in_words(condition)]
        for seen in found.values():
            row = seen[condition]
            cells += [f"{row.normalized:.2f} [{row.low:.2f}, {row.high:.2f}]"]
            cells += [f"{row.worst_seed:.2f}"]
        rows.append(cells)
    return table(["", *(cell for name in VIEWS for cell in (f"`{name}`", "worst agent"))], rows)


def relations() -> str:
    """Agents of six relations: each relation with trained kinds, held-out kinds, and trained kinds
    that it was never combined with."""
    found, rows = summaries(".relations-3D"), []
    for name in ("", *design_named("3-D-relations").vocabulary.relations):
        cells = [name or "all"]
        for way in ("train", "eval", "eval-combinations"):
            row = found["-".join(filter(None, [way, name.lower().replace("_", "-")]))]
            cells.append(f"{row.normalized:.2f} [{row.low:.2f}, {row.high:.2f}]")
            cells.append(f"{row.worst_seed:.2f}")
        rows.append(cells)
    head = ["", "trained", "worst agent", "held-out kinds", "worst agent", "held-out combinations"]
    return table([*head, "worst agent"], rows)


def detectors() -> str:
    """Mean degrees by word; the words of training together, as a range."""
    found = read_rows(RESULTS / "detectors.csv", Accuracy)
    seen = [row for row in found if row.seen and row.condition == "eval"]
    groups = {"words of training": seen}
    groups |= {word: [row for row in found if row.word == word]
               for word in ("new shape", "new color")}  # fmt: skip
    rows = []
    for name, own in groups.items():
        words = dict.fromkeys(row.word for row in own)
        means = [
            [fmean(getattr(row, column) for row in own if row.word == word) for word in words]
            for column in ("on", "best_distractor", "separated")
        ]
        rows.append((name, span(means[0], ".3f"), span(means[1], ".3f"), span(means[2], ".0%")))
    return table(("", "Blocks that have it", "Highest other block", "In this order"), rows)


def equalities() -> str:
    """The largest differences by law; laws that change nothing at all share a row."""
    found = read_rows(RESULTS / "equalities.csv", Difference)
    laws: dict[tuple[str, ...], list[str]] = {}
    for law in dict.fromkeys(row.law for row in found):
        own = [row for row in found if row.law == law]
        largest = [max(abs(getattr(row, name)) for row in own)
                   for name in ("p", "action", "score", "mean_score")]  # fmt: skip
        laws.setdefault(tuple(f"{value:.1g}" for value in largest), []).append(law)
    rows = [(", ".join(names), *values) for values, names in laws.items()]
    return table(("Laws", "p", "Action", "An episode's reward", "Mean reward"), rows)


def variants() -> str:
    """Agents of 3-D that learned with one setting undone, by tag and arm."""
    rows: dict[str, list[str]] = {}
    for suffix in ARMS:
        name = f"programmable-3D{suffix}"
        for row in read_rows(RESULTS / f"{name}-variants.csv", Variant):
            tag = row.label.removeprefix(name).strip(".")
            new = summaries(f"{suffix}.{tag}" if tag else suffix)["reach-new-both"]
            undone = f"`{options(row.changed)}`" if tag else "nothing"
            cells = rows.setdefault(tag, [f"`{tag}`" if tag else NOTHING, undone])
            cells += [f"{row.solved}", f"{row.held_out:.2f}", f"{new.normalized:.2f}"]
    head = ["`--tag`", "Undone by"]
    for arm in ARMS.values():
        head += [f"{arm}: solved of 10", "held out", "both new"]
    return table(head, [rows[tag] for tag in sorted(rows)])


def options(changed: str) -> str:
    """Settings as options of a command; what follows from another one is left out."""
    named = [one.partition("=") for one in changed.split() if "critic_output_bias" not in one]
    return " ".join(f"--{name} {value}" for name, _, value in named)


def peers() -> str:
    found = json.loads((RESULTS / "peers.json").read_text())
    names = dict.fromkeys(key.split(".")[1] for key in found if key.startswith("peers."))

    def shares(key: str) -> str:
        if f"{key}.train_success" not in found:
            return "–"
        return ", ".join(f"{found[f'{key}.{part}_success']:.0%}" for part in ("train", "held_out"))

    rows = [
        (name, shares(f"peers.{name}.at_15000"), shares(f"peers.{name}.in_time"),
         shares(f"peers.{name}"), f"{found[f'peers.{name}.seconds']:,.0f}")
        for name in sorted(names, key=lambda name: (name != "ours", name))
    ]  # fmt: skip
    seconds = found["peers.ours.in_time.seconds"]
    head = ("", "15,000 frames", f"in {seconds:.0f} s", "60,000 frames", "seconds for these")
    return table(head, rows)


def baselines() -> str:
    """Shares of episodes that end satisfied: mean over seeds with its interval."""
    path, rows = RESULTS / "baselines.csv", []
    found = list(csv.DictReader(path.read_text().splitlines())) if path.exists() else []
    conditions = [name for name in FACED if any(row["condition"] == name for row in found)]
    for method, words in METHODS.items():
        own = [row for row in found if row["method"] == method]
        cells = [
            mean_of([float(row["success"]) for row in own if row["condition"] == name])
            for name in conditions
        ]
        if own:
            rows.append((words, f"{len({row['seed'] for row in own})}", *cells))
    measured = {row["method"] for row in found}
    missing = [words for method, words in METHODS.items() if method not in measured]
    return table(("", "Seeds", *(FACED[name] for name in conditions)), rows, missing)


def ends_of(label: str) -> list[EndsRow]:
    """How episodes ended by seed and condition; empty: not measured."""
    path = RESULTS / f"{label}-conditions.csv"
    return read_rows(path, EndsRow) if path.exists() else []


def by_seed(rows: Iterable[EndsRow], measure: str) -> list[float]:
    """The mean over episodes of each seed."""
    found: dict[int, list[EndsRow]] = {}
    for row in rows:
        found.setdefault(row.seed, []).append(row)
    return [
        math.fsum(getattr(row, measure) * row.episodes for row in own)
        / sum(r.episodes for r in own)
        for own in found.values()
    ]


def with_interval(middle: Callable[..., Any], values: Sequence[float]) -> str:
    """The mean or median over seeds with its 95 % bootstrap interval."""
    if not values:
        return NOTHING
    draws = np.random.default_rng(0).choice(values, (2000, len(values)))
    low, high = np.percentile(middle(draws, axis=1), [2.5, 97.5])
    return f"{middle(values):.2f} [{low:.2f}, {high:.2f}]"


mean_of, median_of = partial(with_interval, np.mean), partial(with_interval, np.median)


def claims(of: Sequence[tuple[str, float, str, Sequence[str]]] = CLAIMS) -> str:
    rows, missing = [], []
    for words, aim, label, conditions in of:
        found = [row for row in ends_of(label) if row.condition in conditions]
        own = [row for row in found if not row.spheres]
        if not own:
            missing.append(f"{words} (aim {aim:.2f})")
            continue
        measure = "normalized" if "reach" in conditions else "success"
        values = by_seed(own, measure)
        close = by_seed([row for row in own if not math.isnan(row.close)], "close")
        spheres = [by_seed([r for r in found if r.spheres], name) for name in ("success", "ever")]
        rows.append((
            words,
            f"≥ {aim:.2f}",
            median_of(values),
            f"{sum(value >= aim for value in values)} of {len(values)}",
            f"{min(values):.2f}",
            f"{median(by_seed(own, 'ever')):.2f}",
            f"{median(close):.2f}" if close else NOTHING,
            ", ".join(f"{median(one):.2f}" for one in spheres if one) or NOTHING,
        ))  # fmt: skip
    head = ("", "Aim", "Median of seeds", "Seeds at the aim", "Worst seed", "Ever",
            "Within 0.07 m", "Spheres: end, ever")  # fmt: skip
    return table(head, rows, missing)


def stacking_arms() -> str:
    """The claims of STACKING by arm: the median of seeds, and the worst one."""
    ends = {arm: ends_of(label) for label, arm in STACKING_ARMS.items()}
    counts = {arm: len({row.seed for row in rows}) for arm, rows in ends.items()}
    head = ["", *(f"{arm}, {n} seed{'s' * (n > 1)}" for arm, n in counts.items())]

    def cell(rows: Sequence[EndsRow], conditions: Sequence[str]) -> str:
        measure = "normalized" if "reach" in conditions else "success"
        values = by_seed([row for row in rows if row.condition in conditions], measure)
        return f"{median(values):.2f}, {min(values):.2f}"

    return table(head, (
        (words, *(cell(rows, conditions) for rows in ends.values()))
        for words, _, _, conditions in STACKING
    ))  # fmt: skip


def networks_alone() -> str:
    """Agents without the rules of executing: the median, and the worst one."""
    found = json.loads((RESULTS / "stack-2-networks-alone.json").read_text())

    def cell(measure: str) -> str:
        values = [value for key, value in found.items() if key.endswith(f".{measure}")]
        return f"{median(values):.2f}, {min(values):.2f}"

    return table(("", "At the end", "Ever"), (
        (words, cell(f"{condition}.success"), cell(f"{condition}.ever"))
        for words, condition in NETWORKS_ALONE
    ))  # fmt: skip


def zones() -> str:
    """Shares of episodes in which formulas hold, by the number of zones."""
    found, rows, head = {}, [], ["", "Aim"]
    for label in ("zones-8", "zones-16"):
        path = RESULTS / f"{label}-traces.csv"
        found[label] = read_rows(path, TracesRow) if path.exists() else []
        count = len({row.seed for row in found[label]})
        head += [f"`{label}`: median of {count} seeds", "at the aim", "worst seed", "straight line"]
    for words, aim, conditions in ZONES:
        cells = [words, f"≥ {aim:.2f}" if aim else NOTHING]
        for traced in found.values():
            own = [row for row in traced if row.condition in conditions]
            seeds = sorted({row.seed for row in own})
            means = [fmean(r.success_rate for r in own if r.seed == seed) for seed in seeds]
            if not means:
                cells += [NOTHING] * 4
                continue
            reached = f"{sum(mean >= aim for mean in means)} of {len(means)}" if aim else NOTHING
            straight = fmean(row.straight_line_rate for row in own)
            cells += [f"{median(means):.2f}", reached, f"{min(means):.2f}", f"{straight:.2f}"]
        rows.append(cells)
    return table(head, rows) if any(found.values()) else table((), (), [*found])


TABLES: dict[str, Callable[[], str]] = {
    "headline": headline, "seeds": seeds, "conditions": conditions,
    "relations": relations, "views": views,
    "detectors": detectors, "equalities": equalities,
    "variants": variants, "peers": peers, "baselines": baselines, "claims": claims,
    "stacking": partial(claims, STACKING), "stacking_arms": stacking_arms,
    "networks_alone": networks_alone, "zones": zones,
}  # fmt: skip


def filled(text: str) -> str:
    """The text with all of its tables made anew."""

    def fill(found: re.Match[str]) -> str:
        return f"{found[1]}\n{TABLES[found[2]]()}<!-- end -->"

    return re.sub(r"(<!-- results: (\w+) -->)\n.*?<!-- end -->", fill, text, flags=re.DOTALL)


def card(folder: Path) -> str:
    """The card of a shipped agent, with scores of docs/results/shipped-NAME.json, which
    `pa_ros eval --checkpoint shipped:NAME --condition all --json` wrote: those of trained and of
    held-out programs, and the lowest of the others."""
    path = RESULTS / f"shipped-{folder.name}.json"
    report = read_report(path)
    scores = {key.split(".")[1]: score for key, score in report.items()
              if key.endswith(".normalized")}  # fmt: skip
    others = sorted(set(scores) - {*KEPT, "random"}, key=lambda name: (scores[name], name))
    hidden = tuple(f"eval.{name}." for name in others[LOWEST:])
    shown = {key: value for key, value in report.items() if not key.startswith(hidden)}
    note = (
        f"The table has two of {len(scores) - 1} conditions and the {LOWEST} lowest of the others"
    )
    return model_card(folder, shown) + f"{note}\n(docs/results/{path.name}).\n"


def write_cards() -> None:
    """Write the card of each shipped agent."""
    for folder in sorted(path for path in SHIPPED.iterdir() if path.is_dir()):
        (folder / "README.md").write_text(card(folder))


def main() -> int:
    """Rewrite the pages and the cards."""
    write_cards()
    for page in PAGES:
        page.write_text(filled(page.read_text()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
