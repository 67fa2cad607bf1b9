"""What strangers wrote into a bag or say on the graph is shown, and moves no cursor."""

from pathlib import Path

import pytest

from helpers.recordings import written
from pa_ros import Result
from pa_ros.cli.main import main
from pa_ros.cli.send import print_answers, result_text
from pa_ros.tools.send import Answers
from pa_ros.wire.program import ProgramStatus

CLEAR = "\x1b[2J"  # clears a terminal


def test_what_a_bag_says(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    written(tmp_path / "bag", 1, close=False).close({"pa_ros.repaired": f"by {CLEAR} me"})
    assert main(["bag", "info", str(tmp_path / "bag")]) == 0
    shown = capsys.readouterr().out
    assert r"by \x1b[2J me" in shown and CLEAR not in shown
    assert len(shown.splitlines()) > 1


def test_what_nodes_answer(capsys: pytest.CaptureFixture[str]):
    kind = CLEAR + "kind"
    print_answers(
        Answers(
            {
                "a": ProgramStatus("1", "a", True, canonical=kind),
                kind: ProgramStatus("1", kind, False, code=kind, reason=f"RED\n ^~~{CLEAR}"),
            }
        )
    )
    print(result_text(Result("NEAR(HAND, RED)", False, 0.1, None, kind, kind)))
    said = capsys.readouterr()
    assert CLEAR not in said.out + said.err
    assert said.out.splitlines()[0] == r"a: accepted \x1b[2Jkind"
    assert said.err.splitlines()[1:] == ["RED", r" ^~~\x1b[2J"]
