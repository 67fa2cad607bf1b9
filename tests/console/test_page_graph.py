"""The page in a real browser, beside real nodes."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from console.conftest import SCREENSHOTS

from helpers.recordings import pa_ros, train
from helpers.waiting import DEADLINE_S
from pa_ros.ros.environment import ros_arguments

pytestmark = [pytest.mark.graph, pytest.mark.browser, pytest.mark.timeout(900)]
MS = 1000 * DEADLINE_S


@contextmanager
def console(*arguments: str | Path) -> Iterator[tuple[str, str]]:
    """`pa_ros console` as a process: the address of who may send, and that of who may look."""
    process = pa_ros("console", "--port", "0", "--light", "plain", *arguments)
    try:
        found = re.search(r"console: (\S+)", process.stdout.readline())
        assert found, process.stderr.read()
        yield found[1], found[1].partition("?")[0]
    finally:
        process.send_signal(signal.SIGINT)
        output, error = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 0 and "Traceback" not in error, error


@contextmanager
def another_arena() -> Iterator[None]:
    """One without an agent, in a namespace of its own."""
    given = ros_arguments(
        {"mode": "real_time", "program_source": "topic", "seed": 5}, namespace="/other"
    )
    command = [sys.executable, "-m", "sim_node.main", *given, "--log-level", "error"]
    with subprocess.Popen(command) as process:
        try:
            yield
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(timeout=DEADLINE_S)


@contextmanager
def graph(folder: Path) -> Iterator[None]:
    """Arena and agent of `pa_ros launch`."""
    process = pa_ros("launch", "--out", folder / "launch")
    try:
        assert "started" in process.stdout.readline()
        yield
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 0


def opened(page, address):
    page.set_default_timeout(MS)
    page.goto(address)
    page.get_by_text("pa_ros console").first.wait_for()
    return page


def table(page, name):
    return page.get_by_label(name, exact=True)


def shot(page, name):
    """Kept for people to look at."""
    SCREENSHOTS.mkdir(parents=True, exist_ok=True)
    for closing in page.locator(".mantine-Notification-closeButton").all():  # software GL, it says
        closing.click(timeout=MS)
    page.screenshot(path=SCREENSHOTS / f"{name}.png", timeout=MS)


def enter(page, program):
    """Typed as people do: viser's form sends one change in 50 ms, and of a text that is put in all
    at once in that time after another message it sends nothing."""
    field = page.locator("form input").first
    field.fill("")
    field.press_sequentially(program)


def step_of(page) -> int:
    return int(re.search(r"step (\d+)", table(page, "State").inner_text())[1])


def test_a_program_is_typed_and_followed(tmp_path, new_page):
    with graph(tmp_path), console() as (address, watching):
        page = opened(new_page(), address)
        table(page, "State").wait_for()
        text = page.locator("form input").first
        enter(page, "NEAR(HAND, AND(RDE, CUBE))")
        where = table(page, "Where").filter(has_text="AND(RDE, CUBE))")
        where.wait_for()
        typed, caret = where.inner_text().splitlines()
        assert typed.index("RDE") == caret.index("^")
        text.press("Enter")
        table(page, "History").filter(has_text="refused: column 16").wait_for()
        shot(page, "console-refused")

        enter(page, "NEAR(HAND, NOT(<b>RED</b>))")  # HTML is text
        table(page, "Refused").filter(has_text="unexpected character").wait_for()
        enter(page, "NEAR(HAND, AND(RED, CUBE))")  # held out in 3-D
        table(page, "A program").filter(has_text="AND(RED, CUBE)").wait_for()
        text.press("Enter")
        table(page, "History").filter(has_text="satisfied after").first.wait_for()
        assert "most relevant: RED CUBE" in page.get_by_text("most relevant").inner_text()
        shot(page, "console-satisfied")

        other = opened(new_page(), watching)  # may look, not send
        table(other, "State").filter(has_text="NEAR(HAND, AND(RED, CUBE))").wait_for()
        table(other, "History").filter(has_text="satisfied after").first.wait_for()
        other.get_by_text("This page may look").wait_for()
        assert other.locator("form").count() == 0
        other.close()

        page.get_by_role("button", name="Pause").click()
        page.get_by_text("pause: done").wait_for()
        time.sleep(1.0)  # what was under way
        stands = step_of(page)
        time.sleep(1.0)
        assert step_of(page) == stands
        page.get_by_role("button", name="Step", exact=True).click()
        table(page, "State").filter(has_text=f"step {stands + 1},").wait_for()
        page.get_by_role("button", name="Go on").click()
        page.get_by_role("button", name="Next scene").click()
        table(page, "State").filter(has_text="episode 1,").wait_for()
        moved_by_hand(page)
        with another_arena():
            chosen_among_arenas(page)


def moved_by_hand(page):
    """A block is chosen and put elsewhere, and the arena says that it is there."""
    page.get_by_text("Move a block").click()
    chosen = page.get_by_label("Block", exact=True)
    chosen.click()
    page.get_by_role("option").filter(has_text="1: ").click()
    page.get_by_role("button", name="Put it there").click()
    page.get_by_text(re.compile("move [a-z_]+: done")).wait_for()
    shot(page, "console-moved")


def chosen_among_arenas(page):
    """The page turns to the other arena, programs go there alone, and back."""

    def choose(namespace):
        page.get_by_label("Which", exact=True).click()
        page.get_by_role("option", name=namespace, exact=True).click()

    state, history = table(page, "State"), table(page, "History")
    choose("/other")
    state.filter(has_text="none in force").wait_for()
    enter(page, "NEAR(HAND, OR(RED, NOT(RED)))")
    table(page, "A program").filter(has_text="OR(RED, NOT(RED))").wait_for()
    page.locator("form input").first.press("Enter")
    history.filter(has_text="accepted by /other/sim_node").wait_for()
    state.filter(has_text="NEAR(HAND, OR(RED, NOT(RED)))").wait_for()
    shot(page, "console-other")
    choose("/")
    state.filter(has_text="episode 1,").wait_for()


def test_a_recording_is_scrubbed(tmp_path, new_page):
    assert train(tmp_path / "run", "--record", tmp_path / "bag") == 0
    with console("--bag", tmp_path / "bag") as (address, _):
        page = opened(new_page(), address)
        state = table(page, "State")
        state.filter(has_text="step 0,").wait_for()
        sliders = page.locator("[role=slider]")
        sliders.nth(1).press("ArrowRight")
        state.filter(has_text="step 1,").wait_for()
        sliders.nth(0).press("ArrowRight")
        state.filter(has_text="episode 1, step 0,").wait_for()
        page.get_by_text("most relevant").wait_for()
        shot(page, "console-bag")
