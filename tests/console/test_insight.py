"""What the page says of a program is what the networks say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pa_ros.arena import ReachTask, design_named, preset_named
from pa_ros.console import markup
from pa_ros.console.insight import Insight
from pa_ros.console.moment import Moment, looked
from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import PolicySnapshot
from pa_ros.language import MIN_MAX, parse, relevance
from pa_ros.learning.checkpoints import load_policy
from pa_ros.learning.protocols import LearningSettings
from pa_ros.networks.parameters import initial_actor
from pa_ros.provenance.origins import describe

SNAPSHOT = load_policy(Path("shipped:3-D"))
VOCABULARY = design_named("3-D").vocabulary
TASK = ReachTask(preset_named("fast"), design_named("3-D"), 2)
OBSERVATION, _ = TASK.reset(0, "train")


def test_p_is_the_programs_relevance_and_the_root_is_p_of_the_blocks():
    program = parse("NEAR(HAND, AND(RED, NOT(OR(SPHERE, CYLINDER))))", VOCABULARY)
    look = Insight(SNAPSHOT).look(OBSERVATION, program)
    hand = OBSERVATION.hand_index
    expected = relevance(program, look.phi.tolist(), VOCABULARY.row, hand, MIN_MAX)
    np.testing.assert_allclose(look.p, expected)
    assert [(node.depth, node.text) for node in look.tree] == [
        (0, "AND"), (1, "RED"), (1, "NOT"), (2, "OR"), (3, "SPHERE"), (3, "CYLINDER"),
    ]  # fmt: skip
    blocks = np.arange(len(look.p)) != OBSERVATION.hand_index
    np.testing.assert_allclose(look.tree[0].degrees[blocks], look.p[blocks], rtol=1e-6)
    red = [i + 1 for i, b in enumerate(TASK.episode.blocks) if "RED" in b.kind.words]
    assert all(look.tree[1].degrees[i] > 0.9 for i in red)
    assert look.version == SNAPSHOT.version and look.words == VOCABULARY.words


def test_without_a_program_there_is_phi_alone():
    look = Insight(SNAPSHOT).look(OBSERVATION, None)
    assert look.phi.shape == (len(VOCABULARY.words), 5) and not look.tree and not len(look.p)


def test_networks_without_detectors_are_refused():
    network = LearningSettings().network.changed(family="canonical").for_world(TASK.world)
    tensors = initial_actor(network, np.random.default_rng(0))
    snapshot = PolicySnapshot(0, network.architecture, TASK.world.digest, tensors)
    with pytest.raises(ConfigError, match="canonical"):
        Insight(snapshot)


def test_what_cannot_be_looked_at_says_why():
    assert (
        looked(None, OBSERVATION, "NEAR(HAND, RED)", VOCABULARY)[1] == "no weights are known here"
    )
    other = design_named("2-L").vocabulary
    look, why = looked(Insight(SNAPSHOT), OBSERVATION, "NEAR(HAND, GREEN)", other)
    assert look is None and "unknown word" in why


@pytest.mark.parametrize("text", ["", "NEAR(HAND, RED)"])
def test_tables_have_a_row_for_each_word_and_node(text):
    arena = describe(preset_named("fast"), design_named("3-D"), 2, (), "arena")
    look, why = looked(Insight(SNAPSHOT), OBSERVATION, text, VOCABULARY)
    moment = Moment(arena, OBSERVATION, False, text, -1.0, 0.5, False, look, why)
    names = ["one", "two", "<b>", "four"]
    shown = markup.words_by_objects(moment, names)
    assert shown.count("<tr>") == 1 + len(VOCABULARY.words) + bool(text) and "<b>" not in shown
    why = markup.tree(moment, names)
    assert ("no program is in force" in why) == (not text)
    assert ("most relevant: " in why) == bool(text)
    assert "not yet, 0.50 m away" in markup.state(moment)
