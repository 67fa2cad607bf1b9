"""Programs that an agent hears of: judged, and known by the id that they were sent under."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable

from rclpy.node import Node

from agent_node.acting import Acting
from pa_ros.language import Program, Vocabulary, parse
from pa_ros.ros import topics
from pa_ros.ros.programs import Pace, judge
from pa_ros.wire.arena import ArenaDescription
from pa_ros.wire.errors import WireError
from pa_ros.wire.program import ProgramRequest, encode_program_status

REMEMBERED = 256
EARLY = 32  # programs kept that are heard before the arena is known


class Programs:
    """Judges what comes, and says so, in the words of the arena that counts."""

    def __init__(self, node: Node, acting: Acting, stamp_ns: Callable[[], int]) -> None:
        """`stamp_ns`: of the newest step taken in."""
        self._node, self._acting, self._stamp_ns = node, acting, stamp_ns
        self._arena_id = ""
        self._book: ProgramBook | None = None
        self._early: list[ProgramRequest] = []
        self._pace = Pace()
        self._status_out = topics.PROGRAM_STATUS.publisher(node)

    def belong(self, arena: ArenaDescription) -> None:
        """This arena counts from now on."""
        vocabulary = arena.world.vocabulary
        if self._book is None or self._book.vocabulary != vocabulary:
            self._book = ProgramBook(vocabulary, self._acting.agent.check_program)
        self._arena_id = arena.arena_id
        early, self._early = self._early, []
        for request in early:
            self.hear(request)

    def hear(self, request: ProgramRequest) -> None:
        """Someone, or the arena, sent a program."""
        if self._book is None:
            self._early = [*self._early[1 - EARLY :], request]
        elif not request.program_id.startswith(f"{self._arena_id}/"):  # its own come with steps
            self._pace.check()
            self._judge(self._book, request)

    def in_force(self, program_id: str, text: str) -> Program:
        """The program that the arena says is in force; judged if it wasn't heard of before."""
        book = self._book
        assert book is not None
        if book.stands_for(program_id) != text:
            book.note(program_id, text)
            self._judge(book, ProgramRequest(program_id, text))
        return book.program(text)

    def _judge(self, book: ProgramBook, request: ProgramRequest) -> None:
        name, stamp_ns = self._node.get_fully_qualified_name(), max(self._stamp_ns(), 0)
        judgement = judge(request, name, stamp_ns, book.accept, self._acting.refusals)
        self._status_out.publish(encode_program_status(judgement))


class ProgramBook:
    """Programs by id, the newest REMEMBERED of them."""

    def __init__(
        self, vocabulary: Vocabulary, check: Callable[[Program], None] = lambda program: None
    ) -> None:
        """`check` raises a PaError for a program that the agent cannot act on."""
        self.vocabulary = vocabulary
        self._check = check
        self._texts: OrderedDict[str, str] = OrderedDict()  # canonical ones and as sent, by id
        self._programs: OrderedDict[str, Program] = OrderedDict()  # by text

    def accept(self, request: ProgramRequest) -> str:
        """Remember a program; its canonical text. Raises ProgramError if it isn't one, a PaError
        if it cannot be acted on, WireError if its id stands for another."""
        program = parse(request.text, self.vocabulary)
        text = str(program)
        bound = self._texts.get(request.program_id, text)
        if bound != text:
            expected = f"another one than {request.program_id!r}, which means {bound}"
            raise WireError("program_id", expected, text, code="program.id_taken")
        self.note(request.program_id, text)
        self._check(program)
        return text

    def note(self, program_id: str, text: str) -> None:
        """An id stands for a canonical text, whatever it stood for."""
        _remember(self._texts, program_id, text)

    def stands_for(self, program_id: str) -> str:
        """The canonical text of an id; empty if it was not heard of."""
        return self._texts.get(program_id, "")

    def program(self, text: str) -> Program:
        """The program of a text, parsed once. Raises ProgramError."""
        program = self._programs.get(text)
        if program is None:
            program = parse(text, self.vocabulary)
            self._programs[text] = program
            while len(self._programs) > REMEMBERED:
                self._programs.popitem(last=False)
        return program


def _remember(texts: OrderedDict[str, str], program_id: str, text: str) -> None:
    texts[program_id] = text
    texts.move_to_end(program_id)
    while len(texts) > REMEMBERED:
        texts.popitem(last=False)
