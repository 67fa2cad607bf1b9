"""Programs that were sent from the page, and what became of them."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field

from pa_ros.acting.execution import Execution, ExecutionWatch, window_s
from pa_ros.console import markup
from pa_ros.core.experience import Step
from pa_ros.wire.program import ProgramStatus

KEPT = 10


@dataclass
class Entry:
    """One program."""

    program_id: str
    text: str
    watch: ExecutionWatch
    note: str = ""  # why it was not sent
    statuses: dict[str, ProgramStatus] = field(default_factory=dict)  # by node
    execution: Execution | None = None

    @property
    def rejected(self) -> str:
        """Why the page or a node rejected the program; empty if none did."""
        reasons = [s.reason or s.code for s in self.statuses.values() if not s.accepted]
        return (self.note or next(iter(reasons), "")).partition("\n")[0]

    @property
    def outcome(self) -> str:
        """The program's outcome, in one line."""
        if self.rejected:
            return f"rejected: {self.rejected}"
        done = self.execution
        if done is None:
            nodes = ", ".join(sorted(self.statuses))
            return f"accepted by {nodes}" if nodes else "sent, not answered yet"
        return done.text(self.text)


ARENAS = ("sim_node", "robot_node")  # after they accept a program, their steps are under it


class History:
    """The newest KEPT programs, newest first."""

    def __init__(self) -> None:
        self.entries: deque[Entry] = deque(maxlen=KEPT)

    def add(self, program_id: str, text: str, note: str = "") -> None:
        """Add a program that is sent now, or with a note why it is not."""
        self.entries.appendleft(
            Entry(program_id, text, ExecutionWatch(program_id, window_s(text)), note)
        )

    @property
    def pending(self) -> bool:
        """Whether an accepted program is still being executed."""
        return any(
            entry.statuses and entry.execution is None and not entry.rejected
            for entry in self.entries
        )

    def add_status(self, status: ProgramStatus) -> None:
        """Add a node's answer."""
        for entry in self.entries:
            if entry.program_id == status.program_id:
                entry.statuses[status.node] = status
                if status.accepted and status.node.rpartition("/")[2] in ARENAS:
                    entry.watch.accepted(status.stamp_ns)

    def observe(self, steps: Iterable[Step]) -> None:
        """Follow the executions by the arena's steps, in their order."""
        for step in steps:
            for entry in self.entries:
                if entry.execution is None:
                    entry.execution = entry.watch.observe(step)

    def html(self) -> str:
        """A table with a row for each program."""
        if not self.entries:
            return markup.quiet("no program was sent from this page yet")
        return markup.history((entry.text, entry.outcome) for entry in self.entries)
