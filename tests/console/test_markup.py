"""Texts from outside stay texts, and say where they are wrong."""

from __future__ import annotations

from pa_ros.arena import design_named
from pa_ros.console import markup
from pa_ros.console.history import History
from pa_ros.core.experience import Verdict
from pa_ros.wire.program import ProgramStatus

VOCABULARY = design_named("3-D").vocabulary
HTML = "<img src=x onerror=alert(1)>"


def test_html_is_shown_as_text():
    history = History()
    history.add("id", HTML)
    history.judge(ProgramStatus("id", HTML, True))
    for shown in (history.html(), markup.reading(HTML, VOCABULARY), markup.quiet(HTML)):
        assert "<img" not in shown
    assert "&lt;img" in history.html()


def test_a_megabyte_is_refused_in_a_line():
    shown = markup.reading("A" * 1_000_000, VOCABULARY)
    assert "program too long" in shown and len(shown) < 2000


def test_the_caret_stands_under_the_word():
    shown = markup.reading("NEAR(HAND, AND(RDE, CUBE))", VOCABULARY)
    text, caret = shown.rpartition("<pre")[2].partition(">")[2].splitlines()
    assert text.index("RDE") == caret.index("^") and "did you mean RED?" in shown


def test_words_are_completed():
    text = "NEAR(HAND, AND(RED, CY"
    assert markup.completions(text, VOCABULARY) == ("CYLINDER",)
    assert markup.completed(text, "CYLINDER") == "NEAR(HAND, AND(RED, CYLINDER"
    assert set(markup.completions("C", VOCABULARY)) == {"CUBE", "CYLINDER"}
    assert not markup.completions("NEAR(HAND, ", VOCABULARY)


def verdict(step: int, satisfied: bool) -> Verdict:
    return Verdict(0, step, step * 10**8, "id", 1.0, satisfied, 0.1 if satisfied else 1.0, False)


def test_a_program_is_followed_until_it_is_satisfied():
    history = History()
    history.add("other", "NEAR(HAND, BLUE)", note="no such thing")
    history.add("id", "NEAR(HAND, RED)")
    assert "nobody has answered" in history.html() and not history.pending
    history.judge(ProgramStatus("id", "/sim_node", True))
    assert "accepted by /sim_node" in history.html() and history.pending
    history.observe([verdict(step, step >= 15) for step in range(40)])
    assert "satisfied after 1.5 s" in history.html() and not history.pending
    assert "refused: no such thing" in history.html()


def test_a_refusal_is_the_last_word():
    history = History()
    history.add("id", "NEAR(HAND, GREEN)")
    history.judge(ProgramStatus("id", "/agent_node", True))
    history.judge(ProgramStatus("id", "/sim_node", False, code="x", reason="none is\nthere"))
    assert "refused: none is<" in history.html() and not history.pending
