"""Policies that come with the package: one is added from a run, or replaced as a whole."""

from __future__ import annotations

import json
import os
import re
import shutil
from pathlib import Path
from typing import Any

from pa_ros.core.errors import ConfigError
from pa_ros.learning.checkpoint_files import (
    METADATA,
    SHIPPED,
    find_checkpoint,
    packed,
    write_synced,
)
from pa_ros.learning.checkpoints import POLICIES, load_policy, read_metadata


def check_ship_name(name: str, replaces: bool = False, folder: Path = SHIPPED) -> None:
    """Raise ConfigError unless a policy can be shipped under this name."""
    if not re.fullmatch(r"[\w-]+", name, re.ASCII):
        raise ConfigError(f"ship: name: expected letters, digits, '-' and '_', got {name!r}")
    if (folder / name).exists() and not replaces:
        raise ConfigError(f"ship: name: expected a new one, got {name!r}, which exists (--replace)")


def ship(
    run: Path, name: str, card: dict[str, Any], replaces: bool = False, folder: Path = SHIPPED
) -> Path:
    """Copy what acting needs of a checkpoint into the package as policy `name`; its folder.

    `card` joins the metadata's `extra`: where the policy comes from and how it scores. Raises
    ConfigError for a name that is invalid, or exists and must not be replaced.
    """
    check_ship_name(name, replaces, folder)
    directory = find_checkpoint(run)
    values = read_metadata(directory)
    policy = load_policy(directory)
    values["published"] = [policy.version]
    values["extra"] = values["extra"] | card
    tensors = {f"{policy.version}/{k}": tensor for k, tensor in policy.tensors.items()}
    out, new, old = folder / name, folder / f".{name}.new", folder / f".{name}.old"
    for leftover in (new, old):
        shutil.rmtree(leftover, ignore_errors=True)
    new.mkdir(parents=True)
    write_synced(new / METADATA, (json.dumps(values, indent=1) + "\n").encode())
    write_synced(new / POLICIES, *packed(tensors))
    if out.exists():
        # Only between these two renames is there no policy of this name.
        os.rename(out, old)
    os.rename(new, out)
    shutil.rmtree(old, ignore_errors=True)
    return out
