"""What the page's tables say, as HTML; every text from outside is escaped."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

from pa_ros.console.insight import Look
from pa_ros.console.moment import Moment
from pa_ros.core.errors import PaError
from pa_ros.language import Vocabulary, parse

SHOWN = 300  # characters of a text from outside
_CELL = "padding:1px 5px;text-align:right;font-variant-numeric:tabular-nums;"
_LEFT = "padding:1px 5px;text-align:left;white-space:pre;"


def text_of(text: str) -> str:
    """Any text, shortened and harmless."""
    return escape(text if len(text) <= SHOWN else text[: SHOWN - 1] + "…")


def quiet(text: str) -> str:
    """A remark."""
    return f'<div style="padding:0 1em .5em;opacity:.7;font-size:.85em">{text_of(text)}</div>'


def table(head: Sequence[str], rows: Iterable[Sequence[str]], marks: str = "") -> str:
    """Cells are HTML already; `marks` names the table for tests and assistive technology."""
    top = "".join(f'<th scope="col" style="{_CELL}">{cell}</th>' for cell in head)
    body = "".join(f"<tr>{''.join(cells)}</tr>" for cells in rows)
    return (
        f'<div style="padding:0 .8em .5em;overflow-x:auto"><table aria-label="{escape(marks)}" '
        f'style="font-size:.8em;border-collapse:collapse"><tr>{top}</tr>{body}</table></div>'
    )


def name(text: str, depth: int = 0) -> str:
    """First cell of a row."""
    return f'<th scope="row" style="{_LEFT}font-weight:normal">{"  " * depth}{text_of(text)}</th>'


def share(value: float) -> str:
    """A degree in [0, 1], the fuller the cell the higher."""
    percent = round(100 * min(max(value, 0.0), 1.0))
    fill = f"background:linear-gradient(90deg,rgba(230,160,0,.45) {percent}%,transparent 0)"
    return f'<td style="{_CELL}{fill}">{value:.2f}</td>'


def words_by_objects(moment: Moment, names: Sequence[str]) -> str:
    """Φ and p: a row for each word, a column for each block."""
    look = moment.look
    if look is None:
        return quiet(f"Φ and p: {moment.why_blind}")
    shown = _blocks(moment)
    rows = []
    if look.tree:
        rows.append([name("p (relevant)"), *(share(float(look.p[i])) for i in shown)])
    rows += [
        [name(word), *(share(float(look.phi[v, i])) for i in shown)]
        for v, word in enumerate(look.words)
    ]
    head = ["", *map(text_of, names)]
    return table(head, rows, "Φ and p") + quiet(f"by weights of version {look.version}")


def tree(moment: Moment, names: Sequence[str]) -> str:
    """The program's tree with the degree of each node for each block."""
    look = moment.look
    if look is None or not look.tree:
        return quiet(f"Why: {moment.why_blind or 'no program is in force'}")
    rows = [
        [name(node.text, node.depth), *(share(float(node.degrees[i])) for i in _blocks(moment))]
        for node in look.tree
    ]
    return table(["", *map(text_of, names)], rows, "Why") + quiet(best(look, moment, names))


def best(look: Look, moment: Moment, names: Sequence[str]) -> str:
    """Which block the agent thinks is meant most."""
    shown = _blocks(moment)
    chosen = max(range(len(shown)), key=lambda i: float(look.p[shown[i]]))
    return f"most relevant: {names[chosen]}, p {look.p[shown[chosen]]:.2f}"


def state(moment: Moment, speed: str = "") -> str:
    """What is being executed, and how it stands."""
    seen = moment.observation
    kind = "evaluation episode" if moment.evaluation else "episode"
    held = {True: "satisfied", False: "not yet", None: "not recorded"}[moment.satisfied]
    rows = [
        ("program", moment.program or "none in force"),
        ("verdict", f"{held}, {moment.distance:.2f} m away"),
        ("reward", f"{moment.reward:+.2f}"),
        ("at", f"{kind} {seen.episode}, step {seen.step}, {seen.stamp_ns / 1e9:.1f} s{speed}"),
    ]
    return pairs(rows, "State")


def pairs(rows: Iterable[tuple[str, str]], marks: str) -> str:
    """Label and text, row by row."""
    cells = (
        [name(label), f'<td style="{_LEFT}white-space:normal">{text_of(text)}</td>']
        for label, text in rows
    )
    return table((), cells, marks)


def reading(text: str, vocabulary: Vocabulary) -> str:
    """What a text means as far as it is typed: its canonical form, or where it is wrong."""
    if not text.strip():
        return quiet("type a program, or choose an example")
    try:
        canonical = str(parse(text, vocabulary))
    except PaError as error:
        message, _, excerpt = str(error).partition("\n")
        below = _block(escape(excerpt), "#c33", "Where") if len(text) <= SHOWN else ""
        return _block(text_of(message), "#c33", "Refused", "pre-wrap") + below
    return _block(text_of(f"✓ {canonical}"), "#282", "A program")


def completions(text: str, vocabulary: Vocabulary) -> tuple[str, ...]:
    """Words that the last one may become."""
    stem = text[len(text.rstrip("ABCDEFGHIJKLMNOPQRSTUVWXYZ_0123456789")) :]
    relations = [f"{relation}(HAND, " for relation in vocabulary.relations]
    words = (*relations, "AND(", "OR(", "NOT(", *vocabulary.words)
    return tuple(word for word in words if stem and word.startswith(stem) and word != stem)


def completed(text: str, word: str) -> str:
    """The text with its last word made whole."""
    stem = text[len(text.rstrip("ABCDEFGHIJKLMNOPQRSTUVWXYZ_0123456789")) :]
    return (text[: len(text) - len(stem)] if word.startswith(stem) else text) + word


def _block(text: str, color: str, marks: str, wrap: str = "pre") -> str:
    return (
        f'<pre aria-label="{marks}" style="margin:0;padding:0 1em .4em;font-size:.75em;'
        f'white-space:{wrap};overflow-x:auto;color:{color}">{text}</pre>'
    )


def _blocks(moment: Moment) -> list[int]:
    seen = moment.observation
    return [i for i in range(len(seen.objects)) if i != seen.hand_index]
