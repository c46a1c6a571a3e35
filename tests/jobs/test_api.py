"""The Python API takes paths as texts too, and says in one line what it cannot take."""

from pathlib import Path
from typing import Any

import pytest

import savmap
from savmap.errors import SiteError, VideoError
from savmap.types import SiteMap, Survey

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
