"""What the arena refuses."""

from __future__ import annotations

from pa_ros.core.errors import PaError


class CommandError(PaError):
    """A joint command that is mis-sized, not numbers or not finite. Nothing moved."""

    code = "arena.command"


class EpisodeError(PaError):
    """An episode that cannot be generated, placed or stepped."""

    code = "arena.episode"


class DivergedError(PaError):
    """The physics became unstable; the episode is void."""

    code = "arena.diverged"


class SceneError(PaError):
    """An arrangement of blocks that cannot be. Nothing has changed."""

    code = "arena.scene"


class RenderError(PaError):
    """No offscreen OpenGL here. Nothing but pictures needs it."""

    code = "arena.render"
