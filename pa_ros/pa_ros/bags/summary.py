"""Describes a bag for people: topics, episodes, programs, scores, versions, gaps."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from pa_ros.bags.episodes import RecordedEpisode, episodes
from pa_ros.bags.errors import ProvenanceError
from pa_ros.bags.experience import TRAJECTORIES, Experience
from pa_ros.bags.format import BEFORE, LOST, METADATA, REPAIRED, damaged
from pa_ros.bags.reader import Bag
from pa_ros.core.errors import PaError
from pa_ros.core.experience import AgentKey, TrajectoryKey


@dataclass
class Group:
    """Figures of the training episodes, or of the evaluation episodes."""

    episodes: int = 0
    steps: int = 0
    missing: int = 0  # control steps between others that are not recorded
    rewards: list[float] = field(default_factory=list)  # mean per step, episode by episode
    programs: Counter[str] = field(default_factory=Counter)
    versions: set[int] = field(default_factory=set)  # of the weights that acted

    def add(self, episode: RecordedEpisode) -> None:
        """Count one episode."""
        self.episodes += 1
        self.steps += max(len(episode.rows) - 1, 0)
        self.missing += episode.missing
        if len(episode.rewards):
            self.rewards.append(float(episode.rewards.mean()))
        self.programs.update({row.step.program for row in episode.rows})
        self.versions.update(row.policy_version for row in episode.rows)
        self.versions.discard(-1)


def describe(bag: Bag, namespace: str | None = None) -> tuple[list[str], bool]:
    """Lines to print, and whether the whole bag could be read."""
    lines = [f"{bag.path}: {bag.duration_s:.1f} s, {sum(bag.counts.values())} messages"]
    complete = True
    if REPAIRED in bag.custom:
        lines.append(f"repaired after its recorder was killed: {bag.custom[REPAIRED]}")
    lines += _topics(bag)
    for part in (_learning, _episodes):
        try:
            lines += part(bag, namespace)
        except PaError as error:
            if error.code == "bag.foreign":
                lines.append(f"no episodes or transitions to describe: {error}")
            else:
                lines.append(f"NOT READABLE: {error}")
                complete = False
    return lines, complete


def _topics(bag: Bag) -> list[str]:
    lost, before = _counts(bag, LOST), _counts(bag, BEFORE)
    lines = []
    for name, count in bag.counts.items():
        note = f", {lost[name]} lost while recording" if lost.get(name) else ""
        note += f", {before[name]} published before recording began" if before.get(name) else ""
        lines.append(f"  {name}  {bag.types[name]}  {count}{note}")
    return lines


def _counts(bag: Bag, key: str) -> dict[str, object]:
    """Messages by topic, as metadata.yaml states them. Raises BagError."""
    text = bag.custom.get(key, "{}")
    try:
        found = json.loads(text)
    except ValueError:
        found = None
    if not isinstance(found, dict):
        raise damaged(bag.path, f"{METADATA}: {key}: expected a JSON object, got {text[:100]!r}")
    return found


def _learning(bag: Bag, namespace: str | None) -> list[str]:
    if not bag.topics_of(TRAJECTORIES, namespace):
        return []
    experience = Experience.read(bag, namespace)
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
        lines.append(f"cannot be repeated: {error}")
    lines.append(f"{len(experience.keys)} trajectories of transitions{_gaps(experience.keys)}")
    versions = sorted(experience.published)
    if versions:
        absent = versions[-1] - versions[0] + 1 - len(versions)
        gap = f", {absent} of them not recorded" if absent else ""
        lines.append(f"weights: versions {versions[0]} to {versions[-1]}{gap}")
    return lines


def _gaps(keys: Iterable[TrajectoryKey]) -> str:
    """Say how many trajectories are missing, agent by agent, by their sequence numbers."""
    by_agent: dict[AgentKey, list[int]] = {}
    for key in keys:
        by_agent.setdefault(AgentKey(*key[:2]), []).append(key.sequence)
    missing = {a: max(n) - min(n) + 1 - len(set(n)) for a, n in by_agent.items()}
    said = [f"{count} missing of {agent.agent_id}" for agent, count in missing.items() if count]
    return "; GAPS: " + ", ".join(said) if said else ", no gaps"


def _episodes(bag: Bag, namespace: str | None) -> list[str]:
    groups = {"training": Group(), "evaluation": Group()}
    for episode in episodes(bag, namespace):
        groups["evaluation" if episode.evaluation else "training"].add(episode)
    lines = []
    for kind, group in groups.items():
        if not group.episodes:
            continue
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
    return f", reward per step {np.mean(group.rewards):+.3f}"
