"""`import pa_ros`: an agent executes programs in a few lines of Python."""

import pydoc
import subprocess
import sys
from pathlib import Path
from textwrap import indent

import pytest

import pa_ros
from pa_ros.acting.errors import ActingError
from pa_ros.core.errors import ConfigError
from pa_ros.language import ProgramError

README = (Path(__file__).parents[1] / "README.md").read_text()


def test_importing_loads_no_heavy_library() -> None:
    code = "import sys, pa_ros; print({'numpy', 'mujoco', 'torch', 'rclpy'} & {*sys.modules})"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "set()"


def test_the_example_of_the_readme_and_the_docstring_succeeds(
    capsys: pytest.CaptureFixture[str],
) -> None:
    example = README.partition("```python\n")[2].partition("```")[0]
    assert indent(example, "    ") in (pa_ros.__doc__ or "")
    exec(example, {})
    assert capsys.readouterr().out.startswith("True 0.0")


def test_programs_continue_from_where_the_arm_is() -> None:
    arena, agent = pa_ros.make_arena(seed=2), pa_ros.load_agent()
    assert arena.objects == ("RED CUBE", "GREEN CUBE", "RED SPHERE", "GREEN CYLINDER")
    for program in ("NEAR(HAND, SPHERE)", "NEAR(HAND, AND(GREEN, NOT(CUBE)))"):
        result = arena.execute(agent, program)
        assert result.success and result.distance <= 0.2 and result.program == program
    again = arena.execute(agent, program)
    assert again.reached_s == 0.0  # already there
    arena.reset()
    assert not arena.execute(agent, program, max_steps=1).success
    assert arena.picture(64).shape == (64, 64, 3)


def test_what_cannot_be_executed_is_rejected() -> None:
    arena, agent = pa_ros.make_arena(seed=2), pa_ros.load_agent()
    with pytest.raises(ProgramError, match="did you mean CUBE"):
        arena.execute(agent, "NEAR(HAND, CUBBE)")
    with pytest.raises(ProgramError, match="no such object"):
        arena.execute(agent, "NEAR(HAND, BLUE)")
    with pytest.raises(ConfigError, match="unknown design"):
        pa_ros.make_arena("4-D")
    with pytest.raises(ActingError, match="features"):
        pa_ros.make_arena(arm="panda").execute(agent, "NEAR(HAND, CUBE)")


def test_help_shows_the_functions_and_the_example() -> None:
    shown = pydoc.plain(pydoc.render_doc(pa_ros))
    for name in ("make_arena(", "load_agent(", "execute(", "arena = pa_ros.make_arena"):
        assert name in shown
