"""Parameters of learner_node."""

from __future__ import annotations

from dataclasses import dataclass

from pa_ros.core.errors import ConfigError
from pa_ros.learning.protocols import Protocol, protocol_named
from pa_ros.networks.config import KINDS


@dataclass(frozen=True)
class LearnerNodeConfig:
    """One learner on the graph; what it learns about comes with arena_info."""

    seed: int = 0
    protocol: str = "ours"  # "ours-slow" for the preset `paper`
    options: tuple[str, ...] = ()  # "learner.NAME=VALUE" and "network.NAME=VALUE"
    network: str = "programmable"
    out: str = ""  # folder of the checkpoint; empty: none is written
    resume: bool = False  # go on from the checkpoint in `out`
    checkpoint_every_frames: int = 50_000  # 0: only when the node stops

    def __post_init__(self) -> None:
        if self.network not in KINDS:
            raise ConfigError(f"network: expected one of {KINDS}, got {self.network!r}")
        for name in ("seed", "checkpoint_every_frames"):
            if getattr(self, name) < 0:
                raise ConfigError(f"{name}: expected at least 0, got {getattr(self, name)}")
        if self.resume and not self.out:
            raise ConfigError("out: expected the folder to resume from, got ''")
        self.settings()

    def settings(self) -> Protocol:
        """How to learn; ConfigError for an unknown protocol or option."""
        return protocol_named(self.protocol).with_options(self.options)
