"""What the page says about a program is what the networks and the arena say."""

from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from helpers.learners import LEARNER, again, published
from helpers.messages import judged
from pa_ros.acting.executing import Actor
from pa_ros.acting.insight import Insight, agent_logic, explained
from pa_ros.arena import ReachTask, design_named, preset_named
from pa_ros.console import markup
from pa_ros.console.history import History
from pa_ros.console.moment import Moment
from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import PolicySnapshot, PublishedPolicy, Step, Verdict
from pa_ros.language import MIN_MAX, PRODUCT, parse, parse_goal, relevance
from pa_ros.learning.checkpoints import load_policy
from pa_ros.learning.recipes import LearningSettings
from pa_ros.networks.parameters import initial_actor
from pa_ros.provenance.arena import describe
from pa_ros.ros.refusals import Refusals
from pa_ros.ros.topics import POLICY_WEIGHTS, PROVENANCE
from pa_ros.tools.weights import AgentWeights
from pa_ros.wire.diagnostics import Origin, encode_provenance
from pa_ros.wire.learning import encode_weights
from pa_ros.wire.program import ProgramStatus

SNAPSHOT = load_policy(Path("shipped:3-D"))
VOCABULARY = design_named("3-D").vocabulary


def read(text: str) -> str:
    return str(parse_goal(text, VOCABULARY))


TASK = ReachTask(preset_named("fast"), design_named("3-D"), 2)
OBSERVATION, _ = TASK.reset(0, "train")


def at(text: str, stage: int = 0) -> Step:
    """The observed step under a program, not yet satisfied."""
    return Step(OBSERVATION, Verdict(-1.0, False, 0.5, False, stage), text)


HTML = "<img src=x onerror=alert(1)>"


def test_p_is_the_programs_relevance_and_the_root_is_p_of_the_blocks():
    program = parse("NEAR(HAND, AND(RED, NOT(OR(SPHERE, CYLINDER))))", VOCABULARY)
    found = Insight(SNAPSHOT).explain(OBSERVATION, program)
    hand = OBSERVATION.hand_index
    expected = relevance(program, found.phi.tolist(), VOCABULARY.row, hand, MIN_MAX)
    np.testing.assert_allclose(found.p, expected, atol=1e-6)
    head, *rows = (line.split() for line in str(found).splitlines())
    assert head == [*VOCABULARY.words, "p"] and len(rows) == len(found.objects)
    assert (rows[hand][0], rows[hand][-1]) == ("hand", "1.00")
    assert [(node.depth, node.text) for node in found.tree] == [
        (0, "AND"), (1, "RED"), (1, "NOT"), (2, "OR"), (3, "SPHERE"), (3, "CYLINDER"),
    ]  # fmt: skip
    blocks = np.arange(len(found.p)) != OBSERVATION.hand_index
    np.testing.assert_allclose(found.tree[0].degrees[blocks], found.p[blocks], atol=1e-6)
    red = [i + 1 for i, b in enumerate(TASK.episode.blocks) if "RED" in b.kind.words]
    assert all(found.tree[1].degrees[i] > 0.9 for i in red)
    assert found.version == SNAPSHOT.version and found.words == VOCABULARY.words


def test_p_of_a_comparison_is_that_by_which_the_agent_acts():
    blue = [i for i, block in enumerate(TASK.episode.blocks, 1) if "CUBE" in block.kind.words]
    assert len(blue) > 1
    program = parse("NEAR(HAND, LEFTMOST(CUBE))", VOCABULARY)
    found = Insight(SNAPSHOT).explain(OBSERVATION, program).p
    np.testing.assert_array_equal(found, Actor.of(SNAPSHOT).relevance(OBSERVATION, program))
    assert sum(found[i] > 0.5 for i in blue) == 1


def test_words_that_the_weights_do_not_know_are_named_not_raised():
    observation, _ = ReachTask(preset_named("fast"), design_named("2-L"), 2).reset(0)
    for text in ("NEAR(HAND, GREEN)", "AVOID(GREEN, NEAR(HAND, YELLOW))"):
        insight = Insight(load_policy(Path("shipped:2-L")))
        found, why = explained(insight, observation, text, VOCABULARY)
        assert found is None and why


