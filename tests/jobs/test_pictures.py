"""Orthophotos in a run: made once, kept, made again where the map changes; a row without one is mapped all the same."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from savmap.errors import SavmapError, SiteError
from savmap.files.journal import Journal
from savmap.jobs import tasks
from savmap.jobs.cache import FolderCache
from savmap.jobs.map_site import write_photo
from savmap.jobs.scheduler import MappedRows, RunOptions, map_rows_of
from savmap.jobs.tasks import RowPicture
from savmap.maps.map_file import write_map
from savmap.pipeline.records import MeasuredRow, RowMeasurements, RowRequest
from savmap.report.page import Report
from savmap.site.job import job_for
from savmap.types import (
    FrameTable,
    Orthophoto,
    PlanePatch,
    RowFacts,
    RowMap,
    RowStrips,
    SiteMap,
    Strip,
    Trajectory,
)
from savmap.types.progress import Monitor, NoteCollector
from savmap.vision.markers import MarkerTracks

EXAMPLE = Path(__file__).parents[2] / "examples" / "aisle-dev"
TABLE = FrameTable(np.zeros(1), ("pass 1",))
FACE = PlanePatch("face", np.zeros(3), np.eye(3)[0], np.eye(3)[1], np.ones(2), 0.1)
GREY = np.asarray(cv2.imencode(".jpg", np.full((3, 4), 90, np.uint8))[1], np.uint8).ravel()
PHOTO = Orthophoto(np.zeros(3), np.eye(3)[0], np.eye(3)[1], 0.005, 4, 3, GREY)


@dataclass
class Work:
    """Steps that do nothing, and a note of each that was asked for."""

    done: list[str] = field(default_factory=list)
    photo: Orthophoto | None = PHOTO
    failure: SavmapError | None = None

    def measure(self, requests: Sequence[RowRequest], journal: Journal, monitor: Monitor) -> list[MeasuredRow]:
        (request,) = requests
        self.done.append("measured with strips" if request.strips else "measured")
        marks, facts = MarkerTracks((), {}), RowFacts(request.name, TABLE, {}, {})
        seen = RowMeasurements(facts, {plugin.name: () for plugin in request.plugins}, {}, frozenset(), (), marks)
        return [MeasuredRow(request, seen, strips=RowStrips({}, (Strip(0, "face", np.zeros(2, np.uint8)),)))]

    def solve(self, measured: Sequence[MeasuredRow], monitor: Monitor) -> list[RowMap]:
        self.done.append("solved")
        return [mapped(row.request.name) for row in measured]

    def picture(self, row: RowMap, strips: RowStrips) -> RowPicture:
        self.done.append("pictured")
        assert len(strips.strips) == 1
        if self.failure:
            raise self.failure
        return RowPicture(self.photo)


def mapped(name: str) -> RowMap:
    return RowMap(name, TABLE, {}, Trajectory(np.zeros(1, np.int64), np.eye(4)[None]), {}, (), face=FACE)


@pytest.fixture
def work(monkeypatch: pytest.MonkeyPatch) -> Work:
    steps = Work()
    for name, step in (("measure", steps.measure), ("map_rows", steps.solve), ("picture_of", steps.picture)):
        monkeypatch.setattr(tasks, name, step)
    return steps


def run(
    cache: FolderCache, folder: Path, notes: NoteCollector | None = None, orthophotos: bool = True, **overrides: float
) -> MappedRows:
    job = job_for(EXAMPLE / "site.yaml", ["lights"], folder)
    references = job.site.references.model_copy(update=overrides)
    job = replace(job, site=job.site.model_copy(update={"references": references}))
    return map_rows_of(job, RunOptions(0), notes or NoteCollector(), cache, orthophotos)


def test_picture_is_made_once_and_kept(work: Work, tmp_path: Path) -> None:
    cache = FolderCache(tmp_path)
    first = run(cache, tmp_path)
    assert work.done == ["measured with strips", "solved", "pictured"]
    assert (first.orthophotos["A"].picture == PHOTO.picture).all()
    assert list(first.log.rows["A"].seconds) == ["measured", "solved", "pictured"]
    again = run(cache, tmp_path)
    assert len(work.done) == 3
    assert (again.orthophotos["A"].picture == PHOTO.picture).all()
    assert again.log.rows["A"].status == "kept"


def test_picture_lost_is_made_of_kept_strips(work: Work, tmp_path: Path) -> None:
    cache = FolderCache(tmp_path)
    run(cache, tmp_path)
    (tmp_path / "stages" / "A" / "pictured").unlink()
    again = run(cache, tmp_path)
    assert work.done[3:] == ["pictured"]
    assert again.log.rows["A"].status == "kept"


def test_new_references_solve_and_picture_again(work: Work, tmp_path: Path) -> None:
    cache = FolderCache(tmp_path)
    run(cache, tmp_path)
    run(cache, tmp_path, travel_m=16.0)
    assert work.done[3] == "solved"
    assert "measured with strips" not in work.done[3:]


def test_a_map_that_changes_while_it_is_used_is_told_and_not_kept(
    work: Work, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The next run is of the map as it is then."""
    earlier, cache = tmp_path / "before" / "map.json", FolderCache(tmp_path)
    write_map(SiteMap({"A": mapped("A")}, {}), earlier)
    job = job_for(EXAMPLE / "site.yaml", ["lights"], tmp_path, against=earlier)

    def changes(measured: Sequence[MeasuredRow], monitor: Monitor) -> list[RowMap]:
        write_map(SiteMap({"A": mapped("A"), "B": mapped("B")}, {}), earlier)
        return work.solve(measured, monitor)

    monkeypatch.setattr(tasks, "map_rows", changes)
    with pytest.raises(SiteError, match=r"--against: .*map.json was changed while row A was mapped; run it again"):
        map_rows_of(job, RunOptions(0), NoteCollector(), cache)
    monkeypatch.setattr(tasks, "map_rows", work.solve)
    assert map_rows_of(job, RunOptions(0), NoteCollector(), cache).log.rows["A"].status == "mapped"
    assert work.done == ["measured", "solved", "solved"]


