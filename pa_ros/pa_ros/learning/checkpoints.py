"""Checkpoints: everything a learner needs to go on as if it had not stopped.

Under one root directory, each checkpoint is a directory of safetensors files and a metadata.json,
written elsewhere and renamed when complete; the file LATEST names the newest one and is replaced
atomically. So a crash at any moment leaves a whole checkpoint. Nothing is ever unpickled.
"""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load_file, save

from pa_ros import __version__
from pa_ros.core.errors import ConfigError, PaError
from pa_ros.core.experience import PolicySnapshot
from pa_ros.core.settings import read_json
from pa_ros.language import parse
from pa_ros.learning.checksums import SUMS, check_files, checksums
from pa_ros.learning.config import LearnerConfig
from pa_ros.learning.errors import CheckpointError, DivergedError
from pa_ros.learning.learner import Counters, Learner
from pa_ros.networks.config import NetworkConfig
from pa_ros.world import Scoring

FORMAT = 3
LATEST = "LATEST"
METADATA = "metadata.json"
POLICIES = "policies.safetensors"
ACTING = (METADATA, POLICIES)  # all that acting needs of a checkpoint
_NAME = r"version-\d{9,}"
SHIPPED = Path(__file__).parents[1] / "shipped"
SHIPPED_PREFIX = "shipped:"
# On resuming: they say where, not what.
FREE_TO_CHANGE = ("engine.name", "engine.device", "engine.threads")

Arrays = dict[str, NDArray[Any]]


def save_checkpoint(root: Path, learner: Learner, extra: dict[str, Any] | None = None) -> Path:
    """Write a checkpoint of the learner and make it the latest; its directory.

    The one before stays, older ones are removed. `extra` is plain JSON of the caller's own. Raises
    CheckpointError if it cannot be written, DivergedError if its numbers are not finite; then
    nothing of it is left.
    """
    name = f"version-{learner.counters.version:09d}"
    try:
        root.mkdir(parents=True, exist_ok=True)
        if _latest_name(root) != name:
            files = _files(learner, extra or {})
            _write_directory(root, name, {**files, SUMS: checksums(files)})
            write_synced(root / f".{LATEST}", name.encode())
            os.replace(root / f".{LATEST}", root / LATEST)
            _sync_directory(root)
        remove_older(root, name)
    except OSError as error:
        _remove_unfinished(root, name)
        raise CheckpointError(f"checkpoint: {root}: {error}") from error
    return root / name


def completed(root: Path) -> list[Path]:
    """The checkpoints under a root, oldest first, damaged or not; what else lies there is none."""
    return sorted(
        path
        for path in root.glob("version-*")
        if re.fullmatch(_NAME, path.name, re.ASCII) and path.is_dir()
    )


def remove_older(root: Path, name: str) -> None:
    """Keep the checkpoint `name` and the one before it; of those that a kill cut short, nothing."""
    others = [path for path in completed(root) if path.name != name]
    before = [path for path in others if path.name < name][-1:]
    unfinished = [path for path in root.glob(".version-*") if path.is_dir()]
    for path in (*others, *unfinished):
        if path not in before:
            shutil.rmtree(path)


def _remove_unfinished(root: Path, name: str) -> None:
    """Leave nothing that fills the disk of a checkpoint that could not be completed."""
    shutil.rmtree(root / f".{name}", ignore_errors=True)
    if _latest_name(root) != name:
        shutil.rmtree(root / name, ignore_errors=True)


