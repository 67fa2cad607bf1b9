"""Options of the command line that follow from settings (type, default, choices and help), and
those that every command has."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Any, TypeVar, get_origin

from pa_ros.core.errors import ConfigError
from pa_ros.core.settings import Leaf, Settings

Kind = TypeVar("Kind", bound=Settings)


def add_extension(parser: argparse.ArgumentParser) -> None:
    """Declare `--extension`, which stands anywhere on the line."""
    parser.add_argument(
        "--extension", action="append", default=[], metavar="MODULE|FILE.py",
        help="import what registers arms, designs, relations … of your own; repeatable",
    )  # fmt: skip


def add_setting(
    parser: argparse.ArgumentParser,
    kind: type[Settings],
    path: str,
    flag: str = "",
    otherwise: str = "",
    metavar: str | None = None,
) -> None:
    """Declare the option of one setting, `--its-name` if no other flag is given.

    `otherwise` says what holds where the option is absent, if that is not the setting's default;
    the option is then None. A value that the setting refuses raises ConfigError in parsing.
    """
    leaf = kind.leaf(path)
    flag = flag or f"--{path.rpartition('.')[2].replace('_', '-')}"
    if leaf.type is bool:
        parser.add_argument(flag, dest=path, action="store_true", help=leaf.description)
        return
    shown = f"{leaf.description}; one of {', '.join(leaf.choices)}".removesuffix("; one of ")
    several: dict[str, Any] = {"nargs": "+"} if get_origin(leaf.type) is tuple else {}
    required = leaf.default is ... and not otherwise
    ending = "" if required else f" ({otherwise or _shown(leaf)})"
    parser.add_argument(
        flag,
        dest=path,
        type=_reader(kind, path, flag) if not several else str,
        default=None if otherwise or required else leaf.default,
        required=required,
        metavar=metavar or _metavar(leaf),
        help=f"{shown}{ending}".replace("%", "%%"),
        **several,
    )


def add_settings(parser: argparse.ArgumentParser, kind: type[Settings], *paths: str) -> None:
    """Declare the options of several settings under their own names."""
    for path in paths:
        add_setting(parser, kind, path)


def settings_from(options: argparse.Namespace, kind: type[Kind], **values: Any) -> Kind:
    """The settings that were asked for; `values` are those that no option gives."""
    asked = {name: getattr(options, name, None) for name in kind.model_fields}
    return kind(**{name: value for name, value in asked.items() if value is not None} | values)


def asked(options: argparse.Namespace, kind: type[Settings]) -> list[str]:
    """Which of these settings have another value than their default."""
    names = [name for name in kind.model_fields if hasattr(options, name)]
    return [name for name in names if getattr(options, name) not in (kind.leaf(name).default, None)]


def file_to_write(text: str) -> Path:
    """An option's file. ConfigError, before any work is done for it, if it can't be written."""
    path = Path(text)
    if path.is_dir():
        raise ConfigError(f"{path}: expected a file to write, got a folder")
    _check_folder(path.parent, path)
    if path.exists() and not os.access(path, os.W_OK):
        raise ConfigError(f"{path}: expected a file that may be written")
    return path


def folder_to_write(text: str) -> Path:
    """An option's folder. ConfigError, before any work is done, if it can't be made or written."""
    _check_folder(Path(text), Path(text))
    return Path(text)


def _check_folder(folder: Path, asked: Path) -> None:
    there = next(parent for parent in (folder, *folder.absolute().parents) if parent.exists())
    if not there.is_dir():
        raise ConfigError(f"{asked}: expected a folder at {there}, got a file")
    if not os.access(there, os.W_OK | os.X_OK):
        raise ConfigError(f"{asked}: expected a folder that may be written, got {there}")


def _reader(kind: type[Settings], path: str, flag: str) -> Any:
    def read(text: str) -> Any:
        try:
            return kind.read(path, text)
        except ValueError:
            expected = kind.leaf(path).expected
            raise ConfigError(f"{flag}: expected {expected}, got {text or repr(text)}") from None

    return read


def _shown(leaf: Leaf) -> str:
    if isinstance(leaf.default, float):
        return f"{leaf.default:g}"
    return str(leaf.default) if leaf.default or leaf.default == 0 else "none"


def _metavar(leaf: Leaf) -> str:
    return {int: "N", float: "X", Path: "PATH"}.get(leaf.type, "NAME")
