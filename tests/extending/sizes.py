"""A custom property group: blocks are small or large, seen as a number in metres."""

from dataclasses import replace

from pa_ros.arena.appearance import APPEARANCES, BLOCK_HALF_SIZE_M
from pa_ros.arena.designs import Design, Kind, kinds, register
from pa_ros.world.schema import PAPER, ObjectSchema, PropertyGroup, Real

EDGE_M = {"SMALL": 0.04, "LARGE": 0.08}
MIDDLE_M = 0.06

# One more feature of an object, after shape and color: how much longer its edge is than 0.06 m. So
# the values lie on both sides of 0, as detectors without biases need, and 0 is neither. A word is
# true within 1 cm of its value; networks get 50 units per metre, ±1.
SIZE = PropertyGroup(
    "size",
    ("SMALL", "LARGE"),
    Real(
        ("m_from_middle",),
        {word: (edge - MIDDLE_M,) for word, edge in EDGE_M.items()},
        tolerance=0.01,
        scale=50.0,
    ),
)
SCHEMA = ObjectSchema((*PAPER.groups, SIZE))

# How it looks on the table: the edge of a block of scale 1 is twice BLOCK_HALF_SIZE_M.
APPEARANCES.register(
    "size", lambda look, value: replace(look, scale=EDGE_M[value] / (2 * BLOCK_HALF_SIZE_M))
)

# The blocks of the design, with properties in the order in which programs name them. Large blue
# blocks are never a target in training.
VALUES = {"size": ("SMALL", "LARGE"), "color": ("RED", "BLUE"), "shape": ("CUBE",)}
HELD_OUT = Kind(size="LARGE", color="BLUE", shape="CUBE")
register(
    Design(
        "sizes",
        VALUES,
        SCHEMA.vocabulary,
        train=tuple(kind for kind in kinds(VALUES) if kind != HELD_OUT),
        held_out=(HELD_OUT,),
        schema=SCHEMA,
    )
)
