"""Designs: which blocks exist, which are training targets, which are held out (paper, fig. 2)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from typing import Any

from pa_ros.arena.skills import SKILLS, Skill
from pa_ros.core.errors import ConfigError
from pa_ros.core.registry import Registry
from pa_ros.language.syntax import HOLD, NEAR, ON
from pa_ros.language.vocabulary import Vocabulary
from pa_ros.world.relation import RELATIONS, SIDES
from pa_ros.world.schema import COLORS, PAPER, PLACE, PUSHING, SIZED, ObjectSchema

Values = Mapping[str, tuple[str, ...]]


class Kind(Mapping[str, str]):
    """The properties of a block, unique in an episode: a value of each property group.

    `Kind(color="RED", shape="CUBE")["color"]` is "RED".
    """

    def __init__(self, **values: str) -> None:
        self._values = values
        self._hash = hash(frozenset(values.items()))

    def __getitem__(self, group: str) -> str:
        return self._values[group]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __hash__(self) -> int:
        return self._hash

    def __repr__(self) -> str:
        return f"Kind({', '.join(f'{group}={value!r}' for group, value in self.items())})"

    def __str__(self) -> str:
        return " ".join(self.values())

    @cached_property
    def words(self) -> frozenset[str]:
        """The property words that are true of the block."""
        return frozenset(self.values())

    @property
    def conjunction(self) -> str:
        """The program text AND(RED, CUBE), in the order of the groups; RED for a single group."""
        return f"AND({', '.join(self.values())})" if len(self) > 1 else str(self)


@dataclass(frozen=True)
class Design:
    """A partition of target blocks into training and held out, and the words to name them."""

    name: str
    values: Values = field(hash=False)
    """Values of the blocks in training, by group, in the order in which programs name them."""
    vocabulary: Vocabulary
    train: tuple[Kind, ...]
    held_out: tuple[Kind, ...] = ()
    n_blocks: int = 4
    novel: Mapping[str, str] = field(default_factory=dict, hash=False)
    """A new value of a group, which the conditions with new blocks add to the pool."""
    schema: ObjectSchema = PAPER
    places: tuple[Kind, ...] = ()
    """Kinds without a body, to which programs move blocks; empty: programs move the hand."""
    n_places: int = 0  # on the table
    pairs: bool = False  # training programs move blocks to other blocks, too
    held_out_combinations: tuple[tuple[str, Kind], ...] = ()
    """Relations with a training target that no training program combines."""
    edges_m: Mapping[str, tuple[float, float]] = field(default_factory=dict, hash=False)
    """The shortest and longest edge (m) of blocks of each size, between which it is drawn for each
    block. Empty: all blocks of a size are equal."""
    unseen_edges_m: Mapping[str, tuple[float, float]] = field(default_factory=dict, hash=False)
    """The same for conditions with sizes that training has not."""
    skill_name: str = ""
    """What programs do, one of SKILLS; empty: what the vocabulary says."""

    def __post_init__(self) -> None:
        self._check_values()
        if any(map(self.schema.has_body, self.places)) or self.n_places > len(self.places):
            raise ConfigError(f"design {self.name}: expected places without bodies, {self.places}")
        targets = (*self.train, *self.held_out)
        if not self.train or len(set(targets)) < len(targets) or not set(targets) <= set(self.pool):
            raise ConfigError(
                f"design {self.name}: expected train and held-out targets that are distinct "
                f"blocks of the design, got {self.train} and {self.held_out}"
            )
        for relation, kind in self.held_out_combinations:
            if relation not in self.vocabulary.relations or kind not in self.train:
                raise ConfigError(
                    f"design {self.name}: held_out_combinations: expected relations and training "
                    f"targets of the design, got {relation} and {kind}"
                )
        if not any(self.trains(relation, kind) for relation in self.vocabulary.relations
                   for kind in self.train):  # fmt: skip
            raise ConfigError(f"design {self.name}: expected a training program, all are held out")
        if not 1 <= self.n_blocks <= len(self.pool):
            raise ConfigError(
                f"design {self.name}: n_blocks: expected 1 to {len(self.pool)} (unique in their "
                f"properties), got {self.n_blocks}"
            )

    def _check_values(self) -> None:
        for group in (*self.values, *self.novel):
            known = self.schema[group].features.values
            words = self.values.get(group, ())
            added = (self.novel[group],) if group in self.novel else ()
            given = words + added
            if not words or len(set(given)) < len(given) or not set(given) <= set(known):
                raise ConfigError(
                    f"design {self.name}: {group}: expected some of {known}, got {given}"
                )
        if missing := {group.name for group in self.schema} - set(self.values):
            raise ConfigError(f"design {self.name}: expected values of {sorted(missing)}, got none")
        for group, words in self.values.items():
            if unnamed := set(words) - set(self.vocabulary[group]):
                raise ConfigError(f"design {self.name}: no word in the vocabulary for {unnamed}")

    @property
    def skill(self) -> Skill:
        """What programs do; ConfigError if it is not registered."""
        words = self.vocabulary
        usual = "push" if words.moves_objects else "avoid" if words.avoids else "reach"
        return SKILLS[self.skill_name or usual]

    @property
    def preset(self) -> str:
        """The arena's preset, unless another one is chosen."""
        return self.skill.preset

    @property
    def pool(self) -> tuple[Kind, ...]:
        """Every block that training can put on the table."""
        return kinds(self.values)

    def with_relations(self, *relations: str) -> Design:
        """The same blocks, for programs that ask for these relations; ConfigError for one that is
        not registered. Combinations with them stay held out."""
        for relation in relations:
            RELATIONS[relation]
        held_out = tuple(pair for pair in self.held_out_combinations if pair[0] in relations)
        vocabulary = replace(self.vocabulary, relations=relations)
        return replace(self, vocabulary=vocabulary, held_out_combinations=held_out)

    def trains(self, relation: str, kind: Kind) -> bool:
        """Whether the combination of a relation and a training target is not held out."""
        return (relation, kind) not in self.held_out_combinations

    def relations_for(
        self, kind: Kind, among: tuple[str, ...] = (), held_out: bool | None = None
    ) -> tuple[str, ...]:
        """The relations of programs for a target, `among` these or all: only those whose
        combination with it is held out (True), none of them (False), or any (None)."""
        return tuple(
            relation
            for relation in among or self.vocabulary.relations
            if held_out in (None, not self.trains(relation, kind))
        )

    @property
    def extended_pool(self) -> tuple[Kind, ...]:
        """The pool with one more value of each group that has a novel one."""
        return kinds(
            {
                group: (*words, self.novel[group]) if group in self.novel else words
                for group, words in self.values.items()
            }
        )

    @property
    def words(self) -> tuple[str, ...]:
        """Words of what training puts on the table, in the order of the schema."""
        return tuple(word for group in self.schema for word in self.values[group.name])

    def spare(self, group: str) -> tuple[str, ...]:
        """A group's words for what training has not."""
        known = {*self.values[group], *self.schema.bodiless}
        return tuple(w for w in self.vocabulary[group] if w not in known)