def test_networks_without_detectors_are_rejected():
    network = LearningSettings().network.changed(family="canonical").for_world(TASK.world)
    tensors = initial_actor(network, np.random.default_rng(0))
    snapshot = PolicySnapshot(0, network.architecture, TASK.world.digest, tensors)
    with pytest.raises(ConfigError, match="canonical"):
        Insight(snapshot)


def test_weights_that_do_not_fit_their_description_are_rejected():
    """They may come by topic from anybody."""
    name, tensor = next(iter(SNAPSHOT.tensors.items()))
    fewer = {n: t for n, t in SNAPSHOT.tensors.items() if n != name}
    for tensors in (fewer, {**fewer, name: tensor[:-1]}):
        with pytest.raises(ConfigError, match=name):
            Insight(replace(SNAPSHOT, tensors=tensors))


def test_a_moment_without_explanation_says_why():
    said = "the agent's weights are not known here"
    assert explained(None, OBSERVATION, "NEAR(HAND, RED)", VOCABULARY)[1] == said
    other = design_named("2-L").vocabulary
    found, why = explained(Insight(SNAPSHOT), OBSERVATION, "NEAR(HAND, GREEN)", other)
    assert found is None and "unknown word" in why


def test_a_comparison_has_a_row_with_what_it_chooses():
    found, _ = explained(Insight(SNAPSHOT), OBSERVATION, "NEAR(HAND, LEFTMOST(RED))", VOCABULARY)
    assert found is not None
    comparison, among = found.tree
    assert (comparison.text, comparison.depth) == ("LEFTMOST", 0)
    assert (among.text, among.depth) == ("RED", 1)
    chosen = comparison.degrees > 0.5
    assert chosen.sum() == 1 < (among.degrees > 0.5).sum()
    assert comparison.degrees[chosen] == among.degrees[chosen]


@pytest.mark.parametrize("text", ["", "NEAR(HAND, RED)"])
def test_tables_have_a_row_for_each_word_and_node(text):
    arena = describe(preset_named("fast"), design_named("3-D"), 2, (), "arena")
    found, why = explained(Insight(SNAPSHOT), OBSERVATION, text, VOCABULARY)
    assert found is not None and found.phi.shape == (len(VOCABULARY.words), 5)
    moment = Moment(arena, at(text), -1.0, found, why)
    names = ["one", "two", "<b>", "four"]
    shown = markup.words_by_objects(moment, names)
    assert shown.count("<tr>") == 1 + len(VOCABULARY.words) + bool(text) and "<b>" not in shown
    why = markup.tree(moment, names)
    assert ("no program is in force" in why) == (not text)
    assert ("most relevant: " in why) == bool(text)
    limit = ": 0.50 m, at most 0.20 m is wanted" if text else ""
    assert f"not yet{limit}<" in markup.state(moment)


def test_a_goal_over_time_is_explained_by_the_program_that_is_pursued():
    text = "THEN(NEAR(HAND, RED), NEAR(HAND, AND(BLUE, CUBE)))"
    arena = describe(preset_named("fast"), design_named("3-D"), 2, (), "arena")
    found, why = explained(Insight(SNAPSHOT), OBSERVATION, text, VOCABULARY, 1)
    assert found is not None and [node.text for node in found.tree] == ["AND", "BLUE", "CUBE"]
    moment = Moment(arena, at(text, stage=1), -1.0, found, why)
    shown = markup.state(moment)
    assert "stage 2 of 2" in shown and "at most 0.20 m is wanted" in shown
    assert "THEN" in markup.reading(text, read)
    assert markup.completions("TH", VOCABULARY) == ("THEN(",)


@pytest.mark.parametrize(
    ("parameters", "logic"),
    [
        ({"learning": True, "logic": "min_max"}, PRODUCT),
        ({"learning": False, "logic": "min_max"}, MIN_MAX),
    ],
)
def test_an_agents_logic_follows_from_its_provenance(parameters, logic):
    assert agent_logic(parameters) == logic


