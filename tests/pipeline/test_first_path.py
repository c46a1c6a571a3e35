"""The drive's path before a face: at the distance and turned as the evidence on the face's plane says."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from savmap.errors import StructureError
from savmap.files.journal import Journal
from savmap.geometry.pinhole import rig_from_view
from savmap.graph import References
from savmap.lab.adapt.faces import outline_in
from savmap.pipeline.first_path import paths_before_face
from savmap.pipeline.records import RowMeasurements, RowRequest, WalkedRow
from savmap.plugin.manager import LoadedPlugin, loaded_plugin
from savmap.site.model import Pass
from savmap.types import Floats, FrameTable, RowFacts, Trajectory, View, ViewSpec
from savmap.vision.evidence import PackedView
from savmap.vision.markers import MarkerTracks
from savmap.vision.networks.segmenter import Segmentation

from ..plugin.made_up_plugin import plugin_class
from .test_finding import LAMPS, Config

SPEC = ViewSpec("pass 1 / face", 0.0, hfov_deg=100.0, width=160, height=120)
COUNT, DISTANCE = 12, 1.3
UNIT = 1.8
"""The unit of the drive's path: what is followed lies further away than the face."""
POSTS = (-0.6, 0.5, 1.7, 3.1, 3.6)
AT_FACE = np.diag([1.0, -1.0, -1.0])
POSES = np.tile(np.eye(4), (COUNT, 1, 1))
"""Along the face z = 0 and a little to and fro."""
POSES[:, :3, :3] = AT_FACE
POSES[:, 0, 3], POSES[:, 2, 3] = np.linspace(0.0, 3.0, COUNT), DISTANCE + 0.05 * np.sin(np.arange(COUNT))


@cache
def seen(frame: int) -> PackedView:
    """A frame in which the network sees posts and a beam."""
    maps = np.zeros((2, SPEC.height, SPEC.width), np.float32)
    for x, y, width, height in [*((x, -0.8, 0.1, 1.6) for x in POSTS), (-0.6, 0.3, 4.3, 0.1)]:
        corners = np.array([[x, y, 0], [x + width, y, 0], [x + width, y + height, 0], [x, y + height, 0]])
        outline = outline_in(SPEC, POSES[frame], corners)
        if outline is not None:
            cv2.fillConvexPoly(maps[1], np.round(16 * outline).astype(np.int32), 0.9, cv2.LINE_8, 4)
    maps[0] = 1 - maps[1]
    view = View(SPEC, frame, frame / 6, np.zeros((SPEC.height, SPEC.width, 3), np.uint8))
    return PackedView.of(view, Segmentation(("light",), maps))


@pytest.fixture(scope="module")
def plugin() -> LoadedPlugin:
    return loaded_plugin("one", plugin_class(classes=("light",), model=LAMPS), Config())


def drives_own(poses: Floats, unit: float = UNIT) -> Floats:
    """Poses as a drive knows them: in the frame of the first, in another unit."""
    own = np.linalg.inv(poses[0]) @ poses
    own[:, :3, 3] /= unit
    return np.asarray(own)


def row(
    plugin: LoadedPlugin,
    walked: Trajectory | None,
    attitude: Floats = AT_FACE,
    passes: tuple[str, ...] = ("pass 1",) * COUNT,
) -> WalkedRow:
    """A row in whose frames the network sees the face from `POSES`."""
    specs = {name: replace(SPEC, name=f"{name} / face") for name in passes}
    table = FrameTable(np.arange(len(passes)) / 6, passes)
    facts = RowFacts("A", table, {spec.name: spec for spec in specs.values()}, {"pass 1": 1})
    measured = RowMeasurements(
        facts,
        {"one": []},
        dict.fromkeys(passes, attitude),
        frozenset({"one"}),
        (),
        MarkerTracks({}, {}),
        walked=walked,
    )
    views = [
        replace(seen(frame % COUNT), frame=frame, view=specs[row_pass].name) for frame, row_pass in enumerate(passes)
    ]
    request = RowRequest("A", (Pass(video=Path("a.mp4")),), [], References())
    return WalkedRow(request, measured, plugins=[plugin], packed_views={"one": views}, journal=Journal())


def whole() -> Trajectory:
    return Trajectory(np.arange(COUNT), drives_own(POSES))


def turned(degrees: float) -> Floats:
    """The attitude before the face, turned about the upright."""
    return np.asarray(rig_from_view(degrees, 0.0, 0.0).T @ AT_FACE)


