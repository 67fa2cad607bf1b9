"""Batches of many different programs, evaluated in one vectorized pass."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from pa_ros.language.evaluate import check_hand
from pa_ros.language.flat import AND, COPY, NOT, OR, FlatProgram, compile_program
from pa_ros.language.syntax import Program
from pa_ros.language.vocabulary import Vocabulary

Int32 = NDArray[np.int32]
Arrays = tuple[Int32, Int32, Int32]
"""Flat programs `op`, `a`, `b`, each [P, L] (language.flat.FlatProgram), padded with COPY."""

_COEFFICIENTS = np.zeros((4, 4), dtype=np.float32)  # [op, (1, x, y, xy)]; paper, eq. logic
_COEFFICIENTS[NOT] = 1, -1, 0, 0
_COEFFICIENTS[AND] = 0, 0, 0, 1
_COEFFICIENTS[OR] = 0, 1, 1, -1
_COEFFICIENTS[COPY] = 0, 1, 0, 0

_TRUTH = np.array(  # [op, x, y]: the same operations on {0, 1}
    [[[c @ (1, x, y, x * y) for y in (0, 1)] for x in (0, 1)] for c in _COEFFICIENTS], dtype=bool
)


class ProgramTable:
    """Compiled programs of one vocabulary, numbered from 0 in order of adding."""

    def __init__(self, vocabulary: Vocabulary) -> None:
        self.vocabulary = vocabulary
        self._rows: dict[str, int] = {}
        self._flat: list[FlatProgram] = []
        self._arrays: Arrays | None = None

    def __len__(self) -> int:
        return len(self._flat)

    @property
    def texts(self) -> tuple[str, ...]:
        """Canonical texts in order of rows."""
        return tuple(self._rows)

    def add(self, program: Program) -> int:
        """Return the row of a program, adding it unless an equal one is there.

        Raises UnknownWordError if the program is of another vocabulary.
        """
        text = str(program)
        if text not in self._rows:
            self._flat.append(compile_program(program, self.vocabulary))
            self._rows[text] = len(self._rows)
            self._arrays = None
        return self._rows[text]

    def arrays(self) -> Arrays:
        """Return `op`, `a`, `b`, each [P, L] int32, L the longest program's; do not write to them.

        The same arrays until a program is added.
        """
        if self._arrays is None:
            self._arrays = self._pad()
        return self._arrays

    def tensors(self, device: torch.device | str = "cpu") -> tuple[Tensor, Tensor, Tensor]:
        """Return `op`, `a`, `b` as new int64 tensors, each [P, L]; rows index a batch."""
        op, a, b = (torch.tensor(x, dtype=torch.int64, device=device) for x in self.arrays())
        return op, a, b

    def _pad(self) -> Arrays:
        length = max(map(len, self._flat), default=1)
        result = np.full((len(self), length), len(self.vocabulary.words), dtype=np.int32)
        op, a, b = np.full_like(result, COPY), result, result.copy()
        for row, flat in enumerate(self._flat):
            n = len(flat)
            op[row, :n], a[row, :n], b[row, :n] = flat.op, flat.a, flat.b
            a[row, n:] = b[row, n:] = len(self.vocabulary.words) + n  # the register of p
        return op, a, b


def relevant_objects(phi: Tensor, hand_index: int, op: Tensor, a: Tensor, b: Tensor) -> Tensor:
    """Relevant objects vector p = OR(HAND, e) of each program (paper, eq. logic), differentiable.

    `phi` is [B, V, N] in [0, 1]; `op`, `a`, `b` are flat programs, integers [B, L] for p [B, N] or
    [B, K, L] for p [B, K, N], K programs for each Φ. Any number of leading dimensions will do, as
    long as those of `phi` are the first of the programs'. p of the hand is 1, to rounding. All on
    one device; no loop over samples, one step for each of the L instructions.
    Raises ConfigError if `hand_index` is not one of the N objects.
    """
    lead, length = op.shape[:-1], op.shape[-1]
    words, objects = phi.shape[-2:]
    check_hand(hand_index, objects)
    phi = phi.reshape(*phi.shape[:-2], *[1] * (len(lead) - phi.dim() + 2), words, objects)
    hand = (torch.arange(objects, device=phi.device) == hand_index).to(phi)
    registers = torch.cat(  # [B, K, V + 1, N], a row more after each instruction
        (phi.expand(*lead, words, objects), hand.expand(*lead, 1, objects)), dim=-2
    )
    sources = torch.stack((a, b), dim=-1).long().unsqueeze(-1)
    sources = sources.expand(*lead, length, 2, objects)  # [B, K, L, (a, b), N]
    coefficients = _coefficients(phi.device, phi.dtype)[op.long()].unsqueeze(-1)  # [B, K, L, 4, 1]
    for k in range(length):
        x, y = registers.gather(-2, sources[..., k, :, :]).unbind(-2)  # [B, K, N] each
        c0, c1, c2, c3 = coefficients[..., k, :, :].unbind(-2)  # [B, K, 1] each
        written = (c0 + c1 * x + c2 * y + c3 * (x * y)).unsqueeze(-2)  # [B, K, 1, N]
        registers = torch.cat((registers, written), dim=-2)
    return registers[..., -1, :]


@lru_cache
def _coefficients(device: torch.device, dtype: torch.dtype) -> Tensor:
    """Copied to a device once: a copy would hold up whoever queues work on it."""
    with torch.inference_mode(False):
        return torch.tensor(_COEFFICIENTS, dtype=dtype, device=device)


def crisp(arrays: Arrays, truth: ArrayLike, hand_index: int) -> NDArray[np.bool_]:
    """Objects that each program names, HAND left out: what the verifier would call its targets.

    `truth` is [V, N] or [B, V, N], true properties as bool or 0 and 1 (rows of words that name
    nothing are zero). Returns [P, N] or [B, P, N]; False for the hand, even under NOT(RED).
    Raises ConfigError if `hand_index` is not one of the N objects.
    """
    op, a, b = arrays
    rows = np.moveaxis(np.asarray(truth) > 0.5, -2, 0)  # [V, B, N]
    words, (programs, length) = len(rows), op.shape
    check_hand(hand_index, rows.shape[-1])
    registers = np.zeros((programs, words + 1 + length, *rows.shape[1:]), dtype=bool)
    registers[:, :words] = rows  # register V, HAND, stays False, so that OR(HAND, e) = e
    every = np.arange(programs)
    for k in range(length):
        x, y = registers[every, a[:, k]], registers[every, b[:, k]]  # [P, B, N]
        operation = op[:, k].reshape(-1, *[1] * (x.ndim - 1))
        registers[:, words + 1 + k] = _TRUTH[operation, x.astype(np.intp), y.astype(np.intp)]
    named = registers[:, -1].copy()  # [P, B, N]
    named = named.swapaxes(0, 1) if rows.ndim == 3 else named
    named[..., hand_index] = False
    return named
