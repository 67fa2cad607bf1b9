"""Compile a tree to straight-line code, so that a batch of different programs runs in one pass."""

from __future__ import annotations

from collections.abc import Iterable
from functools import reduce
from typing import Any, NamedTuple

from pa_ros.language.errors import ProgramError
from pa_ros.language.syntax import HAND, And, Expression, Not, Or, Program, Span, Word, left_out
from pa_ros.language.vocabulary import Vocabulary

NOT, AND, OR, COPY = range(4)
"""Operations: 1 - x, both(x, y), either(x, y) (`evaluate.Logic`) and x (padding)."""


class Compiled(NamedTuple):
    """A program as straight-line code over registers, each a vector over objects; all engines take
    its fields by name. Fields are numbers of one program, arrays of several (`ProgramTable`), or
    tensors of a batch.

    With V words: registers 0 … V-1 are the rows of Φ, register V is HAND (1 for the hand, else
    0), and instruction k writes register V+1+k = op[k](register a[k], register b[k]). The last
    register is p = OR(HAND, e). Equal subexpressions share a register. NOT and COPY have b == a.

    At the hand's column a set is 1 if its register is V, else 0, whatever the register contains
    there. If objects are to be moved, p = OR(HAND, OR(moved, target)).
    """

    op: Any  # instructions, L of each program
    a: Any
    b: Any
    relation: Any  # its number among the vocabulary's
    moved: Any  # register of the set that is moved, V if it is HAND
    target: Any  # register of the set that it is moved to
    avoided: Any  # register of the set to avoid, V if there is none


def compile_program(program: Program, vocabulary: Vocabulary) -> Compiled:
    """Compile a program for the rows of `vocabulary`.

    The relation does not become an instruction, because p does not depend on it. Raises
    ProgramError if the program is not of the vocabulary, and for comparisons (program.compares).
    """
    vocabulary.check(program)
    if program.compares:  # p knows no places: `acting.executing` compares for an agent that acts
        text = str(program)
        name = next(filter(None, program.chosen))
        span = Span(at := text.index(f"{name}("), at + len(name))
        expected = "a program without comparisons for networks"
        raise ProgramError(text, span, code="program.compares", expected=expected, received=name)
    code, hand = _Code(vocabulary), len(vocabulary.words)
    moved = code.emit_expression(program.moved)
    if moved != hand:
        moved = code.without(moved, vocabulary.bodiless)
    target = code.emit_expression(program.target)
    target = code.without(target, left_out(program, vocabulary.bodiless))
    either = target if moved == hand else code.emit(OR, moved, target)
    avoided = hand if program.avoided is None else code.emit_expression(program.avoided)
    # p = OR(HAND, e) is always the last instruction, so evaluators need no other end mark.
    code.emit(OR, hand, either)
    op, a, b = zip(*code.instructions, strict=True)
    relation = vocabulary.relation_row[program.relation]
    return Compiled(op, a, b, relation, moved, target, avoided)


class _Code:
    """Instructions so far and their registers. The dictionary writes equal instructions once."""

    def __init__(self, vocabulary: Vocabulary) -> None:
        self._row = {**vocabulary.row, HAND.name: len(vocabulary.words)}
        self.instructions: dict[tuple[int, int, int], int] = {}

    def emit(self, op: int, a: int, b: int) -> int:
        """Write an instruction unless an equal one exists; return its register."""
        first = len(self._row)
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
                return self.fold(AND, operands)
            case Or(operands):
                return self.fold(OR, operands)

    def without(self, source: int, words: Iterable[str]) -> int:
        """The register of those objects in another one that have none of some words."""
        known = tuple(Word(word) for word in words if word in self._row)
        if not known:
            return source
        out = self.fold(OR, known)
        return self.emit(AND, source, self.emit(NOT, out, out))

    def fold(self, op: int, operands: tuple[Expression, ...]) -> int:
        """Join the operands by AND or OR, from the left; return the register of the value."""
        sources = map(self.emit_expression, operands)
        return reduce(lambda x, y: self.emit(op, x, y), sources)
