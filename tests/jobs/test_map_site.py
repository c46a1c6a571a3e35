"""What ends a run, and what only is told."""

import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from savmap.apps.viewer.beside import viewed
from savmap.errors import PluginError, SolveError
from savmap.jobs.map_site import SiteRun, in_one_frame, in_users_world, map_job_into, with_footage
from savmap.jobs.scheduler import MappedRows, RunOptions, _Progress
from savmap.maps.map_file import write_map
from savmap.maps.run_record import FootageFile, RowRun, RunLog
from savmap.site.job import Job, job_for
from savmap.site.overrides import overrides_of
from savmap.types import FrameTable, MapWarning, RowMap, SiteMap, Trajectory, Verdict
from savmap.types.maps import SKIPPED
from savmap.types.progress import NoteCollector

EXAMPLE = Path(__file__).parents[2] / "examples" / "aisle-dev"
PATH = Trajectory(np.zeros(0, np.int64), np.zeros((0, 4, 4)))
NAME = "A"
NOTHING: Any = None


def row(name: str = NAME, **more: Any) -> RowMap:
    return RowMap(name, FrameTable(np.zeros(0), ()), {}, PATH, {}, (), **more)


@pytest.fixture
def job(tmp_path: Path) -> Job:
    return job_for(EXAMPLE / "site.yaml", None, tmp_path)


def written(job: Job, monkeypatch: pytest.MonkeyPatch, mapped: MappedRows) -> tuple[SiteRun, list[str]]:
    """A run whose rows were mapped so, and its notes."""
    monkeypatch.setattr("savmap.jobs.map_site.map_rows_of", lambda *_, **__: mapped)
    notes = NoteCollector()
    return map_job_into(job, RunOptions(jobs=0), notes), notes.lines


