"""The hand and the blocks of an arena by name: look at them, move, add and remove them. No ROS."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from pydantic_core import SchemaError, SchemaValidator, core_schema

from pa_ros.arena import Episode, Kind
from pa_ros.arena.rearranging import bodies, rearrange
from pa_ros.arena.urdf import FRAMES, link_name
from pa_ros.core.experience import Body
from pa_ros.wire.simulator import Category, Entity, EntityFilter, ResultCode, SpawnCode, Spawning
from pa_ros.wire.views import OPTICAL_FRAME, Solid
from sim_node.session import Session, SimulatorError

HAND = "hand"
NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*(/[A-Za-z][A-Za-z0-9_]*)*\Z")


class Entities:
    """The hand and the blocks of a session's arena. Names are valid until the episode ends.

    Methods raise SimulatorError for a wrong request, and ArenaError for poses that cannot be.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._names: list[str] = []  # of the blocks, in the order of the observation's rows
        self._spawned: dict[str, Body] = {}  # where each added block was put, by name
        self._named_episode: Episode | None = None

    def matching(self, wanted: EntityFilter | None = None) -> list[Entity]:
        """The entities that pass a filter, the hand first."""
        self._name_blocks()
        hand, *states = bodies(self._session.task)
        found = [Entity(HAND, Category.ROBOT, (), "the arm's hand", hand)]
        schema = self._session.task.design.schema
        for name, kind, body in zip(self._names, self._kinds(), states, strict=True):
            moves = schema.has_body(kind)
            category = Category.DYNAMIC_OBJECT if moves else Category.STATIC_OBJECT
            found.append(Entity(name, category, tuple(kind.values()), f"a {kind}", body))
        return found if wanted is None else list(filter(_test_of(wanted), found))

    def named(self, name: str) -> Entity:
        """The entity with this name."""
        for entity in self.matching():
            if entity.name == name:
                return entity
        raise _not_found(name, [HAND, *self._names])

    def spawnable(self) -> dict[str, Kind]:
        """The kinds of blocks that can be added, by uri."""
        design = self._session.task.design
        return {_uri_of(kind): kind for kind in (*design.extended_pool, *design.places)}

    def put(self, name: str, body: Body) -> None:
        """Change the pose and the velocity of a block."""
        index = self._index_of(name)
        placed = bodies(self._session.task)[1:]
        placed[index] = body
        self._rearrange(self._names, self._kinds(), placed, [index])

    def spawn(self, request: Spawning) -> str:
        """Add a block; return its name."""
        self._name_blocks()
        kind = self._kind_of(request)
        name = self._free_name(request, kind)
        placed = [*bodies(self._session.task)[1:], request.body]
        kinds = [*self._kinds(), kind]
        self._rearrange([*self._names, name], kinds, placed, [len(placed) - 1])
        self._spawned[name] = request.body
        return name

    def delete(self, *names: str) -> None:
        """Remove blocks. Raises ArenaError if none would stay."""
        gone = {self._index_of(name) for name in names}
        stay = [i for i in range(len(self._names)) if i not in gone]
        kinds, placed = self._kinds(), bodies(self._session.task)[1:]
        left = [self._names[i] for i in stay], [kinds[i] for i in stay], [placed[i] for i in stay]
        self._rearrange(*left, given=())
        for name in names:
            self._spawned.pop(name, None)

    def despawn(self) -> None:
        """Remove the added blocks."""
        self._name_blocks()
        if self._spawned:
            self.delete(*self._spawned)

    def restart(self, begin: Callable[[], object], keep_spawned: bool) -> None:
        """Begin the episode again; put added blocks where they were added, or remove them."""
        self._name_blocks()
        kinds = dict(zip(self._names, self._kinds(), strict=True))
        spawned = self._spawned if keep_spawned else {}
        begin()
        for name, body in spawned.items():
            self.spawn(Spawning(name, True, _uri_of(kinds[name]), body))

    def _name_blocks(self) -> None:
        """Name the blocks of an episode that has just begun."""
        episode = self._session.task.episode
        if episode is self._named_episode:
            return
        self._named_episode, self._names, self._spawned = episode, [], {}
        for kind in self._kinds():
            self._names.append(_numbered(_snake(str(kind)), self._names))

    def _kinds(self) -> list[Kind]:
        return [block.kind for block in self._session.task.episode.blocks]

    def _index_of(self, name: str) -> int:
        """The place of a block."""
        self._name_blocks()
        if name == HAND:
            text = f"entity: expected one of {self._names}: only the joints move the hand"
            raise SimulatorError(text, ResultCode.OPERATION_FAILED)
        if name not in self._names:
            raise _not_found(name, self._names)
        return self._names.index(name)

    def _rearrange(
        self,
        names: Sequence[str],
        kinds: Sequence[Kind],
        placed: Sequence[Body],
        given: Collection[int],
    ) -> None:
        rearrange(self._session.task, kinds, placed, given)
        # The next step is then no consequence of a command alone, so no agent learns from it.
        self._session.disturbed = True
        self._named_episode, self._names = self._session.task.episode, list(names)

    def _kind_of(self, request: Spawning) -> Kind:
        field, known = "spawn_entity.uri", self.spawnable()
        if not request.uri:
            text = f"{field}: expected one of get_spawnables, got none"
            raise SimulatorError(text, SpawnCode.NO_RESOURCE)
        if request.uri not in known:
            text = f"{field}: expected one of {list(known)}, got {request.uri[:200]!r}"
            raise SimulatorError(text, SpawnCode.UNSUPPORTED_FORMAT)
        return known[request.uri]

    def _free_name(self, request: Spawning, kind: Kind) -> str:
        name = request.name or (_snake(str(kind)) if request.allow_renaming else "")
        if not NAME.match(name):
            text = f"spawn_entity.name: expected letters, digits and _, got {name!r}"
            raise SimulatorError(text, SpawnCode.NAME_INVALID)
        model = self._session.task.simulation.model
        # Each name is a frame in tf, where it must have one parent.
        links = (link_name(model, body) for body in range(model.body(HAND).id + 1))
        taken = [*FRAMES, OPTICAL_FRAME, *links, *self._names]
        if name in taken and not request.allow_renaming:
            text = f"spawn_entity.name: expected another than {taken}, got {name!r}"
            raise SimulatorError(text, SpawnCode.NAME_NOT_UNIQUE)
        return _numbered(name, taken)


