"""What is in the arena, by name: looked at, put elsewhere, added, taken away. Without ROS."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from pydantic_core import SchemaError, SchemaValidator, core_schema

from pa_ros.arena import Episode, Kind
from pa_ros.arena.rearranging import bodies, check_added, rearrange
from pa_ros.core.body import Body
from pa_ros.wire.simulator import (
    Category,
    Entity,
    EntityFilter,
    ResultCode,
    SpawnCode,
    Spawning,
)
from pa_ros.wire.views import Solid
from sim_node.errors import SimulatorError
from sim_node.session import Session

HAND = "hand"
NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*(/[A-Za-z][A-Za-z0-9_]*)*\Z")
LARGEST = 32  # blocks
LONGEST_FILTER = 1000


class Entities:
    """The hand and the blocks of a session's arena. Names last as long as the episode."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._names: list[str] = []  # of the blocks, in Ω's order
        self._spawned: dict[str, Body] = {}  # by name, as they were spawned
        self._known: Episode | None = None

    def matching(self, wanted: EntityFilter | None = None) -> list[Entity]:
        """Hand and blocks that a filter lets pass. SimulatorError for a filter that can't be."""
        self._look()
        kinds = [block.kind for block in self._session.task.episode.blocks]
        states = bodies(self._session.task)
        found = [Entity(HAND, Category.ROBOT, (), "the arm's hand", states[0])]
        for name, kind, body in zip(self._names, kinds, states[1:], strict=True):
            tags = tuple(sorted(kind.words))
            found.append(Entity(name, Category.DYNAMIC_OBJECT, tags, f"a {label(kind)}", body))
        passes = _filter(wanted) if wanted is not None else None
        return [entity for entity in found if passes is None or passes(entity)]

    def named(self, name: str) -> Entity:
        """SimulatorError if there is none of that name."""
        for entity in self.matching():
            if entity.name == name:
                return entity
        raise _not_found(name, [HAND, *self._names])

    def put(self, name: str, change: Callable[[Body], Body]) -> None:
        """Have a block elsewhere, or moving otherwise. Raises SimulatorError, ArenaError."""
        index = self._block(name)
        placed = bodies(self._session.task)[1:]
        placed[index] = change(placed[index])
        self._rearrange(self._names, self._kinds(), placed)

    def spawn(self, request: Spawning) -> str:
        """Add a block; its name. Raises SimulatorError, ArenaError."""
        self._look()
        kind = self._kind_of(request)
        name = self._free_name(request, kind)
        self._check_number(len(self._names) + 1)
        placed = [*bodies(self._session.task)[1:], request.body]
        self._rearrange([*self._names, name], [*self._kinds(), kind], placed)
        self._spawned[name] = request.body
        return name

    def delete(self, *names: str) -> None:
        """Take blocks away. Raises SimulatorError, ArenaError if none would stay."""
        gone = {self._block(name) for name in names}
        keep = [i for i in range(len(self._names)) if i not in gone]
        placed, kinds = bodies(self._session.task)[1:], self._kinds()
        self._rearrange(
            [self._names[i] for i in keep], [kinds[i] for i in keep], [placed[i] for i in keep]
        )
        for name in names:
            self._spawned.pop(name, None)

    def despawn(self) -> None:
        """Take away whatever was spawned."""
        self._look()
        if self._spawned:
            self.delete(*self._spawned)

    def restore(self, begin: Callable[[], object], spawned: bool) -> None:
        """`begin` the episode anew; with `spawned`, blocks that were added stand where they were
        spawned. Raises SimulatorError, ArenaError if these can't; then nothing has changed."""
        self._look()
        kinds = dict(zip(self._names, self._kinds(), strict=True))
        kept = {name: (kinds[name], body) for name, body in self._spawned.items() if spawned}
        if kept:
            self._check_room([*kept.values()])
        begin()
        for name, (kind, body) in kept.items():
            self.spawn(Spawning(name, True, uri_of(kind), body))

    def _check_room(self, added: Sequence[tuple[Kind, Body]]) -> None:
        """SimulatorError, ArenaError unless blocks fit in with those that the episode begins
        with."""
        stands = self._session.frame
        episode = self._session.scene(stands.evaluation, stands.observation.episode)
        self._check_number(len(episode.blocks) + len(added))
        check_added(self._session.task, episode, added)

    def _check_number(self, blocks: int) -> None:
        if blocks > LARGEST:
            text = f"blocks: expected at most {LARGEST}, got {blocks}"
            raise SimulatorError(text, ResultCode.OPERATION_FAILED)

    def spawnable(self) -> dict[str, Kind]:
        """What can be spawned, by its uri."""
        return {uri_of(kind): kind for kind in self._session.task.design.extended_pool}

    def _look(self) -> None:
        """Name the blocks of an episode that was not seen yet."""
        episode = self._session.task.episode
        if episode is self._known:
            return
        self._known, self._names, self._spawned = episode, [], {}
        for block in episode.blocks:
            self._names.append(_numbered(_snake(label(block.kind)), self._names))

    def _kinds(self) -> list[Kind]:
        return [block.kind for block in self._session.task.episode.blocks]

    def _block(self, name: str) -> int:
        self._look()
        if name == HAND:
            text = f"entity: expected one of {self._names}: the hand is where the joints have it"
            raise SimulatorError(text, ResultCode.OPERATION_FAILED)
        if name not in self._names:
            raise _not_found(name, self._names)
        return self._names.index(name)

    def _rearrange(
        self, names: Sequence[str], kinds: Sequence[Kind], placed: Sequence[Body]
    ) -> None:
        rearrange(self._session.task, kinds, placed)
        self._session.disturbed = True
        self._known, self._names = self._session.task.episode, list(names)

    def _kind_of(self, request: Spawning) -> Kind:
        if not request.uri:
            text = "spawn_entity.entity_resource.uri: expected one of get_spawnables, got none"
            raise SimulatorError(text, SpawnCode.NO_RESOURCE)
        known = self.spawnable()
        if request.uri not in known:
            text = f"spawn_entity.entity_resource.uri: expected one of {list(known)}, "
            raise SimulatorError(text + f"got {request.uri!r}", SpawnCode.UNSUPPORTED_FORMAT)
        return known[request.uri]

    def _free_name(self, request: Spawning, kind: Kind) -> str:
        name = request.name or (_snake(label(kind)) if request.allow_renaming else "")
        if not NAME.match(name) or len(name) > 200:
            text = f"spawn_entity.name: expected letters, digits and _, got {name[:200]!r}"
            raise SimulatorError(text, SpawnCode.NAME_INVALID)
        taken = [HAND, *self._names]
        if name in taken and not request.allow_renaming:
            text = f"spawn_entity.name: expected another than {taken}, got {name!r}"
            raise SimulatorError(text, SpawnCode.NAME_NOT_UNIQUE)
        return _numbered(name, taken)


