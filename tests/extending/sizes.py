"""An extension: blocks are small or large, too; a property group that is a number, in metres."""

from __future__ import annotations

from dataclasses import replace

from pa_ros.arena.appearance import APPEARANCES, BLOCK_HALF_SIZE_M
from pa_ros.arena.designs import Design, Kind, kinds, register
from pa_ros.world.schema import PAPER, ObjectSchema, PropertyGroup, Real

EDGE_M = {"SMALL": 0.04, "LARGE": 0.08}

# What an object is seen as, after shape and color: one number, its edge in m. Words are true
# within a centimetre; networks read 25 units per metre.
SIZE = PropertyGroup(
    "size",
    ("SMALL", "LARGE"),
    Real(("m",), {word: (edge,) for word, edge in EDGE_M.items()}, tolerance=0.01, scale=25.0),
)
SCHEMA = ObjectSchema((*PAPER.groups, SIZE))

# What it is on the table: our blocks' edge is twice BLOCK_HALF_SIZE_M.
APPEARANCES.register(
    "size", lambda look, value: replace(look, scale=EDGE_M[value] / (2 * BLOCK_HALF_SIZE_M))
)

# Which blocks there are, in the order in which programs name their properties; large blue ones are
# never a target in training.
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
