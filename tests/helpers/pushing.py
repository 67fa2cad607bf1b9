"""A world of a cube, a sphere and a place, and made-up trajectories in which the cube moves."""

import numpy as np

from helpers.worlds import random_trajectory
from pa_ros.core.update import HAND_INDEX
from pa_ros.language import Vocabulary, parse
from pa_ros.world import Trajectory
from pa_ros.world.poses import in_hand
from pa_ros.world.schema import PUSHING
from pa_ros.world.world import World

WORDS = Vocabulary.of(shape=("CUBE", "SPHERE", "PLACE"), color=("RED", "BLUE")).moving("PLACE")
PUSH = World(PUSHING, WORDS, joints=6)
TEXTS = ("NEAR(CUBE, RED)", "NEAR(AND(RED, SPHERE), PLACE)", "NEAR(CUBE, PLACE)",
         "NEAR(HAND, CUBE)", "NEAR(HAND, PLACE)", "NEAR(CUBE, SPHERE)")  # fmt: skip
PROGRAMS = [parse(text, WORDS) for text in TEXTS]
CUBE, SPHERE, PLACE = 1, 2, 3
STEPS = 20


def pushed(rng: np.random.Generator, sequence: int, moves: bool) -> Trajectory:
    """A trajectory in which the hand goes anywhere and the cube along x, if it moves."""
    base = np.zeros((STEPS + 1, 4, 7))
    base[..., 6] = 1.0
    base[:, HAND_INDEX] = rng.normal(size=(STEPS + 1, 7))
    base[:, HAND_INDEX, 3:] /= np.linalg.norm(base[:, HAND_INDEX, 3:], axis=-1, keepdims=True)
    base[:, 1:, :3] = rng.uniform(-0.5, 0.5, (3, 3))
    base[:, 1:, 2] = 0.03
    if moves:
        base[:, CUBE, 0] += np.linspace(0, 2, STEPS + 1)
    kinds = [{"shape": s, "color": "RED"} for s in ("CUBE", "SPHERE", "PLACE")]
    objects = np.zeros((STEPS + 1, 4, PUSH.object_features), np.float32)
    objects[:, 1:] = [PUSHING.features(kind) for kind in kinds]
    objects[..., :7] = in_hand(base[:, :1], base)
    arm = np.zeros((STEPS + 1, PUSH.arm_features), np.float32)
    arm[:, -7:] = base[:, HAND_INDEX]
    fields = {"objects": objects, "arm": arm, "world_digest": PUSH.digest, "program": PROGRAMS[0]}
    return random_trajectory(rng, STEPS, sequence=sequence, **fields)
