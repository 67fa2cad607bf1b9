"""The older name of `pa_ros.arena.kinematics`, which programs of users may import."""

from pa_ros.arena.kinematics import hand_controller as hand_controller
