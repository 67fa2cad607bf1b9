"""Policies that come with the package: what acting needs of a checkpoint."""

from __future__ import annotations

import json
import os
import re
import shutil
from pathlib import Path
from typing import Any

from pa_ros.core.errors import ConfigError
from pa_ros.learning.checkpoints import (
    METADATA,
    POLICIES,
    SHIPPED,
    find_checkpoint,
    load_policy,
    packed,
    read_metadata,
    write_synced,
)


def check_ship_name(name: str, replaces: bool = False, folder: Path = SHIPPED) -> None:
    """Raise ConfigError unless a policy can be shipped under this name."""
    if not re.fullmatch(r"[\w-]+", name, re.ASCII):
        raise ConfigError(f"ship: name: expected letters, digits, '-' and '_', got {name!r}")
    if (folder / name).exists() and not replaces:
        raise ConfigError(f"ship: name: expected another than {name!r}, which is there (--replace)")


def ship(
    run: Path, name: str, card: dict[str, Any], replaces: bool = False, folder: Path = SHIPPED
) -> Path:
    """Keep what acting needs of a checkpoint as the shipped policy `name`; its directory.

    `card` joins the metadata's `extra`: where the policy comes from and how it scores. Raises
    ConfigError for a name that is none, or is taken and not to be replaced.
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
    write_synced(new / POLICIES, packed(tensors))
    if out.exists():
        os.rename(out, old)
    os.rename(new, out)
    shutil.rmtree(old, ignore_errors=True)
    return out