def solids(model: Any, blocks: Sequence[Entity]) -> list[Solid]:
    """How a compiled model has its blocks look, in Ω's order."""
    found = []
    for i, entity in enumerate(blocks):
        geom = model.geom(f"block{i}")
        shape = {2: "sphere", 3: "capsule", 5: "cylinder", 6: "box"}[int(geom.type[0])]  # mjtGeom
        x, y, z = geom.size.tolist()
        whole = {
            "sphere": (2 * x, 2 * x, 2 * x),
            "box": (2 * x, 2 * y, 2 * z),
            "cylinder": (2 * x, 2 * x, 2 * y),
            "capsule": (2 * x, 2 * x, 2 * (x + y)),
        }[shape]
        color = tuple(geom.rgba.tolist())
        found.append(Solid(entity.name, shape, np.array(whole), color, entity.body))
    return found


def label(kind: Kind) -> str:
    """A kind in words: "RED CUBE"."""
    return str(kind)


def uri_of(kind: Kind) -> str:
    """What a kind is spawned by."""
    return f"block:{_snake(label(kind))}"


def _snake(text: str) -> str:
    return text.lower().replace(" ", "_")


def _numbered(name: str, taken: Sequence[str]) -> str:
    number, free = 1, name
    while free in taken:
        number += 1
        free = f"{name}_{number}"
    return free


def _not_found(name: str, known: Sequence[str]) -> SimulatorError:
    text = f"entity: expected one of {list(known)}, got {name[:200]!r}"
    return SimulatorError(text, ResultCode.NOT_FOUND)


def _filter(wanted: EntityFilter) -> Callable[[Entity], bool]:
    pattern = _expression(wanted.pattern)
    quantity = all if wanted.all_tags else any

    def passes(entity: Entity) -> bool:
        tagged = not wanted.tags or quantity(tag in entity.tags for tag in wanted.tags)
        kept = not wanted.categories or entity.category in wanted.categories
        named = pattern.isinstance_python(entity.name)
        return named and kept and tagged and wanted.within(entity.body)

    return passes


def _expression(text: str) -> SchemaValidator:
    """What names that have a match are valid to: takes time in proportion to a name, whatever the
    expression is, as Python's own does not. SimulatorError for one that is none, or too large."""
    expected = f"filters.filter: expected a regular expression of at most {LONGEST_FILTER} letters"
    reason = "too long"
    if len(text) <= LONGEST_FILTER:
        try:
            return SchemaValidator(core_schema.str_schema(pattern=text))
        except SchemaError as error:
            reason = str(error).splitlines()[-1].strip()
    raise SimulatorError(f"{expected}, got {text[:200]!r}: {reason}", ResultCode.OPERATION_FAILED)