@pytest.mark.parametrize("off_deg", [0.0, 0.75, -0.5])
def test_a_path_is_laid_where_the_evidence_is_sharpest(plugin: LoadedPlugin, off_deg: float) -> None:
    """Distance and turn are found, where edges tell the turn to a degree; the path's form and unit stay."""
    (path,) = paths_before_face(row(plugin, whole(), turned(off_deg)), plugin)
    assert path.frames.tolist() == [*range(COUNT)]
    assert UNIT * path.world_from_rig[:, 2, 3] == pytest.approx(POSES[:, 2, 3], rel=0.03)
    assert UNIT * np.diff(path.world_from_rig[:, 0, 3]) == pytest.approx(np.diff(POSES[:, 0, 3]), rel=0.01)
    assert degrees_off(path, POSES) < 0.3


def degrees_off(path: Trajectory, poses: Floats) -> float:
    """The largest angle by which a path is turned otherwise."""
    off = path.world_from_rig[:, :3, :3] @ poses[:, :3, :3].transpose(0, 2, 1)
    return float(np.degrees(Rotation.from_matrix(off).magnitude()).max())


def test_each_pass_has_a_path_of_its_own(plugin: LoadedPlugin) -> None:
    """Each in a frame and a unit of its own, of frames whose pose is known."""
    back = Trajectory(np.arange(COUNT + 1, 2 * COUNT), drives_own(POSES[1:], UNIT / 0.8))
    both = row(plugin, Trajectory.joined([whole(), back]), AT_FACE, ("pass 1",) * COUNT + ("pass 2",) * COUNT)
    first, second = paths_before_face(both, plugin)
    assert (first.frames.tolist(), second.frames.tolist()) == ([*range(COUNT)], [*range(COUNT + 1, 2 * COUNT)])
    assert UNIT * np.median(first.world_from_rig[:, 2, 3]) == pytest.approx(np.median(POSES[:, 2, 3]), rel=0.02)
    assert UNIT / 0.8 * np.median(second.world_from_rig[:, 2, 3]) == pytest.approx(np.median(POSES[1:, 2, 3]), rel=0.02)


def test_frames_in_which_the_face_is_not_looked_at_tell_nothing(plugin: LoadedPlugin) -> None:
    """A live drive measures in few of its frames, and knows the poses of all."""
    between = np.repeat(whole().world_from_rig, 9, axis=0)
    frames = np.arange(len(between))
    live = row(plugin, Trajectory(frames, between), AT_FACE, ("pass 1",) * len(frames))
    looked_at = [replace(seen(number), frame=9 * number + 4) for number in range(COUNT)]
    (path,) = paths_before_face(replace(live, packed_views={"one": looked_at}), plugin)
    assert path.frames.tolist() == frames.tolist()
    assert UNIT * path.world_from_rig[4::9, 2, 3] == pytest.approx(POSES[:, 2, 3], rel=0.03)


def test_a_row_whose_camera_hardly_moves_is_refused(plugin: LoadedPlugin) -> None:
    """A few centimetres along it are too little."""
    poses = np.tile(POSES[0], (COUNT, 1, 1))
    poses[:, 0, 3] += np.linspace(0.0, 0.03, COUNT)
    still = row(plugin, Trajectory(np.arange(COUNT), drives_own(poses)))
    views = [replace(seen(0), frame=frame) for frame in range(COUNT)]
    with pytest.raises(StructureError, match=r"row A, pass 1: too little motion: the camera moved 0\.0\d of its dist"):
        paths_before_face(replace(still, packed_views={"one": views}), plugin)


@pytest.mark.parametrize("known", [0, 2, None])
def test_a_path_that_is_not_known_is_refused(plugin: LoadedPlugin, known: int | None) -> None:
    """In one of two passes no pose is known, or too few are; or in none at all."""
    passes, path = ("pass 1",) * COUNT + ("pass 2",) * COUNT, None
    if known is not None:
        some = Trajectory(np.arange(COUNT, COUNT + known), drives_own(POSES)[:known])
        path = Trajectory.joined([whole(), some])
    name = "pass 1" if known is None else "pass 2"
    with pytest.raises(
        StructureError, match=f"row A, {name}: the camera's path is not known: it hardly moves, or too few points"
    ):
        paths_before_face(row(plugin, path, AT_FACE, passes), plugin)


def test_a_row_whose_direction_is_not_known_is_refused(plugin: LoadedPlugin) -> None:
    unknown = row(plugin, whole())
    unknown = replace(unknown, measurements=replace(unknown.measurements, attitudes={}))
    with pytest.raises(StructureError, match="A, pass 1: the face's direction was not found"):
        paths_before_face(unknown, plugin)
