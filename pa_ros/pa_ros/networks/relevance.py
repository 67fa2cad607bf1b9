"""Batches of many different programs over soft Φ, evaluated in one vectorized pass of torch."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import torch
from torch import Tensor

from pa_ros.language import PRODUCT, Logic
from pa_ros.language.flat import AND, NOT, OR, Compiled
from pa_ros.world.programs import COEFFICIENTS, ProgramTable

Joined = Callable[[int, Tensor, Tensor], Tensor]
"""Compute instruction k of each program from its sources, [B, K, N] each."""


def program_tensors(table: ProgramTable) -> Compiled:
    """A table's programs as new int64 tensors; rows index a batch."""
    return Compiled(*(torch.tensor(field, dtype=torch.int64) for field in table.compiled()))


def relevant_objects(
    phi: Tensor, hand_index: int, programs: Compiled, logic: Logic = PRODUCT
) -> Tensor:
    """Relevant objects vector p = OR(HAND, e) of each program (paper, eq. logic), differentiable.

    `phi` is [B, V, N] in [0, 1]; the fields of `programs` are integers, instructions [B, L] for p
    [B, N] or [B, K, L] for p [B, K, N], K programs for each Φ. Any number of leading dimensions
    will do, as long as those of `phi` are the first of the programs'. p of the hand is 1, to
    rounding. All on one device; no loop over samples, one step for each of the L instructions.
    """
    return _registers(phi, hand_index, programs, logic)[..., -1, :]


def relevant_sets(
    phi: Tensor, hand_index: int, programs: Compiled, registers: Tensor, logic: Logic
) -> Tensor:
    """Degrees of S sets of each program, [B, S, N] or [B, K, S, N], such as p1 and p2. Other
    arguments are those of `relevant_objects`.

    `registers` are the sets', [B, S] or [B, K, S]. Only HAND, register V, contains the hand.
    """
    words, objects = phi.shape[-2:]
    sets = registers.long().unsqueeze(-1)  # [B, K, S, 1]
    degrees = _registers(phi, hand_index, programs, logic)
    chosen = degrees.gather(-2, sets.expand(*sets.shape[:-1], objects))
    other = torch.arange(objects, device=phi.device) != hand_index
    return chosen * (other | (sets == words)).to(phi)


def _registers(phi: Tensor, hand_index: int, programs: Compiled, logic: Logic) -> Tensor:
    """All registers of each program, [B, K, V + 1 + L, N]."""
    op, a, b, *_ = programs
    lead, length = op.shape[:-1], op.shape[-1]
    words, objects = phi.shape[-2:]
    phi = phi.reshape(*phi.shape[:-2], *[1] * (len(lead) - phi.dim() + 2), words, objects)
    hand = (torch.arange(objects, device=phi.device) == hand_index).to(phi)
    registers = torch.cat(  # [B, K, V + 1, N], a row more after each instruction
        (phi.expand(*lead, words, objects), hand.expand(*lead, 1, objects)), dim=-2
    )
    sources = torch.stack((a, b), dim=-1).long().unsqueeze(-1)
    sources = sources.expand(*lead, length, 2, objects)  # [B, K, L, (a, b), N]
    joined = (_products if logic == PRODUCT else _extremes)(op.long(), phi)
    for k in range(length):
        x, y = registers.gather(-2, sources[..., k, :, :]).unbind(-2)  # [B, K, N] each
        registers = torch.cat((registers, joined(k, x, y).unsqueeze(-2)), dim=-2)
    return registers


def _products(op: Tensor, phi: Tensor) -> Joined:
    coefficients = _coefficients(phi.device, phi.dtype)[op].unsqueeze(-1)  # [B, K, L, 4, 1]

    def joined(k: int, x: Tensor, y: Tensor) -> Tensor:
        c0, c1, c2, c3 = coefficients[..., k, :, :].unbind(-2)  # [B, K, 1] each
        return c0 + c1 * x + c2 * y + c3 * (x * y)

    return joined


def _extremes(op: Tensor, phi: Tensor) -> Joined:
    """The operations of `MIN_MAX`; not meant to be differentiated."""

    def joined(k: int, x: Tensor, y: Tensor) -> Tensor:
        which = op[..., k, None]  # [B, K, 1]
        unary = torch.where(which == NOT, 1.0 - x, x)
        either = torch.where(which == OR, torch.maximum(x, y), unary)
        return torch.where(which == AND, torch.minimum(x, y), either)

    return joined


@lru_cache
def _coefficients(device: torch.device, dtype: torch.dtype) -> Tensor:
    """Copied to a device once, since each copy delays the work that waits for the device."""
    with torch.inference_mode(False):
        return torch.tensor(COEFFICIENTS, dtype=dtype, device=device)
