"""Designs: which blocks exist, which are targets in training, which held out (paper, fig. 2)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import COLORS, SHAPES
from pa_ros.language.vocabulary import Vocabulary
from pa_ros.world.relations import RELATIONS


class Kind(NamedTuple):
    """What a block is: unique within an episode."""

    color: str
    shape: str

    @property
    def words(self) -> frozenset[str]:
        """The property words that are true of such a block."""
        return frozenset(self)


@dataclass(frozen=True)
class Design:
    """A partition of target blocks into training and held out, and the words to name them."""

    name: str
    shapes: tuple[str, ...]  # of the blocks on the table in training
    colors: tuple[str, ...]
    vocabulary: Vocabulary
    train: tuple[Kind, ...]
    held_out: tuple[Kind, ...] = ()
    n_blocks: int = 4
    new_shape: str = "CAPSULE"  # added to the pool by the conditions with new blocks
    new_color: str = "MAGENTA"

    def __post_init__(self) -> None:
        for group, words, known in (
            ("shapes", self.shapes, SHAPES),
            ("colors", self.colors, COLORS),
        ):
            if not words or len(set(words)) < len(words) or not set(words) <= set(known):
                raise ConfigError(
                    f"design {self.name}: {group}: expected some of {known}, got {words}"
                )
        unnamed = (set(self.shapes) - set(self.vocabulary["shape"])) | (
            set(self.colors) - set(self.vocabulary["color"])
        )
        if unnamed:
            raise ConfigError(f"design {self.name}: no word in the vocabulary for {unnamed}")
        targets = (*self.train, *self.held_out)
        if not self.train or len(set(targets)) < len(targets) or not set(targets) <= set(self.pool):
            raise ConfigError(
                f"design {self.name}: expected train and held-out targets that are distinct "
                f"blocks of the design, got {self.train} and {self.held_out}"
            )
        if not 1 <= self.n_blocks <= len(self.pool):
            raise ConfigError(
                f"design {self.name}: n_blocks: expected 1 to {len(self.pool)} (unique shape and "
                f"color), got {self.n_blocks}"
            )

    @property
    def pool(self) -> tuple[Kind, ...]:
        """Every block that training can put on the table."""
        return kinds(self.colors, self.shapes)

    def with_relations(self, *relations: str) -> Design:
        """The same blocks, for programs that ask for these relations; ConfigError for one that is
        not registered."""
        for relation in relations:
            RELATIONS[relation]
        return replace(self, vocabulary=replace(self.vocabulary, relations=relations))

    @property
    def extended_pool(self) -> tuple[Kind, ...]:
        """The pool with one more shape and one more color."""
        return kinds((*self.colors, self.new_color), (*self.shapes, self.new_shape))


def kinds(colors: tuple[str, ...], shapes: tuple[str, ...]) -> tuple[Kind, ...]:
    """All combinations, in order."""
    return tuple(Kind(color, shape) for color, shape in product(colors, shapes))


_SHAPES_2, _COLORS_2 = ("CUBE", "SPHERE"), ("RED", "BLUE")
_SHAPES_3, _COLORS_3 = ("CUBE", "SPHERE", "CYLINDER"), ("RED", "GREEN", "BLUE")
_WORDS_2 = Vocabulary.of(shape=_SHAPES_2, color=_COLORS_2)
_WORDS_3 = Vocabulary.of(shape=(*_SHAPES_3, "C"), color=(*_COLORS_3, "A", "B"))
_WORDS_3_EXACT = Vocabulary.of(
    shape=_SHAPES_3, color=_COLORS_3
)  # without words for what is not there yet
_ALL_2, _ALL_3 = kinds(_COLORS_2, _SHAPES_2), kinds(_COLORS_3, _SHAPES_3)
_CORNER = Kind("BLUE", "SPHERE")
_DIAGONAL = tuple(Kind(color, shape) for color, shape in zip(_COLORS_3, _SHAPES_3, strict=True))

_THREE_D = Design(
    "3-D",
    _SHAPES_3,
    _COLORS_3,
    _WORDS_3,
    tuple(kind for kind in _ALL_3 if kind not in _DIAGONAL),
    _DIAGONAL,
)

DESIGNS = {
    design.name: design
    for design in (
        Design("2-C", _SHAPES_2, _COLORS_2, _WORDS_2, _ALL_2),
        Design(
            "2-L",
            _SHAPES_2,
            _COLORS_2,
            _WORDS_2,
            tuple(kind for kind in _ALL_2 if kind != _CORNER),
            (_CORNER,),
        ),
        Design("3-C", _SHAPES_3, _COLORS_3, _WORDS_3, _ALL_3),
        _THREE_D,
        replace(_THREE_D, name="3-D-exact", vocabulary=_WORDS_3_EXACT),
    )
}


def design_named(name: str) -> Design:
    """Look up a design of the paper; ConfigError names the known ones."""
    if name not in DESIGNS:
        raise ConfigError(f"arena: expected a design of {sorted(DESIGNS)}, got {name!r}")
    return DESIGNS[name]
