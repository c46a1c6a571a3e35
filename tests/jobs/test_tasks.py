"""Work: what plugins warn of reaches the user, the log and the map."""

import logging

import numpy as np

from savmap.jobs.tasks import warnings_as_notes, with_notes
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
