"""Programs that were sent from the page, and what became of them."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field

from pa_ros.acting.execution import Execution, ExecutionWatch
from pa_ros.console import markup
from pa_ros.core.experience import Verdict
from pa_ros.wire.program import ProgramStatus

KEPT = 10


@dataclass
class Entry:
    """One program."""

    program_id: str
    text: str
    judgements: dict[str, ProgramStatus] = field(default_factory=dict)  # by node
    execution: Execution | None = None
    watch: ExecutionWatch | None = None
    note: str = ""  # why it wasn't sent

    @property
    def outcome(self) -> str:
        """One line: refused, accepted, satisfied, and after how long."""
        refused = [j for j in self.judgements.values() if not j.accepted]
        if self.note or refused:
            return f"refused: {self.note or _line(refused[0])}"
        if self.execution is not None:
            return _became(self.execution)
        if self.judgements:
            return f"accepted by {', '.join(sorted(self.judgements))}"
        return "sent; nobody has answered yet"


class History:
    """The newest KEPT programs, newest first."""

    def __init__(self) -> None:
        self.entries: deque[Entry] = deque(maxlen=KEPT)

    def add(self, program_id: str, text: str, note: str = "") -> None:
        """A program is sent now; with a note, it is not."""
        self.entries.appendleft(
            Entry(program_id, text, watch=ExecutionWatch(program_id), note=note)
        )

    @property
    def pending(self) -> bool:
        """Whether something is still to become of one."""
        return any(
            entry.execution is None and entry.judgements and not entry.outcome.startswith("refused")
            for entry in self.entries
        )

    def judge(self, judgement: ProgramStatus) -> None:
        """A node has answered."""
        for entry in self.entries:
            if entry.program_id == judgement.program_id:
                entry.judgements[judgement.node] = judgement

    def observe(self, verdicts: Iterable[Verdict]) -> None:
        """The arena's word on steps, in their order."""
        for verdict in verdicts:
            for entry in self.entries:
                if entry.execution is None and entry.watch is not None:
                    entry.execution = entry.watch.observe(verdict)

    def html(self) -> str:
        """A row for each."""
        if not self.entries:
            return markup.quiet("no program was sent from here yet")
        return markup.pairs(((entry.text, entry.outcome) for entry in self.entries), "History")


def _became(execution: Execution) -> str:
    if execution.satisfied and execution.reached_s is not None:
        return f"satisfied after {execution.reached_s:.1f} s, at {execution.distance:.2f} m"
    return f"not satisfied: {execution.ended} after {execution.watched_s:.1f} s, at " + (
        f"{execution.distance:.2f} m"
    )


def _line(judgement: ProgramStatus) -> str:
    return judgement.reason.partition("\n")[0] or judgement.code
