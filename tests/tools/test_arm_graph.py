"""`pa_ros.Arm`, the client of a graph: scenes, programs, feedback, cancelling, what errors say.

The tests share one graph, which `Arm.simulated` starts.
"""

import re
import subprocess
import sys
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from textwrap import indent
from unittest.mock import Mock

import numpy as np
import pytest

import pa_ros
from helpers.processes import processes_of
from helpers.rejections import rejected
from helpers.waiting import wait_for
from pa_ros import Arm
from pa_ros.core.errors import PaError
from pa_ros.language import ProgramError
from pa_ros.tools.arm import GoalHandle
from pa_ros.tools.client import NoAnswerError
from pa_ros.wire.program import GoalResult, ProgramGoal, encode_goal_result

pytestmark = pytest.mark.graph
REACHABLE = "NEAR(HAND, AND(RED, CUBE))"


@pytest.fixture(scope="module")
def arm(module_domain: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Arm]:
    logs = tmp_path_factory.mktemp("arm")
    domain, bag = int(module_domain), logs / "bag"
    with Arm.simulated(speed=5.0, domain=domain, logs=str(logs), record=str(bag)) as arm:
        assert processes_of(logs)
        yield arm
    assert not processes_of(logs) and (bag / "metadata.yaml").is_file()


def test_the_example_of_the_readme_and_of_help_succeeds(arm: Arm, capsys) -> None:
    readme = (Path(__file__).parents[2] / "README.md").read_text()
    example = readme.partition("```python\n")[2].partition("```")[0]
    assert indent(example, "    ") in (pa_ros.__doc__ or "")
    # It joins the graph of these tests, as its comment says, instead of starting one.
    exec(example.replace("Arm.simulated()", "Arm()", 1), {})
    assert capsys.readouterr().out.splitlines()[-1].startswith("True 0.")


def test_the_programs_that_the_readme_sends_name_something_in_the_scene_of_a_launch(arm: Arm):
    readme = (Path(__file__).parents[2] / "README.md").read_text()
    programs = re.findall('pa_ros send "(.*)"', readme)
    assert len(programs) > 1 and [arm.check(program) for program in programs] == programs


def test_the_page_on_python_shows_what_happens(arm: Arm, capsys) -> None:
    page = (Path(__file__).parents[2] / "docs/starting.md").read_text()
    example = page.partition("<!-- test: arm -->\n```python\n")[2].partition("```")[0]
    exec(example.replace('Arm.simulated("3-D", speed=2.0)', "Arm()", 1), {})
    shown = capsys.readouterr().out
    assert "did you mean RED?" in shown and "RED CUBE" in shown and shown.endswith("True\n")
    arm.reset(0)


def test_a_second_arm_joins_sees_the_table_and_executes(arm: Arm, capsys) -> None:
    with Arm() as other:
        print(other.scene())
        result = other.execute(REACHABLE, timeout=30)
    shown = capsys.readouterr().out
    assert "blocks: RED CUBE, GREEN CUBE, RED SPHERE, GREEN CYLINDER\n" in shown
    assert f"\n  {REACHABLE}\n" in shown
    assert result.success and result.distance < 0.2 and 0 < result.reached_s < 30
    assert arm.scene().picture(64).shape == (64, 64, 3)
    wait_for(lambda: arm.scene().satisfied)
    assert arm.scene().program == REACHABLE


def test_feedback_is_an_iterator_and_cancelling_is_a_result(arm: Arm) -> None:
    goal = arm.start("NEAR(HAND, AND(GREEN, CUBE))", timeout=0, hold=10_000)
    progress = next(one for one in goal if one.relevance)
    meant = dict(zip(progress.objects, progress.relevance, strict=True))
    assert meant["GREEN CUBE"] > 0.8 and meant["RED SPHERE"] < 0.2 and not goal.done
    arm.cancel()
    result = goal.result()
    assert (result.success, result.code) == (False, "goal.cancelled")
    assert list(goal) == [] and goal.done


