"""Checkpoints: everything a learner needs to resume as if it had never stopped.

| File | Holds |
|---|---|
| metadata.json | settings, counters, random state, programs, and the caller's own `extra` |
| engine.safetensors | networks, targets, Adam's moments and steps |
| replay.safetensors | the filled rows of the replay buffer |
| policies.safetensors | the published weights that agents may still ask for |
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pa_ros.core import __version__
from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import PolicySnapshot
from pa_ros.core.settings import read_json
from pa_ros.language import parse
from pa_ros.learning.checkpoint_files import (
    METADATA,
    check_files,
    find_checkpoint,
    latest_name,
    load_arrays,
    packed,
    write_checkpoint,
)
from pa_ros.learning.config import LearnerConfig
from pa_ros.learning.errors import CheckpointError, DivergedError
from pa_ros.networks.config import NetworkConfig, actor_config
from pa_ros.world import Scoring
from pa_ros.world.world import World

if TYPE_CHECKING:  # it starts from checkpoints
    from pa_ros.learning.learner import Learner

FORMAT = 4
ENGINE, POLICIES = "engine.safetensors", "policies.safetensors"
ACTING = (METADATA, POLICIES)  # all that acting needs of a checkpoint
# These settings may differ when resuming: they say where to compute, not what.
FREE_TO_CHANGE = ("engine.name", "engine.device", "engine.threads")


def save_checkpoint(root: Path, learner: Learner, extra: dict[str, Any] | None = None) -> Path:
    """Write a checkpoint of the learner and make it the latest. Returns its folder.

    `extra`: plain JSON that the caller wants back. Raises CheckpointError if it cannot be written,
    DivergedError if its numbers are not finite; either way the earlier checkpoints stay.
    """
    name = f"version-{learner.counters.version:09d}"
    # Nothing was learned since then, and a whole checkpoint is never written over.
    if latest_name(root) == name:
        return root / name
    policies = {
        f"{snapshot.version}/{key}": tensor
        for snapshot in learner.published
        for key, tensor in snapshot.tensors.items()
    }
    tensors = learner.engine.tensors()
    # A checkpoint that contains NaN would replace a good one, and no run could resume from it.
    _check_finite({**tensors, **policies})
    values = {
        "format": FORMAT,
        "architecture": learner.network.architecture,
        "network": learner.network.to_json(),
        "algorithm": learner.config.ALGORITHM,
        "learner": learner.config.to_json(),
        "scoring": repr(learner.scoring),
        "counters": asdict(learner.counters),
        "rng": learner.rng.bit_generator.state,
        "programs": list(learner.table.texts),
        "replay": learner.replay.to_metadata(),
        "published": [snapshot.version for snapshot in learner.published],
        "extra": extra or {},
    }
    files = {
        METADATA: [json.dumps(values, indent=1).encode()],
        ENGINE: packed(tensors),
        "replay.safetensors": packed(learner.replay.filled()),
        POLICIES: packed(policies),
    }
    write_checkpoint(root, name, files)
    return root / name


def read_metadata(path: Path) -> dict[str, Any]:
    """metadata.json of a checkpoint, or of the latest one under a root. Raises CheckpointError."""
    directory = find_checkpoint(path)
    check_files(directory, (METADATA,))
    try:
        values = read_json((directory / METADATA).read_text())
        found = values["format"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise CheckpointError(f"checkpoint: {directory}: {METADATA}: {error!r}") from error
    if found != FORMAT:
        raise CheckpointError(
            f"checkpoint: {directory}: expected format {FORMAT} (pa_ros {__version__}), got "
            f"{found!r}: use the version that wrote it, or train anew"
        )
    return dict(values)


def camera_of(path: Path) -> str:
    """The calibration of the camera through which a checkpoint's agent sees.

    Raises ConfigError for an agent without a camera; CheckpointError.
    """
    if found := str(read_metadata(path)["extra"].get("perception", "")):
        return found
    raise ConfigError(
        f"perception: expected an agent that sees through a camera, got {str(path)!r}, which was "
        "trained without one"
    )


def load_policy(path: Path) -> PolicySnapshot:
    """The newest published weights of a checkpoint: all that acting needs."""
    directory = find_checkpoint(path)  # once: a running learner may replace the latest meanwhile
    values = read_metadata(directory)
    check_files(directory, ACTING)
    return _load_policies(directory, values)[-1]


def restore(path: Path, learner: Learner) -> dict[str, Any]:
    """Put a new learner where the checkpoint's was. Returns the caller's `extra`.

    Raises CheckpointError, naming both sides, if networks or settings differ, or if a file is
    missing or damaged; the learner must not be used then.
    """
    directory = find_checkpoint(path)
    values = read_metadata(directory)
    check_files(directory)
    # From here on the content is what a learner of the same networks and settings wrote.
    _check_same(directory, values, learner.network, learner.config, learner.scoring)
    for text in values["programs"]:
        learner.table.add(parse(text, learner.network.vocabulary))
    if list(learner.table.texts) != values["programs"]:
        raise CheckpointError(
            f"checkpoint: {directory}: expected programs {values['programs']}, "
            f"got {list(learner.table.texts)}"
        )
    learner.engine.load_tensors(load_arrays(directory / ENGINE))
    learner.replay.restore(load_arrays(directory / "replay.safetensors"), values["replay"])
    learner.rng.bit_generator.state = values["rng"]
    learner.counters = replace(learner.counters, **values["counters"])
    learner.published.clear()
    learner.published.extend(_load_policies(directory, values))
    extra: dict[str, Any] = values["extra"]
    return extra


def start_from(path: Path, learner: Learner) -> dict[str, NDArray[Any]]:
    """Give a new learner the networks of a checkpoint; the weights of its actor, as
    `Engine.tensors` names them. The replay buffer and Adam start anew.

    A checkpoint for acting has no critic: the critic then knows words as the actor does, and starts
    at its usual value. Raises CheckpointError for other networks, or if a file is missing.
    """
    directory, policy = find_checkpoint(path), load_policy(path)
    if policy.architecture != learner.network.architecture:
        raise CheckpointError(
            f"learner.starts_from: {path}: expected networks {learner.network.architecture}, "
            f"got {policy.architecture}"
        )
    ours, file = learner.engine.tensors(), directory / ENGINE
    given = load_arrays(file) if file.is_file() else {}
    for name in ours:
        network, _, key = name.removeprefix("target_").partition(".")
        if network == "actor":
            ours[name] = policy.tensors[key]
        elif name in given and not name.startswith("adam."):
            ours[name] = given[name]
        elif network == "critic" and not given and key in policy.tensors and "output" not in key:
            ours[name] = policy.tensors[key]
    learner.engine.load_tensors(ours)
    return {name: ours[name] for name in ours if name.startswith("actor.")}


def check_trained_with(
    path: Path, network: NetworkConfig, config: LearnerConfig, scoring: Scoring, **facts: object
) -> dict[str, Any]:
    """metadata.json of a checkpoint of these networks, settings, rewards and facts.

    Raises CheckpointError, naming both sides, if it has others.
    """
    directory = find_checkpoint(path)
    values = read_metadata(directory)
    check_facts(path, values, **facts)
    _check_same(directory, values, network, config, scoring)
    return values


def check_facts(path: Path, values: Mapping[str, Any], **expected: object) -> None:
    """Raise CheckpointError unless the run wrote these facts into its checkpoint's `extra`."""
    facts = values["extra"]
    for name, value in expected.items():
        if facts.get(name) != value:
            raise CheckpointError(
                f"checkpoint: {path}: {name}: expected {value!r}, got {facts.get(name)!r}"
            )


