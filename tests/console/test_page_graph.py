"""The page in a real browser, beside real nodes."""

import re
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from console.conftest import SCREENSHOTS

from helpers.processes import node_command, pa_ros, running
from helpers.recordings import train
from helpers.waiting import DEADLINE_S
from pa_ros.ros.environment import ros_arguments

pytestmark = [pytest.mark.graph, pytest.mark.browser, pytest.mark.timeout(900)]
MS = 1000 * DEADLINE_S
LONG = "NEAR(HAND, OR(AND(RED, CUBE), AND(GREEN, CUBE), SPHERE))"


@contextmanager
def console(*arguments: str | Path) -> Iterator[tuple[str, str]]:
    """`pa_ros console` as a process: the address for sending, and the one for viewing."""
    process = pa_ros("console", "--port", "0", "--light", "plain", *arguments)
    try:
        found = re.search(r"console: (\S+)", process.stdout.readline())
        assert found, process.stderr.read()
        yield found[1], found[1].partition("?")[0]
    finally:
        process.send_signal(signal.SIGINT)
        output, error = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 0 and "Traceback" not in error, error


OTHER = ros_arguments(
    {"mode": "real_time", "program_source": "topic", "seed": 5}, namespace="/other"
)


@contextmanager
def graph(folder: Path) -> Iterator[None]:
    """Arena and agent of `pa_ros launch`, which start while the browser does."""
    process = pa_ros("launch", "--out", folder / "launch")
    try:
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
    """Type the end as people do: viser drops a text that is put in at once just after a message."""
    field = page.locator("form input").first
    field.fill(program[:-2])
    field.press_sequentially(program[-2:], delay=100)


def step_of(page) -> int:
    return int(re.search(r"step (\d+)", table(page, "State").inner_text())[1])


def press(page, name):
    page.get_by_role("button", name=name, exact=True).click()


def test_a_running_graph_is_shown_and_controlled(tmp_path, new_page):
    with graph(tmp_path), console() as (address, viewing):
        page = opened(new_page(), address)
        table(page, "State").filter(has_text="step ").wait_for()
        a_program_is_typed_and_followed(page)
        other = opened(new_page(), viewing)
        table(other, "State").filter(has_text="NEAR(HAND, AND(RED, CUBE))").wait_for()
        other.get_by_text("This page is for viewing").wait_for()
        assert other.locator("form").count() == 0
        other.close()
        the_arena_is_paused_stepped_and_reset(page)
        a_block_is_moved(page)
        with running(tmp_path, node_command("sim_node", *OTHER)):  # without an agent
            another_arena_is_chosen(page)
        shot(page, "console")


def a_program_is_typed_and_followed(page):
    text = page.locator("form input").first
    enter(page, "NEAR(HAND, AND(RDE, CUBE))")
    where = table(page, "Where").filter(has_text="AND(RDE, CUBE))")
    where.wait_for()
    typed, caret = where.inner_text().splitlines()
    assert typed.index("RDE") == caret.index("^")
    text.press("Enter")
    table(page, "History").filter(has_text="rejected: column 16").wait_for()
    enter(page, f"THEN(NEAR(HAND, LEFTMOST(GREEN)), AVOID(RED, {LONG}))")
    table(page, "Rejected").filter(has_text="nothing can be avoided").wait_for()
    enter(page, f"THEN(NEAR(HAND, LEFTMOST(GREEN)), THEN({LONG}, {LONG}))")
    text.press("Enter")
    reached = re.compile(r"^\s*THEN.*satisfied after")
    table(page, "History").filter(has_text=reached).wait_for()
    history = table(page, "History").bounding_box()
    assert history["width"] < 400 and history["height"] < 250
    enter(page, "NEAR(HAND, AND(RED, CUBE))")  # held out in 3-D
    table(page, "A program").filter(has_text="AND(RED, CUBE)").wait_for()
    text.press("Enter")
    reached = re.compile(r"^\s*NEAR\(HAND, AND\(RED, CUBE\)\)\s*satisfied after")
    table(page, "History").filter(has_text=reached).wait_for()
    assert "most relevant: RED CUBE" in page.get_by_text("most relevant").inner_text()
    shot(page, "console-satisfied")


def the_arena_is_paused_stepped_and_reset(page):
    press(page, "Pause")
    page.get_by_text("pause: done").wait_for()
    table(page, "State").filter(has_text=re.compile(r" s, paused\b")).wait_for()
    table(page, "Alarms").filter(has_text=re.compile(r"alarms\s*none")).wait_for()
    time.sleep(1.0)  # until the last step is drawn
    paused_at = step_of(page)
    press(page, "Step")
    table(page, "State").filter(has_text=f"step {paused_at + 1},").wait_for()
    press(page, "Resume")
    page.get_by_text("resume: done").wait_for()
    press(page, "Next scene")
    table(page, "State").filter(has_text="episode 1,").wait_for()


def a_block_is_moved(page):
    page.get_by_text("Move a block").click()
    page.get_by_label("Block", exact=True).click()
    page.get_by_role("option").filter(has_text="1: ").click()
    press(page, "Put it there")
    page.get_by_text(re.compile("move [A-Z ]+: done")).wait_for()


def another_arena_is_chosen(page):
    """Programs go to the chosen arena only."""

    def choose(namespace):
        page.get_by_label("Which", exact=True).click()
        page.get_by_role("option", name=namespace, exact=True).click()

    state, history = table(page, "State"), table(page, "History")
    choose("/other")
    state.filter(has_text="none in force").wait_for()
    enter(page, "NEAR(HAND, NOT(RED))")
    table(page, "A program").filter(has_text="NOT(RED)").wait_for()
    page.locator("form input").first.press("Enter")
    history.filter(has_text="accepted by /other/sim_node").wait_for()
    state.filter(has_text="NEAR(HAND, NOT(RED))").wait_for()
    choose("/")
    state.filter(has_text="episode 1,").wait_for()


def test_a_recording_is_scrubbed(tmp_path, new_page):
    assert train(tmp_path / "run", "--record", tmp_path / "bag", frames=200) == 0
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
