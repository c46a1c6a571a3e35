"""What ends a run, and what only is told."""

import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from savmap.errors import PluginError, SolveError
from savmap.jobs.map_site import in_one_frame, in_users_world, map_job_into, with_footage
from savmap.jobs.scheduler import MappedRows, RunOptions, _Progress
from savmap.jobs.tasks import Failure
from savmap.maps.map_file import write_map
from savmap.maps.run_record import FootageFile, RowRun, RunLog
from savmap.report.site_report import viewed
from savmap.site.job import job_for
from savmap.site.overrides import overrides_of
from savmap.types import Doubt, FrameTable, RowMap, SiteMap, Trajectory, Verdict
from savmap.types.maps import SKIPPED
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


def test_places_that_do_not_fit_cost_only_the_alignment(tmp_path: Path) -> None:
    known = "align: {points: [{at: a, world_m: [1, 2]}, {at: b, world_m: [3, 4]}]}\n"
    site = (EXAMPLE / "site.yaml").read_text(encoding="utf-8")
    (tmp_path / "site.yaml").write_text(known + site, encoding="utf-8")
    job = job_for(tmp_path / "site.yaml", None, tmp_path)
    path = Trajectory(np.zeros(0, np.int64), np.zeros((0, 4, 4)))
    mapped = SiteMap({"A": RowMap("A", FrameTable(np.zeros(0), ()), {}, path, {}, ())}, {})
    site_map, (note,) = in_users_world(job, mapped)
    assert site_map is mapped
    assert note.startswith(f"the site is not aligned: {tmp_path / 'site.yaml'}:1: `align.points[0]`: row A has no `a`")
    assert note.endswith("after mending it run `savmap align`")


def test_the_runs_record_counts_skipped_frames(tmp_path: Path) -> None:
    job = job_for(EXAMPLE / "site.yaml", None, tmp_path)
    path = Trajectory(np.zeros(0, np.int64), np.zeros((0, 4, 4)))
    row = RowMap("A", FrameTable(np.zeros(0), ()), {}, path, {}, (), {SKIPPED: 3})
    nothing: Any = None
    assert _Progress(job, nothing, nothing, nothing, (), nothing).row_run("A", row).skipped == 3


