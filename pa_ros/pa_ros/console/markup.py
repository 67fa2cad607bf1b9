"""The page's tables as HTML. Every text from outside is escaped."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from html import escape

from pa_ros.acting.insight import Explanation
from pa_ros.console.moment import Moment
from pa_ros.core.errors import PaError
from pa_ros.language import Vocabulary
from pa_ros.language.parser import OPERATORS, OVER_TIME
from pa_ros.world.relation import at_stage, measured

SHOWN = 300  # characters of a text from outside
_CELL = "padding:1px 5px;text-align:right;font-variant-numeric:tabular-nums;"
_LEFT = "padding:1px 5px;text-align:left;white-space:pre;"


def text_of(text: str) -> str:
    """Any text as HTML, shortened."""
    return escape(text if len(text) <= SHOWN else text[: SHOWN - 1] + "…")


def quiet(text: str) -> str:
    """A remark."""
    return f'<div style="padding:0 1em .5em;opacity:.7;font-size:.85em">{text_of(text)}</div>'


def table(head: Sequence[str], rows: Iterable[Sequence[str]], label: str = "") -> str:
    """A table of HTML cells; `label` names it for tests and assistive technology."""
    top = "".join(f'<th scope="col" style="{_CELL}">{cell}</th>' for cell in head)
    body = "".join(f"<tr>{''.join(cells)}</tr>" for cells in rows)
    return (
        f'<div style="padding:0 .8em .5em;overflow-x:auto"><table aria-label="{escape(label)}" '
        f'style="font-size:.8em;border-collapse:collapse"><tr>{top}</tr>{body}</table></div>'
    )


def name(text: str, depth: int = 0) -> str:
    """The first cell of a row."""
    return f'<th scope="row" style="{_LEFT}font-weight:normal">{"  " * depth}{text_of(text)}</th>'


def share(value: float) -> str:
    """A cell for a degree in [0, 1], filled to that degree."""
    percent = round(100 * min(max(value, 0.0), 1.0))
    fill = f"background:linear-gradient(90deg,rgba(230,160,0,.45) {percent}%,transparent 0)"
    return f'<td style="{_CELL}{fill}">{value:.2f}</td>'


def words_by_objects(moment: Moment, names: Sequence[str]) -> str:
    """Φ and p: a row for each word, a column for each block."""
    found, shown = moment.explanation, moment.block_rows
    if found is None:
        return quiet(f"Φ and p: {moment.unexplained}")
    rows = []
    if found.tree:
        rows.append([name("p (relevant)"), *(share(float(found.p[i])) for i in shown)])
    rows += [
        [name(word), *(share(float(found.phi[v, i])) for i in shown)]
        for v, word in enumerate(found.words)
    ]
    head = ["", *map(text_of, names)]
    return table(head, rows, "Φ and p") + quiet(f"by weights of version {found.version}")


def tree(moment: Moment, names: Sequence[str]) -> str:
    """The program's tree with the degree of each node for each block."""
    found = moment.explanation
    if found is None or not found.tree:
        return quiet(f"Why: {moment.unexplained or 'no program is in force'}")
    rows = [
        [name(node.text, node.depth), *(share(float(node.degrees[i])) for i in moment.block_rows)]
        for node in found.tree
    ]
    return table(["", *map(text_of, names)], rows, "Why") + quiet(
        _most_relevant(found, moment, names)
    )


def _most_relevant(found: Explanation, moment: Moment, names: Sequence[str]) -> str:
    degrees = [float(found.p[i]) for i in moment.block_rows]
    chosen = max(range(len(degrees)), key=degrees.__getitem__)
    return f"most relevant: {names[chosen]}, p {degrees[chosen]:.2f}"


def state(moment: Moment, speed: str = "") -> str:
    """What is being executed, and with what success."""
    seen, step = moment.observation, moment.step
    kind = "evaluation episode" if step.evaluation else "episode"
    verdict, program, stage = moment.verdict, step.program, step.stage
    if program and step.verdict is not None:
        verdict += f": {measured(program, moment.distance, stage)}"
        if (limit := moment.arena.threshold(program, stage)) is not None:
            verdict += f", at most {measured(program, limit, stage)} is wanted"
    at, time_s = at_stage(program, stage), max(seen.stamp_ns, 0) / 1e9
    rows = [
        ("program", program or "none in force"),
        *([("stage", at)] if at else []),
        ("verdict", verdict),
        ("reward", f"{moment.reward:+.2f}"),
        (
            "time",
            f"{kind} {seen.episode}, step {seen.step}, {time_s:.1f} s{speed}",
        ),
    ]
    return pairs(rows, "State")


def pairs(rows: Iterable[tuple[str, str]], label: str) -> str:
    """A table with a name and a text in each row."""
    cells = (
        [name(first), f'<td style="{_LEFT}white-space:normal">{text_of(text)}</td>']
        for first, text in rows
    )
    return table((), cells, label)


def reading(text: str, read: Callable[[str], str]) -> str:
    """The canonical form of a typed program, or where it is wrong.

    :param read: returns the canonical form. Raises PaError for a program that can't be executed.
    """
    if not text.strip():
        return quiet("type a program, or choose an example")
    try:
        canonical = read(text)
    except PaError as error:
        message, _, excerpt = str(error).partition("\n")
        below = _block(escape(excerpt), "#c33", "Where") if len(text) <= SHOWN else ""
        return _block(text_of(message), "#c33", "Rejected", "pre-wrap") + below
    return _block(text_of(f"✓ {canonical}"), "#282", "A program", "pre-wrap")


def history(entries: Iterable[tuple[str, str]]) -> str:
    """Programs, each above what became of it: side by side a long one would leave no room."""
    cells = (
        [
            f'<td style="{_LEFT}white-space:normal;overflow-wrap:anywhere">{text_of(program)}<br>'
            f'<span style="opacity:.7">{text_of(outcome)}</span></td>'
        ]
        for program, outcome in entries
    )
    return table((), cells, "History")


def completions(text: str, vocabulary: Vocabulary) -> tuple[str, ...]:
    """The words that begin with the text's last, unfinished word."""
    stem = _last_word(text)
    relations = [f"{relation}(HAND, " for relation in vocabulary.relations]
    operators = [f"{name}(" for name in (*OPERATORS, *OVER_TIME)]
    words = (*relations, *operators, *vocabulary.words)
    return tuple(word for word in words if stem and word.startswith(stem) and word != stem)


def completed(text: str, word: str) -> str:
    """The text with its last word completed."""
    stem = _last_word(text)
    return (text[: len(text) - len(stem)] if word.startswith(stem) else text) + word


def _last_word(text: str) -> str:
    return text[len(text.rstrip("ABCDEFGHIJKLMNOPQRSTUVWXYZ_0123456789")) :]


def _block(text: str, color: str, label: str, wrap: str = "pre") -> str:
    return (
        f'<pre aria-label="{label}" style="margin:0;padding:0 1em .4em;font-size:.75em;'
        f'white-space:{wrap};overflow-x:auto;color:{color}">{text}</pre>'
    )
