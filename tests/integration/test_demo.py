"""The main job on real pixels: the demo, mapped once by the documentation's notebook, and what is made of its map."""

import json
from pathlib import Path

import nbformat
import numpy as np
import pytest
import yaml
from nbclient import NotebookClient
from typer.testing import CliRunner

import savmap
from savmap.cli.app import app
from savmap.types import SiteMap

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "aisle-dev"
NOTEBOOK = ROOT / "examples" / "notebooks" / "first_map.ipynb"


def printed(notebook: nbformat.NotebookNode) -> str:
    """All that its cells print."""
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    return "".join(output.text for output in outputs if output.output_type == "stream")


def pictures(notebook: nbformat.NotebookNode) -> int:
    """How many pictures its cells show."""
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    return sum("image/png" in output.get("data", {}) for output in outputs)


@pytest.fixture(scope="module")
def executed(tmp_path_factory: pytest.TempPathFactory) -> nbformat.NotebookNode:
    """The notebook after it ran in a folder of its own, whose path its metadata have."""
    folder = tmp_path_factory.mktemp("notebook")
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    client = NotebookClient(notebook, timeout=900, kernel_name="python3", resources={"metadata": {"path": folder}})
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("JUPYTER_PLATFORM_DIRS", "1")
        patch.setenv("JUPYTER_RUNTIME_DIR", str(folder / "runtime"))
        patch.setenv("IPYTHONDIR", str(folder / "ipython"))
        patch.setenv("TMPDIR", str(folder))
        client.execute()
    notebook.metadata["folder"] = str(next(folder.glob("*/demo")))
    return notebook


@pytest.fixture(scope="module")
def demo(executed: nbformat.NotebookNode) -> Path:
    """The folder with the demo's map."""
    return Path(executed.metadata["folder"])


@pytest.fixture(scope="module")
def site_map(demo: Path) -> SiteMap:
    return savmap.load_map(demo)


def site(folder: Path, **of_pass: object) -> Path:
    """The example's site file, with keys of its pass changed, in a folder of its own."""
    content = yaml.safe_load((EXAMPLE / "site.yaml").read_text(encoding="utf-8"))
    content["rows"]["A"]["passes"][0].update(video=str(EXAMPLE / "aisle-dev.mp4"), **of_pass)
    content["survey"] = str(EXAMPLE / "survey.json")
    path = folder / "site.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return path


def run(*arguments: object) -> str:
    """Run the command line; its standard output."""
    result = CliRunner().invoke(app, [str(argument) for argument in arguments], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.stdout


@pytest.mark.slow
def test_the_notebook_runs_as_it_stands(executed: nbformat.NotebookNode, demo: Path) -> None:
    assert pictures(executed) == 1
    assert printed(executed).count("\nbay ") == 22
    assert "missing {'upright': 0, 'beam': 0} spurious {'upright': 0, 'beam': 0}" in printed(executed)
    made = {"map.json", "face-A.png", "plan-A.png", "errors.png", "site.resolved.json", "report.html"}
    assert made <= {path.name for path in demo.iterdir()}


def test_the_notebook_is_kept_with_small_outputs() -> None:
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    assert pictures(notebook) == 1
    assert printed(notebook).count("\nbay ") == 22
    assert NOTEBOOK.stat().st_size < 150_000


@pytest.mark.slow
def test_every_element_is_where_the_survey_has_it(site_map: SiteMap) -> None:
    score = savmap.evaluate(site_map, EXAMPLE / "survey.json").rows["A"]
    assert set(score.missing.values()) == {0}
    assert set(score.spurious.values()) == {0}
    errors_m = np.concatenate([score.errors[name] for name in score.errors])
    assert np.abs(errors_m).mean() < 0.0025


@pytest.mark.slow
def test_lamps_are_where_the_survey_has_them(demo: Path) -> None:
    lamps = json.loads(run("evaluate", demo, EXAMPLE / "survey.json", "--json"))["lights"]
    assert (lamps["count"], lamps["missing"], lamps["spurious"]) == (5, 0, 0)
    assert lamps["max_m"] < 0.025  # 18 mm too high, all of them: the survey has their lower edges


@pytest.mark.slow
def test_lamps_alone_are_mapped_on_an_earlier_maps_path(demo: Path, tmp_path: Path) -> None:
    run("map", site(tmp_path), "--plugins", "lights", "--trajectory", demo / "map.json", "-o", tmp_path / "out")
    lamps = json.loads(run("evaluate", tmp_path / "out", EXAMPLE / "survey.json", "--json"))["lights"]
    assert (lamps["missing"], lamps["spurious"]) == (0, 0)
    assert lamps["max_m"] < 0.025
