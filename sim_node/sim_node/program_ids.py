"""What program ids mean in one arena: each one text; those with its own prefix are its own."""

from __future__ import annotations

from collections import OrderedDict

from pa_ros.wire.errors import WireError

REMEMBERED = 4096


class ProgramIds:
    """Canonical texts by id, the newest REMEMBERED of them."""

    def __init__(self, arena_id: str) -> None:
        self._prefix = f"{arena_id}/"
        self._texts: OrderedDict[str, str] = OrderedDict()

    def is_own(self, program_id: str) -> bool:
        """Whether an id is one of the arena's own."""
        return program_id.startswith(self._prefix)

    def announce(self, program_id: str, text: str) -> None:
        """One of the arena's own programs is drawn."""
        self._remember(program_id, text)

    def bind(self, program_id: str, text: str) -> None:
        """Someone's program is accepted. Raises WireError if the id is not free for it."""
        if self.is_own(program_id):
            expected = f"one that does not begin with {self._prefix!r}: the arena's own ids do"
            raise WireError("program_id", expected, program_id, code="program.id_taken")
        bound = self._texts.get(program_id, text)
        if bound != text:
            expected = f"another one than {program_id!r}, which means {bound}"
            raise WireError("program_id", expected, text, code="program.id_taken")
        self._remember(program_id, text)

    def is_echo(self, program_id: str, text: str) -> bool:
        """Whether this is what the arena itself has announced, as it hears it."""
        return self.is_own(program_id) and self._texts.get(program_id) == text

    def _remember(self, program_id: str, text: str) -> None:
        self._texts[program_id] = text
        self._texts.move_to_end(program_id)
        while len(self._texts) > REMEMBERED:
            self._texts.popitem(last=False)
