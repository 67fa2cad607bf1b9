"""Batches of many different programs over soft Φ, evaluated in one vectorized pass of torch."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import torch
from torch import Tensor

from pa_ros.language import PRODUCT, Logic
from pa_ros.language.flat import AND, NOT, OR
from pa_ros.world.programs import COEFFICIENTS, ProgramTable

Joined = Callable[[int, Tensor, Tensor], Tensor]
"""Compute instruction k of each program from its sources, [B, K, N] each."""


def program_tensors(table: ProgramTable) -> tuple[Tensor, Tensor, Tensor]:
    """`op`, `a`, `b` of a table as new int64 tensors, each [P, L]; rows index a batch."""
    op, a, b = (torch.tensor(x, dtype=torch.int64) for x in table.arrays())
    return op, a, b


def relevant_objects(
    phi: Tensor, hand_index: int, op: Tensor, a: Tensor, b: Tensor, logic: Logic = PRODUCT
) -> Tensor:
    """Relevant objects vector p = OR(HAND, e) of each program (paper, eq. logic), differentiable.

    `phi` is [B, V, N] in [0, 1]; `op`, `a`, `b` are flat programs, integers [B, L] for p [B, N] or
    [B, K, L] for p [B, K, N], K programs for each Φ. Any number of leading dimensions will do, as
    long as those of `phi` are the first of the programs'. p of the hand is 1, to rounding. All on
    one device; no loop over samples, one step for each of the L instructions.
    """
    return _registers(phi, hand_index, op, a, b, logic)[..., -1, :]


def relevant_roles(
    phi: Tensor,
    hand_index: int,
    op: Tensor,
    a: Tensor,
    b: Tensor,
    roles: Tensor,
    logic: Logic,
) -> Tensor:
    """Degrees of sets of each program, such as p1 and p2 (what is moved, and the target): [B, S, N]
    or [B, K, S, N]. Other arguments are those of `relevant_objects`.

    `roles` are registers of the sets (`ProgramTable.roles`), [B, S] or [B, K, S]. Only HAND,
    register V, contains the hand.
    """
    registers = _registers(phi, hand_index, op, a, b, logic)
    words, objects = phi.shape[-2:]
    roles = roles.long().unsqueeze(-1)  # [B, K, 2, 1]
    chosen = registers.gather(-2, roles.expand(*roles.shape[:-1], objects))
    other = torch.arange(objects, device=phi.device) != hand_index
    return chosen * (other | (roles == words)).to(phi)


def _registers(
    phi: Tensor, hand_index: int, op: Tensor, a: Tensor, b: Tensor, logic: Logic
) -> Tensor:
    """All registers of each program, [B, K, V + 1 + L, N]."""
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
