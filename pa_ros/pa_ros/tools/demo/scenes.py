"""What a demonstration asks of the arm, the scenes it asks it in, and the pictures it leaves."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pa_ros.arena import (
    ArenaConfig,
    Design,
    Episode,
    ReachTask,
    condition_named,
    generate,
)
from pa_ros.core.errors import ConfigError
from pa_ros.evaluation.pictures.drawing import learning_curve, phi_picture
from pa_ros.evaluation.scoring.tally import EpisodeTally, HeldOutTarget
from pa_ros.language import MIN_MAX, parse, relevance, satisfying
from pa_ros.learning.checkpoints import load_policy
from pa_ros.networks.config import actor_config
from pa_ros.networks.inference import TorchActor
from pa_ros.world.relations import RELATIONS

FULL, FEWER = "eval", "only-color"
"""Conditions of scenes: as in training; and with one block alone of a color, so fewer blocks."""

SCENES_SEARCHED = 1000
FARTHER = 2.0
"""Thresholds of the relation from hand to target at a scene's start, so that the arm must move."""
MOST_POINTS, EPISODES_A_POINT = 60, 4  # of the learning curve


@dataclass(frozen=True)
class DemoProgram:
    """A program to send, and what is new about it."""

    kind: str
    text: str
    targets: int = 1  # blocks of the scene that it names


@dataclass(frozen=True)
class Scene:
    """An episode of an arena, as its Reset service is asked for it."""

    condition: str  # FULL or FEWER
    episode: Episode
    distance: float  # the relation's measure of the nearest block that is named, at the start


def demo_programs(design: Design) -> list[DemoProgram]:
    """Six programs of the design's first relation: one trained, five never trained.

    ConfigError if nothing is held out.
    """
    if not design.held_out:
        raise ConfigError(f"demo: expected a design with held-out targets, got {design.name}")
    known, new = design.train[0], design.held_out[0]
    first, last = [*design.values][0], [*design.values][-1]
    other = next(kind for kind in design.train if kind[last] == known[last] and kind != known)
    trained, held_out = known.conjunction, new.conjunction
    relation = design.vocabulary.relations[0]
    without = f"AND({', '.join([f'NOT({known[first]})', *[*other.values()][1:]])})"
    return [
        DemoProgram("trained", f"{relation}(HAND, {trained})"),
        DemoProgram("held out", f"{relation}(HAND, {held_out})"),
        DemoProgram(f"{first} alone", f"{relation}(HAND, {known[first]})"),
        DemoProgram(f"{last} alone", f"{relation}(HAND, {new[last]})"),
        DemoProgram("NOT", f"{relation}(HAND, {without})"),
        DemoProgram("OR of two", f"{relation}(HAND, OR({trained}, {held_out}))", targets=2),
    ]


def find_scene(config: ArenaConfig, design: Design, seed: int, program: DemoProgram) -> Scene:
    """The first scene of a seed that lets a program show something.

    The program names exactly as many blocks as it should, none of them nearer than FARTHER. Scenes
    as in training come first; where they cannot do (2 x 2 blocks and a color alone), one with
    fewer blocks. Raises ConfigError if none does.
    """
    task = ReachTask(config, design, seed)
    parsed = parse(program.text, design.vocabulary)
    farther = FARTHER * task.scoring.threshold(parsed.relation)
    for condition in (FULL, FEWER):
        drawn_from = condition_named(condition, design)
        for index in range(SCENES_SEARCHED):
            episode = generate(config, design, drawn_from, seed, index)
            kinds = [block.kind.words for block in episode.blocks]
            if sum(satisfying(parsed, kinds, None)) != program.targets:
                continue
            task.reset_to(episode)
            _, verdict = task.set_program(parsed)
            if verdict.distance >= farther:
                return Scene(condition, episode, verdict.distance)
    raise ConfigError(
        f"demo: no scene of design {design.name} in which {program.text} names "
        f"{program.targets} block(s) at least {farther:g} {RELATIONS[parsed.relation].unit} away"
    )


def draw_learning_curve(path: Path, tally: EpisodeTally, target: HeldOutTarget, title: str) -> None:
    """Reward per step against frames, each point over a few held-out episodes."""
    held_out_episodes = sum(episode.held_out for episode in tally.episodes)
    bins = min(MOST_POINTS, max(1, held_out_episodes // EPISODES_A_POINT))
    frames, train, held_out = tally.curve(bins)
    learning_curve(path, frames, train, held_out, title, (target.random, target.scripted))


def draw_phi(path: Path, checkpoint: Path, config: ArenaConfig, design: Design, scene: Scene,
             program: str) -> None:  # fmt: skip
    """Φ and p of a learned actor at the first observation of a scene, beside the arena."""
    snapshot = load_policy(checkpoint)
    network = actor_config(snapshot.architecture)
    task = ReachTask(config, design, seed=0)
    observation, _ = task.reset_to(scene.episode)
    phi = TorchActor(network, snapshot.tensors, MIN_MAX).properties(
        observation.objects, network.world.arm(observation)
    )
    parsed = parse(program, network.vocabulary)
    p = relevance(parsed, phi.tolist(), network.vocabulary.row, observation.hand_index, MIN_MAX)
    hand, *blocks = task.simulation.positions[:, :2].tolist()
    phi_picture(
        path,
        [(b.kind, x, y)
         for b, (x, y) in zip(scene.episode.blocks, blocks, strict=True)],
        (hand[0], hand[1]),
        phi,
        np.array(p),
        network.vocabulary.words,
        str(parsed),
    )  # fmt: skip
