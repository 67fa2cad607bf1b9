"""The words a program may use: groups of mutually exclusive properties, and relations."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from pa_ros.core.errors import ConfigError
from pa_ros.language.errors import cannot_avoid, cannot_move, check_words, foreign_word
from pa_ros.language.syntax import COMPARISONS, HAND, NEAR, OF_PLACES, SIZE, Program

RESERVED = frozenset({"HAND", "AND", "OR", "NOT", "THEN", "ALL", "AVOID", *COMPARISONS})

MAX_RELATIONS = 16
"""Relations that the programs of one world may use."""


@dataclass(frozen=True)
class WordGroup:
    """Words of which exactly one is true of each object, such as CUBE and SPHERE of "shape"."""

    name: str
    words: tuple[str, ...]

    def __post_init__(self) -> None:
        if not (self.name.isascii() and self.name.isidentifier() and self.name.islower()):
            raise ConfigError(
                f"vocabulary: expected a lower-case ASCII name of a group, got {self.name!r}"
            )
        if not self.words:
            raise ConfigError(f"vocabulary: expected at least one word in {self.name}, got none")


@dataclass(frozen=True)
class Vocabulary:
    """Property words by group; the order fixes the rows of Φ.

    Each object has exactly one property of each group (paper, "Learned grounding"), so the
    detectors of a group are coupled by one softmax. Programs may use `relations`; their order is
    the order of the embeddings. Only with `moves_objects` may the first argument of a relation be
    another set than HAND; objects with a word of `bodiless` cannot be moved. Only with `avoids` do
    networks learn what a program avoids.
    """

    groups: tuple[WordGroup, ...]
    relations: tuple[str, ...] = (NEAR,)
    moves_objects: bool = False
    bodiless: tuple[str, ...] = ()
    avoids: bool = False

    def __post_init__(self) -> None:
        if len({group.name for group in self.groups}) < len(self.groups):
            raise ConfigError(
                "vocabulary: expected groups of different names, got "
                f"{[group.name for group in self.groups]}"
            )
        if not 1 <= len(self.relations) <= MAX_RELATIONS:
            raise ConfigError(
                f"vocabulary: expected 1 to {MAX_RELATIONS} relations, got {self.relations}"
            )
        # A relation must not be a property word too, or an error could not say what is wrong.
        words = (*self.relations, *self.words)
        for word in words:
            if not (word.isascii() and word.isidentifier() and word == word.upper()):
                raise ConfigError(f"vocabulary: expected an upper-case ASCII word, got {word!r}")
            if word in RESERVED or words.count(word) > 1:
                raise ConfigError(f"vocabulary: {word!r} is reserved or named twice")
        if unknown := set(self.bodiless) - set(self.words):
            raise ConfigError(f"vocabulary: bodiless: expected words of it, got {unknown}")
        moves = " and objects that are moved" if self.moves_objects else ""
        if self.avoids and (self.relations != (NEAR,) or moves):
            raise ConfigError(
                f"vocabulary: avoids: expected the relation {NEAR} of the hand alone, got "
                f"{self.relations}{moves}"
            )

    @classmethod
    def of(cls, **groups: tuple[str, ...]) -> Vocabulary:
        """`Vocabulary.of(shape=("CUBE", "SPHERE"), color=("RED",))`."""
        return cls(tuple(WordGroup(name, tuple(words)) for name, words in groups.items()))

    def asking(self, *relations: str) -> Vocabulary:
        """The same words with other relations."""
        return replace(self, relations=relations)

    def moving(self, *bodiless: str) -> Vocabulary:
        """The same words for programs that may move objects; those of `bodiless` words stay."""
        return replace(self, moves_objects=True, bodiless=bodiless)

    def avoiding(self) -> Vocabulary:
        """The same words for networks that learn to avoid a set. ConfigError unless NEAR is the
        only relation, and of the hand."""
        return replace(self, avoids=True)

    def check(self, program: Program) -> None:
        """Raise ProgramError for a program with another word or relation (program.unknown_word), or
        one that moves objects (program.moves) or avoids a set (program.avoids) although networks
        don't learn to."""
        if program.relation not in self.relations:
            raise foreign_word(program, program.relation, self.relations)
        if program.moved != HAND and not self.moves_objects:
            raise cannot_move(program)
        if program.avoided is not None and not self.avoids:
            raise cannot_avoid(program)
        check_words(program, self.row)

    def to_data(self) -> dict[str, Any]:
        """Words, relations and what else programs may do, as data for JSON."""
        more = {name: True for name in ("moves_objects", "avoids") if getattr(self, name)}
        words = [[group.name, list(group.words)] for group in self.groups]
        return {"words": words, "relations": list(self.relations), **more}

    def __getitem__(self, group: str) -> tuple[str, ...]:
        """Words of a group; ConfigError lists the known groups."""
        for one in self.groups:
            if one.name == group:
                return one.words
        known = [one.name for one in self.groups]
        raise ConfigError(f"unknown group of words: expected one of {known}, got {group!r}")

    @cached_property
    def words(self) -> tuple[str, ...]:
        """All property words in the order of the rows of Φ."""
        return tuple(word for group in self.groups for word in group.words)

    @property
    def group_sizes(self) -> tuple[int, ...]:
        """Number of words in each softmax group, in row order."""
        return tuple(len(group.words) for group in self.groups)

    @cached_property
    def row(self) -> dict[str, int]:
        """Row of Φ for each word."""
        return {word: i for i, word in enumerate(self.words)}

    @property
    def by_group(self) -> dict[str, tuple[str, ...]]:
        """Words by the name of their group, in order."""
        return {group.name: group.words for group in self.groups}

    @cached_property
    def comparisons(self) -> tuple[str, ...]:
        """Comparisons that programs may use: of sizes only where objects have a size."""
        return COMPARISONS if SIZE in self.by_group else OF_PLACES

    @cached_property
    def relation_row(self) -> dict[str, int]:
        """Index of each relation."""
        return {relation: i for i, relation in enumerate(self.relations)}

    @property
    def relation_inputs(self) -> int:
        """Inputs of the networks that say which relation a program has; 0 if there is only one."""
        return len(self.relations) if len(self.relations) > 1 else 0
