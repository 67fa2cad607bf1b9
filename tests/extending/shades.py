"""A custom property group: blocks are dark or bright, seen as a number."""

from dataclasses import replace

from pa_ros.arena.appearance import APPEARANCES
from pa_ros.arena.designs import Design, Kind, kinds, register
from pa_ros.world.schema import PAPER, ObjectSchema, PropertyGroup, Real

BRIGHTNESS = {"DARK": 0.4, "BRIGHT": 1.0}
MIDDLE = 0.7

# One more feature of an object: how much brighter it is than the middle. So the values lie on both
# sides of 0, as detectors without biases need, and 0 is neither. A word is true within 0.2 of its
# value; networks get 3 units per unit of brightness, about ±1.
SHADE = PropertyGroup(
    "shade",
    ("DARK", "BRIGHT"),
    Real(
        ("from_middle",),
        {word: (shade - MIDDLE,) for word, shade in BRIGHTNESS.items()},
        tolerance=0.2,
        scale=3.0,
    ),
)
SCHEMA = ObjectSchema((*PAPER.groups, SHADE))

# How it looks on the table: red, green and blue, times the brightness.
APPEARANCES.register(
    "shade",
    lambda look, value: replace(
        look, rgba=" ".join(str(one * BRIGHTNESS[value]) for one in look.rgb) + " 1"
    ),
)

# The blocks of the design, with properties in the order in which programs name them. Bright blue
# blocks are never a target in training.
VALUES = {"color": ("RED", "BLUE"), "shape": ("CUBE",), "shade": ("DARK", "BRIGHT")}
HELD_OUT = Kind(color="BLUE", shape="CUBE", shade="BRIGHT")
register(
    Design(
        "shades",
        VALUES,
        SCHEMA.vocabulary,
        train=tuple(kind for kind in kinds(VALUES) if kind != HELD_OUT),
        held_out=(HELD_OUT,),
        schema=SCHEMA,
    )
)
