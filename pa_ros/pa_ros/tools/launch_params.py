"""Parameters files: which nodes a launch starts, and with which parameters. Needs no ROS."""

from __future__ import annotations

import itertools
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from pa_ros.core.errors import ConfigError
from pa_ros.core.text import did_you_mean
from pa_ros.core.yaml_text import read_yaml
from pa_ros.learning.checkpoint_files import SHIPPED_PREFIX, shipped_names
from pa_ros.learning.folder import refuse_used

CONFIG = Path(__file__).parents[1] / "config"
NODES = ("sim_node", "learner_node", "agent_node")  # in the order of starting
MAX_ARENAS = 64
SIGHTED = {"shipped:3-D": "shipped:camera"}  # agents, and those of the same design that see
_EVERY = "**"
_KEY = "ros__parameters"

Parameters = dict[str, dict[str, Any]]
"""Parameters by node: `sim_node`, or `arena1/sim_node` if there are several arenas."""


def packaged(name: str) -> Path:
    """The path of a packaged parameters file, named without its ending."""
    return CONFIG / f"{name}.yaml"


def packaged_names() -> list[str]:
    """Names of the packaged parameters files."""
    return sorted(found.stem for found in CONFIG.glob("*.yaml"))


def chosen(named: str) -> Path:
    """The packaged file of this name if there is one, else the name as a path."""
    return packaged(named) if named in packaged_names() else Path(named)


def load_parameters(path: Path) -> Parameters:
    """Read a ROS 2 parameters file. Every node that it names is to be started.

    The parameters of `/**` go to all nodes; a file with `/**` alone starts all three. If all keys
    have the same namespace, only the nodes' names count. Nodes in several namespaces
    (`/arena1/sim_node`, `/arena2/sim_node`, `/learner_node`) are a fleet. Raises ConfigError.
    """
    try:
        content = read_yaml(path.read_text())
    except FileNotFoundError as error:
        raise ConfigError(
            f"parameters: expected a file or one of {list(packaged_names())}, got {str(path)!r}"
            f"{did_you_mean(str(path), packaged_names())}"
        ) from error
    except (OSError, ValueError) as error:
        raise ConfigError(f"parameters: {path}: {error}") from error
    if not isinstance(content, dict) or not content:
        shown = type(content).__name__ if content else "nothing"
        raise ConfigError(f"parameters: {path}: expected nodes by name, got {shown}")
    # The more exactly a key names a node, the more it counts: all nodes, a name in any namespace,
    # one node.
    common: dict[str, Any] = {}
    wild: Parameters = {}  # of all nodes with a name, in any namespace
    named: Parameters = {}
    for key, value in content.items():
        name, values = _node_name(path, key), _values(path, key, value)
        if name == _EVERY:
            common |= values
        else:
            kept = wild if _namespace(key) == _EVERY else named
            place = name if kept is wild else str(key).strip("/")
            kept[place] = kept.get(place, {}) | values
    if len({_namespace(place) for place in named}) > 1:
        return gathered(_fleet_of(path, common, wild, named))
    own = {_last(place): values for place, values in named.items()}
    started = {*own, *wild} or {*NODES}
    return {
        name: common | wild.get(name, {}) | own.get(name, {}) for name in NODES if name in started
    }


def fleet(parameters: Parameters, arenas: int) -> Parameters:
    """Several arenas, each with its agent, and one learner that learns from all of them.

    Arena K and its agent are in the namespace `arenaK`; their seed is the file's plus K - 1. Raises
    ConfigError for a number outside 1 to MAX_ARENAS, or if there are several arenas already.
    """
    if not 1 <= arenas <= MAX_ARENAS:
        raise ConfigError(f"arenas: expected 1 to {MAX_ARENAS}, got {arenas}")
    if "sim_node" not in parameters:
        raise ConfigError(
            f"arenas: expected one sim_node to make {arenas} of, got {', '.join(parameters)}"
        )
    spread: Parameters = {}
    for number in range(arenas):
        for name in ("sim_node", "agent_node"):
            if name in parameters:
                seed = parameters[name].get("seed", 0)
                if not isinstance(seed, int):
                    raise ConfigError(f"{name}: seed: expected an integer, got {seed!r}")
                seed += number
                spread[f"arena{number + 1}/{name}"] = parameters[name] | {"seed": seed}
    if "learner_node" in parameters:
        spread["learner_node"] = parameters["learner_node"]
    return gathered(spread)


