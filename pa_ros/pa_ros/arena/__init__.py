"""The simulated arena: arm, table, blocks, episodes, the verifier and reference policies."""

from pa_ros.arena import avoiding, holding, pushing, reaching, zones  # noqa: F401  # register skills
from pa_ros.arena.arms import ARMS, ArmModel, Joint
from pa_ros.arena.conditions import Condition, condition_named, conditions_for, training_programs
from pa_ros.arena.config import PRESETS, ArenaChoice, ArenaConfig, preset_for, preset_named
from pa_ros.arena.designs import DESIGNS, Design, Kind, design_named
from pa_ros.arena.episodes import Block, Episode, generate
from pa_ros.arena.errors import ArenaError, PhysicsError, RenderError
from pa_ros.arena.gym_env import ENV_ID, ReachEnv, register
from pa_ros.arena.references import mean_reward, random_policy, scripted_action
from pa_ros.arena.task import ReachTask, play, scoring_of, world_of

__all__ = [
    "ARMS", "DESIGNS", "ENV_ID", "PRESETS", "ArenaChoice", "ArenaConfig", "ArenaError", "ArmModel",
    "Block", "Condition", "Design", "PhysicsError", "Episode", "Joint", "Kind", "ReachEnv",
    "ReachTask", "RenderError", "condition_named", "conditions_for", "design_named", "generate",
    "mean_reward", "play", "preset_for", "preset_named", "random_policy", "scoring_of",
    "scripted_action",
    "training_programs", "world_of",
]  # fmt: skip

register()
