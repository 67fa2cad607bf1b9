"""The parameters file of a launch: which nodes it starts, and with what. Needs no ROS."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

from pa_ros.core.errors import ConfigError
from pa_ros.learning.folder import refuse_used

CONFIG = Path(__file__).parents[1] / "config"
NODES = ("sim_node", "agent_node", "learner_node")
_EVERY = "**"
_KEY = "ros__parameters"

Parameters = dict[str, dict[str, Any]]
"""Parameters by node, in the order of NODES."""


def packaged(name: str) -> Path:
    """A parameters file that comes with the package, by its name without ending."""
    path = CONFIG / f"{name}.yaml"
    if not path.is_file():
        raise ConfigError(f"parameters: expected one of {packaged_names()}, got {name!r}")
    return path


def packaged_names() -> list[str]:
    """Names of the parameters files that come with the package."""
    return sorted(found.stem for found in CONFIG.glob("*.yaml"))


def chosen(named: str) -> Path:
    """A file's path, or that of the packaged file of this name."""
    return packaged(named) if named in packaged_names() else Path(named)


def load_parameters(path: Path) -> Parameters:
    """Read a ROS 2 parameters file: each node that it names is started.

    Keys are names of nodes (`sim_node`, `/arena1/sim_node`, `/**/sim_node`: the last part counts,
    but the keys may name one namespace only) or `/**`, whose parameters go to every node started; a
    file with `/**` alone starts all three. Raises ConfigError if the file is missing, is not YAML,
    names nodes of several namespaces or has another structure.
    """
    try:
        content = yaml.safe_load(path.read_text())
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ConfigError(f"parameters: {path}: {error}") from error
    if not isinstance(content, dict) or not content:
        shown = type(content).__name__ if content else "nothing"
        raise ConfigError(f"parameters: {path}: expected nodes by name, got {shown}")
    _check_one_namespace(path, content)
    by_node: dict[str, dict[str, Any]] = {}
    for key, value in content.items():
        name = _node_name(path, key)
        by_node[name] = by_node.get(name, {}) | _values(path, key, value)
    common = by_node.pop(_EVERY, {})
    started = by_node or dict.fromkeys(NODES, {})
    return {name: common | started[name] for name in NODES if name in started}


def merged(parameters: Parameters, changes: Mapping[str, Mapping[str, Any]]) -> Parameters:
    """Parameters with some replaced or added; ConfigError for a node that is not started."""
    absent = set(changes) - set(parameters)
    if absent:
        raise ConfigError(f"parameters: expected nodes of {list(parameters)}, got {sorted(absent)}")
    return {name: values | dict(changes.get(name, {})) for name, values in parameters.items()}


def new_folder(kind: str) -> Path:
    """A folder runs/KIND-TIME that is not there yet; it is made, so that no other has it."""
    stem = Path("runs") / f"{kind}-{time.strftime('%Y%m%d-%H%M%S')}"
    for number in itertools.count(1):
        folder = stem if number == 1 else Path(f"{stem}-{number}")
        try:
            folder.mkdir(parents=True)
            return folder
        except FileExistsError:
            continue
        except OSError as error:
            raise ConfigError(f"launch: {folder}: {error}") from error
    raise AssertionError("numbers do not end")


def learning_into(folder: Path, parameters: Parameters) -> Parameters:
    """Parameters whose learner, unless told where, writes into the launch's own folder.

    Raises FolderUsedError if that holds a run that is not to be resumed.
    """
    learner = parameters.get("learner_node")
    if learner is None:
        return parameters
    out = learner.get("out", str(folder.resolve()))
    if isinstance(out, str) and out and learner.get("resume") is not True:
        refuse_used(Path(out))
    return merged(parameters, {"learner_node": {"out": out}})


def write_parameters(path: Path, parameters: Parameters, namespace: str = "") -> None:
    """Write what is really used, under the nodes' full names, for `--params-file`."""
    prefix = f"/{namespace.strip('/')}" if namespace.strip("/") else ""
    content = {f"{prefix}/{name}": {_KEY: values} for name, values in parameters.items() if values}
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(yaml.dump(content, Dumper=_Plain, sort_keys=False))


class _Plain(yaml.SafeDumper):
    """YAML without aliases, which rcl refuses: a list in two places is written twice."""

    def ignore_aliases(self, data: object) -> bool:
        return True


def _node_name(path: Path, key: object) -> str:
    name = str(key).rstrip("/").rpartition("/")[2]
    if name not in (*NODES, _EVERY):
        raise ConfigError(f"parameters: {path}: expected a node of {NODES} or /**, got {key!r}")
    return name


def _check_one_namespace(path: Path, keys: Iterable[object]) -> None:
    """A launch is one arena with its nodes: those of another namespace are another launch."""
    within = {
        str(key).strip("/").rpartition("/")[0] for key in keys if _node_name(path, key) != _EVERY
    }
    within.discard(_EVERY)
    if len(within) > 1:
        shown = ", ".join(sorted(f"/{namespace}" for namespace in within))
        raise ConfigError(
            f"parameters: {path}: expected nodes of one namespace, got {shown}: "
            "a launch (and a file) for each"
        )


def _values(path: Path, key: object, value: object) -> dict[str, Any]:
    """The parameters under one node's key; names are text."""
    if not isinstance(value, dict) or set(value) != {_KEY}:
        raise ConfigError(f"parameters: {path}: {key}: expected {_KEY} alone, got {value!r:.200}")
    values = value[_KEY]
    if not isinstance(values, dict) or not all(isinstance(name, str) for name in values):
        raise ConfigError(
            f"parameters: {path}: {key}: {_KEY}: expected names and values, got {values!r:.200}"
        )
    return values