def gathered(parameters: Parameters) -> Parameters:
    """Connect a fleet: name its agents after their arenas, and give the learner both lists.

    What the file says about these parameters is kept.
    """
    arenas = arenas_of(parameters)
    if not arenas or "learner_node" not in parameters:
        return parameters
    places = [f"{arena}/agent_node" for arena in arenas]
    learn = [place for place in places if parameters.get(place, {}).get("learning") is True]
    named = {place: {"agent_id": _namespace(place)} | parameters[place] for place in learn}
    agents = [values["agent_id"] for values in named.values()]
    of_learner = {"arenas": arenas, "agents": agents} | parameters["learner_node"]
    return merged(parameters, {**named, "learner_node": of_learner})


def arenas_of(parameters: Parameters) -> list[str]:
    """Namespaces of the arenas of a fleet; empty if there is only one arena, without namespace."""
    arenas = [_namespace(place) for place in parameters if place.endswith("/sim_node")]
    return [] if arenas == [""] else arenas


def preferred(
    parameters: Parameters, checkpoint: str | None, design: str | None, seed: int | None
) -> Parameters:
    """Change the agent, the design or the seed of a file; None keeps the file's.

    Where agents don't learn, a design without a checkpoint brings the shipped agent of that design.
    Raises ConfigError for a checkpoint beside a learner, or a seed for several arenas.
    """
    if (checkpoint or seed is not None) and arenas_of(parameters):
        raise ConfigError("--checkpoint, --seed: expected a file with one arena, got several")
    if checkpoint or (design and "learner_node" not in parameters):
        parameters = acting(parameters, checkpoint or _shipped_for(str(design)))
    if design is not None:
        places = [place for place in parameters if _last(place) == "sim_node"]
        parameters = merged(parameters, {place: {"design": design} for place in places})
    if seed is not None:
        parameters = merged(parameters, {place: {"seed": seed} for place in parameters})
    return parameters


def acting(parameters: Parameters, agent: str | Path) -> Parameters:
    """Let a trained agent act, in an arena like that of its training.

    Raises ConfigError if the file has a learner or lacks an arena or an agent, CheckpointError for
    no usable checkpoint.
    """
    from pa_ros.agents import checkpoint_named, load_agent

    if "learner_node" in parameters:
        raise ConfigError(
            "--checkpoint: expected a parameters file without a learner_node (such as execute_3d)"
        )
    checkpoint = checkpoint_named(agent)
    trained = load_agent(checkpoint)
    world: dict[str, Any] = {"design": trained.design.name, "arm": trained.arena.arm}
    world |= {"relations": list(trained.design.vocabulary.relations)}
    world |= {"preset": trained.arena.preset}
    if trained.perception:
        world["perception"] = str(checkpoint)
    acts = {"learning": False, "weights": "checkpoint", "checkpoint": str(checkpoint)}
    return merged(parameters, {"sim_node": world, "agent_node": acts})


def _shipped_for(design: str) -> str:
    """The agent of the package that learned a design, not from pictures.

    Raises ConfigError if the package has no such agent.
    """
    from pa_ros.learning.checkpoints import read_metadata

    learned = dict[str, str]()
    for name in shipped_names():
        facts = read_metadata(Path(f"{SHIPPED_PREFIX}{name}"))["extra"]
        if not facts.get("perception"):
            learned.setdefault(facts["design"], name)
    if design in learned:
        return learned[design]
    raise ConfigError(
        f"--design: expected one that a shipped agent learned ({', '.join(learned)}), "
        f"got {design!r}: name your agent by --checkpoint"
    )


def in_step(parameters: Parameters, way: str) -> Parameters:
    """Set `learner.schedule.in_step`: how agents and learner wait.

    Raises ConfigError without a learner.
    """
    if "learner_node" not in parameters:
        raise ConfigError(
            "--in-step: expected a parameters file with a learner_node (such as train_2l), got "
            f"{', '.join(parameters)}"
        )
    return merged(parameters, {"learner_node": {"learner.schedule.in_step": way}})


def seeing(parameters: Parameters, view: str) -> Parameters:
    """Let every arena see its blocks through the camera of its agent's checkpoint, or a new one.

    Raises ConfigError for a view beside a checkpoint.
    """
    changes = {}
    for place in parameters:
        if _last(place) == "sim_node":
            agent = place.replace("sim_node", "agent_node")
            checkpoint = parameters.get(agent, {}).get("checkpoint", "")
            if checkpoint and view != "camera":
                raise ConfigError(
                    f"--perception {view}: expected camera, as the agent of {checkpoint} sees "
                    "through its own"
                )
            changes[place] = {"perception": SIGHTED.get(checkpoint, checkpoint) or view}
            if checkpoint in SIGHTED:
                changes[agent] = {"checkpoint": SIGHTED[checkpoint]}
    return merged(parameters, changes)


