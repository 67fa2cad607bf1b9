"""`import pa_ros`: an agent executes programs in a few lines of Python."""

import pydoc
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import pa_ros
from pa_ros.acting.errors import ActingError
from pa_ros.arena import ArenaError
from pa_ros.core.errors import ConfigError, PaError
from pa_ros.language import ProgramError


def test_importing_loads_no_heavy_library() -> None:
    code = "import sys, pa_ros; print({'numpy', 'mujoco', 'torch', 'rclpy'} & {*sys.modules})"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "set()"


def test_programs_continue_from_where_the_arm_is() -> None:
    arena, agent = pa_ros.make_arena(seed=2), pa_ros.load()
    assert arena.objects == ("RED CUBE", "GREEN CUBE", "RED SPHERE", "GREEN CYLINDER")
    for program in ("NEAR(HAND, SPHERE)", "NEAR(HAND, AND(GREEN, NOT(CUBE)))"):
        result = arena.execute(agent, program)
        assert result.success and result.distance <= 0.2 and result.program == program
    again = arena.execute(agent, program)
    assert again.reached_s == 0.0  # already there
    arena.reset()
    assert not arena.execute(agent, program, max_steps=1).success
    assert arena.picture(64).shape == (64, 64, 3)


def test_a_violated_goal_is_over_with_its_reason() -> None:
    arena, agent = pa_ros.make_arena(seed=2), pa_ros.load()
    arena.execute(agent, "NEAR(HAND, SPHERE)")
    result = arena.execute(agent, "THEN(NEAR(HAND, SPHERE), AVOID(SPHERE, NEAR(HAND, CYLINDER)))")
    assert (result.success, result.code) == (False, "goal.violated")


def test_training_says_how_far_it_is(tmp_path: Path, monkeypatch: Any, capsys: Any) -> None:
    monkeypatch.setattr("pa_ros.cli.training_view.LINE_PERIOD_S", 0.0)
    pa_ros.train(out=tmp_path / "a", frames=200)
    lines = capsys.readouterr().out.splitlines()
    assert [line.partition("  ")[0] for line in lines] == ["100 of 200 frames", "200 of 200 frames"]
    told: list[tuple[int, float]] = []
    pa_ros.train(out=tmp_path / "b", frames=200, progress=lambda *one: told.append(one))
    assert capsys.readouterr().out == ""
    assert [frames for frames, _ in told] == [100, 200] and all(-1 <= r <= 1 for _, r in told)


def test_what_cannot_be_executed_is_rejected() -> None:
    arena, agent = pa_ros.make_arena(seed=2), pa_ros.load()
    with pytest.raises(ProgramError, match="did you mean CUBE"):
        arena.execute(agent, "NEAR(HAND, CUBBE)")
    with pytest.raises(ProgramError, match="no such object"):
        arena.execute(agent, "NEAR(HAND, BLUE)")
    with pytest.raises(ConfigError, match="unknown design"):
        pa_ros.make_arena("4-D")
    with pytest.raises(ActingError, match="features"):
        pa_ros.make_arena(arm="panda").execute(agent, "NEAR(HAND, CUBE)")


def test_one_steps_an_arena_with_an_agent_in_the_loop() -> None:
    arena, agent = pa_ros.make_arena(seed=2), pa_ros.load("3-D")
    observation = arena.begin(program := "NEAR(HAND, SPHERE)")
    first, steps = arena.verdict.distance, 0
    while not arena.verdict.satisfied and steps < 60:
        observation, steps = arena.step(agent.act(observation, program)), steps + 1
    assert arena.verdict.satisfied and arena.verdict.distance < 0.2 < first
    with pytest.raises(ArenaError, match="finite"):
        arena.step([float("nan")] * 6)


def test_an_agent_explains_what_a_program_means_to_it() -> None:
    arena, agent = pa_ros.make_arena(seed=2), pa_ros.load()
    found = agent.explain(arena.observation, "NEAR(HAND, AND(RED, CUBE))")
    p = dict(zip(found.objects, found.p, strict=True))
    assert p["RED CUBE"] > 0.8 > 0.2 > p["GREEN CUBE"]


def test_an_agent_is_trained_and_scored_on_programs_of_ones_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fast: dict[str, Any] = {"learner.replay.warmup_frames": 50, "network.hidden": 8}
    mine = pa_ros.train(out=tmp_path / "run", frames=100, seed=1, **fast)
    assert mine.design.name == "2-L" and (tmp_path / "run/progress.csv").is_file()
    with pytest.raises(PaError, match="resume"):
        pa_ros.train(out=tmp_path / "run", frames=100)
    programs = ["NEAR(HAND, AND(RED, SPHERE))", "NEAR(HAND, NOT(CUBE))"]
    rows = pa_ros.evaluate(pa_ros.load("2-L"), programs, episodes=2)
    assert [(row.program, row.episodes) for row in rows] == [(one, 2) for one in programs]
    assert rows[0].success_rate == 1.0
    monkeypatch.setattr("pa_ros.evaluation.evaluate.SCENES_SEARCHED", 5)
    with pytest.raises(ConfigError, match=r"expected 1 scenes in which NEAR\(HAND, A\) can hold"):
        pa_ros.evaluate(pa_ros.load("3-D"), ["NEAR(HAND, A)"], episodes=1)


def test_one_program_is_scored_and_no_episodes_are_rejected() -> None:
    agent = pa_ros.load("2-L")
    (row,) = pa_ros.evaluate(agent, "NEAR(HAND, RED)", episodes=1)  # type: ignore[arg-type]
    assert row.program == "NEAR(HAND, RED)"
    with pytest.raises(ConfigError, match="expected at least one episode, got 0"):
        pa_ros.evaluate(agent, ["NEAR(HAND, RED)"], episodes=0)


def test_an_unknown_agent_is_rejected_with_the_known_ones() -> None:
    with pytest.raises(PaError, match="2-L.*3-D"):
        pa_ros.load("4-D")


def test_help_shows_the_functions_and_the_example() -> None:
    shown = pydoc.plain(pydoc.render_doc(pa_ros))
    for name in ("make_arena(", "load(", "train(", "evaluate(", "execute(", "class Arm("):
        assert name in shown
    for line in pa_ros.__doc__.splitlines():
        assert line in shown
