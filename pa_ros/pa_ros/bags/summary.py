"""What a bag holds, for people: topics, episodes, programs, scores, versions, gaps."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pa_ros.bags.episodes import RecordedEpisode, episodes
from pa_ros.bags.errors import (
    BagError,
    DamagedBagError,
    DefinitionError,
    ForeignBagError,
    ProvenanceError,
)
from pa_ros.bags.experience import TRAJECTORIES, Experience
from pa_ros.bags.losses import LOST, Losses
from pa_ros.bags.numbers import losses_of
from pa_ros.bags.reader import Bag
from pa_ros.core.errors import PaError
from pa_ros.core.experience import AgentKey, TrajectoryKey
from pa_ros.core.settings import read_json


@dataclass
class Group:
    """Episodes of a kind."""

    episodes: int = 0
    steps: int = 0
    missing: int = 0  # control steps between others that are not recorded
    rewards: list[float] = field(default_factory=list)  # mean per step, episode by episode
    programs: Counter[str] = field(default_factory=Counter)
    versions: set[int] = field(default_factory=set)  # of the weights that acted

    def add(self, episode: RecordedEpisode) -> None:
        """Count one."""
        self.episodes += 1
        self.steps += max(len(episode.rows) - 1, 0)
        self.missing += episode.missing
        if len(episode.rewards):
            self.rewards.append(float(episode.rewards.mean()))
        self.programs.update({row.program for row in episode.rows})
        self.versions.update(row.policy_version for row in episode.rows)
        self.versions.discard(-1)


def describe(bag: Bag, namespace: str | None = None) -> list[str]:
    """Lines to print; what cannot be read is said in a line of its own."""
    lines = [f"{bag.path}: {bag.duration_s:.1f} s, {sum(bag.counts.values())} messages"]
    try:
        lost = _lost(bag)
    except PaError as error:
        lost = {}
        lines.append(f"not readable: {error}")
    if "pa_ros.repaired" in bag.custom:
        lines.append(f"repaired after its recorder was killed: {bag.custom['pa_ros.repaired']}")
    if bag.unseen:
        lines.append(f"NOT SEEN: {bag.unseen}; counts and gaps below are of the rest")
    try:
        numbered = losses_of(bag.path)
    except BagError as error:
        numbered = {}
        lines.append(f"not readable: {error}")
    for name, count in bag.counts.items():
        note = _published(count, numbered[name]) if name in numbered else ""
        note += f", {lost[name]} lost while recording" if lost.get(name) else ""
        if bag.differs(name):
            note += ", another edition of the definition than is installed here"
        lines.append(f"  {name}  {bag.types[name]}  {count}{note}")
    for part in (_learning, _episodes):
        try:
            lines += part(bag, namespace)
        except ForeignBagError as error:
            lines.append(f"nothing of ours to tell: {error}")
        except (DefinitionError, PaError) as error:
            lines.append(f"not readable: {error}")
    return lines


def _lost(bag: Bag) -> dict[str, Any]:
    """Messages lost while recording, by topic."""
    text = bag.custom.get(LOST, "{}")
    try:
        return dict(read_json(text))
    except (ValueError, TypeError) as error:
        raise DamagedBagError(
            f"bag: {bag.path}: {LOST}: expected counts by topic, got {text!r:.200}"
        ) from error


def _published(count: int, losses: Losses) -> str:
    before = f", {losses.before} before the first heard" if losses.before else ""
    return f" of {count + losses.lost} published{before}"


def _learning(bag: Bag, namespace: str | None) -> list[str]:
    if TRAJECTORIES not in bag.types.values():
        return []
    experience = Experience(bag, namespace)
    lines = []
    for origin in experience.origins:
        facts = (origin.design, origin.arm, origin.preset, f"seed {origin.seed}")
        what = ", ".join(filter(None, facts))
        lines.append(f"{origin.node} ({origin.instance}): {what}; {origin.versions}")
    try:
        began = experience.learner.learner
        assert began is not None
        how = "from scratch" if began.first_version == 0 else f"at version {began.first_version}"
        lines.append(f"one learner, recorded from its beginning {how}")
    except ProvenanceError as error:
        lines.append(f"cannot be made again: {error}")
    lessons = list(experience.keys)
    lines.append(f"{len(lessons)} trajectories of transitions{_gaps(lessons)}")
    versions = sorted(experience.published)
    if versions:
        absent = versions[-1] - versions[0] + 1 - len(versions)
        gap = f", {absent} of them not recorded" if absent else ""
        lines.append(f"weights: versions {versions[0]} to {versions[-1]}{gap}")
    return lines


def _gaps(keys: Iterable[TrajectoryKey]) -> str:
    """Trajectories that the numbers say are missing, agent by agent."""
    by_agent: dict[AgentKey, list[int]] = {}
    for key in keys:
        by_agent.setdefault(AgentKey(*key[:2]), []).append(key.sequence)
    missing = {a: max(n) - min(n) + 1 - len(set(n)) for a, n in by_agent.items()}
    said = [f"{count} missing of {agent.agent_id}" for agent, count in missing.items() if count]
    return "; GAPS: " + ", ".join(said) if said else ", no gaps"


def _episodes(bag: Bag, namespace: str | None) -> list[str]:
    groups = {False: Group(), True: Group()}
    for episode in episodes(bag, namespace):
        groups[episode.evaluation].add(episode)
    lines = []
    for evaluation, group in groups.items():
        if not group.episodes:
            continue
        kind = "evaluation" if evaluation else "training"
        lines.append(f"{group.episodes} {kind} episodes, {group.steps} steps{_score(group)}")
        if group.missing:
            lines.append(f"  GAPS: {group.missing} steps between others are not recorded")
        if group.versions:
            lines.append(f"  acted by versions {min(group.versions)} to {max(group.versions)}")
        lines += [
            f"  {count:>6} episodes under {text or '(no program)'}"
            for text, count in group.programs.most_common()
        ]
    return lines


def _score(group: Group) -> str:
    if not group.rewards:
        return ""
    last = group.rewards[-20:]
    return (
        f", reward per step {np.mean(group.rewards):+.3f}, of the last {len(last)} "
        f"{np.mean(last):+.3f}"
    )