def test_warning_of_mapping_is_left_to_its_task(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def warns(*_: object, **__: object) -> None:
        logging.getLogger("savmap_things").warning("row A: one too many")
        raise PluginError("enough")

    monkeypatch.setattr("savmap.jobs.map_site.map_rows_of", warns)
    notes = NoteCollector()
    with pytest.raises(PluginError, match="enough"):
        map_job_into(job_for(EXAMPLE / "site.yaml", None, tmp_path), RunOptions(jobs=0), notes)
    assert notes.lines == []


def test_viewer_of_a_run_is_of_its_map(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    job = job_for(EXAMPLE / "site.yaml", None, tmp_path)
    name = next(iter(job.site.rows))
    path = Trajectory(np.zeros(0, np.int64), np.zeros((0, 4, 4)))
    mapped = MappedRows({name: RowMap(name, FrameTable(np.zeros(0), ()), {}, path, {}, ())}, {}, RunLog(rows={}))
    monkeypatch.setattr("savmap.jobs.map_site.map_rows_of", lambda *_, **__: mapped)
    map_job_into(job, RunOptions(jobs=0), NoteCollector())
    assert viewed(tmp_path, job.site.survey) == (tmp_path / "view.html", False)


def test_record_of_a_run_tells_when_it_ended_and_its_footage(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1770000000")
    job = job_for(EXAMPLE / "site.yaml", None, tmp_path)
    name, passes = next((name, row.passes) for name, row in job.site.rows.items())
    log = with_footage(job, RunLog(rows={name: RowRun(status="mapped"), "gone": RowRun(status="failed")}))
    assert log.ended == "2026-02-02T02:40:00.00Z"
    assert log.rows[name].footage == {"pass 1": FootageFile(name=passes[0].video.name, width=2048, height=1024)}
    missing = passes[0].model_copy(update={"video": tmp_path / "gone.mp4"})
    rows = {name: job.site.rows[name].model_copy(update={"passes": (missing,)})}
    log = with_footage(replace(job, site=job.site.model_copy(update={"rows": rows})), log)
    assert log.rows[name].footage == {"pass 1": FootageFile(name="gone.mp4")}


def test_what_the_site_file_confirms_is_a_note_of_the_map(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    what, action = "an element was measured in few frames", "look whether it is there: bay 1 / beam 2"
    doubt = Doubt("support", what, place=(1.0, 2.0, 0.0), figure="3 of 40 frames", action=action)
    lines = overrides_of([f'rows.A.confirmed=["{doubt.line}", "light 9 is a window"]'], {})
    job = job_for(EXAMPLE / "site.yaml", None, tmp_path, overrides=lines)
    path = Trajectory(np.zeros(0, np.int64), np.zeros((0, 4, 4)))
    row = RowMap("A", FrameTable(np.zeros(0), ()), {}, path, {}, (), verdict=Verdict((doubt,)))
    monkeypatch.setattr(
        "savmap.jobs.map_site.map_rows_of", lambda *_, **__: MappedRows({"A": row}, {}, RunLog(rows={}))
    )
    notes = NoteCollector()
    run = map_job_into(job, RunOptions(jobs=0), notes)
    assert run.site_map.rows["A"].verdict == Verdict((), (f"confirmed in the site file: {doubt.line}",))
    assert notes.lines == ["row A: `confirmed` has a line that no doubt says now: light 9 is a window"]


def test_pictures_of_rows_that_are_gone_are_removed_and_nothing_else(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    path = Trajectory(np.zeros(0, np.int64), np.zeros((0, 4, 4)))
    job = job_for(EXAMPLE / "site.yaml", None, tmp_path)
    name = next(iter(job.site.rows))
    rows = {row: RowMap(row, FrameTable(np.zeros(0), ()), {}, path, {}, ()) for row in (name, "old")}
    write_map(SiteMap({"old": rows["old"]}, {}, {"older": "no scale"}), tmp_path / "map.json")
    ours = [f"{kind}-{row}.png" for kind in ("face", "plan") for row in ("old", "older")]
    ours += [f"face-old.{end}" for end in ("jpg", "json", "jgw", "jpg.aux.xml", "svg")]
    theirs = ["face-mine.png", "plan-oldest.png", "notes-old.txt", "face-old.pdf", "errors-old.png"]
    for file in (*ours, *theirs):
        (tmp_path / file).write_text("of an earlier run", encoding="utf-8")
    mapped = MappedRows({name: rows[name]}, {}, RunLog(rows={}))
    monkeypatch.setattr("savmap.jobs.map_site.map_rows_of", lambda *_, **__: mapped)
    map_job_into(job, RunOptions(jobs=0), NoteCollector())
    left = {file.name for file in tmp_path.iterdir()}
    assert not left & set(ours)
    assert {*theirs, "map.json", f"face-{name}.png", f"plan-{name}.png"} <= left


def test_pictures_of_a_row_that_is_refused_now_are_removed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    path = Trajectory(np.zeros(0, np.int64), np.zeros((0, 4, 4)))
    job = job_for(EXAMPLE / "site.yaml", None, tmp_path)
    name, other = next(iter(job.site.rows)), "other"
    job = replace(job, site=job.site.model_copy(update={"rows": {**job.site.rows, other: job.site.rows[name]}}))
    rows = {row: RowMap(row, FrameTable(np.zeros(0), ()), {}, path, {}, ()) for row in (name, other)}
    write_map(SiteMap(rows, {}), tmp_path / "map.json")
    (tmp_path / f"face-{other}.jpg").write_text("of an earlier run", encoding="utf-8")
    failed = Failure(SolveError("no scale"))
    mapped = MappedRows({name: rows[name]}, {other: failed}, RunLog(rows={}))
    monkeypatch.setattr("savmap.jobs.map_site.map_rows_of", lambda *_, **__: mapped)
    map_job_into(job, RunOptions(jobs=0), NoteCollector())
    assert not (tmp_path / f"face-{other}.jpg").exists()


@pytest.mark.parametrize("content", ["", "[]", '{"rows": {"old": 1}}', '{"format": "savmap-map", "rows": ["old"]}'])
def test_where_no_earlier_map_tells_its_rows_nothing_is_removed(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, content: str
) -> None:
    job = job_for(EXAMPLE / "site.yaml", None, tmp_path)
    path = Trajectory(np.zeros(0, np.int64), np.zeros((0, 4, 4)))
    name = next(iter(job.site.rows))
    mapped = MappedRows({name: RowMap(name, FrameTable(np.zeros(0), ()), {}, path, {}, ())}, {}, RunLog(rows={}))
    monkeypatch.setattr("savmap.jobs.map_site.map_rows_of", lambda *_, **__: mapped)
    (tmp_path / "map.json").write_text(content, encoding="utf-8")
    (tmp_path / "face-old.png").touch()
    map_job_into(job, RunOptions(jobs=0), NoteCollector())
    assert (tmp_path / "face-old.png").is_file()
