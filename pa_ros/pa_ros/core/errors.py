"""The root of every error this project raises on purpose."""

from __future__ import annotations


class PaError(Exception):
    """Input refused: says what was expected and what came.

    `code` names the kind of refusal ("program.unknown_word", "wire.non_finite"); nodes count
    refusals by it and publish the counts in /diagnostics. Subclasses set it as a class attribute.
    """

    code = "error"


class ConfigError(PaError):
    """A parameter, option or file that cannot be used, with the value received."""

    code = "config"
