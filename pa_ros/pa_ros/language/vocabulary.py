"""The words a program may use: groups of mutually exclusive properties."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property

from pa_ros.core.errors import ConfigError

RESERVED = frozenset({"NEAR", "HAND", "AND", "OR", "NOT"})


@dataclass(frozen=True)
class Vocabulary:
    """Property words by group; the order fixes the rows of Φ: shapes first, then colors.

    Each object has exactly one property of each group (paper, "Learned grounding"), so the
    detectors of a group are coupled by one softmax.
    """

    shapes: tuple[str, ...]
    colors: tuple[str, ...]

    def __post_init__(self) -> None:
        for group, words in (("shapes", self.shapes), ("colors", self.colors)):
            if len(words) < 1:
                raise ConfigError(f"vocabulary: expected at least one word in {group}, got none")
        seen: set[str] = set()
        for word in self.words:
            if not (word.isascii() and word.isidentifier() and word == word.upper()):
                raise ConfigError(f"vocabulary: expected an upper-case ASCII word, got {word!r}")
            if word in RESERVED or word in seen:
                raise ConfigError(f"vocabulary: {word!r} is reserved or named twice")
            seen.add(word)

    @property
    def words(self) -> tuple[str, ...]:
        """All property words in the order of the rows of Φ."""
        return self.shapes + self.colors

    @property
    def group_sizes(self) -> tuple[int, int]:
        """Number of words in each softmax group, in row order."""
        return (len(self.shapes), len(self.colors))

    @cached_property
    def row(self) -> dict[str, int]:
        """Row of Φ for each word."""
        return {word: i for i, word in enumerate(self.words)}

    @cached_property
    def digest(self) -> str:
        """16 hexadecimal digits that two equal vocabularies share and two different ones do not."""
        text = ",".join(self.shapes) + ";" + ",".join(self.colors)
        return hashlib.sha256(text.encode("ascii")).hexdigest()[:16]