def read_metadata(path: Path) -> dict[str, Any]:
    """metadata.json of a checkpoint, or of the latest one under a root; `extra` is in it."""
    directory = find_checkpoint(path)
    try:
        check_files(directory, (METADATA,))
        values = read_json((directory / METADATA).read_text())
        if values["format"] != FORMAT:
            raise CheckpointError(
                f"checkpoint: {directory}: expected format {FORMAT} (pa_ros {__version__}), got "
                f"{values['format']!r}: use the version that wrote it, or train anew"
            )
        if not isinstance(values["extra"], dict):
            raise CheckpointError(
                f"checkpoint: {directory}: extra: expected facts by name, got {values['extra']!r}"
            )
        if not isinstance(values["architecture"], str):
            raise CheckpointError(
                f"checkpoint: {directory}: architecture: expected text, got "
                f"{values['architecture']!r:.200}"
            )
        counts = values["counters"]
        if not all(type(count) is int and count >= 0 for count in counts.values()):
            raise CheckpointError(
                f"checkpoint: {directory}: counters: expected integers of at least 0, got {counts}"
            )
        _ = counts["frames"]  # must be there
    except (OSError, ConfigError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise CheckpointError(f"checkpoint: {directory}: {METADATA}: {error!r}") from error
    return dict(values)


def load_policy(path: Path) -> PolicySnapshot:
    """The newest published weights of a checkpoint: all that acting needs."""
    directory = find_checkpoint(path)  # once: a run that goes on may have the next, then
    values = read_metadata(directory)
    check_files(directory, ACTING)
    return _load_policies(directory, values)[-1]


def restore(path: Path, learner: Learner) -> dict[str, Any]:
    """Put a new learner where the checkpoint's was; returns the caller's `extra`.

    Raises CheckpointError, naming both sides, if networks or settings differ, or if a file is
    missing or damaged; the learner is then not to be used.
    """
    directory = find_checkpoint(path)
    values = read_metadata(directory)
    check_files(directory)
    try:
        _check_same(directory, values, learner.network, learner.config, learner.scoring)
        for text in values["programs"]:
            learner.table.add(parse(text, learner.network.vocabulary))
        if list(learner.table.texts) != values["programs"]:
            raise CheckpointError(
                f"checkpoint: {directory}: expected programs {values['programs']}, "
                f"got {list(learner.table.texts)}"
            )
        learner.engine.load_tensors(_load_arrays(directory / "engine.safetensors"))
        learner.replay.restore(_load_arrays(directory / "replay.safetensors"), values["replay"])
        learner.rng.bit_generator.state = values["rng"]
        int(values["counters"]["version"])  # must be there
        learner.counters = Counters(**values["counters"])
        learner.published.clear()
        learner.published.extend(_load_policies(directory, values))
        extra: dict[str, Any] = values["extra"]
        return extra
    except CheckpointError:
        raise
    except (PaError, ValueError, LookupError, TypeError, AttributeError, OverflowError) as error:
        raise CheckpointError(f"checkpoint: {directory}: {error!r}") from error


def check_trained_with(
    path: Path, network: NetworkConfig, config: LearnerConfig, scoring: Scoring, **facts: object
) -> dict[str, Any]:
    """metadata.json of a checkpoint of these networks, settings, rewards and facts.

    Raises CheckpointError, naming both sides, if it is of others.
    """
    directory = find_checkpoint(path)
    values = read_metadata(directory)
    check_facts(path, values, **facts)
    _check_same(directory, values, network, config, scoring)
    return values


def check_facts(path: Path, values: Mapping[str, Any], **expected: object) -> None:
    """Raise CheckpointError unless a checkpoint's run said this of itself in metadata.json."""
    facts = values["extra"]
    for name, value in expected.items():
        if facts.get(name) != value:
            raise CheckpointError(
                f"checkpoint: {path}: {name}: expected {value!r}, got {facts.get(name)!r}"
            )


def find_checkpoint(path: Path) -> Path:
    """The checkpoint directory that `path` is, or that its LATEST names.

    "shipped:NAME" is a policy that comes with the package.
    """
    if str(path).startswith(SHIPPED_PREFIX):
        return _shipped(str(path).removeprefix(SHIPPED_PREFIX))
    try:
        if (path / METADATA).is_file():
            return path
    except OSError as error:  # a folder that may not be looked into, say
        raise CheckpointError(f"checkpoint: {path}: {error}") from error
    name = _latest_name(path)
    if not name or Path(name).name != name or not os.path.isfile(path / name / METADATA):
        raise CheckpointError(f"checkpoint: expected one at {path}, found none")
    return path / name


def _shipped(name: str) -> Path:
    names = sorted(card.parent.name for card in SHIPPED.glob(f"*/{METADATA}"))
    if name not in names:
        raise CheckpointError(f"checkpoint: expected shipped: and one of {names}, got {name!r}")
    return SHIPPED / name


def _files(learner: Learner, extra: dict[str, Any]) -> dict[str, bytes]:
    policies = {
        f"{snapshot.version}/{name}": tensor
        for snapshot in learner.published
        for name, tensor in snapshot.tensors.items()
    }
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
        "extra": extra,
    }
    tensors = learner.engine.tensors()
    _check_finite(tensors | policies)
    return {
        METADATA: json.dumps(values, indent=1).encode(),
        "engine.safetensors": packed(tensors),
        "replay.safetensors": packed(learner.replay.filled()),
        POLICIES: packed(policies),
    }


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
    algorithm, here = values["algorithm"], ours_config.ALGORITHM
    if algorithm != here:
        raise CheckpointError(
            f"checkpoint: {directory}: differs in algorithm: checkpoint {algorithm!r}, "
            f"here {here!r}"
        )
    try:
        network = NetworkConfig.from_json(values["network"])
        config = type(ours_config).from_json(values["learner"])
    except ConfigError as error:
        raise CheckpointError(
            f"checkpoint: {directory}: expected settings that are known here, got others: its "
            f"agents act, its learner does not go on ({error})"
        ) from error
    theirs = network.flat() | config.flat()
    ours = ours_network.flat() | ours_config.flat()
    theirs["scoring"], ours["scoring"] = values["scoring"], repr(scoring)
    differing = [
        f"{name}: checkpoint {theirs[name]!r}, here {ours[name]!r}"
        for name in sorted(ours)
        if theirs[name] != ours[name] and name not in FREE_TO_CHANGE
    ]
    if differing:
        raise CheckpointError(f"checkpoint: {directory}: differs in {'; '.join(differing)}")


