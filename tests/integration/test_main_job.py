"""The main job on real pixels: the footage that ships, from its site file to scores (a minute or two)."""

import json
from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

from savmap.cli.app import app

pytestmark = pytest.mark.slow

EXAMPLE = Path(__file__).parents[2] / "examples" / "aisle-dev"


def site(folder: Path, **of_pass: object) -> Path:
    """The example's site file, with keys of its pass changed, in a folder of its own."""
    content = yaml.safe_load((EXAMPLE / "site.yaml").read_text(encoding="utf-8"))
    one = content["rows"]["A"]["passes"][0]
    one.update(video=str(EXAMPLE / "aisle-dev.mp4"), **of_pass)
    content["survey"] = str(EXAMPLE / "survey.json")
    path = folder / "site.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return path


def savmap(*arguments: object) -> str:
    """Run the command line; its standard output."""
    result = CliRunner().invoke(app, [str(argument) for argument in arguments], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.stdout


def scores(map_file: Path) -> dict[str, object]:
    return json.loads(savmap("evaluate", map_file, EXAMPLE / "survey.json", "--json"))


@pytest.fixture(scope="module")
def mapped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder with the example's map."""
    folder = tmp_path_factory.mktemp("mapped")
    savmap("map", site(folder), "--plugins", "shelves,lights", "-o", folder / "out")
    return folder / "out"


def test_every_element_is_found_and_none_invented(mapped: Path) -> None:
    found = scores(mapped / "map.json")
    assert set(found["missing"].values()) == {0}
    assert set(found["spurious"].values()) == {0}
    assert found["mae_m"] <= 0.04
    assert found["not_mapped"] == ["B"]


def test_lamps_above_the_row_are_within_ten_centimetres(mapped: Path) -> None:
    lamps = scores(mapped / "map.json")["lights"]
    assert lamps["count"] == 5
    assert (lamps["missing"], lamps["spurious"]) == (0, 0)
    assert lamps["max_m"] <= 0.10


def test_pictures_map_and_log_are_written(mapped: Path) -> None:
    names = {path.name for path in mapped.iterdir()}
    assert {"map.json", "face-A.png", "plan-A.png", "errors.png", "savmap.log", "site.resolved.json"} <= names


def test_lamps_alone_from_an_earlier_maps_path(mapped: Path, tmp_path: Path) -> None:
    savmap("map", site(tmp_path), "--plugins", "lights", "--trajectory", mapped / "map.json", "-o", tmp_path / "out")
    lamps = scores(tmp_path / "out" / "map.json")["lights"]
    assert (lamps["missing"], lamps["spurious"]) == (0, 0)
    assert lamps["max_m"] <= 0.10


def test_check_finds_nothing_wrong_and_says_what_a_run_takes(tmp_path: Path) -> None:
    told = savmap("check", site(tmp_path, fps=1.0), "-o", tmp_path / "out")
    assert "views in" in told
    assert "17 frames; measuring them will take about" in told
    assert "no problem found" in told
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["views-A-pass-1.jpg"]


def test_the_same_map_twice(tmp_path: Path) -> None:
    path = site(tmp_path, fps=1.0)
    for name in ("one", "two"):
        savmap("map", path, "--plugins", "shelves", "-o", tmp_path / name)
    assert (tmp_path / "one" / "map.json").read_bytes() == (tmp_path / "two" / "map.json").read_bytes()