def _check_finite(arrays: Mapping[str, NDArray[Any]]) -> None:
    wrong = sorted(name for name, array in arrays.items() if not np.isfinite(array).all())
    if wrong:
        raise DivergedError(
            f"checkpoint: expected finite numbers, got others in {len(wrong)} of {len(arrays)} "
            f"tensors ({', '.join(wrong[:3])}, …); the checkpoint before is kept"
        )


def _check_same(
    directory: Path,
    values: dict[str, Any],
    ours_network: NetworkConfig,
    ours_config: LearnerConfig,
    scoring: Scoring,
) -> None:
    theirs: dict[str, Any] = {"algorithm": values["algorithm"], "scoring": values["scoring"]}
    ours: dict[str, Any] = {"algorithm": ours_config.ALGORITHM, "scoring": repr(scoring)}
    if theirs["algorithm"] == ours["algorithm"]:  # else settings would differ in everything
        try:
            network = NetworkConfig.from_json(values["network"])
            config = type(ours_config).from_json(values["learner"])
        except ConfigError as error:
            raise CheckpointError(
                f"checkpoint: {directory}: expected settings that this version knows, got others; "
                f"agents can use its weights, but learning cannot resume ({error})"
            ) from error
        theirs |= _settings(network, config)
        ours |= _settings(ours_network, ours_config)
    differing = [
        f"{name}: checkpoint {theirs[name]!r}, here {ours[name]!r}"
        for name in sorted(ours)
        if theirs[name] != ours[name] and name not in FREE_TO_CHANGE
    ]
    if differing:
        raise CheckpointError(f"checkpoint: {directory}: differs in {'; '.join(differing)}")


def _settings(network: NetworkConfig, config: LearnerConfig) -> dict[str, Any]:
    """All settings by name, and the parts of the world."""
    parts = {f"world.{one.name}": getattr(network.world, one.name) for one in fields(World)}
    return {**network.flat(), **config.flat(), **parts, "world": None}


def _load_policies(directory: Path, values: dict[str, Any]) -> list[PolicySnapshot]:
    """The published policies, oldest first."""
    arrays = load_arrays(directory / POLICIES)
    digest = actor_config(values["architecture"]).world.digest
    tensors: dict[str, dict[str, NDArray[Any]]] = {}
    for path, array in arrays.items():
        version, _, name = path.partition("/")
        tensors.setdefault(version, {})[name] = array
    return [
        PolicySnapshot(version, values["architecture"], digest, tensors[str(version)])
        for version in values["published"]
    ]
