"""Work: what plugins warn of reaches the user, the log and the map."""

import logging
from pathlib import Path

import numpy as np

from savmap.jobs.tasks import warnings_as_notes, with_notes
from savmap.pipeline.drive import recordings
from savmap.site.model import Pass
from savmap.types import FrameTable, RowMap, Trajectory
from savmap.types.progress import NoteCollector


def row() -> RowMap:
    path = Trajectory(np.zeros(0, np.int64), np.zeros((0, 4, 4)))
    return RowMap("A", FrameTable(np.zeros(0), ()), {}, path, {}, (), {"frames": 0, "note 1": "seen"})


def test_warnings_of_plugins_become_notes() -> None:
    heard = NoteCollector()
    with warnings_as_notes(heard):
        logging.getLogger("savmap_things.tracking").warning("row A: a %s too many", "thing")
        logging.getLogger("savmap").warning("told already")
        logging.getLogger("savmap_things.tracking").info("of no interest")
    logging.getLogger("savmap_things").error("after it")
    assert heard.lines == ["row A: a thing too many"]


def test_a_rows_notes_stand_in_its_report() -> None:
    noted = with_notes(row(), ["row A: one", "row B: other", "row A: two"])
    assert noted.report == {"frames": 0, "note 1": "seen", "note 2": "one", "note 3": "two"}


def test_passes_of_one_video_are_one_recording(tmp_path: Path) -> None:
    video, folder = tmp_path / "aisle.mp4", tmp_path / "pictures"
    folder.mkdir()
    passes = [
        Pass(video=video, start_s=0, end_s=60),
        Pass(video=video, start_s=50, fps=5),
        Pass(video=folder, fps=5),
        Pass(video=folder, fps=10),
    ]
    found = recordings(passes)
    assert list(found) == ["pass 1", "pass 2", "pass 3", "pass 4"]
    assert found["pass 1"] == found["pass 2"] == video
    assert len(set(found.values())) == 3


def test_a_video_at_a_url_is_not_looked_for() -> None:
    one = Pass.model_validate({"video": "memory://bucket/aisle.mp4"})
    assert recordings([one, one])["pass 1"] == one.video
