"""Physical facts of table and blocks, with unit. Our own: the paper gives no sizes."""

from __future__ import annotations

PRESETS = ("paper", "fast")  # names; their values are in pa_ros.arena.config

TABLE_SIDE_M = 1.6
TABLE_THICKNESS_M = 0.04
FLOOR_DEPTH_M = 0.5  # below the table top; catches what falls off
BLOCK_HALF_SIZE_M = 0.03  # of the cube's edge, the sphere's and the cylinder's radius and height
CAPSULE_RADIUS_M = 0.025
CAPSULE_HALF_LENGTH_M = 0.025  # the capsule lies on its side, along the block's x axis
# How far MuJoCo's soft contact lets each shape sink in, m, whatever its mass; measured
# (tests/arena/test_sleep.py holds it). Starting there, nothing moves when a block wakes.
RESTING_DEPTH_M = {"CUBE": 4.36e-5, "SPHERE": 1.69e-4, "CYLINDER": 4.4e-5, "CAPSULE": 8.66e-5}

COLOR_RGBA = {
    "RED": "0.85 0.15 0.15 1",
    "GREEN": "0.15 0.65 0.2 1",
    "BLUE": "0.15 0.3 0.85 1",
    "YELLOW": "0.95 0.85 0.1 1",
    "MAGENTA": "0.85 0.15 0.75 1",
}