def test_plugin_failing_in_assembly_costs_only_the_places(job: Job, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> None:
        raise PluginError("plugin `things` failed in `shared`")

    monkeypatch.setattr("savmap.jobs.map_site.assembled", fails)
    mapped = SiteMap({}, {"savmap": "0"})
    site_map, notes = in_one_frame(job, mapped, {NAME: {}})
    assert site_map is mapped
    assert notes == ("rows are not placed in one frame: plugin `things` failed in `shared`",)


def test_places_that_do_not_fit_cost_only_the_alignment(tmp_path: Path) -> None:
    known = "align: {points: [{at: a, world_m: [1, 2]}, {at: b, world_m: [3, 4]}]}\n"
    site = (EXAMPLE / "site.yaml").read_text(encoding="utf-8")
    (tmp_path / "site.yaml").write_text(known + site, encoding="utf-8")
    job = job_for(tmp_path / "site.yaml", None, tmp_path)
    mapped = SiteMap({NAME: row()}, {})
    site_map, (note,) = in_users_world(job, mapped)
    assert site_map is mapped
    assert note.startswith(f"the site is not aligned: {tmp_path / 'site.yaml'}:1: `align.points[0]`: row A has no `a`")
    assert note.endswith("after mending it run `savmap align`")


def test_the_runs_record_counts_skipped_frames(job: Job) -> None:
    progress = _Progress(job, NOTHING, NOTHING, (), NOTHING, wants_pictures=False, is_here=True)
    assert progress.row_run(NAME, row(report={SKIPPED: 3})).skipped == 3


def test_warning_of_mapping_is_left_to_its_task(job: Job, monkeypatch: pytest.MonkeyPatch) -> None:
    def warns(*_: object, **__: object) -> None:
        logging.getLogger("savmap_things").warning("row A: one too many")
        raise PluginError("enough")

    monkeypatch.setattr("savmap.jobs.map_site.map_rows_of", warns)
    notes = NoteCollector()
    with pytest.raises(PluginError, match="enough"):
        map_job_into(job, RunOptions(jobs=0), notes)
    assert notes.lines == []


def test_a_run_asks_what_check_asks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    given = overrides_of(["references.camera_height_m=10.02"], {})
    job = job_for(EXAMPLE / "site.yaml", None, tmp_path, overrides=given)
    _, notes = written(job, monkeypatch, MappedRows({NAME: row()}, {}, RunLog(rows={})))
    assert any("is the camera 10.02 m high? 10.02 feet are 3.05 m" in line for line in notes)


def test_viewer_of_a_run_is_of_its_map(job: Job, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    written(job, monkeypatch, MappedRows({NAME: row()}, {}, RunLog(rows={})))
    assert viewed(tmp_path, job.site.survey) == (tmp_path / "view.html", False)


def test_record_of_a_run_tells_when_it_ended_and_its_footage(
    job: Job, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1770000000")
    passes = job.site.rows[NAME].passes
    log = with_footage(job, RunLog(rows={NAME: RowRun(status="mapped"), "gone": RowRun(status="failed")}))
    assert log.ended == "2026-02-02T02:40:00.00Z"
    assert log.rows[NAME].footage == {"pass 1": FootageFile(name=passes[0].video.name, width=2048, height=1024)}
    missing = passes[0].model_copy(update={"video": tmp_path / "gone.mp4"})
    rows = {NAME: job.site.rows[NAME].model_copy(update={"passes": (missing,)})}
    log = with_footage(replace(job, site=job.site.model_copy(update={"rows": rows})), log)
    assert log.rows[NAME].footage == {"pass 1": FootageFile(name="gone.mp4")}


def test_what_the_site_file_confirms_is_a_note_of_the_map(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    warning = MapWarning("uncertain-element", ("bay 1 / beam 2",), "seen in 3 of 40 frames", (1.0, 2.0, 0.0))
    entry = '{"code": "uncertain-element", "subjects": ["bay 1 / beam 2", "light 9"], "reason": "a window"}'
    lines = overrides_of([f"rows.A.confirmed=[{entry}]"], {})
    job = job_for(EXAMPLE / "site.yaml", None, tmp_path, overrides=lines)
    mapped = MappedRows({NAME: row(verdict=Verdict((warning,)))}, {}, RunLog(rows={}))
    run, notes = written(job, monkeypatch, mapped)
    assert run.site_map.rows[NAME].verdict == Verdict(
        (), ("confirmed in the site file: uncertain-element, bay 1 / beam 2",)
    )
    assert notes == ["row A: `confirmed` has what nothing warns of now: uncertain-element, light 9"]


def test_pictures_of_rows_that_the_map_lacks_are_removed_and_nothing_else(
    job: Job, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Those of a row that the site lost, of one that failed in an earlier run, and of one that fails now."""
    rows = {**job.site.rows, "new": job.site.rows[NAME]}
    job = replace(job, site=job.site.model_copy(update={"rows": rows}))
    write_map(SiteMap({"old": row("old"), "new": row("new")}, {}, {"older": "no scale"}), tmp_path / "map.json")
    ours = [f"{kind}-{name}.png" for kind in ("face", "plan") for name in ("old", "older", "new")]
    ours += [f"face-old.{end}" for end in ("jpg", "json", "jgw", "jpg.aux.xml", "svg")]
    theirs = ["face-mine.png", "plan-oldest.png", "notes-old.txt", "face-old.pdf", "errors-old.png"]
    for file in (*ours, *theirs):
        (tmp_path / file).write_text("of an earlier run", encoding="utf-8")
    written(job, monkeypatch, MappedRows({NAME: row()}, {"new": SolveError("no scale")}, RunLog(rows={})))
    left = {file.name for file in tmp_path.iterdir()}
    assert not left & set(ours)
    assert {*theirs, "map.json", f"face-{NAME}.png", f"plan-{NAME}.png"} <= left


@pytest.mark.parametrize("content", ["", "[]", '{"rows": {"old": 1}}', '{"format": "savmap-map", "rows": ["old"]}'])
def test_where_no_earlier_map_tells_its_rows_nothing_is_removed(
    job: Job, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, content: str
) -> None:
    (tmp_path / "map.json").write_text(content, encoding="utf-8")
    (tmp_path / "face-old.png").touch()
    written(job, monkeypatch, MappedRows({NAME: row()}, {}, RunLog(rows={})))
    assert (tmp_path / "face-old.png").is_file()