def test_an_exception_while_it_waits_cancels_the_goal(arm: Arm) -> None:
    def interrupt(_progress) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        arm.execute("NEAR(HAND, SPHERE)", timeout=0, hold=10_000, progress=interrupt)
    assert arm.goal is not None and arm.goal.result().code == "goal.cancelled"


def test_a_forgotten_arm_ends_once_its_goals_are_forgotten(tmp_path: Path) -> None:
    """As where a notebook's cell runs again."""
    goal = Arm.simulated(logs=tmp_path, speed=5.0).start(REACHABLE, timeout=50)
    assert goal.result().success and processes_of(tmp_path)
    arm = Arm.simulated(logs=tmp_path / "again")
    other = arm.start("NEAR(HAND, SPHERE)", timeout=0, hold=10_000)
    del goal, arm, other
    wait_for(lambda: not processes_of(tmp_path), "the arenas' end")


def test_too_little_time_is_a_result(arm: Arm) -> None:
    arm.execute(REACHABLE)
    result = arm.execute("NEAR(HAND, AND(GREEN, CYLINDER))", timeout=1, hold=0.9)
    assert not result.success and result.code == "goal.time_limit" and "(1 s)" in result.reason


def test_a_wrong_program_is_an_error_with_its_place(arm: Arm) -> None:
    assert arm.check(" NEAR( HAND,RED )") == "NEAR(HAND, RED)"
    for ask in (arm.check, arm.execute, arm.start):
        with pytest.raises(ProgramError, match=r"did you mean RED\?\n.*\n +\^~~"):
            ask("NEAR(HAND, RAD)")
    for ask in (arm.check, arm.execute):
        with rejected("program.names_nothing", match=r"no such object[^\n]*\n.*\n +\^~~"):
            ask("NEAR(HAND, BLUE)")


def test_a_program_that_this_agent_never_learned_is_no_program_to_check(arm: Arm) -> None:
    avoiding = "AVOID(AND(GREEN, CUBE), NEAR(HAND, AND(RED, CUBE)))"
    for text in (avoiding, f"THEN(NEAR(HAND, SPHERE), {avoiding})"):
        with rejected("program.avoids", match="for these networks"):
            arm.check(text)
    assert "AVOID" not in arm.check("THEN(NEAR(HAND, SPHERE), NEAR(HAND, CUBE))")


def test_phi_and_p_of_the_scene_are_explained(arm: Arm) -> None:
    found = arm.explain("NEAR(HAND, AND(RED, CUBE))")
    p = dict(zip(found.objects, found.p, strict=True))
    assert p["RED CUBE"] > 0.8 and p["GREEN CUBE"] < 0.2
    assert found.phi[found.words.index("RED"), found.objects.index("RED SPHERE")] > 0.8
    header, *rows = str(found).splitlines()
    assert header.split() == [*found.words, "p"] and rows[1].startswith("RED CUBE ")
    assert len(arm.explain().p) == 0


def test_a_scene_is_chosen_and_a_paused_arena_is_an_error_that_says_so(arm: Arm, monkeypatch):
    assert arm.reset(7).episode == 7
    assert arm.reset(0).blocks == ("RED CUBE", "GREEN CUBE", "RED SPHERE", "GREEN CYLINDER")
    arm.pause()
    monkeypatch.setattr(arm.graph, "patience", 2.0)
    with pytest.raises(NoAnswerError, match="time stands still: /sim_node: paused"):
        arm.execute(REACHABLE)
    arm.resume()
    assert arm.execute(REACHABLE, timeout=50).success


def test_without_an_arena_the_error_says_what_to_do() -> None:
    with pytest.raises(NoAnswerError, match=r"no arena within 0\.2 s.*pa_ros launch"):
        Arm("nowhere", patience=0.2)


def test_without_an_agent_the_error_says_what_to_do(arm: Arm, monkeypatch) -> None:
    monkeypatch.setattr(arm.graph, "patience", 0.2)
    monkeypatch.setattr(arm.graph, "goals", Mock(server_is_ready=lambda: False))
    with pytest.raises(NoAnswerError, match="no agent that takes goals: start one"):
        arm.start(REACHABLE)


