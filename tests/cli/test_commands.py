"""The command line: exit statuses, refusals and flat JSON."""

import json
import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from pa_ros.cli.main import build_parser, main


def test_train_then_eval(tmp_path, capsys):
    run = ["train", "--out", str(tmp_path), "--seed", "1", "--eval-every", "0"]
    assert main([*run, "--frames", "200"]) == 0
    assert main([*run, "--frames", "300"]) == 2
    refusal = capsys.readouterr().err.splitlines()[-1]
    assert "holds a checkpoint: resume it (--resume" in refusal
    assert main([*run, "--frames", "400", "--resume"]) == 0
    report = tmp_path / "eval.json"
    arguments = ["eval", "--checkpoint", str(tmp_path), "--episodes", "3", "--json", str(report)]
    assert main(arguments) == 0
    figures = json.loads(report.read_text())
    assert -1.0 <= figures["eval.reward_per_step"] <= 1.0
    assert figures["eval.normalized_low"] <= figures["eval.normalized"]
    assert figures["eval.normalized"] <= figures["eval.normalized_high"]
    assert 0.0 <= figures["eval.success_rate"] <= 1.0
    assert figures["eval.design"] == "2-L" and figures["eval.condition"] == "eval"
    assert all(isinstance(value, int | float | str) for value in figures.values()), "flat"
    assert "NEAR(HAND, AND(BLUE, SPHERE)): 3 episodes" in capsys.readouterr().out


