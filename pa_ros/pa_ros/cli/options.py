"""Options of the command line: those made from settings, and those that commands share."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from pa_ros.core.errors import ConfigError
from pa_ros.core.settings import Leaf, Settings

if TYPE_CHECKING:
    from pa_ros.arena import Design
    from pa_ros.learning.recipes import LearningSettings

Kind = TypeVar("Kind", bound=Settings)
LEARNING = ("learner.", "network.")  # the options of `add_learning` begin with these


def add_extension(parser: argparse.ArgumentParser) -> None:
    """Declare `--extension`, which may be anywhere on the line."""
    parser.add_argument(
        "--extension", action="append", default=[], metavar="MODULE|FILE.py",
        help="import custom arms, designs, relations …; repeatable",
    )  # fmt: skip


def add_learning(parser: argparse.ArgumentParser, *, with_network: bool = True) -> None:
    """Declare --recipe, --algorithm, --network and every setting of learning by dotted name.

    Settings of all algorithms are declared, since the algorithm is known only after parsing.
    """
    from pa_ros.learning.algorithms import ALGORITHMS
    from pa_ros.learning.recipes import LearningSettings

    otherwise = "ours; push or deep for designs that need it"
    add_setting(parser, LearningSettings, "recipe", otherwise=otherwise)
    parser.add_argument(  # its older name
        "--protocol", dest="recipe", default=argparse.SUPPRESS, help=argparse.SUPPRESS,
        type=replace(LearningSettings.leaf("recipe"), path="--protocol").read,
    )  # fmt: skip
    add_settings(parser, LearningSettings, "algorithm")
    if with_network:
        leaf = LearningSettings.leaf("network.family")
        parser.add_argument(
            "--network", dest=leaf.path, default=argparse.SUPPRESS, metavar="NAME",
            help=f"{leaf.description}; one of {', '.join(leaf.choices)} ({leaf.default})",
        )  # fmt: skip
    group = parser.add_argument_group(
        "settings of learning", "each has the recipe's value unless it is given; docs/learning.md"
    )
    parser.usage = "%(prog)s [option …]"  # else it would list them all
    kinds = [LearningSettings(algorithm=algorithm) for algorithm in ALGORITHMS]
    leaves = {leaf.path: leaf for kind in kinds for leaf in kind.own_leaves()}
    for path, leaf in leaves.items():
        if path.startswith(LEARNING) and (with_network or path != "network.family"):
            group.add_argument(
                f"--{path}", dest=path, default=argparse.SUPPRESS, metavar=_metavar(leaf),
                help=leaf.description.replace("%", "%%"),
            )  # fmt: skip


def learning_given(options: argparse.Namespace, learning: LearningSettings) -> dict[str, Any]:
    """The settings of learning that were given by `add_learning`'s options, by dotted name.

    `learning` says which settings the algorithm has. Raises ConfigError for another's, or for text
    that a setting rejects.
    """
    leaves = {leaf.path: leaf for leaf in learning.own_leaves()}
    given = {path: text for path, text in vars(options).items() if path.startswith(LEARNING)}
    if unknown := sorted(given.keys() - leaves):
        raise ConfigError(f"--{unknown[0]}: not a setting of the algorithm {learning.algorithm}")
    return {path: leaves[path].read(text) for path, text in given.items()}


def learning_from(options: argparse.Namespace, design: Design, **values: Any) -> LearningSettings:
    """How to learn a design, by the options of `add_learning`; `values` are others by dotted name.

    Unless a recipe is named, it is the design's.
    """
    from pa_ros.learning.recipes import LearningSettings, recipe_for

    recipe = options.recipe or recipe_for(design.vocabulary)
    names = {"recipe": recipe, "algorithm": options.algorithm}
    given = learning_given(options, LearningSettings(**names))
    return LearningSettings(**names, **values, **given)


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
    several: dict[str, Any] = {"nargs": "+"} if leaf.is_list else {}
    required = leaf.default is ... and not otherwise
    ending = "" if required else f" ({otherwise or _shown(leaf)})"
    parser.add_argument(
        flag,
        dest=path,
        type=str if several else replace(leaf, path=flag).read,
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


def settings_from(options: argparse.Namespace, kind: type[Kind]) -> Kind:
    """The settings that were asked for."""
    asked = {name: getattr(options, name, None) for name in kind.model_fields}
    return kind(**{name: value for name, value in asked.items() if value is not None})


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
    return path


def folder_to_write(text: str) -> Path:
    """An option's folder. ConfigError, before any work is done, if it can't be made or written."""
    _check_folder(Path(text), Path(text))
    return Path(text)


def _check_folder(folder: Path, asked: Path) -> None:
    # Hours of work must not end with a folder that cannot be made.
    there = next(parent for parent in (folder, *folder.absolute().parents) if parent.exists())
    if not there.is_dir():
        raise ConfigError(f"{asked}: expected a folder at {there}, got a file")


def _shown(leaf: Leaf) -> str:
    if isinstance(leaf.default, float):
        return f"{leaf.default:g}"
    return str(leaf.default) if leaf.default or leaf.default == 0 else "none"


def _metavar(leaf: Leaf) -> str:
    return {int: "N", float: "X", Path: "PATH"}.get(leaf.type, "NAME")
