"""Provenance in a bag's metadata: what latched topics said, for people and for other programs."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict
from typing import Final

from pa_ros.wire.arena import ArenaDescription
from pa_ros.wire.diagnostics import Origin

# Keys of custom_data in metadata.yaml.
ORIGINS: Final = "pa_ros.provenance"  # JSON list, one object per process
ARENAS: Final = "pa_ros.arena_info"  # JSON list, one object per arena


def as_custom_data(origins: Iterable[Origin], arenas: Iterable[ArenaDescription]) -> dict[str, str]:
    """Entries for custom_data."""
    return {
        ORIGINS: json.dumps([asdict(origin) for origin in origins], sort_keys=True),
        ARENAS: json.dumps([asdict(arena) for arena in arenas], sort_keys=True),
    }