def test_rows_measured_without_strips_are_measured_again(work: Work, tmp_path: Path) -> None:
    cache = FolderCache(tmp_path)
    assert run(cache, tmp_path, orthophotos=False).orthophotos == {}
    assert work.done == ["measured", "solved"]
    assert "A" in run(cache, tmp_path).orthophotos
    assert work.done[2:] == ["measured with strips", "pictured"]


def test_stills_wanted_later_are_measured_again(work: Work, tmp_path: Path) -> None:
    cache = FolderCache(tmp_path)
    job = job_for(EXAMPLE / "site.yaml", ["lights"], tmp_path)
    without = replace(job, site=job.site.model_copy(update={"panoramas": False}))
    map_rows_of(without, RunOptions(0), NoteCollector(), cache, True)
    map_rows_of(job, RunOptions(0), NoteCollector(), cache, True)
    assert work.done == ["measured with strips", "solved", "pictured", "measured with strips", "pictured"]


def test_strips_reach_the_picture_where_nothing_is_kept(work: Work, tmp_path: Path) -> None:
    assert "A" in run(FolderCache(tmp_path / "none"), tmp_path).orthophotos


def test_row_without_a_picture_is_mapped_all_the_same(work: Work, tmp_path: Path) -> None:
    work.photo = None
    assert run(FolderCache(tmp_path), tmp_path).orthophotos == {}
    work.failure, notes = SavmapError("no room"), NoteCollector()
    mapped = run(FolderCache(tmp_path / "none"), tmp_path, notes)
    assert list(mapped.rows) == ["A"]
    assert mapped.orthophotos == {}
    assert "row A: no orthophoto: no room" in notes.lines


def test_row_whose_face_is_not_known_has_no_picture() -> None:
    path = Trajectory(np.zeros(1, np.int64), np.eye(4)[None])
    mapped = RowMap("A", TABLE, {}, path, {}, ())
    assert tasks.picture_of(mapped, RowStrips()).orthophoto is None


def test_old_picture_does_not_stay_beside_a_map_without(tmp_path: Path) -> None:
    with_photo = Report(SiteMap({}, {}), {"A/1": []}, photos={"A/1": PHOTO})
    (picture,) = write_photo("A/1", with_photo, tmp_path)
    names = [f"face-A%2F1.{ending}" for ending in ("jgw", "jpg", "jpg.aux.xml", "json", "svg")]
    assert picture.name == names[1]
    assert sorted(path.name for path in tmp_path.iterdir()) == names
    assert write_photo("A/1", replace(with_photo, photos={}), tmp_path) == []
    assert not list(tmp_path.iterdir())
