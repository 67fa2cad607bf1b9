"""True properties of objects (torch)."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from pa_ros.world.world import World


class TrueProperties(nn.Module):
    """`World.truth` of tensors; no parameters, and nothing in a state dict."""

    words: Tensor  # [values, V]

    def __init__(self, world: World) -> None:
        super().__init__()
        self._schema = world.schema
        self.register_buffer("words", torch.from_numpy(world.value_words), persistent=False)
        for group, known in zip(self._schema, self._schema.prototypes, strict=True):
            self.register_buffer(f"of_{group.name}", torch.from_numpy(known), persistent=False)

    def has(self, objects: Tensor) -> list[Tensor]:
        """Whether objects [B, N, F] have each value: of each group bool [B, N, values]."""
        known = [getattr(self, f"of_{group.name}") for group in self._schema]
        return self._schema.has(objects, known)

    def forward(self, objects: Tensor) -> Tensor:
        """True Φ, [B, N, V]."""
        return torch.cat(self.has(objects), -1).to(self.words) @ self.words
