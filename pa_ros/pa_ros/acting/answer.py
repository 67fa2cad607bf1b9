"""May this agent act, and with which weights? What can be answered."""

from __future__ import annotations

from dataclasses import dataclass

from pa_ros.core.published import PublishedPolicy


@dataclass(frozen=True, slots=True)
class Wait:
    """It may not act before this has come."""

    reason: str


@dataclass(frozen=True, slots=True)
class Load:
    """It may act once it has loaded these weights."""

    policy: PublishedPolicy


@dataclass(frozen=True, slots=True)
class Act:
    """It may act, with the weights that it has."""


Answer = Wait | Load | Act
