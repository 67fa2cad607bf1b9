"""What `make` runs, wherever the clone lies."""

import re
import shlex
import shutil
import subprocess
from pathlib import Path
from urllib.parse import unquote

import pytest

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("name", ["clone", "a clone", "100 % mine", "it's mine"])
def test_the_constraints_are_named_in_one_word(tmp_path: Path, name: str) -> None:
    """pip splits PIP_CONSTRAINT at spaces, and so does the shell."""
    folder = tmp_path / name
    folder.mkdir()
    for file in ("Makefile", "pyproject.toml", "constraints.txt"):
        shutil.copy(ROOT / file, folder)
    done = subprocess.run(
        ["make", "-n", "install"], cwd=folder, capture_output=True, text=True, check=True
    )
    said = done.stdout.splitlines()
    (at,) = (i for i, line in enumerate(said) if "pip install" in line)
    line, before = said[at], said[at - 1]
    assert "compiling the messages" in before, "pip takes minutes, and writes nothing to a log"
    value = shlex.split(line)[0].removeprefix("PIP_CONSTRAINT=")
    assert not re.search(r"\s", value)
    assert Path(unquote(value.removeprefix("file://"))) == folder / "constraints.txt"
