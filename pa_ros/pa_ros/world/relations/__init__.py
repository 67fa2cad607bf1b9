"""Relations between the hand and objects, by name: what may be asked for, and what it means.

A relation that a newcomer registers here is known to parser, verifier, relabeling, networks,
pictures and the scripted reference alike; no other file tells them apart.
"""

from pa_ros.world.relations import above, near, sides  # noqa: F401 - they register themselves
from pa_ros.world.relations.relation import RELATIONS, Relation, register

__all__ = ["RELATIONS", "Relation", "register"]