def _load_policies(directory: Path, values: dict[str, Any]) -> list[PolicySnapshot]:
    arrays = _load_arrays(directory / POLICIES)
    try:
        network, versions = NetworkConfig.from_json(values["network"]), values["published"]
        known = {name.partition("/")[0] for name in arrays}
        if not versions or not {str(version) for version in versions} <= known:
            raise CheckpointError(
                f"checkpoint: {directory}: published: expected versions of {sorted(known)}, "
                f"got {versions!r}"
            )
        return [
            PolicySnapshot(
                version=version,
                architecture=values["architecture"],
                world_digest=network.world.digest,
                tensors={
                    name.partition("/")[2]: tensor
                    for name, tensor in arrays.items()
                    if name.partition("/")[0] == str(version)
                },
            )
            for version in versions
        ]
    except CheckpointError:
        raise
    except (PaError, KeyError, TypeError, AttributeError) as error:
        raise CheckpointError(f"checkpoint: {directory}: {error!r}") from error


def packed(arrays: Arrays) -> bytes:
    """Safetensors; it writes strided arrays wrongly, and says nothing."""
    content: bytes = save({k: np.asarray(array, order="C") for k, array in arrays.items()})
    return content


def _load_arrays(path: Path) -> Arrays:
    try:
        arrays: Arrays = load_file(path)
    except (OSError, SafetensorError, ValueError) as error:
        raise CheckpointError(f"checkpoint: {path}: {error}") from error
    return {name: np.array(array) for name, array in arrays.items()}


def _latest_name(root: Path) -> str | None:
    try:
        return (root / LATEST).read_text(encoding="ascii").strip().partition("\0")[0]
    except (OSError, UnicodeDecodeError):
        return None


def _write_directory(root: Path, name: str, files: dict[str, bytes]) -> None:
    unfinished, finished = root / f".{name}", root / name
    for leftover in (unfinished, finished):  # of a crash; LATEST names neither
        shutil.rmtree(leftover, ignore_errors=True)
    unfinished.mkdir()
    for file_name, content in files.items():
        write_synced(unfinished / file_name, content)
    _sync_directory(unfinished)
    os.rename(unfinished, finished)
    _sync_directory(root)


def write_synced(path: Path, content: bytes) -> None:
    """Write a file through to the disk."""
    with path.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


def _sync_directory(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