def weights_of(agent: str, **parameters: str) -> tuple[AgentWeights, dict[str, Any]]:
    """The weights of an agent that described itself, and what hears its topics, by name."""
    callbacks: dict[str, Any] = {}
    node, namespace = Mock(), agent.rpartition("/")[0]
    node.create_subscription = lambda _, name, heard, *__, **___: callbacks.update({name: heard})
    weights = AgentWeights(node, namespace.strip("/"), Refusals(print))
    origin = Origin(agent, "a", "1", "{}", 0, {"weights": "topic", "checkpoint": "", **parameters})
    callbacks[f"{namespace}/{PROVENANCE.name}"](encode_provenance(origin))
    weights.refresh()
    return weights, callbacks


def test_the_newest_weights_of_a_learner_are_shown_and_the_first_of_another() -> None:
    weights, callbacks = weights_of("/agent_node")

    def receive(policy: PublishedPolicy) -> Any:
        callbacks[f"/{POLICY_WEIGHTS.name}"](encode_weights(policy))
        return weights.insight

    newest = receive(published(3000))
    assert newest is not None and receive(published(2999)) is newest
    other = again(LEARNER, 0)
    first = receive(published(0, learner=other))
    assert first is not newest and receive(published(0, learner=other)) is first
    assert receive(published(1, learner=other)) is not first


def test_the_weights_of_a_fleets_agent_come_from_its_learners_namespace() -> None:
    weights, callbacks = weights_of("/arena1/agent_node", learner="/")
    callbacks[f"/{POLICY_WEIGHTS.name}"](encode_weights(published(3)))
    assert weights.insight is not None


def test_html_is_shown_as_text():
    history = History()
    history.add("id", HTML)
    history.add_status(ProgramStatus("id", HTML, True))
    for shown in (history.html(), markup.reading(HTML, read), markup.quiet(HTML)):
        assert "<img" not in shown
    assert "&lt;img" in history.html()


def test_the_caret_is_under_the_wrong_word():
    shown = markup.reading("NEAR(HAND, AND(RDE, CUBE))", read)
    text, caret = shown.rpartition("<pre")[2].partition(">")[2].splitlines()
    assert text.index("RDE") == caret.index("^") and "did you mean RED?" in shown


def test_words_are_completed():
    text = "NEAR(HAND, AND(RED, CY"
    assert markup.completions(text, VOCABULARY) == ("CYLINDER",)
    assert markup.completed(text, "CYLINDER") == "NEAR(HAND, AND(RED, CYLINDER"
    assert set(markup.completions("C", VOCABULARY)) == {"CUBE", "CYLINDER"}
    assert not markup.completions("NEAR(HAND, ", VOCABULARY)


def taken(step: int, satisfied: bool) -> Step:
    return judged(step, satisfied, step * 10**8, program_id="id")


def test_a_program_is_followed_until_it_is_satisfied():
    history = History()
    history.add("other", "NEAR(HAND, BLUE)", note="unknown word")
    history.add("id", "NEAR(HAND, RED)")
    assert "not answered yet" in history.html() and not history.pending
    history.add_status(ProgramStatus("id", "/sim_node", True))
    history.add_status(ProgramStatus("other", "/agent_node", True))
    assert "accepted by /sim_node" in history.html() and history.pending
    history.observe([taken(step, step >= 15) for step in range(40)])
    assert "satisfied after 1.5 s" in history.html() and not history.pending
    assert "rejected: unknown word" in history.html()


def test_an_agents_older_answer_does_not_end_a_program():
    history = History()
    history.add("id", "NEAR(HAND, RED)")
    history.add_status(ProgramStatus("id", "/agent_node", True, stamp_ns=0))
    history.observe([judged(1, False, 10**8, program_id="before")])
    history.add_status(ProgramStatus("id", "/sim_node", True, stamp_ns=2 * 10**8))
    history.observe([taken(step, step >= 5) for step in range(3, 30)])
    assert "satisfied after" in history.html()


def test_a_program_that_is_replaced_before_its_first_step_is_over():
    history = History()
    history.add("early", "NEAR(HAND, RED)")
    history.add_status(ProgramStatus("early", "/agent_node", True, stamp_ns=0))  # may be older
    history.add_status(ProgramStatus("early", "/sim_node", True, stamp_ns=1))
    history.observe([taken(step, False) for step in range(3)])
    assert "another program" in history.html() and not history.pending
