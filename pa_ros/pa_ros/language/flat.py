"""Compile a tree to straight-line code, so that a batch of different programs runs in one pass."""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce

from pa_ros.language.evaluate import check_words, foreign_word
from pa_ros.language.syntax import And, Expression, Not, Or, Program, Word
from pa_ros.language.vocabulary import Vocabulary

NOT, AND, OR, COPY = range(4)
"""Operations: 1 - x, both(x, y), either(x, y) (`evaluate.Logic`) and x (padding)."""


@dataclass(frozen=True, slots=True)
class FlatProgram:
    """Instructions over registers, each a vector over objects.

    With V words: registers 0 … V-1 are the rows of Φ, register V is HAND (1 for the hand, else
    0), and instruction k writes register V+1+k = op[k](register a[k], register b[k]). The last
    register is p = OR(HAND, e). Equal subexpressions share a register. NOT and COPY have b == a.
    """

    op: tuple[int, ...]
    a: tuple[int, ...]
    b: tuple[int, ...]

    def __len__(self) -> int:
        return len(self.op)


def compile_program(program: Program, vocabulary: Vocabulary) -> FlatProgram:
    """Compile a program for the rows of `vocabulary`.

    The relation does not become an instruction, because p does not depend on it. Raises
    ProgramError (program.unknown_word) if the program is of another vocabulary.
    """
    if program.relation not in vocabulary.relations:
        raise foreign_word(program, program.relation, vocabulary.relation_row)
    check_words(program, vocabulary.row)
    code = _Code(vocabulary)
    # p = OR(HAND, e) is always the last instruction, so evaluators need no other end mark.
    target = code.emit_expression(program.target)
    code.emit(OR, len(vocabulary.words), target)
    op, a, b = zip(*code.instructions, strict=True)
    return FlatProgram(op, a, b)


class _Code:
    """Instructions so far and their registers. The dictionary writes equal instructions once."""

    def __init__(self, vocabulary: Vocabulary) -> None:
        self._row = vocabulary.row
        self.instructions: dict[tuple[int, int, int], int] = {}

    def emit(self, op: int, a: int, b: int) -> int:
        """Write an instruction unless an equal one exists; return its register."""
        first = len(self._row) + 1
        return self.instructions.setdefault((op, a, b), first + len(self.instructions))

    def emit_expression(self, expression: Expression) -> int:
        """Write the instructions of an expression; return the register of its value."""
        match expression:
            case Word(name):
                return self._row[name]
            case Not(operand):
                source = self.emit_expression(operand)
                return self.emit(NOT, source, source)
            case And(operands):
                return self._fold(AND, operands)
            case Or(operands):
                return self._fold(OR, operands)

    def _fold(self, op: int, operands: tuple[Expression, ...]) -> int:
        sources = map(self.emit_expression, operands)
        return reduce(lambda x, y: self.emit(op, x, y), sources)
