"""docs/tour.ipynb runs from its first cell to its last, as a reader would have it run."""

from __future__ import annotations

from pathlib import Path

import pytest

nbformat = pytest.importorskip("nbformat", reason="the extra `notebook` is not installed")
nbclient = pytest.importorskip("nbclient", reason="the extra `notebook` is not installed")

NOTEBOOK = Path(__file__).parents[2] / "docs/tour.ipynb"


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_the_notebook_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("TOUR_FRAMES", "1200")
    monkeypatch.setenv("TOUR_EPISODES", "1")
    for place in ("TMPDIR", "IPYTHONDIR", "JUPYTER_RUNTIME_DIR"):
        monkeypatch.setenv(place, str(tmp_path))
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    nbformat.validate(notebook)
    client = nbclient.NotebookClient(
        notebook, timeout=250, kernel_name="python3", resources={"metadata": {"path": tmp_path}}
    )
    client.execute()
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    said = ["".join(str(output) for output in cell.outputs) for cell in code]
    assert len(code) == 8 and "blocks" in said[0] and "AND" in said[2] and "steps" in said[6]
    assert all("Traceback" not in text for text in said)
    drawn = [text for text in said if "image/png" in text]
    assert len(drawn) == 3 and (next(tmp_path.glob("tour-*")) / "bag").is_dir()
