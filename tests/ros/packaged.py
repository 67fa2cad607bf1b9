"""Source archive and wheel in dist/ hold what they should, and the wheel does its work in an
environment of its own, which sees the dependencies of this one: `make dist`."""

import json
import os
import re
import signal
import subprocess
import sys
import sysconfig
import tarfile
import venv
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from helpers.installed import ORIGINS, PACKAGES, ROOT, elsewhere, missing
from helpers.waiting import DEADLINE_S

Command = Callable[..., subprocess.CompletedProcess[str]]


def built(pattern: str) -> Path:
    """The one file in dist/ of that name."""
    (found,) = (ROOT / "dist").glob(pattern)
    return found


@pytest.fixture(scope="module")
def prefix(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An environment that holds the wheel; of this one it sees the packages, but, since `.pth`
    files count only in an environment's own folder, nothing that is installed editable."""
    home = tmp_path_factory.mktemp("environment")
    venv.create(home, symlinks=True)
    purelib = sysconfig.get_path("purelib", vars={"base": str(home)})
    pip = [sys.executable, "-m", "pip", "--python", str(home), "install", "--quiet", "--no-deps"]
    subprocess.run([*pip, str(built("*.whl"))], check=True, timeout=DEADLINE_S)
    (Path(purelib) / "dependencies.pth").write_text(sysconfig.get_path("purelib"))
    return home


@pytest.fixture
def environment(prefix: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Path]:
    """The prefix, of which all libraries, programs and resources are found first."""
    for name, folder in (("LD_LIBRARY_PATH", "lib"), ("PATH", "bin"), ("AMENT_PREFIX_PATH", "")):
        there = os.environ.get(name, sys.prefix)
        monkeypatch.setenv(name, f"{prefix / folder}{os.pathsep}{there}")
    monkeypatch.chdir(tmp_path)
    yield prefix


@pytest.fixture
def run(environment: Path) -> Command:
    def run(program: str, *arguments: str) -> subprocess.CompletedProcess[str]:
        command = [str(environment / "bin" / program), *arguments]
        done = subprocess.run(command, capture_output=True, text=True, timeout=DEADLINE_S)
        assert done.returncode == 0, done.stderr
        return done

    return run


def test_the_source_archive_holds_what_git_does_not_ignore():
    with tarfile.open(built("*.tar.gz")) as archive:
        held = {member.partition("/")[2] for member in archive.getnames()} - {"PKG-INFO"}
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert held == set(listed.stdout.split("\0")) - {""}


def test_both_have_the_declared_version():
    declared = re.search(r'^version = "(.*)"', (ROOT / "pyproject.toml").read_text(), re.MULTILINE)
    assert declared is not None
    version = declared.group(1)
    assert built("*.tar.gz").name == f"programmable_agents-{version}.tar.gz"
    assert built("*.whl").name.startswith(f"programmable_agents-{version}-")


def test_code_messages_libraries_and_index_come_from_the_wheel(run: Command, environment: Path):
    assert elsewhere(json.loads(run("python", "-c", ORIGINS).stdout), environment) == []


@pytest.mark.parametrize("package", PACKAGES)
def test_shared_files_are_installed(package: str, prefix: Path):
    assert missing(package, prefix / "share" / package) == []


def test_the_shipped_agent_scores_well(run: Command):
    options = ("--condition", "eval", "--episodes", "5", "--json", "score.json")
    run("pa_ros", "eval", "--checkpoint", "shipped:3-D", *options)
    report = json.loads(Path("score.json").read_text())
    assert report["eval.normalized"] > 0.8


def test_the_laboratory_is_in_no_wheel(environment: Path):
    command = [str(environment / "bin/pa_ros"), "experiment", "forgetting"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=DEADLINE_S)
    assert done.returncode == 2 and "run `make install` in a clone" in done.stderr


@pytest.mark.graph
def test_a_graph_executes_a_program(run: Command, environment: Path):
    launch = [str(environment / "bin/pa_ros"), "launch", "--out", "run"]
    with subprocess.Popen(launch, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as process:
        try:
            run("pa_ros", "send", "NEAR(HAND, AND(RED, CUBE))", "--wait")
            process.send_signal(signal.SIGINT)
            said, _ = process.communicate(timeout=DEADLINE_S)
        finally:
            process.kill()
    assert process.returncode == 0, said
