"""Extensions: modules (`a.b.c`) or files (`path/x.py`) that add arms, designs … to registries.

They are named on a command line or in a parameter, never by a message: nothing that arrives over a
topic is ever imported.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import sys
from collections.abc import Callable, Iterable
from functools import partial, wraps
from pathlib import Path
from types import ModuleType
from typing import Any

from pa_ros.core.errors import ConfigError, PaError

OWN = "pa_ros."  # modules of this package


class ExtensionError(PaError):
    """A function of an extension that failed, or returned something else than it must."""

    code = "extension.failed"


def load(extensions: Iterable[str]) -> tuple[ModuleType, ...]:
    """Import extensions in order, each once; ConfigError names the one that failed, and why."""
    return tuple(map(_load, extensions))


def _load(extension: str) -> ModuleType:
    try:
        if extension.endswith(".py"):
            return _load_file(Path(extension).resolve())
        return importlib.import_module(extension)
    except PaError:
        raise
    except (Exception, SystemExit) as error:  # custom code may raise anything
        raise ConfigError(
            f"extension: expected a module or a file that can be imported, got {extension!r}: "
            f"{type(error).__name__}: {error}"
        ) from error


def _load_file(path: Path) -> ModuleType:
    # The path is part of the name, so that two files called x.py are two modules.
    name = f"pa_ros_extension_{path.stem}_{hashlib.sha256(str(path).encode()).hexdigest()[:8]}"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, path)
        assert spec is not None and spec.loader is not None  # the name ends in .py
        module = sys.modules[name] = importlib.util.module_from_spec(spec)
        try:
            spec.loader.exec_module(module)
        # A module that failed half-way must not pass for a loaded one at the next attempt.
        except BaseException:
            del sys.modules[name]
            raise
    return sys.modules[name]


def guarded(
    what: str,
    function: Callable[..., Any],
    fits: Callable[..., bool] = lambda *_: True,
    expected: str = "a result",
) -> Callable[..., Any]:
    """A function of an extension whose faults are ExtensionErrors; a function of this package as it
    is.

    :param what: names it in errors ("reward Shaped").
    :param fits: receives a result and the arguments; whether it is what the function must return.
    :param expected: says in errors what that is.
    """
    inner = function
    while isinstance(inner, partial):
        inner = inner.func
    module = getattr(inner, "__module__", "") or ""
    if module.startswith(OWN):
        return function

    def fault(got: str) -> ExtensionError:
        file = getattr(sys.modules.get(module), "__file__", None) or module
        return ExtensionError(f"{what} of the extension {file}: expected {expected}, got {got}")

    @wraps(function)
    def call(*arguments: Any) -> Any:
        try:
            result = function(*arguments)
            good = fits(result, *arguments)
        except PaError:
            raise
        except (Exception, SystemExit) as error:  # custom code may raise anything
            raise fault(f"{type(error).__name__}: {error}") from error
        if not good:
            raise fault(repr(result)[:200])
        return result

    return call
