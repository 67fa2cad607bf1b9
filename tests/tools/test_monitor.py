"""The table shows what the nodes report, and no row for what nobody reports."""

import io
from unittest.mock import Mock

import pytest

from helpers.waiting import Clock
from pa_ros.tools.monitor import LINE_PERIOD_S, STALE_S, Display, GraphFigures, watch_diagnostics
from pa_ros.wire.diagnostics import Health, encode_diagnostics


def filled(clock=None) -> GraphFigures:
    figures = GraphFigures(clock or Clock())
    sim = {"steps_per_s": "512.4", "real_time_factor": "2.46", "refused.wire.size": "2"}
    agent = {"refused.wire.size": "1", "policy_version": "7"}
    learner = {"mean_q": "-4.5", "updates_per_s": "junk", "frames": "33"}
    figures.take([
        Health("/sim_node", 0, "running", sim),
        Health("/a/agent_node", 2, "stuck", agent),
        Health("/learner_node", 0, "learning", learner),
    ])  # fmt: skip
    return figures


def test_rows_hold_the_newest_figures():
    figures = filled()
    rows = dict(figures.rows())
    assert rows["frames/s"] == "512"
    assert rows["weights version, agent"] == "7"
    assert rows["mean Q"] == "-4.5000"
    assert not {"updates/s", "critic loss"} & rows.keys(), "nobody reports them"
    assert rows["real-time factor"] == "2.5" and rows["frames"] == "33"
    assert rows["refused messages"] == "wire.size 3"
    assert rows["alarms"] == "/a/agent_node: stuck"
    figures.take([Health("/sim_node", 0, "running", {"steps_per_s": "7"})])
    assert dict(figures.rows())["frames/s"] == "7"


def test_several_arenas_have_a_row_each_and_combined_figures():
    figures = GraphFigures(Clock())
    one = {"steps_per_s": "80", "train.reward_per_step": "-1.0", "refused.wire.size": "1"}
    two = {"steps_per_s": "100", "train.reward_per_step": "-0.5"}
    figures.take([Health("/arena2/sim_node", 0, "", two), Health("/arena1/sim_node", 0, "", one)])
    versions = {"/arena1/agent_node": "9", "/arena2/agent_node": "7"}
    figures.take([Health(name, 0, "", {"policy_version": v}) for name, v in versions.items()])
    rows = dict(figures.rows())
    assert rows["frames/s"] == "180" and rows["reward/step, training"] == "-0.750"
    assert rows["weights version, agent"] == "7"  # the one that lags
    assert rows["/arena1"] == "frames/s 80  train -1.000  weights version 9"
    assert rows["/arena2"] == "frames/s 100  train -0.500  weights version 7"
    labels = [label for label, _ in figures.rows()]
    assert labels.index("/arena1") < labels.index("/arena2") < labels.index("refused messages")
    assert "/arena1" not in dict(filled().rows())


def test_silence_is_an_alarm():
    clock = Clock()
    figures = filled(clock)
    clock.now += STALE_S + 1
    assert "/sim_node: silent for 6 s" in dict(figures.rows())["alarms"]


def test_who_waits_for_a_paused_arena_gives_no_alarm():
    figures = GraphFigures(Clock())
    waiting = [Health(f"/{arena}/agent_node", 1, "waits") for arena in "ab"]
    pausing = [Health("/a/sim_node", 0, "", {"paused": "true"}), Health("/b/sim_node")]
    figures.take([*waiting, *pausing, Health("/a/learner_node", 2, "broken")])
    assert dict(figures.rows())["alarms"] == "/a/learner_node: broken; /b/agent_node: waits"


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize("stream", [io.StringIO(), Terminal()], ids=["file", "dumb"])
def test_a_stream_that_is_no_terminal_gets_a_plain_line_now_and_then(monkeypatch, stream):
    monkeypatch.setenv("TERM", "dumb")
    clock = Clock()
    monkeypatch.setattr("pa_ros.tools.monitor.time.monotonic", clock)
    figures = filled()
    with Display("title", figures.rows, figures.line, stream) as display:
        for _ in range(30):
            display.refresh()
            clock.now += LINE_PERIOD_S / 10
    lines = stream.getvalue().splitlines()
    assert len(lines) == 2
    assert lines[0].startswith("frames 33  frames/s 512") and "\x1b" not in stream.getvalue()


@pytest.mark.parametrize(
    ("said", "shown"),
    [("[/red] :warning: {x}", "[/red] :warning: {x}"), ("a\x1b[2Jb\rc\nd", r"a\x1b[2Jb\rc\nd")],
)
def test_the_table_on_a_terminal_shows_messages_unchanged_and_moves_no_cursor(
    monkeypatch, said, shown
):
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "200")
    stream, figures = Terminal(), filled()
    figures.take([Health("/a_stranger", 2, said, {})])
    with Display("title", figures.rows, figures.line, stream) as display:
        display.refresh()
    assert "title" in stream.getvalue() and "512" in stream.getvalue()
    assert shown in stream.getvalue() and "\x1b[2J" not in stream.getvalue()


@pytest.mark.parametrize("number", ["inf", "nan"])
def test_numbers_that_are_not_finite_are_ignored(number):
    figures = filled()
    values = {"mean_q": number, "refused.wire.size": number}
    figures.take([Health("/b/learner_node", 0, "", values)])
    rows = dict(figures.rows())
    assert rows["mean Q"] == "-4.5000"
    assert rows["refused messages"] == "wire.size 3"


def test_nodes_of_other_namespaces_are_left_out() -> None:
    node, figures, heard = Mock(), GraphFigures(), []
    node.get_namespace.return_value = "/left"
    node.create_subscription = lambda _, name, to, *_rest, **_how: heard.append(to)
    watch_diagnostics(node, figures)
    for where, frames in (("/left", "1000"), ("/right", "90000")):
        health = Health(f"{where}/learner_node", values={"frames": frames})
        heard[0](encode_diagnostics([health], 0))
    assert figures.value("learner_node", "frames") == 1000