def test_a_misspelled_command_is_told_its_name(capsys):
    assert main(["launhc"]) == 2
    assert "got 'launhc'; did you mean 'launch'? (see" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments",
    [["experiment", "forgetting"], ["figures"], ["export", "shipped:2-L", "--card", "c.md"]],
)
def test_where_the_laboratory_is_absent_its_commands_say_how_to_get_it(
    arguments, capsys, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    for module in ("commands.experiment", "commands.figures", "studies.cards"):
        monkeypatch.setitem(sys.modules, f"laboratory.{module}", None)
    assert main(arguments) == 2
    assert "run `make install` in a clone" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("eval --policy scripted --episodes 0", "got 0"),
        ("eval --policy scripted --condition sideways", "sideways"),
        ("eval --checkpoint nowhere/at/all", "nowhere/at/all"),
        ("train --out unused --frames ten", "--frames: expected an integer of at"),
        ("train --out unused --network x", "network.family: expected one of ['programmable', "),
        (
            "train --out unused --learner.updates.discount=abc",
            "learner.updates.discount: expected a number in [0, 1), got abc",
        ),
        ("record unused --repair --split-s 1", "expected it alone, got split_s, too"),
        ("send RED --timeout 0", "--timeout: expected a positive number, got 0"),
        ("experiment programmable-2L --seeds 0", "--seeds: expected an integer"),
        (
            "train --out unused --learner.updates.discont=1",
            "--learner.updates.discont; did you mean '--learner.updates.discount'?",
        ),
        ("experiment nope", "algorithms, got 'nope' ("),
        ("experiment programable-2L", "got 'programable-2L'; did you mean 'programmable-2L'?"),
        ("train --design 3D --out unused", "got 3D; did you mean '3-D'?"),
        ("eval --condition evl --policy random", "got 'evl'; did you mean 'eval'?"),
        ("experiment generalization", "first run `pa_ros experiment programmable-3D`"),
        ("experiment detectors --of sizes", "first run `pa_ros experiment sizes`"),
        (
            "experiment programmable-2L --logic product",
            "--logic: expected a study (generalization, detectors, equalities)",
        ),
        ("train --out unused --namespace /a", "--namespace: needs --from-bag"),
        ("eval --checkpoint shipped:2-L --relations NEAR", "--relations: needs --policy"),
        ("send --wait", "--wait: needs a program"),
        ("send --scene last", "--scene: expected next or the number of an episode, got 'last'"),
        ("send RED --namespace 'not a name'", "namespace"),
        ("launch --params absent.yaml", "absent.yaml"),
        ("eval --policy scripted --condition all", "all: needs --checkpoint"),
        ("record --repair x --split-s 9", "expected it alone, got split_s"),
        ("launch --out /dev/null/x", "expected a folder at /dev/null, got a file"),
        ("ship unused 3-D", "expected a new one, got '3-D', which exists (--replace)"),
        (
            "experiment programmable-2L --tag ../x --learner.detectors.gain=2",
            "tag: expected letters, digits, '-' and '_', also with dots between, got '../x'",
        ),
        ("eval --policy scripted --logic product", "--logic: needs --checkpoint"),
    ],
)
def test_bad_input_is_refused_with_status_2_and_what_came(
    arguments, said, capsys, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    command, *options = shlex.split(arguments)
    assert main([command, *options]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"pa_ros {command}: ") and said in error
    assert error.count("\n") == 1
    assert not list(tmp_path.iterdir()), "a refused command leaves nothing"


TOO_LONG = "x" * 300  # of a file's name


@pytest.mark.parametrize(
    "arguments",
    [
        ["eval", "--checkpoint", TOO_LONG],
        ["train", "--frames", "100", "--out", TOO_LONG],
        ["bag", "info", TOO_LONG],
        ["film", "--out", f"{TOO_LONG}.gif"],
        ["launch", "--params", TOO_LONG],
    ],
    ids=lambda arguments: arguments[0],
)
def test_a_path_that_the_system_refuses_is_one_line(tmp_path, monkeypatch, capsys, arguments):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    reason = capsys.readouterr().err
    assert "File name too long" in reason and TOO_LONG in reason and len(reason.splitlines()) == 1


@pytest.mark.parametrize("command", [["experiment", "programmable-2L"], ["figures"]])
def test_published_tables_are_written_over_only_when_that_is_asked_for(command):
    parser = build_parser(command[0])
    assert parser.parse_args(command).results == Path("runs/experiments/results")
    assert parser.parse_args([*command, "--publish"]).results == Path("docs/results")


def test_the_older_name_of_the_recipe_is_accepted_and_not_shown():
    parser = build_parser("train")
    run = ["train", "--out", "unused"]
    given = parser.parse_args([*run, "--protocol", "paper"])
    assert given == parser.parse_args([*run, "--recipe", "paper"])
    assert "--protocol" not in parser.format_help()


def test_a_reader_that_has_read_enough_is_no_error():
    command = [sys.executable, "-m", "pa_ros", "program", "check", "NEAR(HAND, RED)"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        process.stdout.close()
        assert process.stderr.read() == b""
        assert process.wait(timeout=60) == 141


def test_a_terminal_without_our_letters_gets_all_the_same_what_is_said():
    command = [sys.executable, "-m", "pa_ros", "train", "--help"]
    said = subprocess.run(
        command, env={**os.environ, "PYTHONIOENCODING": "ascii"}, capture_output=True, timeout=60
    )
    assert said.returncode == 0 and said.stderr == b""
    assert b"usage: pa_ros train" in said.stdout and b"\\u2026" in said.stdout


@pytest.mark.parametrize(
    ("line", "expected"),
    [("pa_ros exp", {"experiment", "export"}), ("pa_ros export 3-D --ca", {"--card"})],
)
def test_a_shell_completes_commands_and_their_options(line, expected, tmp_path):
    answer = tmp_path / "answer"
    asked = {"_ARGCOMPLETE": "1", "_ARGCOMPLETE_STDOUT_FILENAME": str(answer)}
    asked |= {"_ARGCOMPLETE_IFS": "\n", "COMP_LINE": line, "COMP_POINT": str(len(line))}
    subprocess.run([sys.executable, "-m", "pa_ros"], env={**os.environ, **asked}, check=True)
    assert {word.strip() for word in answer.read_text().split("\n")} == expected
