"""The hand's controller: its commands, and what an arm must be."""

from dataclasses import replace

import numpy as np
import pytest

from pa_ros.arena import ARMS, preset_named
from pa_ros.arena.kinematics import hand_controller
from pa_ros.core.errors import ConfigError
from pa_ros.world.controller import RADII, HandController

JACO = tuple(joint.start for joint in ARMS["jaco"].joints)
LOW = (3.1065, 4.341, 2.4074, 3.5513, 4.8528, -0.0012)  # the hand at the rim, as low as it goes
PANDA = (0.197, 0.0719, 0.0, -2.342, 0.0, 2.4139, 0.785)


@pytest.mark.parametrize(
    ("joints", "action", "command"),
    [
        (JACO, (1, 0, 0), (-0.1439, 0.5977, 1.0, 0.122, -0.4482, 0.0167)),
        (JACO, (0, -3, 0.5), (0.8137, -0.2527, 0.321, 0.2181, -0.6695, 0.1999)),
        (LOW, (1, 0.2, -1), (-0.1136, 0.2645, 0.4043, 0.0436, -0.1398, 0.0425)),
        # Turned away from its heading.
        ((*JACO[:5], 0.4), (0, 0, 0), (0.0066, 0.0039, 0.0071, -0.0033, -0.0193, -0.3736)),
        ((0.3, 2.9, 1.3, 3.5, 5.4, 3.1), (0.2, 0.1, 0.3),
         (0.1499, 0.6824, -1.0, -0.6965, 0.5584, 0.4821)),
        (PANDA, (0, 1, -1), (0.2461, 0.4755, 0.2426, -0.1437, -0.0181, 0.4813, 0.0115)),
        # Joints are near their limits.
        ((1.8, -0.18, 0.21, -2.68, -0.36, 2.65, -0.78), (-0.1, -0.7, 0.3),
         (0, -0.1541, -0.6116, 0.1122, 0.3252, -0.4109, 0)),
        ((*PANDA[:3], -3.04, *PANDA[4:]), (-1, 0, 0), (0, -1.0, 0, 0, 0.0001, -0.2137, 0)),
        # The hand is near the base's axis.
        ((0.1, 0.25, 0.1, -3.05, 0.1, 1.8, 0.785), (0.1, 0.1, 0),
         (0.9228, 0.5436, 0.8771, 0, 1.0, 0.5366, 0.0197)),
    ],
)  # fmt: skip
def test_the_commands_never_change(joints, action, command) -> None:
    """The shipped agents that push learned with them."""
    arm = "jaco" if len(joints) == 6 else "panda"
    controller = replace(hand_controller(preset_named("push", arm)), radii=RADII)  # for any arm
    found = controller.joint_action(np.array(action, np.float32), np.array(joints))
    np.testing.assert_allclose(found, command, atol=1e-4)
    assert HandController.from_data(controller.to_data()) == controller


def test_an_arm_of_impossible_numbers_is_rejected() -> None:
    joint = hand_controller(preset_named("push")).joints[0]
    assert replace(joint, max_speed=0.1) and replace(joint, zero=None, max_speed=0.0)
    for wrong in ({"max_speed": 0.0}, {"position": (0.0, 0.0)}, {"upper": np.nan}):
        with pytest.raises(ConfigError, match="controller: expected .*, got Frame"):
            replace(joint, **wrong)


def test_the_action_of_a_command_is_the_hands_motion_that_it_makes() -> None:
    controller, joints = hand_controller(preset_named("push")), np.array(JACO)
    for action in ((0.3, -0.2, 0.1), (0.0, 0.4, -0.2), (-0.2, 0.0, 0.0)):
        given = np.array(action, np.float32)
        found = controller.action_of(controller.joint_action(given, joints), joints)
        np.testing.assert_allclose(found, given, atol=0.03)  # damping takes a little
