"""What a run makes of passes along rows of an earlier map: that map, updated, by its rows' names."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from savmap.errors import RowsFailedError, StructureError, VideoError
from savmap.jobs.map_site import MAP, map_job_into
from savmap.jobs.returning import back_in_map
from savmap.jobs.scheduler import MappedRows, RunOptions
from savmap.maps.map_file import read_map, write_map
from savmap.maps.run_record import RowRun, RunLog
from savmap.site.job import Job, job_for
from savmap.types import RowMap, Structure
from savmap.types.progress import NoteCollector

sys.path.insert(0, str(Path(__file__).parent / "comparison"))
import mapped_place as place

EXAMPLE = Path(__file__).parents[3] / "examples" / "aisle-dev"
BAYS = place.irregular(5)


def lamps_of(row: RowMap) -> RowMap:
    """The row as a plugin that is installed might have mapped it."""
    posts = [part for part in row.structures["racks"] if part.label == "post"]
    edges, up = np.zeros((0, 2), np.int64), np.array([0.0, 4.0, 0.0])
    lamps = [
        Structure(name, "light", post.vertices[:1] + up, post.covariances[:1], (f"{name} / centre",), edges)
        for name, post in ((f"light {k}", post) for k, post in enumerate(posts, 1))
    ]
    return replace(row, structures={"lights": tuple(lamps)})


@pytest.fixture
def job(tmp_path: Path) -> Job:
    site = place.mapped(BAYS, 1)
    write_map(replace(site, rows={"A": lamps_of(site.rows["A"])}), tmp_path / "before" / MAP)
    return job_for(EXAMPLE / "site.yaml", ["lights"], tmp_path / "out", against=tmp_path / "before")


def mapped(*names: str, **failed: VideoError) -> MappedRows:
    row = lamps_of(place.mapped(BAYS, 2).rows["A"])
    log = RunLog(rows={name: RowRun(status="mapped") for name in (*names, *failed)})
    return MappedRows(dict.fromkeys(names, row), failed, log)


def test_rows_are_called_as_in_the_map(job: Job) -> None:
    rows, site_map, changes = back_in_map(job, mapped("1", B=VideoError("b.mp4: empty")), {"savmap": "2"})
    assert (list(rows.rows), list(rows.log.rows)) == (["A"], ["A", "B"])
    assert site_map.failed == {"B": "b.mp4: empty"}
    assert site_map.made_by == {"savmap": "2"}
    assert {change.state for change in changes.comparison.rows[0].elements} == {"same"}


def test_a_row_that_failed_is_told(job: Job, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("savmap.jobs.map_site.map_rows_of", lambda *_, **__: mapped("1", A=VideoError("empty")))
    job.output.mkdir()
    run = map_job_into(job, RunOptions(jobs=0), NoteCollector())
    assert not run.site_map.failed
    with pytest.raises(RowsFailedError, match=r"nothing is updated by row A, which could not be mapped; .*run.json"):
        run.raise_if_incomplete(job)


def test_two_rows_that_are_one_are_refused(job: Job) -> None:
    with pytest.raises(StructureError, match=r"rows 1 and 2 are both row A of .*map.json: give their videos as passes"):
        back_in_map(job, mapped("1", "2"), {})


def test_the_updated_map_and_its_changes_are_written(job: Job, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("savmap.jobs.map_site.map_rows_of", lambda *_, **__: mapped("A"))
    job.output.mkdir()
    run = map_job_into(job, RunOptions(jobs=0), NoteCollector())
    assert run.changes is not None
    assert not run.changes.comparison.changed
    assert {part.id for part in read_map(job.output / MAP).rows["A"].structures["lights"]} == {
        f"light {k}" for k in range(1, 7)
    }
    assert "light 3" in (job.output / "report.html").read_text(encoding="utf-8")
