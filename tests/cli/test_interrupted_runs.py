"""A run that is cut off says what its folder keeps, and the command that goes on."""

import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from savmap.cli.app import main
from savmap.errors import SavmapError
from savmap.files import journal as journals
from savmap.files.journal import Journal
from savmap.jobs import tasks
from savmap.jobs.cache import FolderCache
from savmap.jobs.map_site import map_job_into
from savmap.jobs.scheduler import RunOptions
from savmap.pipeline.records import FrameRecord, MeasuredRow, RowMeasurements, RowRequest
from savmap.site.job import job_for
from savmap.types import FrameTable, RowFacts
from savmap.types.progress import Monitor, SilentMonitor
from savmap.vision.markers import MarkerTracks

from ..video.made_up_video import evenly, write_video

SITE = """
plugins: {shelves: {}}
references: {camera_height_m: 3.0}
rows:
  A: {passes: [{video: a.mp4}]}
  B: {fps: 5, passes: [{video: b.mp4}]}
"""
EARLIER: dict[str, int] = {}


def measure(requests: Sequence[RowRequest], journal: Journal, monitor: Monitor) -> list[SavmapError]:
    """Row A is measured at once; row B is interrupted after three more frames."""
    (row,) = (request.name for request in requests)
    EARLIER[row] = journal.earlier[row]
    if row == "B":
        for frame in range(EARLIER[row], EARLIER[row] + 3):
            journal.add(row, frame, FrameRecord({}))
        assert all(journal.get(FrameRecord, row, frame) for frame in range(EARLIER[row] + 3))
        raise KeyboardInterrupt
    return [SavmapError("nothing is there")]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in ("a.mp4", "b.mp4"):
        write_video(tmp_path / name, evenly(60, 30))
    (tmp_path / "site.yaml").write_text(SITE, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(journals, "KEEP_S", 0.0)
    monkeypatch.setattr(tasks, "measure", measure)
    return tmp_path


def said(command: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> list[str]:
    monkeypatch.setattr(sys, "argv", shlex.split(command))
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 130
    return capsys.readouterr().err.splitlines()


def test_interrupt_says_what_is_kept_and_how_to_go_on(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    again = "savmap map --jobs 0 -o 'my out'"
    keeps = f"my out keeps row B ({{}} of 10 frames); go on with `{again}`"
    assert said(f"{again} --fresh", monkeypatch, capsys)[-2:] == [keeps.format(3), "savmap: interrupted"]
    assert EARLIER["B"] == 0
    assert said(again, monkeypatch, capsys)[-2] == keeps.format(6)
    assert EARLIER["B"] == 3
    assert said(f"{again} --fresh", monkeypatch, capsys)[-2] == keeps.format(3)
    assert EARLIER["B"] == 0
    assert said(f"{again} --set rows.B.fps=6", monkeypatch, capsys)[-2].startswith(
        "my out keeps row B (3 of 12 frames)"
    )


def test_after_a_fresh_run_nothing_of_an_earlier_one_is_used(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Also where it is cut off, and goes on without --fresh."""
    kept = FolderCache(folder / "out")
    kept.save("B", "measured", "key", b"of an earlier run")
    said("savmap map --jobs 0", monkeypatch, capsys)
    said("savmap map --jobs 0 --fresh", monkeypatch, capsys)
    assert kept.load("B", "measured", None) is None
    assert EARLIER["B"] == 0
    said("savmap map --jobs 0", monkeypatch, capsys)
    assert EARLIER["B"] == 3


def test_frames_are_forgotten_when_their_row_is_measured(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def measured(requests: Sequence[RowRequest], journal: Journal, monitor: Monitor) -> list[MeasuredRow]:
        (request,) = requests
        journal.add(request.name, 0, FrameRecord({}))
        written = [path.name for path in (folder / "out" / "stages" / request.name).iterdir()]
        assert written == ["frames"]
        facts = RowFacts(request.name, FrameTable(np.zeros(1), ("pass 1",)), {}, {})
        return [MeasuredRow(request, RowMeasurements(facts, {}, {}, frozenset(), (), MarkerTracks({}, {})))]

    monkeypatch.setattr(tasks, "measure", measured)
    job = job_for(folder / "site.yaml", None, folder / "out")
    with pytest.raises(SavmapError):
        map_job_into(job, RunOptions(0), SilentMonitor())
    kept = {path.name for path in (folder / "out" / "stages").rglob("*") if path.is_file()}
    assert kept == {"measured", "strips"}
