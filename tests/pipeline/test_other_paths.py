"""The path of a drive, before the face of a row that did not tell it."""

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest

from savmap.errors import StructureError
from savmap.files.journal import Journal
from savmap.graph import References
from savmap.pipeline import other_paths
from savmap.pipeline.other_paths import path_beside, with_paths_of_others
from savmap.pipeline.records import MeasuredRow, RowMeasurements, RowRequest, WalkedRow
from savmap.plugin.manager import loaded_plugin
from savmap.site.model import Pass
from savmap.types import Floats, FrameTable, RowFacts, Trajectory, View, ViewSpec
from savmap.types.progress import NoteCollector
from savmap.vision.evidence import PackedView
from savmap.vision.evidence.planes import outline_in
from savmap.vision.markers import MarkerTracks
from savmap.vision.networks.segmenter import Segmentation

from ..plugin.made_up_plugin import plugin_class
from .test_finding import LAMPS, Config

SPEC = ViewSpec("pass 1 / face", 0.0, hfov_deg=100.0, width=160, height=120)
COUNT, DISTANCE, UNIT, AISLE = 16, 1.3, 1.4, 2.9
POSTS = (-0.6, 0.5, 1.7, 3.1, 3.6)
AT_FACE = np.diag([1.0, -1.0, -1.0])
TURNED = np.diag([-1.0, 1.0, -1.0])


def before_face(x: Floats, distance: float) -> Floats:
    """Poses (n, 4, 4) that look at z = 0."""
    poses = np.tile(np.eye(4), (len(x), 1, 1))
    poses[:, :3, :3] = AT_FACE
    poses[:, 0, 3], poses[:, 2, 3] = x, distance
    return poses


POSES = before_face(np.linspace(0.0, 3.0, COUNT), DISTANCE)


def seen(frame: int) -> PackedView:
    """A frame in which the network sees the posts."""
    maps = np.zeros((2, SPEC.height, SPEC.width), np.float32)
    for x in POSTS:
        corners = np.array([[x, -0.8, 0], [x + 0.1, -0.8, 0], [x + 0.1, 0.8, 0], [x, 0.8, 0]])
        outline = outline_in(SPEC, POSES[frame], corners)
        assert outline is not None
        cv2.fillConvexPoly(maps[1], np.round(16 * outline).astype(np.int32), 0.9, cv2.LINE_8, 4)
    maps[0] = 1 - maps[1]
    view = View(SPEC, frame, frame / 6, np.zeros((SPEC.height, SPEC.width, 3), np.uint8))
    return PackedView.of(view, Segmentation(("light",), maps))


def row(name: str, footage: str, attitude: Floats = AT_FACE) -> WalkedRow:
    """A row whose posts the network sees from `POSES`."""
    plugin = loaded_plugin("one", plugin_class(classes=("light",), model=LAMPS), Config())
    table = FrameTable(np.arange(COUNT) / 6, ("pass 1",) * COUNT)
    facts = RowFacts(name, table, {SPEC.name: SPEC}, {"pass 1": 1})
    attitudes = {"pass 1": attitude}
    measured = RowMeasurements(facts, {"one": []}, attitudes, frozenset({"one"}), (), MarkerTracks((), {}))
    request = RowRequest(name, (Pass(video=footage),), [], References())
    views = {"one": [seen(frame) for frame in range(COUNT)]}
    return WalkedRow(request, measured, plugins=[plugin], packed_views=views, journal=Journal())


def beyond(footage: str = "footage.mp4", frames: int = COUNT) -> MeasuredRow:
    """The row on the other side of the aisle, and its path, in another unit, of which some frames are known."""
    walked = row("B", footage, TURNED @ AT_FACE)
    poses = POSES.copy()
    poses[:, :3, :3] = TURNED @ AT_FACE
    poses[:, :3, 3] = UNIT * (POSES[:, :3, 3] @ TURNED + [4.0, 0.0, AISLE])
    path = Trajectory(np.arange(frames), poses[:frames])
    return MeasuredRow(walked.request, replace(walked.measurements, path=path))


@pytest.mark.slow
def test_the_path_of_the_row_across_the_aisle_is_laid_where_the_evidence_is_sharpest() -> None:
    path = path_beside(row("A", "footage.mp4"), beyond())
    assert path is not None
    assert np.median(path.world_from_rig[:, 2, 3]) / UNIT == pytest.approx(DISTANCE, rel=0.02)
    assert np.diff(path.world_from_rig[:, 0, 3]) / UNIT == pytest.approx(np.diff(POSES[:, 0, 3]), rel=0.01)
    assert path.world_from_rig[:, :3, :3] == pytest.approx(POSES[:, :3, :3], abs=0.02)


def test_rows_that_share_no_frames_lend_no_path() -> None:
    assert path_beside(row("A", "footage.mp4"), beyond("other.mp4")) is None
    assert path_beside(row("A", "footage.mp4"), beyond(frames=7)) is None
    located = beyond()
    assert (
        path_beside(row("A", "footage.mp4"), replace(located, measurements=row("B", "footage.mp4").measurements))
        is None
    )


def test_a_row_whose_structure_lies_in_no_plane_is_lent_no_path() -> None:
    assert path_beside(replace(row("A", "footage.mp4"), packed_views={}), beyond()) is None


@pytest.mark.slow
def test_a_row_that_does_not_tell_its_path_is_measured_along_that_of_another(monkeypatch: pytest.MonkeyPatch) -> None:
    def measured(walked: WalkedRow, monitor: Any, start: Trajectory) -> MeasuredRow:
        return MeasuredRow(walked.request, replace(walked.measurements, path=start))

    monkeypatch.setattr(other_paths, "find_structures", measured)
    failed, located, notes = StructureError("row A: no two uprights"), beyond(), NoteCollector()
    results = with_paths_of_others([row("A", "footage.mp4"), row("B", "footage.mp4")], [failed, located], notes)
    assert isinstance(results[0], MeasuredRow)
    assert results[0].measurements.path is not None
    assert results[1] is located
    assert notes.lines == ["row A: its face does not tell the camera's path; that of row B is used"]


@pytest.mark.slow
def test_a_row_that_is_not_found_along_another_path_either_keeps_its_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object) -> MeasuredRow:
        raise StructureError("row A: no beam")

    monkeypatch.setattr(other_paths, "find_structures", refused)
    failed = StructureError("row A: no two uprights")
    results = with_paths_of_others(
        [row("A", "footage.mp4"), row("B", "footage.mp4")], [failed, beyond()], NoteCollector()
    )
    assert results[0] is failed
