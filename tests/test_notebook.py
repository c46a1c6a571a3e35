"""The notebook of the documentation runs as it stands, and shows what it did when it was written."""

from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

NOTEBOOK = Path(__file__).parent.parent / "examples" / "notebooks" / "first_map.ipynb"


def printed(notebook: nbformat.NotebookNode) -> str:
    """All that its cells print."""
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    return "".join(output.text for output in outputs if output.output_type == "stream")


def pictures(notebook: nbformat.NotebookNode) -> int:
    """How many pictures its cells show."""
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    return sum("image/png" in output.get("data", {}) for output in outputs)


@pytest.mark.slow
def test_notebook_runs_as_it_stands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("JUPYTER_PLATFORM_DIRS", "1")
    monkeypatch.setenv("JUPYTER_RUNTIME_DIR", str(tmp_path / "runtime"))
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    client = NotebookClient(notebook, timeout=900, kernel_name="python3", resources={"metadata": {"path": tmp_path}})
    client.execute()
    assert pictures(notebook) == 1
    assert printed(notebook).count("\nbay ") == 22
    assert "missing {'upright': 0, 'beam': 0} spurious {'upright': 0, 'beam': 0}" in printed(notebook)
    assert (next(tmp_path.glob("*/demo")) / "report.html").is_file()


def test_notebook_is_kept_with_small_outputs() -> None:
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    assert pictures(notebook) == 1
    assert printed(notebook).count("\nbay ") == 22
    assert NOTEBOOK.stat().st_size < 150_000