def kinds(values: Values) -> tuple[Kind, ...]:
    """All combinations, in order."""
    return tuple(Kind(**dict(zip(values, row, strict=True))) for row in product(*values.values()))


DESIGNS: Registry[Design] = Registry("design")


def register(*designs: Design) -> None:
    """Make designs known by their names."""
    for design in designs:
        DESIGNS.register(design.name, design)


_VALUES_2 = {"color": ("RED", "BLUE"), "shape": ("CUBE", "SPHERE")}
_VALUES_3 = {"color": ("RED", "GREEN", "BLUE"), "shape": ("CUBE", "SPHERE", "CYLINDER")}
_WORDS_2 = Vocabulary.of(shape=_VALUES_2["shape"], color=_VALUES_2["color"])
_WORDS_3 = Vocabulary.of(shape=(*_VALUES_3["shape"], "C"), color=(*_VALUES_3["color"], "A", "B"))
# The same without spare words.
_WORDS_3_EXACT = Vocabulary.of(shape=_VALUES_3["shape"], color=_VALUES_3["color"])
_ALL_2, _ALL_3 = kinds(_VALUES_2), kinds(_VALUES_3)
_CORNER = Kind(color="BLUE", shape="SPHERE")
_DIAGONAL = tuple(
    Kind(color=color, shape=shape)
    for color, shape in zip(_VALUES_3["color"], _VALUES_3["shape"], strict=True)
)
_OFF_DIAGONAL = tuple(kind for kind in _ALL_3 if kind not in _DIAGONAL)
_SIZES = {"size": ("SMALL", "LARGE"), **_VALUES_3}


def _on_diagonal(kind: Kind) -> bool:
    return any(one.words <= kind.words for one in _DIAGONAL)


