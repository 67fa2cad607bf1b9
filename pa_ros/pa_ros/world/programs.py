"""Many different programs as arrays, and the objects that they name, given true properties."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pa_ros.language.flat import AND, COPY, NOT, OR, Compiled, compile_program
from pa_ros.language.syntax import Program
from pa_ros.language.vocabulary import Vocabulary

Int32 = NDArray[np.int32]
Bools = NDArray[np.bool_]

COEFFICIENTS = np.zeros((4, 4), dtype=np.float32)  # [op, (1, x, y, xy)]; paper, eq. logic
COEFFICIENTS[NOT] = 1, -1, 0, 0
COEFFICIENTS[AND] = 0, 0, 0, 1
COEFFICIENTS[OR] = 0, 1, 1, -1
COEFFICIENTS[COPY] = 0, 1, 0, 0

# The truth table is derived from the coefficients, so that crisp and soft evaluation cannot differ.
_TRUTH = np.array(  # [op, x, y]: the same operations on {0, 1}
    [[[c @ (1, x, y, x * y) for y in (0, 1)] for x in (0, 1)] for c in COEFFICIENTS], dtype=bool
)


class ProgramTable:
    """Compiled programs of one vocabulary, numbered from 0 in the order of `add`."""

    def __init__(self, vocabulary: Vocabulary, programs: Iterable[Program] = ()) -> None:
        self.vocabulary = vocabulary
        self._rows: dict[Program, int] = {}
        self._each: list[Compiled] = []
        self._all: Compiled | None = None
        for program in programs:
            self.add(program)

    def __len__(self) -> int:
        return len(self._each)

    @property
    def texts(self) -> tuple[str, ...]:
        """Canonical texts in order of rows."""
        return tuple(map(str, self._rows))

    @property
    def programs(self) -> tuple[Program, ...]:
        """Programs in order of rows."""
        return tuple(self._rows)

    def add(self, program: Program) -> int:
        """The row of a program; it is added unless the table contains an equal one.

        Raises ProgramError if the program is of another vocabulary.
        """
        if program not in self._rows:
            self._each.append(compile_program(program, self.vocabulary))
            self._rows[program] = len(self._rows)
            self._all = None
        return self._rows[program]

    def compiled(self) -> Compiled:
        """All programs, int32: instructions [P, L], where L is the longest program's number, and
        all else [P]. Read-only.

        Returns the same arrays until a program is added.
        """
        if self._all is None:
            self._all = self._padded()
        return self._all

    def _padded(self) -> Compiled:
        # Padding copies the register of p to the last register, so all programs end in the same
        # place.
        words = len(self.vocabulary.words)
        length = max((len(one.op) for one in self._each), default=1)
        result = np.full((len(self), length), words, dtype=np.int32)
        op, a, b = np.full_like(result, COPY), result, result.copy()
        for row, one in enumerate(self._each):
            n = len(one.op)
            op[row, :n], a[row, :n], b[row, :n] = one.op, one.a, one.b
            a[row, n:] = b[row, n:] = words + n  # the register of p
        numbers = np.array([one[3:] for one in self._each], np.int32).reshape(-1, 4)
        return Compiled(op, a, b, *np.ascontiguousarray(numbers.T))


class Sets(NamedTuple):
    """Which objects each of P programs means, [P, N]: what is moved, where to, what to avoid."""

    moved: Bools
    target: Bools
    avoided: Bools


def crisp(programs: Compiled, truth: ArrayLike, hand_index: int) -> Bools:
    """Objects that each program names, [P, N]: the targets of the verifier.

    `truth` [V, N] are the true properties as bool or 0 and 1; the rows of spare words are zero. The
    hand is not named, even under NOT(RED).
    """
    named = _registers(programs, truth, hand_index)[:, -1].copy()
    named[:, hand_index] = False
    return named


def crisp_sets(programs: Compiled, truth: ArrayLike, hand_index: int) -> Sets:
    """The sets of each program (`language.roles`), given true properties as `crisp` takes them."""
    registers = _registers(programs, truth, hand_index)
    rows, words, sets = np.arange(len(registers)), len(np.asarray(truth)), []
    for register in (programs.moved, programs.target, programs.avoided):
        objects = registers[rows, register]
        objects[:, hand_index] = register == words
        sets.append(objects)
    sets[2][:, hand_index] = False
    return Sets(*sets)


def _registers(programs: Compiled, truth: ArrayLike, hand_index: int) -> Bools:
    """All registers of each program, [P, V + 1 + L, N]."""
    op, a, b, *_ = programs
    rows = np.asarray(truth) > 0.5
    (words, objects), (count, length) = rows.shape, op.shape
    registers = np.zeros((count, words + 1 + length, objects), dtype=bool)
    registers[:, :words] = rows
    registers[:, words, hand_index] = True
    every = np.arange(count)
    for k in range(length):
        x, y = registers[every, a[:, k]], registers[every, b[:, k]]  # [P, N]
        truths = _TRUTH[op[:, k, None], x.astype(np.intp), y.astype(np.intp)]
        registers[:, words + 1 + k] = truths
    return registers
