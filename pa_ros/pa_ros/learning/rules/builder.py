"""Which rule a learner learns by, from its settings and what its world's programs do."""

from __future__ import annotations

from collections.abc import Sequence

from pa_ros.core.errors import ConfigError
from pa_ros.language import Program
from pa_ros.learning.config import LearnerConfig
from pa_ros.learning.rules.all_goals import AllGoals
from pa_ros.learning.rules.dropout import PropertyDropout
from pa_ros.learning.rules.entries import Entries
from pa_ros.learning.rules.hindsight import Hindsight
from pa_ros.learning.rules.own import OwnProgram
from pa_ros.learning.rules.rule import Rule
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.families import family_of
from pa_ros.world import Scoring
from pa_ros.world.programs import ProgramTable


def make_rule(
    network: NetworkConfig,
    config: LearnerConfig,
    programs: Sequence[Program],
    scoring: Scoring,
    table: ProgramTable,
) -> Rule:
    """The rule that settings ask for; ConfigError for settings that don't fit the world.

    :param programs: the training programs.
    :param table: whose rows the programs of a batch are.
    """
    rule = _relabeling(network, config, programs, scoring)
    probability = config.relabeling.property_dropout
    if not probability:
        return rule
    if not network.world.schema.tells_words and "may_name" not in rule.columns:
        raise ConfigError(
            "learner.relabeling.property_dropout: expected 0 without relabeling where "
            "properties are seen, since it is not known which objects a program names, got "
            f"{probability}"
        )
    if not family_of(network).evaluates_programs:
        return rule
    return PropertyDropout(rule, table, network.world, probability)


def _relabeling(
    network: NetworkConfig, config: LearnerConfig, programs: Sequence[Program], scoring: Scoring
) -> Rule:
    discount, count = config.updates.discount, config.relabeling.programs_per_transition
    if config.relabeling.rule == "none":
        return OwnProgram(discount)
    rule: Rule
    if network.vocabulary.moves_objects:
        rule = Hindsight(programs, network.world, scoring, config.hindsight, discount)
    elif config.relabeling.rule == "entries":
        rule = Entries(programs, network.world, scoring, discount)
    else:
        rule = AllGoals(programs, network.world, scoring, discount, count)
    if count > 1 and not rule.draws_several:
        raise ConfigError(
            "learner.relabeling.programs_per_transition: expected 1 where programs move objects "
            f"or avoid them, got {count}"
        )
    return rule
