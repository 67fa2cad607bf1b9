"""Errors of the arena."""

from __future__ import annotations

from pa_ros.core.errors import PaError


class ArenaError(PaError):
    """A rejected command, episode or arrangement of blocks; nothing has changed.

    Codes: "arena.command", "arena.episode", "arena.scene".
    """

    code = "arena"


class PhysicsError(ArenaError):
    """The physics became unstable; the episode is void."""

    code = "arena.diverged"


class RenderError(ArenaError):
    """This machine has no offscreen OpenGL, or a picture cannot be written."""

    code = "arena.render"