def solids(model: Any, blocks: Sequence[Entity]) -> list[Solid]:
    """Shape and color of the blocks of a compiled MuJoCo model, in their order."""
    found = []
    for i, entity in enumerate(blocks):
        geom = model.geom(f"block{i}")
        shape = {2: "sphere", 3: "capsule", 5: "cylinder", 6: "box"}[int(geom.type[0])]  # mjtGeom
        # MuJoCo's sizes are radii and half lengths.
        x, y, z = geom.size.tolist()
        whole = {
            "sphere": (2 * x, 2 * x, 2 * x),
            "box": (2 * x, 2 * y, 2 * z),
            "cylinder": (2 * x, 2 * x, 2 * y),
            "capsule": (2 * x, 2 * x, 2 * (x + y)),
        }[shape]
        color = tuple(geom.rgba.tolist())
        # The disk of a place lies below its pose, which is that of a block on it.
        body = replace(entity.body, position=entity.body.position + geom.pos)
        found.append(Solid(entity.name, shape, np.array(whole), color, body))
    return found


def _uri_of(kind: Kind) -> str:
    return f"block:{_snake(str(kind))}"


def _snake(text: str) -> str:
    return text.lower().replace(" ", "_")


def _numbered(name: str, taken: Sequence[str]) -> str:
    """The name, with a number if it is taken."""
    number, free = 1, name
    while free in taken:
        number += 1
        free = f"{name}_{number}"
    return free


def _not_found(name: str, known: Sequence[str]) -> SimulatorError:
    text = f"entity: expected one of {list(known)}, got {name!r}"
    return SimulatorError(text, ResultCode.NOT_FOUND)


def _test_of(wanted: EntityFilter) -> Callable[[Entity], bool]:
    """Whether an entity passes a filter, as a function."""
    # The standard's expressions are POSIX extended. pydantic's regular expressions know its
    # character classes and take linear time, while Python's own know neither.
    try:
        pattern = SchemaValidator(core_schema.str_schema(pattern=wanted.pattern))
    except SchemaError as error:
        reason = str(error).splitlines()[-1].strip()
        text = f"filters.filter: expected a regular expression, got {wanted.pattern[:200]!r}"
        raise SimulatorError(f"{text}: {reason}", ResultCode.OPERATION_FAILED) from error
    quantity = all if wanted.all_tags else any

    def passes(entity: Entity) -> bool:
        tagged = not wanted.tags or quantity(tag in entity.tags for tag in wanted.tags)
        kept = not wanted.categories or entity.category in wanted.categories
        named = pattern.isinstance_python(entity.name)
        return named and kept and tagged and wanted.within(entity.body)

    return passes
