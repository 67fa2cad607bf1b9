"""What commands write: to nowhere, to a link, numbers that JSON lacks, and text of strangers."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from helpers.recordings import written
from pa_ros import Result
from pa_ros.cli.main import main
from pa_ros.cli.send import print_answers, result_text
from pa_ros.core.files import write_whole
from pa_ros.core.text import write_report
from pa_ros.tools.send import Answers
from pa_ros.wire.program import ProgramStatus

COMMAND = (sys.executable, "-m", "pa_ros")
CHECK = ("program", "check", "NEAR(HAND, RED)")


def run(redirection: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    line = f'exec "$@" {redirection}'
    return subprocess.run(
        ["sh", "-c", line, "sh", *COMMAND, *arguments], stderr=subprocess.PIPE, text=True
    )


def test_a_command_without_an_output_ends_well() -> None:
    ended = run(">&-", *CHECK)
    assert ended.returncode == 0 and not ended.stderr


def test_a_module_of_the_current_folder_is_not_run(tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "random.py").write_text("raise SystemExit('the file of the user was run')")
    monkeypatch.chdir(tmp_path)
    ended = run("", "eval", "--policy", "random", "--episodes", "1")
    assert (ended.returncode, ended.stderr) == (0, "")


def test_a_file_is_whole_and_a_link_stays_one(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    link = tmp_path / "link.txt"
    link.symlink_to(tmp_path / "there" / "file.txt")
    write_whole(link, "a\r\n")
    assert link.is_symlink() and (tmp_path / "there" / "file.txt").read_bytes() == b"a\r\n"
    write_whole(Path("/dev/null"), "a")
    assert not Path("/dev/null").is_file()


def test_numbers_that_json_lacks_are_text(tmp_path: Path) -> None:
    report = {"a": float("nan"), "b": float("inf"), "c": 0.5}
    write_report(tmp_path / "report.json", report)
    said = json.loads((tmp_path / "report.json").read_text(), parse_constant=pytest.fail)
    assert said == {"a": "nan", "b": "inf", "c": 0.5}


def test_an_option_cut_short_is_refused_and_not_dropped() -> None:
    ended = run("", *CHECK, "--exten", "nosuch.py")
    assert ended.returncode == 2 and "--exten" in ended.stderr


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