def merged(parameters: Parameters, changes: Mapping[str, Mapping[str, Any]]) -> Parameters:
    """Replace or add parameters. Raises ConfigError for a node that isn't started."""
    absent = set(changes) - set(parameters)
    if absent:
        raise ConfigError(f"parameters: expected nodes of {list(parameters)}, got {sorted(absent)}")
    return {name: values | dict(changes.get(name, {})) for name, values in parameters.items()}


def extended(parameters: Parameters, extensions: Sequence[str]) -> Parameters:
    """Let all nodes import more extensions, after those that they already import."""
    if not extensions:
        return parameters
    # The nodes may run in another folder.
    more = [str(Path(name).resolve()) if name.endswith(".py") else name for name in extensions]
    return merged(parameters, {
        name: {"extensions": [*values.get("extensions", []), *more]}
        for name, values in parameters.items()
    })  # fmt: skip


def new_folder(kind: str) -> Path:
    """Make and return a new folder runs/KIND-TIME, with a number if that exists already."""
    stem = Path("runs") / f"{kind}-{time.strftime('%Y%m%d-%H%M%S')}"
    numbered = (Path(f"{stem}-{number}") for number in itertools.count(2))
    folder = next(path for path in itertools.chain([stem], numbered) if not path.exists())
    folder.mkdir(parents=True)
    return folder


def learning_into(folder: Path, parameters: Parameters) -> Parameters:
    """Let the learner write into the launch's folder, unless the file names another one.

    Raises CheckpointError if that folder already contains a run that isn't resumed.
    """
    learner = parameters.get("learner_node")
    if learner is None:
        return parameters
    out = learner.get("out", str(folder.resolve()))
    if out and learner.get("resume") is not True:
        refuse_used(Path(out))
    return merged(parameters, {"learner_node": {"out": out}})


def write_parameters(path: Path, parameters: Parameters, namespace: str = "") -> None:
    """Write parameters under the nodes' full names, for `--params-file`."""
    prefix = f"/{namespace.strip('/')}" if namespace.strip("/") else ""
    content = {f"{prefix}/{name}": {_KEY: values} for name, values in parameters.items() if values}
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(yaml.dump(content, Dumper=_Plain, sort_keys=False))


class _Plain(yaml.SafeDumper):
    """YAML without aliases, which rcl rejects: a list used twice is written twice."""

    def ignore_aliases(self, data: object) -> bool:
        return True


def _node_name(path: Path, key: object) -> str:
    name = str(key).rstrip("/").rpartition("/")[2]
    if name not in (*NODES, _EVERY):
        raise ConfigError(f"parameters: {path}: expected a node of {NODES} or /**, got {key!r}")
    return name


def _namespace(key: object) -> str:
    return str(key).strip("/").rpartition("/")[0]


def _last(place: str) -> str:
    return place.rpartition("/")[2]


def _fleet_of(
    path: Path, common: dict[str, Any], wild: Parameters, named: Parameters
) -> Parameters:
    """Nodes in several namespaces: each has an arena, and the learner has no namespace."""
    places = dict(named)
    if "learner_node" in wild:
        places.setdefault("learner_node", {})
    arenas = {_namespace(place) for place in places if _last(place) == "sim_node"}
    for place in places:
        alone = _last(place) == "agent_node" and _namespace(place) not in arenas
        if alone or (_last(place) == "learner_node" and _namespace(place)):
            raise ConfigError(
                f"parameters: {path}: expected all nodes in one namespace, or several namespaces "
                f"with a sim_node each and learner_node in none, got /{place}"
            )
    return {place: common | wild.get(_last(place), {}) | values for place, values in places.items()}


def _values(path: Path, key: object, value: object) -> dict[str, Any]:
    """The parameters of one node in a file."""
    if not isinstance(value, dict) or set(value) != {_KEY}:
        raise ConfigError(f"parameters: {path}: {key}: expected {_KEY} alone, got {value!r:.200}")
    values = value[_KEY]
    if not isinstance(values, dict):
        raise ConfigError(
            f"parameters: {path}: {key}: {_KEY}: expected names and values, got {values!r:.200}"
        )
    return _flat(values)


def _flat(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Values by dotted name, where a file may nest them."""
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, dict):
            flat |= _flat(value, f"{prefix}{name}.")
        else:
            flat[f"{prefix}{name}"] = value
    return flat