_COMMON: dict[str, Any] = {"novel": {"color": "MAGENTA", "shape": "CAPSULE"}}
_RELATIONS = ("NEAR", "ABOVE", *SIDES)
_THREE_D = Design("3-D", _VALUES_3, _WORDS_3, _OFF_DIAGONAL, _DIAGONAL, **_COMMON)

register(
    Design("2-C", _VALUES_2, _WORDS_2, _ALL_2, **_COMMON),
    Design("2-L", _VALUES_2, _WORDS_2, tuple(k for k in _ALL_2 if k != _CORNER), (_CORNER,),
           **_COMMON),
    Design("3-C", _VALUES_3, _WORDS_3, _ALL_3, **_COMMON),
    _THREE_D,
    replace(_THREE_D, name="3-D-avoid", vocabulary=_WORDS_3.avoiding()),
    replace(_THREE_D, name="3-D-exact", vocabulary=_WORDS_3_EXACT),
    # Each relation is held out with one training target: with another one each.
    replace(
        _THREE_D.with_relations(*_RELATIONS),
        name="3-D-relations",
        held_out_combinations=tuple(zip(_RELATIONS, _OFF_DIAGONAL, strict=True)),
    ),
    # ABOVE is only ever trained with red blocks.
    replace(
        _THREE_D.with_relations("NEAR", "ABOVE"),
        name="3-D-above-red",
        held_out_combinations=tuple(
            ("ABOVE", kind) for kind in _OFF_DIAGONAL if "RED" not in kind.words
        ),
    ),
    Design(
        "sizes",
        _SIZES,
        SIZED.vocabulary,
        train=tuple(kind for kind in kinds(_SIZES) if not _on_diagonal(kind)),
        held_out=tuple(kind for kind in kinds(_SIZES) if _on_diagonal(kind)),
        schema=SIZED,
        edges_m={"SMALL": (0.03, 0.05), "LARGE": (0.07, 0.09)},
        unseen_edges_m={"SMALL": (0.022, 0.028), "LARGE": (0.092, 0.098)},
    ),
)  # fmt: skip


def _pushing(
    name: str, shapes: tuple[str, ...], words: Vocabulary, held_out: tuple[Kind, ...]
) -> Design:
    """A design whose programs move blocks, to places and to other blocks. No training program
    names a held-out block, in either argument."""
    colors = tuple(word for word in words["color"] if word in COLORS)
    values = {"color": colors, "shape": shapes}
    train = tuple(kind for kind in kinds(values) if kind not in held_out)
    places = kinds({"color": colors, "shape": (PLACE,)})
    return Design(name, values, words.moving(PLACE), train, held_out, schema=PUSHING,
                  places=places, n_places=2, **_COMMON)  # fmt: skip


_PUSH_2_WORDS = Vocabulary.of(shape=("CUBE", "CYLINDER", PLACE), color=("RED", "BLUE"))
_PUSH_3_WORDS = Vocabulary.of(
    shape=(*_VALUES_3["shape"], PLACE, "C"), color=(*_VALUES_3["color"], "A", "B")
)
_PUSH_2 = _pushing(
    "push-2",
    ("CUBE", "CYLINDER"),
    _PUSH_2_WORDS,
    (Kind(color="BLUE", shape="CYLINDER"),),
)
register(
    _PUSH_2,
    replace(_PUSH_2, name="push-2-pairs", pairs=True),
    _pushing(
        "push-3D",
        _VALUES_3["shape"],
        _PUSH_3_WORDS,
        _DIAGONAL,
    ),
)


def _stacking(
    name: str, shapes: tuple[str, ...], words: Vocabulary, held_out: tuple[Kind, ...]
) -> Design:
    """Blocks that the hand takes and puts on places and on each other."""
    one = _pushing(name, shapes, words, held_out)
    vocabulary = replace(one.vocabulary, relations=(ON, HOLD, NEAR))
    return replace(one, vocabulary=vocabulary, pairs=True, skill_name="hold", n_blocks=3)


register(
    _stacking("stack-2", ("CUBE", "CYLINDER"), _PUSH_2_WORDS, _PUSH_2.held_out),
    _stacking("stack-3D", ("CUBE", "CYLINDER", "SPHERE"), _PUSH_3_WORDS, _DIAGONAL),
)


def design_named(name: str) -> Design:
    """Look up a design; ConfigError names the known ones."""
    return DESIGNS[name]
