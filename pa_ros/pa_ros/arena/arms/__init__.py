"""Arms by name; extensions register custom ones (docs/extending.md)."""

from pa_ros.arena.arms.arm import ArmModel, Joint, VacuumCup
from pa_ros.arena.arms.jaco import JACO
from pa_ros.arena.arms.panda import PANDA
from pa_ros.core.registry import Registry

__all__ = ["ARMS", "ArmModel", "Joint", "VacuumCup"]

ARMS: Registry[ArmModel] = Registry("arm")
for _arm in (JACO, PANDA):
    ARMS.register(_arm.name, _arm)
