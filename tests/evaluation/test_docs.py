"""Links of the docs lead somewhere, and code blocks run as they are written."""

import json
import re
from pathlib import Path

import pytest

from pa_ros.arena import conditions_for, design_named
from pa_ros.language.errors import SUMMARIES

DOCS = Path(__file__).parents[2] / "docs"
PAGES = [*DOCS.parent.glob("*.md"), *DOCS.glob("*.md")]


def blocks_of(page: str) -> list[str]:
    return re.findall(r"```python\n(.*?)```", (DOCS / page).read_text(), re.DOTALL)


def named_block(page: str, name: str) -> str:
    """The block of a page under a comment with this name."""
    (block,) = re.findall(
        rf"<!-- test: {name} -->\n```python\n(.*?)```", (DOCS / page).read_text(), re.DOTALL
    )
    return str(block)


def prose(page: Path) -> str:
    return re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)


def headings(page: Path) -> set[str]:
    """The anchors of a page."""
    found = re.findall(r"^#+ (.*)$", prose(page), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", text.lower()).replace(" ", "-") for text in found}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_to_files_and_headings(page: Path):
    for link in re.findall(r"\]\((?!http)([^)\s]+)\)", prose(page)):
        name, _, heading = link.partition("#")
        target = page.parent / name if name else page
        assert target.exists(), link
        assert not heading or heading in headings(target), link


@pytest.mark.parametrize("block", blocks_of("arena.md"))
def test_the_examples_of_the_page_on_the_arena_run(block: str) -> None:
    exec(block, {})


def test_programs_mean_what_the_page_on_the_language_says(capsys) -> None:
    (block,) = blocks_of("language.md")
    exec(block, {})
    shown = capsys.readouterr().out.splitlines()
    assert [line.rpartition(" ")[2] for line in shown] == ["False", "False", "True"]


def test_the_page_on_the_language_lists_every_code() -> None:
    text = (DOCS / "language.md").read_text()
    assert set(re.findall(r"^\| `(program\.\w+)` \|", text, re.MULTILINE)) == set(SUMMARIES)


def test_an_arena_is_stepped_and_explained_as_the_page_shows(capsys):
    exec(named_block("starting.md", "process"), {})
    assert capsys.readouterr().out.startswith("True 0.")


def test_training_in_python_works_as_the_pages_show(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    short = named_block("starting.md", "train").replace("30_000", "100")
    exec(short.replace("episodes=20", "episodes=1"), {})
    rows = capsys.readouterr().out.splitlines()[-2:]
    untrained = ["NEAR(HAND, AND(BLUE, SPHERE))", "NEAR(HAND, AND(BLUE, NOT(CUBE)))"]
    assert [row.rpartition(" ")[0] for row in rows] == untrained
    exec(named_block("learning.md", "loop").replace("30_000", "100"), {})
    assert "'frames': 100" in capsys.readouterr().out


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::UserWarning")
def test_baselines_trains_and_scores_another_librarys_agent(capsys) -> None:
    pytest.importorskip("stable_baselines3")
    sizes = "FRAMES, EPISODES, SEED = 10_000, 20, 0"
    (block,) = blocks_of("evaluation.md")
    assert sizes in block
    exec(block.replace(sizes, "FRAMES, EPISODES, SEED = 110, 1, 0"), {})
    scored = [line.split()[0] for line in capsys.readouterr().out.splitlines()]
    assert [*scored, "compare"] == list(conditions_for(design_named("2-L")))


def test_the_notebook_is_read_with_its_outputs_and_without_paths():
    text = (DOCS / "tour.ipynb").read_text()
    code = [cell for cell in json.loads(text)["cells"] if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in code] == list(range(1, 1 + len(code)))
    assert all(cell["outputs"] for cell in code) and text.count("image/png") == 4
    assert len(text) < 80_000 and not re.search(r"/(tmp|home|root|work)\b", text)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_the_notebook_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    nbformat = pytest.importorskip("nbformat", reason="the extra `notebook` is not installed")
    nbclient = pytest.importorskip("nbclient", reason="the extra `notebook` is not installed")
    monkeypatch.setenv("TOUR_FRAMES", "1200")
    monkeypatch.setenv("TOUR_EPISODES", "1")
    for place in ("TMPDIR", "IPYTHONDIR", "JUPYTER_RUNTIME_DIR"):
        monkeypatch.setenv(place, str(tmp_path))
    notebook = nbformat.read(DOCS / "tour.ipynb", as_version=4)
    client = nbclient.NotebookClient(
        notebook, timeout=250, kernel_name="python3", resources={"metadata": {"path": tmp_path}}
    )
    client.execute()
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    outputs = ["".join(str(output) for output in cell.outputs) for cell in code]
    assert all("Traceback" not in text for text in outputs)
    assert sum("image/png" in text for text in outputs) == 4
    assert "success True" in "".join(outputs)
    assert (next(tmp_path.glob("tour-*")) / "bag").is_dir()
