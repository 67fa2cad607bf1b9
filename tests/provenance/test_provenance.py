"""What a learner and an arena say of themselves."""

from helpers.worlds import PROGRAMS, WORLD, dpg
from pa_ros.arena import design_named, preset_named
from pa_ros.learning.learner import Learner
from pa_ros.networks.config import NetworkConfig
from pa_ros.provenance import learner_origin
from pa_ros.provenance.arena import describe

NETWORK = NetworkConfig(world=WORLD, hidden=6, attention=4)


def test_a_learners_account_is_of_its_own_settings_and_of_its_processs() -> None:
    learner = Learner(
        NETWORK, dpg(replay__capacity_frames=100, schedule__trajectory_steps=20), PROGRAMS, 0
    )
    about = learner_origin("/l", "i", 3, learner, PROGRAMS, parameters={"out": "runs/1"})
    assert about.parameters == {"engine": learner.engine.name, "out": "runs/1"}
    assert about.learner is not None
    assert about.learner.network == NETWORK.to_json() and about.learner.first_version == 0
    assert about.learner.training_programs == tuple(PROGRAMS)
    assert (about.node, about.instance, about.seed) == ("/l", "i", 3)
    assert about.world == WORLD


def test_an_arenas_account_is_of_its_joints_and_its_design() -> None:
    arena, design = preset_named("fast"), design_named("2-L")
    about = describe(arena, design, 5, PROGRAMS, "i")
    assert about.joint_names == tuple(f"joint_{i}" for i in (1, 2, 3, 4, 5, 6))
    assert (about.joint_lower, about.joint_upper) == (arena.joint_lower, arena.joint_upper)
    assert (about.design, about.preset, about.seed) == ("2-L", arena.preset, 5)
    assert about.training_programs == tuple(PROGRAMS) and about.block_count == design.n_blocks