def test_a_node_that_cannot_start_is_an_error_with_its_log() -> None:
    with pytest.raises(PaError, match="ended by itself.*\n.*condition"):
        Arm.simulated(condition="no such")


@pytest.mark.parametrize("accepted", [False, True])
def test_an_agent_that_takes_no_goals_is_an_error_that_says_what_to_do(accepted: bool) -> None:
    """Rejected, or accepted and aborted without a word, as where it is cleaned up meanwhile."""
    nothing = type(encode_goal_result(GoalResult(True)))()
    with rejected("goal.rejected", match="ros2 lifecycle get"):
        ended_with(nothing, accepted).result()


def test_coming_near_what_is_to_be_avoided_is_a_result() -> None:
    violated = encode_goal_result(GoalResult(False, reason="it was near", code="goal.violated"))
    assert ended_with(violated).result().code == "goal.violated"


def ended_with(result: object, accepted: bool = True) -> GoalHandle:
    """A goal that an agent ended with this message."""
    ended = Mock(result=lambda: Mock(result=result))
    handle = Mock(accepted=accepted, get_result_async=lambda: ended)
    goals = Mock(send_goal_async=lambda *_, **__: Mock(result=lambda: handle))
    graph = Mock(goals=goals, patience=1.0, call=lambda act: act())
    return GoalHandle(graph, ProgramGoal(REACHABLE))


def test_an_arm_that_is_not_closed_ends_with_its_process(arm: Arm, tmp_path: Path) -> None:
    code = "from pa_ros import Arm; print(Arm().scene().blocks[0])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (run.returncode, run.stdout) == (0, "RED CUBE\n"), run.stderr
    # On a busy machine it says that it waits, and nothing else.
    assert all("waits for one" in line for line in run.stderr.splitlines()), run.stderr


def test_without_ros_the_error_says_what_to_do(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "rclpy", None)
    with pytest.raises(ImportError, match=r"expected ROS 2 \(rclpy\)"):
        pa_ros.__getattr__("Arm")
    assert "Arm" in dir(pa_ros)


def test_the_page_on_the_simulator_steps_the_agent_to_its_target(arm: Arm, capsys) -> None:
    page = (Path(__file__).parents[2] / "docs/graph.md").read_text()
    example = page.partition("<!-- test: steps -->\n```python\n")[2].partition("```")[0]
    arm.reset(0)
    exec(example.replace("Arm.simulated()", "Arm()", 1), {})
    shown = capsys.readouterr().out.splitlines()
    steps = [int(line.split(":")[0].removeprefix("step ")) for line in shown]
    assert [later - before for before, later in pairwise(steps)] == [5] * 9
    assert shown[-1].endswith("satisfied")


def test_blocks_are_moved_by_number_and_wrong_requests_say_why(arm: Arm) -> None:
    arm.reset(0)
    with pytest.raises(PaError, match="paused"):
        arm.step()
    with pytest.raises(PaError, match=r"expected one of \d blocks, got number 99"):
        arm.move(99, 0.0, 0.3)
    with pytest.raises(PaError, match="blocks, got number 'RED CUBE'"):
        arm.move("RED CUBE", 0.0, 0.3)  # type: ignore[arg-type]
    for number in (-1, 2**64, 0.5):
        with pytest.raises(PaError, match=f"expected the number of an episode, got {number}"):
            arm.reset(number)  # type: ignore[arg-type]
    with pytest.raises(PaError, match="real_time_factor"):
        arm.set_speed(-1.0)
    arm.set_speed(5.0)
    arm.pause()
    arm.move(0, 0.35, -0.3)
    arm.move(0, 0.45, -0.3)  # the same block, though no step shows yet that it moved
    with pytest.raises(PaError, match="every other block"):
        arm.move(1, 0.45, -0.3)
    hand, block, *_ = arm.step().step.observation.objects
    assert hand[:3] == pytest.approx(0.0) and np.linalg.norm(block[:3]) < 1.0
    arm.resume()
    arm.reset(0)
