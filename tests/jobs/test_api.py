"""The Python API takes paths as texts too, and says in one line what it cannot take."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import savmap
from savmap.errors import SiteError, VideoError
from savmap.types import FrameTable, MapWarning, RowMap, SiteMap, Structure, Survey, Trajectory, Verdict

EMPTY = SiteMap({}, {})


def test_files_are_written_to_paths_and_texts_alike(tmp_path: Path) -> None:
    survey = Survey({"A": {"length": 3.0}})
    for kind in (str, Path):
        place = kind(tmp_path / kind.__name__)
        savmap.write_map(EMPTY, kind(f"{place}.json"))
        savmap.write_survey(survey, kind(f"{place}-survey.json"))
        assert not savmap.load_map(kind(f"{place}.json")).rows
        assert savmap.export(kind(f"{place}.json"), kind(f"{place}.csv")) == Path(f"{place}.csv")
        assert not savmap.compare(kind(f"{place}.json"), EMPTY).rows
    assert (tmp_path / "str-survey.json").read_bytes() == (tmp_path / f"{Path.__name__}-survey.json").read_bytes()


def test_one_plugin_may_be_given_by_its_name(tmp_path: Path) -> None:
    site = tmp_path / "site.yaml"
    site.write_text("references: {camera_height_m: {value: 3.0}}\nrows: {A: {passes: [{video: none.mp4}]}}\n")
    with pytest.raises(VideoError, match=r"none\.mp4"):
        savmap.map_site(str(site), "shelves", output=str(tmp_path / "out"))


@pytest.mark.parametrize("height", ["3,05", "3.05", [3.05], True])
def test_a_camera_height_that_is_no_number_is_refused_in_one_line(height: Any) -> None:
    with pytest.raises(SiteError, match=r"^camera_height_m: a number of metres is expected"):
        savmap.map_video("aisle.mp4", camera_height_m=height)


def post(number: int) -> Structure:
    place = np.array([[3.0 * number, 1.0, 0.0]])
    none = np.zeros((0, 2), np.int64)
    return Structure(f"post {number}", "post", place, 1e-6 * np.eye(3)[None], (f"post {number} / top",), none)


@pytest.fixture
def warned() -> SiteMap:
    """A row of two posts, the second of which is warned."""
    path = Trajectory(np.arange(1), np.eye(4)[None])
    row = RowMap("A", FrameTable(np.zeros(1), ("pass 1",)), {}, path, {"posts": (post(1), post(2))}, ())
    return SiteMap({"A": replace(row, verdict=Verdict((MapWarning("uncertain-element", ("post 2",)),)))}, {})


def test_the_table_of_vertices_says_what_is_warned(warned: SiteMap) -> None:
    table = warned.to_dataframe()
    assert dict(zip(table["structure"], table["warnings"], strict=True)) == {
        "post 1": "",
        "post 2": MapWarning("uncertain-element", ("post 2",)).line,
    }


def test_structures_are_found_and_distances_measured_as_on_the_command_line(warned: SiteMap, tmp_path: Path) -> None:
    file = tmp_path / "map.json"
    savmap.write_map(warned, file)
    for site_map in (warned, str(file)):
        (hit,) = savmap.find(site_map, "POST 2")
        assert (hit.row, hit.structure.id, hit.position_m.tolist()) == ("A", "post 2", [6.0, 1.0, 0.0])
        distance = savmap.measure(site_map, "post 1 / top", "post 2 / top")
        assert distance.length_m == pytest.approx(3.0)
        assert distance.sigma_m == pytest.approx(2**0.5 * 1e-3)
    with pytest.raises(SiteError, match="nearest: post"):
        savmap.find(warned, "post 7")


@pytest.mark.parametrize("thing", [None, {"rows": {}}, 7])
def test_what_is_no_path_is_refused_by_name(thing: Any) -> None:
    for function in (savmap.load_map, savmap.map_site, savmap.map_video):
        with pytest.raises(TypeError, match=f"a path is expected, as a text or a Path, not {type(thing).__name__}"):
            function(thing)


def test_what_is_no_text_or_count_is_told_as_such(warned: SiteMap, tmp_path: Path) -> None:
    site = tmp_path / "site.yaml"
    site.write_text("rows: {A: {passes: [{video: a.mp4}]}}", encoding="utf-8")
    number: Any = 3
    with pytest.raises(TypeError, match="a text is expected, not int"):
        savmap.find(warned, number)
    with pytest.raises(TypeError, match="a text is expected, not int"):
        savmap.map_site(site, [number])
    with pytest.raises(SiteError, match="jobs -1: give the number of rows"):
        savmap.map_site(site, "shelves", jobs=-1)
