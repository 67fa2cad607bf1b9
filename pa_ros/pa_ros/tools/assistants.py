"""Tools for assistants by the Model Context Protocol: see the table, check programs, execute them.

The server gives an assistant no topics, services or parameters, only the tools below.
"""

from __future__ import annotations

import io
import threading
import time
from collections.abc import Callable
from functools import partial, wraps
from math import isfinite
from typing import TYPE_CHECKING, Any

import anyio
from anyio.to_thread import run_sync
from mcp.server.mcpserver import Image, MCPServer
from mcp.server.mcpserver.exceptions import ToolError
from mcp.types import ToolAnnotations
from PIL import Image as Pillow

from pa_ros.core.errors import ConfigError, PaError

if TYPE_CHECKING:
    from pa_ros.tools.arm import Arm

LONGEST_S = 60.0  # of one execution, of the arena's time
PICTURE_PX = 480
INSTRUCTIONS = """\
A robot arm at a table with blocks executes programs such as NEAR(HAND, AND(RED, CUBE)). The hand
moves to the objects that a program names; agents that were trained for it also push blocks to
others or to places (NEAR), or take them (HOLD) and put them on places and on each other (ON). First
call `scene`: it lists the blocks and programs that make sense now. `check` says whether a program
can be executed. {execution}"""
EXECUTION = {
    True: "`execute` moves the arm; `cancel` stops it, and the arm holds.",
    False: "This server only looks: it was started without --allow-execute, so nothing moves.",
}


class Table:
    """The tools. The graph is joined by the first call, so that a server can start before it."""

    def __init__(self, join: Callable[[], Arm]) -> None:
        self._join, self._lock = join, threading.Lock()
        self._arm: Arm | None = None

    @property
    def arm(self) -> Arm:
        """The arm. Raises NoAnswerError if there is no running graph."""
        with self._lock:
            if self._arm is None:
                self._arm = self._join()
            return self._arm

    def close(self) -> None:
        """Cancel what is being executed, and leave the graph."""
        with self._lock:
            if self._arm is not None:
                self._arm.close()

    def scene(self) -> dict[str, Any]:
        """What is on the table now: blocks, the program in force, programs that make sense, the
        words and relations that programs may use."""
        scene = self.arm.scene()
        vocabulary = scene.arena.world.vocabulary
        return {
            "blocks": list(scene.blocks),
            "program": scene.program,
            "satisfied": scene.satisfied,
            "distance": _finite(scene.distance),
            "programs_that_make_sense": list(scene.programs),
            "words": {name: list(words) for name, words in vocabulary.by_group.items()},
            "relations": list(vocabulary.relations),
            "can_push": vocabulary.moves_objects,
            "can_grasp": False,
        }

    def check(self, program: str) -> dict[str, Any]:
        """Whether a program can be executed in this scene; if not, the error shows the place."""
        arm = self.arm
        try:
            return {"valid": True, "program": arm.check(program), "error": ""}
        except PaError as error:
            return {"valid": False, "program": "", "error": str(error)}

    def status(self) -> dict[str, Any]:
        """Which arm and arena these are, whether an agent takes programs, and whether one is being
        executed, for any client."""
        arm, scene = self.arm, self.arm.scene()
        return {
            "arena": scene.arena.arena_id,
            "arm": scene.arena.arm,
            "design": scene.arena.design,
            "episode": scene.episode,
            "step": scene.step.observation.step,
            "seconds_since_the_last_step": round(
                time.monotonic() - arm.graph.monitor.stepped_at, 1
            ),
            "an_agent_takes_programs": (takes := arm.graph.discovered(arm.graph.agent_takes_goals)),
            "executing": takes and arm.graph.executing,
            "program": scene.program,
            "satisfied": scene.satisfied,
            "distance": _finite(scene.distance),
        }

    def picture(self) -> Image:
        """The table from above, drawn from what the arena observed: the hand is a white ring at the
        end of the gray arm, and objects that the program in force names have a black edge. Where
        the arena only sees its blocks, they are gray squares."""
        file = io.BytesIO()
        Pillow.fromarray(self.arm.scene().picture(PICTURE_PX)).save(file, "png")
        return Image(data=file.getvalue(), format="png")

    def execute(self, program: str, timeout_s: float | None = None) -> dict[str, Any]:
        """Execute a program: the arm moves until the program has been satisfied for a moment, or
        for timeout_s seconds (0.1 to 60) of the arena's time; by default for 10 s, in a goal of
        several programs for each. Not to reach it is a result."""
        if timeout_s is not None and not 0.1 <= timeout_s <= LONGEST_S:
            raise ConfigError(f"timeout_s: expected 0.1 to {LONGEST_S:g}, got {timeout_s:g}")
        result = self.arm.execute(program, timeout=timeout_s)
        return {
            "program": result.program,
            "success": result.success,
            "distance": _finite(result.distance),
            "reached_s": result.reached_s,
            "reason": result.reason,
        }

    def cancel(self) -> dict[str, Any]:
        """Cancel what `execute` began; the arm holds."""
        self.arm.cancel()
        return {"executing": False}


def make_server(table: Table, allow_execute: bool) -> MCPServer:
    """A server of the tools; `execute` and `cancel` only if they are allowed."""
    instructions = INSTRUCTIONS.format(execution=EXECUTION[allow_execute])
    server = MCPServer("pa_ros", instructions=instructions, log_level="WARNING")
    for look in (table.scene, table.check, table.status, table.picture):
        server.add_tool(_tool(look), annotations=ToolAnnotations(read_only_hint=True))
    if allow_execute:
        moves = ToolAnnotations(read_only_hint=False, destructive_hint=False)
        server.add_tool(_tool(table.execute, table.cancel), annotations=moves)
        server.add_tool(_tool(table.cancel), annotations=moves)
    return server


def _tool(act: Callable[..., Any], undo: Callable[[], Any] | None = None) -> Callable[..., Any]:
    """A tool that runs in a thread, so that `cancel` is heard during `execute`.

    If the client withdraws its call, `undo` is done. Errors are the tool's answer, in one line.
    """

    @wraps(act)
    async def tool(**given: Any) -> Any:
        try:
            return await run_sync(partial(act, **given), abandon_on_cancel=True)
        except PaError as error:
            raise ToolError(str(error)) from error
        except anyio.get_cancelled_exc_class():
            if undo is not None:
                with anyio.CancelScope(shield=True):
                    await run_sync(undo)
            raise

    return tool


def _finite(value: float) -> float | None:
    """JSON has no infinity."""
    return value if isfinite(value) else None
