"""What ends a run, and what only is told."""

import logging
from pathlib import Path

import pytest

from savmap.errors import PluginError
from savmap.jobs.map_site import in_one_frame, map_job_into
from savmap.jobs.scheduler import RunOptions
from savmap.site.job import job_for
from savmap.types import SiteMap
from savmap.types.progress import NoteCollector

EXAMPLE = Path(__file__).parents[2] / "examples" / "aisle-dev"


def test_plugin_failing_in_assembly_costs_only_the_places(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def fails(*_: object) -> None:
        raise PluginError("plugin `things` failed in `shared`")

    monkeypatch.setattr("savmap.jobs.map_site.assembled", fails)
    mapped = SiteMap({}, {"savmap": "0"})
    site_map, notes = in_one_frame(job_for(EXAMPLE / "site.yaml", None, tmp_path), mapped, {"A": {}})
    assert site_map is mapped
    assert notes == ("rows are not placed in one frame: plugin `things` failed in `shared`",)


def test_warning_of_mapping_is_left_to_its_task(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def warns(*_: object, **__: object) -> None:
        logging.getLogger("savmap_things").warning("row A: one too many")
        raise PluginError("enough")

    monkeypatch.setattr("savmap.jobs.map_site.map_rows_of", warns)
    notes = NoteCollector()
    with pytest.raises(PluginError, match="enough"):
        map_job_into(job_for(EXAMPLE / "site.yaml", None, tmp_path), RunOptions(jobs=0), notes)
    assert notes.lines == []
