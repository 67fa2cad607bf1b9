"""Many different programs as arrays, and the objects that they name, given true properties."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pa_ros.language.flat import AND, COPY, NOT, OR, FlatProgram, compile_program
from pa_ros.language.syntax import Program
from pa_ros.language.vocabulary import Vocabulary

Int32 = NDArray[np.int32]
Arrays = tuple[Int32, Int32, Int32]
"""Flat programs `op`, `a`, `b`, each [P, L] (language.flat.FlatProgram), padded with COPY."""

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
        self._flat: list[FlatProgram] = []
        self._arrays: Arrays | None = None
        for program in programs:
            self.add(program)

    def __len__(self) -> int:
        return len(self._flat)

    @property
    def texts(self) -> tuple[str, ...]:
        """Canonical texts in order of rows."""
        return tuple(map(str, self._rows))

    @property
    def programs(self) -> tuple[Program, ...]:
        """Programs in order of rows."""
        return tuple(self._rows)

    def relations(self) -> Int32:
        """Index of each program's relation in the vocabulary, [P]."""
        rows = self.vocabulary.relation_row
        return np.array([rows[program.relation] for program in self._rows], np.int32)

    def add(self, program: Program) -> int:
        """Return the row of a program; add the program unless the table contains an equal one.

        Raises ProgramError if the program is of another vocabulary.
        """
        if program not in self._rows:
            self._flat.append(compile_program(program, self.vocabulary))
            self._rows[program] = len(self._rows)
            self._arrays = None
        return self._rows[program]

    def roles(self) -> Int32:
        """Registers of each program's two sets, what is moved and the target: [P, 2]."""
        return np.array([(f.moved, f.target) for f in self._flat], np.int32).reshape(-1, 2)

    def avoided(self) -> Int32:
        """Register of the set that each program avoids, [P]; HAND's if it avoids nothing."""
        return np.array([f.avoided for f in self._flat], np.int32)

    def arrays(self) -> Arrays:
        """`op`, `a`, `b`, each [P, L] int32, where L is the longest program's length. Read-only.

        Returns the same arrays until a program is added.
        """
        if self._arrays is None:
            self._arrays = self._pad()
        return self._arrays

    def _pad(self) -> Arrays:
        # Padding copies the register of p to the last register, so all programs end in the same
        # place.
        length = max(map(len, self._flat), default=1)
        result = np.full((len(self), length), len(self.vocabulary.words), dtype=np.int32)
        op, a, b = np.full_like(result, COPY), result, result.copy()
        for row, flat in enumerate(self._flat):
            n = len(flat)
            op[row, :n], a[row, :n], b[row, :n] = flat.op, flat.a, flat.b
            a[row, n:] = b[row, n:] = len(self.vocabulary.words) + n  # the register of p
        return op, a, b


def crisp(arrays: Arrays, truth: ArrayLike, hand_index: int) -> NDArray[np.bool_]:
    """Objects that each program names, [P, N]: the targets of the verifier.

    `truth` [V, N] are the true properties as bool or 0 and 1; the rows of spare words are zero. The
    hand is not named, even under NOT(RED).
    """
    named = _registers(arrays, truth, hand_index)[:, -1].copy()
    named[:, hand_index] = False
    return named


def crisp_roles(
    arrays: Arrays, roles: Int32, truth: ArrayLike, hand_index: int
) -> NDArray[np.bool_]:
    """Objects of each program's two sets, what is moved and the target (`language.roles`).

    `roles` [P, 2] are the table's. Returns [P, 2, N].
    """
    registers = _registers(arrays, truth, hand_index)
    named = registers[np.arange(len(roles))[:, None], roles]
    named[..., hand_index] = roles == len(np.asarray(truth))
    return named


def _registers(arrays: Arrays, truth: ArrayLike, hand_index: int) -> NDArray[np.bool_]:
    """All registers of each program, [P, V + 1 + L, N]."""
    op, a, b = arrays
    rows = np.asarray(truth) > 0.5
    (words, objects), (programs, length) = rows.shape, op.shape
    registers = np.zeros((programs, words + 1 + length, objects), dtype=bool)
    registers[:, :words] = rows
    registers[:, words, hand_index] = True
    every = np.arange(programs)
    for k in range(length):
        x, y = registers[every, a[:, k]], registers[every, b[:, k]]  # [P, N]
        truths = _TRUTH[op[:, k, None], x.astype(np.intp), y.astype(np.intp)]
        registers[:, words + 1 + k] = truths
    return registers
