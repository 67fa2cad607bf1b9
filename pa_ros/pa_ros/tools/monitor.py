"""Show a running graph from its /diagnostics: a live table, or plain lines without a terminal.

All figures come from the nodes; nothing is measured here.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import TextIO

from rclpy.node import Node
from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

from pa_ros.core.text import printable, renewable
from pa_ros.ros.health import LIFECYCLE, WARN
from pa_ros.ros.topics import DIAGNOSTICS
from pa_ros.wire import Message
from pa_ros.wire.diagnostics import Health, decode_diagnostics

REFRESH_S = 0.5  # of the table
LINE_PERIOD_S = 5.0  # of plain lines
STALE_S = 5.0  # a node whose last diagnostics are older is shown as silent


@dataclass(frozen=True)
class Figure:
    """One row of the table."""

    label: str
    node: str  # last part of the name of the node that reports it
    key: str  # in that node's diagnostics
    form: str = "{:.0f}"
    short: str = ""  # label in plain lines; empty: left out there
    over_arenas: Callable[[Sequence[float]], float] = fmean  # one number for several arenas


FIGURES = (
    Figure("frames", "learner_node", "frames", short="frames"),
    Figure("frames/s", "sim_node", "steps_per_s", short="frames/s", over_arenas=sum),
    Figure("updates/s", "learner_node", "updates_per_s", short="updates/s"),
    Figure("reward/step, training", "sim_node", "train.reward_per_step", "{:+.3f}", "train"),
    Figure("reward/step, zero-shot", "sim_node", "eval.reward_per_step", "{:+.3f}", "zero-shot"),
    Figure("weights version, learner", "learner_node", "version", short="version"),
    Figure("weights version, agent", "agent_node", "policy_version", over_arenas=min),
    Figure("critic loss", "learner_node", "critic_loss", "{:.5f}", "critic"),
    Figure("mean Q", "learner_node", "mean_q", "{:+.4f}", "Q"),
    Figure("real-time factor", "sim_node", "real_time_factor", "{:.1f}", "x real time", sum),
)


class GraphFigures:
    """The newest diagnostics of each node; `now` is a steady clock in seconds."""

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self._health: dict[str, tuple[Health, float]] = {}  # by full name; time of arrival

    def take(self, entries: Iterable[Health]) -> None:
        """Store the entries of one diagnostics message."""
        for entry in entries:
            values = {printable(key): printable(value) for key, value in entry.values.items()}
            shown = Health(printable(entry.name), entry.level, printable(entry.message), values)
            self._health[shown.name] = (shown, self._now())

    def value(
        self, node: str, key: str, over_arenas: Callable[[Sequence[float]], float] = fmean
    ) -> float | None:
        """A figure as a number, combined over all arenas; None if no node reported one."""
        values = [_number(entry, key) for entry in self._of(node)]
        known = [value for value in values if value is not None]
        return over_arenas(known) if known else None

    def rows(self, scenes: Sequence[tuple[str, str]] = ()) -> list[tuple[str, str]]:
        """(label, text) of the figures, of each arena if there are several, of `scenes` and, last,
        of the alarms."""
        found = [(figure.label, text) for figure, text in self._known()]
        arenas = self._of("sim_node")
        if len(arenas) > 1:
            found += [(_namespace(arena.name), self._arena_text(arena)) for arena in arenas]
        found += [("lifecycle", self._states()), *scenes]
        return [*found, ("refused messages", self._refusals()), ("alarms", self._alarms())]

    def line(self) -> str:
        """The figures in one plain line."""
        parts = [f"{figure.short} {text}" for figure, text in self._known() if figure.short]
        return "  ".join([*parts, f"refused {self._refusals()}", f"alarms {self._alarms()}"])

    def _of(self, node: str) -> list[Health]:
        """The entries of all nodes with a name, in the order of their namespaces, or of one by its
        full name."""
        known = sorted(self._health.items())
        return [one for name, (one, _) in known if node in (name, name.rpartition("/")[2])]

    def _known(self, place: str = "") -> Iterator[tuple[Figure, str]]:
        """The figures that a node reports, written; `place` is a namespace with its slashes."""
        for figure in FIGURES:
            value = self.value(place + figure.node, figure.key, figure.over_arenas)
            if value is not None:
                yield figure, figure.form.format(value)

    def _arena_text(self, arena: Health) -> str:
        """The figures of one arena and its agent."""
        known = self._known(arena.name.removesuffix("sim_node"))
        parts = [f"{one.short or one.label.partition(',')[0]} {text}" for one, text in known]
        return "  ".join(parts) or arena.message

    def _refusals(self) -> str:
        counts: dict[str, int] = {}
        for entry, _ in self._health.values():
            for key in entry.values:
                if key.startswith("refused.") and (count := _number(entry, key)) is not None:
                    code = key.removeprefix("refused.")
                    counts[code] = counts.get(code, 0) + int(count)
        return ", ".join(f"{code} {count}" for code, count in sorted(counts.items())) or "0"

    def _states(self) -> str:
        """The nodes in each state of the ROS lifecycle."""
        nodes: dict[str, list[str]] = {}
        for name, (entry, when) in sorted(self._health.items()):
            if LIFECYCLE in entry.values and self._now() - when <= STALE_S:
                nodes.setdefault(entry.values[LIFECYCLE], []).append(name)
        found = [f"{state}: {', '.join(names)}" for state, names in sorted(nodes.items())]
        return "; ".join(found) or "-"

    def _alarms(self) -> str:
        alarms = [self.message(name) for name in sorted(self._health) if self._is_alarm(name)]
        return "; ".join(alarms) or "none"

    def _is_alarm(self, name: str) -> bool:
        entry, when = self._health[name]
        # To wait for an arena that somebody paused is no reason for an alarm.
        waits = entry.level == WARN and self.is_paused(f"{name.rpartition('/')[0]}/sim_node")
        return (bool(entry.level) and not waits) or self._now() - when > STALE_S

    def is_paused(self, arena: str) -> bool:
        """Whether an arena, by its full name, says that it is paused."""
        entry, _ = self._health.get(arena, (Health(arena), 0.0))
        return entry.values.get("paused") == "true"

    def message(self, name: str) -> str:
        """What a node, by its full name, said last, and its name before that."""
        if name not in self._health:
            return f"{name}: no diagnostics"
        entry, when = self._health[name]
        silent_s = self._now() - when
        return f"{name}: {f'silent for {silent_s:.0f} s' if silent_s > STALE_S else entry.message}"


def _number(entry: Health, key: str) -> float | None:
    try:
        number = float(entry.values[key])
    except (KeyError, ValueError):
        return None
    return number if math.isfinite(number) else None


def _namespace(node: str) -> str:
    return node.rpartition("/")[0] or "/"


def watch_diagnostics(node: Node, figures: GraphFigures) -> None:
    """Fill figures from /diagnostics for as long as the node exists: of nodes in its namespace and
    below."""
    below = node.get_namespace().rstrip("/") + "/"

    def take(message: Message) -> None:
        figures.take(one for one in decode_diagnostics(message) if one.name.startswith(below))

    DIAGNOSTICS.subscribe(node, take)


class Display:
    """A table that is renewed in place; a line every LINE_PERIOD_S if the stream isn't a terminal.

    A context manager. `rows` and `line` return what to show at each `refresh`.
    """

    def __init__(
        self,
        title: str,
        rows: Callable[[], list[tuple[str, str]]],
        line: Callable[[], str],
        stream: TextIO | None = None,
    ) -> None:
        self._title, self._rows, self._line = title, rows, line
        self._stream = stream or sys.stdout
        self._console = Console(file=self._stream)
        self._live: Live | None = None
        self._printed = time.monotonic()

    def __enter__(self) -> Display:
        if renewable(self._console):
            self._live = Live(console=self._console, auto_refresh=False)
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live is not None:
            self.refresh()
            self._live.stop()
            self._live = None

    def refresh(self) -> None:
        """Show the newest rows; call every REFRESH_S or so."""
        if self._live is not None:
            self._live.update(self._table(), refresh=True)
        elif time.monotonic() - self._printed >= LINE_PERIOD_S:
            self._printed = time.monotonic()
            print(self._line(), file=self._stream, flush=True)

    def _table(self) -> Table:
        table = Table(title=self._title, title_justify="left", show_header=False)
        table.add_column(style="bold")
        table.add_column(min_width=40)
        for label, text in self._rows():
            table.add_row(Text(label), Text(text))
        return table
