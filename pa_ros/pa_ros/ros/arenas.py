"""Which arena a node belongs to: the one whose steps come, not the first that said it is there."""

from __future__ import annotations

import math
import time
from collections import OrderedDict
from collections.abc import Callable

from pa_ros.core.errors import PaError
from pa_ros.wire.arena import ArenaDescription

SILENT_S = 2.0  # without a step for so long, an arena gives way to one whose steps come
RIVAL_S = 3.0  # a step of another arena is an alarm for so long
KNOWN = 16  # arenas remembered


class OtherArenaError(PaError):
    """A step of another arena than the one that the node belongs to."""

    code = "observation.arena"


class Arenas:
    """The arena that counts, and the others heard of.

    Before any step has come the newest description counts, for what it is worth. A description
    alone never takes the place of an arena whose steps come.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.current: ArenaDescription | None = None
        self._clock = clock
        self._known: OrderedDict[str, ArenaDescription] = OrderedDict()
        self._heard: dict[str, float] = {}  # when a step of an arena came last
        self._stranger, self._stranger_at = "", -math.inf  # only said to be there

    def announce(self, arena: ArenaDescription) -> bool:
        """An arena describes itself; whether it is the one that counts now."""
        self._known[arena.arena_id] = arena
        self._known.move_to_end(arena.arena_id)
        current = self.current
        if current is None or arena.arena_id == current.arena_id or not self._alive(current):
            self.current = arena
        else:
            self._stranger, self._stranger_at = arena.arena_id, self._clock()
        self._forget()
        return self.current is arena

    def step(self, arena_id: str) -> bool:
        """A step has come; whether another arena counts because of it.

        Raises OtherArenaError if it is of one that does not count.
        """
        current, known = self.current, self._known.get(arena_id)
        changed = False
        if current is None or current.arena_id != arena_id:
            if known is not None and (current is None or not self._alive(current)):
                self.current, changed = known, True
            elif current is not None:
                if known is not None:
                    self._heard[arena_id] = self._clock()
                raise OtherArenaError(
                    f"arena_id: expected {current.arena_id!r}, whose steps come, got a step of "
                    f"{arena_id!r}: stop one of the two, or start it in a namespace of its own"
                )
        if self.current is not None:
            self._heard[arena_id] = self._clock()
        return changed

    @property
    def rivals(self) -> list[str]:
        """Other arenas whose steps come."""
        mine = "" if self.current is None else self.current.arena_id
        since = self._clock() - RIVAL_S
        return sorted(name for name, at in self._heard.items() if name != mine and at > since)

    @property
    def alarm(self) -> str:
        """What a person should know and do; empty: nothing."""
        rivals, stranger = self.rivals, self._stranger
        if rivals:
            others = ", ".join(rivals)
            return f"steps of other arenas come, too ({others}): stop all but one sim_node"
        mine = "" if self.current is None else self.current.arena_id
        if self._clock() - self._stranger_at < RIVAL_S and stranger != mine:
            return (
                f"another arena describes itself here ({stranger}), sends no steps, and is not "
                "believed: find who publishes it, or sign with auth_key_file"
            )
        return ""

    def _forget(self) -> None:
        """The arenas that described themselves longest ago, but for the one that counts."""
        spare = [name for name, one in self._known.items() if one is not self.current]
        for name in spare[: max(0, len(self._known) - KNOWN)]:
            del self._known[name]
            self._heard.pop(name, None)

    def _alive(self, arena: ArenaDescription) -> bool:
        return self._clock() - self._heard.get(arena.arena_id, -math.inf) < SILENT_S
