"""Depths of what a run kept: by its strips and orthophoto, none where either is missing or damaged."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from savmap.files.serialization import packed
from savmap.jobs import depths
from savmap.jobs.cache import FolderCache
from savmap.jobs.scheduler import STRIPS
from savmap.maps.orthophoto_file import write_orthophoto
from savmap.types import FrameTable, Orthophoto, PlanePatch, RowMap, RowStrips, Trajectory

ROW = RowMap("A", FrameTable(np.zeros(1), ("pass 1",)), {}, Trajectory(np.arange(1), np.eye(4)[None]), {}, ())


def test_depths_are_of_the_strips_and_the_face_that_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[PlanePatch, RowStrips, Trajectory]] = []
    monkeypatch.setattr(depths, "face_depths", lambda *given: asked.append(given))
    assert depths.kept_depths(tmp_path, ROW) is None
    FolderCache(tmp_path).save("A", STRIPS, "key", packed(RowStrips()))
    assert depths.kept_depths(tmp_path, ROW) is None
    assert asked == [], "there is no face"
    picture = np.asarray(cv2.imencode(".jpg", np.zeros((40, 50, 3), np.uint8))[1], np.uint8).ravel()
    write_orthophoto("A", Orthophoto(np.ones(3), np.eye(3)[0], np.eye(3)[1], 0.01, 50, 40, picture), tmp_path)
    depths.kept_depths(tmp_path, ROW)
    (face, strips, path), *others = asked
    assert not others
    assert (face.origin.tolist(), face.size.tolist()) == ([1, 1, 1], pytest.approx([0.5, 0.4]))
    assert (strips.strips, path) == ((), ROW.trajectory)
    file = next(tmp_path.glob("stages/*/strips"))
    file.write_bytes(file.read_bytes()[:-1])
    assert depths.kept_depths(tmp_path, ROW) is None
    assert len(asked) == 1, "what is damaged is not used"
