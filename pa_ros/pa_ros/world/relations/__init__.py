"""Relations between the hand and objects, by name, with their meaning.

Parser, verifier, relabeling, networks, pictures and the scripted reference use what is registered
here. A custom relation is one file that calls `register`.
"""

from pa_ros.world.relations import standard  # noqa: F401 - registers its relations
from pa_ros.world.relations.relation import RELATIONS, Relation, arc, circle, register

__all__ = ["RELATIONS", "Relation", "arc", "circle", "register"]
