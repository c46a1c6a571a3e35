"""The path of a drive: its key frames are the frames of the rows, and a run that was cut off goes on with the same."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import BaseModel, ConfigDict

from savmap.files import journal as journals
from savmap.files.journal import Journal
from savmap.files.serialization import packed
from savmap.graph import References
from savmap.jobs.tasks import request_for
from savmap.maps.map_file import write_map
from savmap.pipeline import drive, key_frames
from savmap.pipeline.drive import RowWalk, before_face, breaks
from savmap.pipeline.records import DriveFrame, RowRequest, WalkedRow, drive_of
from savmap.pipeline.view_plans import PassPlan
from savmap.plugin.manager import LoadedPlugin, loaded_plugin
from savmap.plugin.segmenters import SegmenterPool
from savmap.site.job import job_for
from savmap.site.model import Pass
from savmap.types import (
    Feature,
    Floats,
    FrameTable,
    Panorama,
    RowMap,
    SiteMap,
    Trajectory,
    View,
    ViewPlan,
    ViewSpec,
)
from savmap.types.progress import SilentMonitor
from savmap.video.reader import Clip, DecodeReport
from savmap.vision.odometry import WalkedPath
from savmap.vision.views import Renderer

from ..plugin.made_up_plugin import plugin_class
from ..video.made_up_video import evenly, write_video
from .filmed_aisle import LEVEL, SIDES_M, aisle

LAMPS = Path(__file__).parents[2] / "plugins" / "lights" / "savmap_lights" / "model" / "lights.onnx"
COUNT, STEP_M, AWAY_M = 20, 0.12, SIDES_M[0]
SHARE = 0.3
"""Of these tests: five key frames."""
FACE, BEHIND = (ViewSpec("face", yaw, hfov_deg=120.0, width=96, height=64) for yaw in (0.0, 180.0))
BACK = LEVEL @ np.diag([-1.0, 1.0, -1.0])
"""The attitude before the wall across the aisle."""
Extract = Callable[[View], None]


class Config(BaseModel):
    model_config = ConfigDict(extra="forbid")


@pytest.fixture(scope="module", autouse=True)
def share() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(key_frames, "SHARE", SHARE)
        yield


@pytest.fixture(scope="module")
def filmed() -> list[Panorama]:
    """A drive along an aisle."""
    return [aisle(STEP_M * frame, frame) for frame in range(COUNT)]


@pytest.fixture(scope="module")
def whole(filmed: list[Panorama]) -> WalkedRow:
    """What the drive gives where nothing ends it."""
    (row,) = driven([walk_of()], filmed)
    return row


def room(looks: Extract) -> LoadedPlugin:
    """A plugin that measures the colour in the middle of its views."""

    def extract_features(self: object, view: View, detections: object) -> list[Feature]:
        looks(view)
        middle = view.image[32, 48, :2].astype(float)
        return [Feature(view.frame, view.spec.name, "light", "centre", 0, middle[None], np.eye(2)[None])]

    known = plugin_class(
        classes=("light",), model=LAMPS, detect=lambda self, view: [], extract_features=extract_features
    )
    return loaded_plugin("one", known, Config())


def walk_of(
    journal: Journal | None = None,
    looks: Extract = lambda view: None,
    row: str = "A",
    spec: ViewSpec = FACE,
    attitude: Floats = LEVEL,
    **asked: Any,
) -> RowWalk:
    """A row with one pass, which begins."""
    row_pass, plugin = Pass(video=Path("drive.mp4")), room(looks)
    plan = PassPlan("pass 1", Clip(row_pass.video), {"one": ViewPlan((spec,), attitude)})
    request = RowRequest(row, (row_pass,), [plugin], References(), appearance=True, **asked)
    walk = RowWalk((request, plan), SegmenterPool([plugin]), Renderer(), journal or Journal())
    walk.begin("pass 1", row_pass, SilentMonitor())
    return walk


def driven(walks: Sequence[RowWalk], panoramas: Sequence[Panorama]) -> list[WalkedRow]:
    """The walks along panoramas of which none is lost."""
    report = DecodeReport()
    with drive.Drive(walks, Renderer(), report) as along:
        known = along.resume()
        for panorama in panoramas[len(known) :]:
            report.whole_until_s = panorama.stamp_s
            along.add(panorama)
        along.finish()
    assert [walk.failure for walk in walks] == [None] * len(walks)
    return [walk.walked() for walk in walks]


def content(row: WalkedRow) -> bytes:
    """All that was measured, and followed."""
    seen = row.measurements
    return packed([seen.facts, seen.features, seen.walked, list(seen.flows), seen.tones, seen.warnings, row.floor])


def test_frames_are_as_far_apart_as_the_face_is_away(whole: WalkedRow) -> None:
    """The row's frames are those before which the camera moved on by 0.3 of its distance from the face; the path has
    this as its unit."""
    facts, path = whole.measurements.facts, whole.measurements.walked
    x = STEP_M * 15 * facts.frames.stamps_s
    assert len(x) == 5
    assert all(0.9 * SHARE * AWAY_M < gap < 1.1 * SHARE * AWAY_M + STEP_M for gap in np.diff(x)[1:])
    assert path is not None
    places = AWAY_M * path.world_from_rig[:, :3, 3]
    assert np.diff(places[:, 0]) == pytest.approx(np.diff(x[path.frames]), rel=0.05)
    assert np.ptp(places[:, 1:], axis=0).max() < 0.02
    assert [flow.frames.tolist() for flow in whole.measurements.flows] == [[0, 1, 2, 3]]
    assert len(whole.measurements.flows[0].pixels) > 20


@pytest.mark.parametrize("cut_off_at", [0, 2, 4])
def test_a_run_that_was_cut_off_goes_on_with_the_same_path(
    filmed: list[Panorama], whole: WalkedRow, cut_off_at: int, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """It ends while a frame of the row is measured; what was measured before is not measured again."""
    monkeypatch.setattr(journals, "KEEP_S", 0.0)
    asked, stops = list[int](), [True]

    def looks(view: View) -> None:
        asked.append(view.frame)
        if stops and view.frame == cut_off_at:
            raise KeyboardInterrupt

    def walked() -> WalkedRow:
        with Journal(kept) as journal:
            (row,) = driven([walk_of(journal, looks)], filmed)
        return row

    kept = tmp_path / "frames"
    with pytest.raises(KeyboardInterrupt):
        walked()
    stops.clear()
    asked.clear()
    assert content(walked()) == content(whole)
    assert asked == [*range(cut_off_at, len(whole.measurements.facts.frames))]


def test_a_run_that_ended_is_taken_up_without_following(
    filmed: list[Panorama], whole: WalkedRow, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """But for the last frame, whose picture is needed to follow points on from there."""
    kept = tmp_path / "frames"
    with Journal(kept) as journal:
        driven([walk_of(journal)], filmed[:8])
    with Journal(kept) as journal, drive.Drive([walk_of(journal)], Renderer(), DecodeReport()) as along:
        assert along.resume() == [panorama.stamp_s for panorama in filmed[:7]]
        for panorama in filmed[7:]:
            along.add(panorama)
        (row,) = along.snapshot()
    assert content(row) == content(whole)


def test_points_never_get_the_number_of_another_one(filmed: list[Panorama], tmp_path: Path) -> None:
    """Not even where a run is taken up at a frame in which nothing can be followed."""
    dark = replace(filmed[3], image=np.zeros_like(filmed[3].image))
    blinked = [*filmed[:3], dark, *filmed[4:7]]
    (uncut,) = driven([walk_of(whole := Journal())], blinked)
    kept = tmp_path / "frames"
    with Journal(kept) as journal:
        driven([walk_of(journal)], blinked[:4])
    with Journal(kept) as journal:
        (row,) = driven([walk_of(journal)], blinked)
        series = drive_of("A", "pass 1")
        for number in range(len(blinked)):
            frames = [one.get(DriveFrame, series, number) for one in (whole, journal)]
            first, second = (frame.followed.numbers.tolist() for frame in frames if frame is not None)
            assert first == second
    assert content(row) == content(uncut)


def test_a_snapshot_has_the_path_so_far(filmed: list[Panorama], whole: WalkedRow) -> None:
    """It needs no frame that follows, and the drive goes on after it."""
    with drive.Drive([walk_of()], Renderer(), DecodeReport()) as along:
        for panorama in filmed[:9]:
            along.add(panorama)
        (early,) = along.snapshot()
        for panorama in filmed[9:]:
            along.add(panorama)
        (late,) = along.snapshot()
    assert content(late) == content(whole)
    path, later = early.measurements.walked, late.measurements.walked
    assert path is not None
    assert later is not None
    count = len(path.frames)
    assert early.measurements.facts.frames.stamps_s.tolist() == late.measurements.facts.frames.stamps_s[:3].tolist()
    assert path.frames.tolist() == later.frames[:count].tolist()
    steps = [np.diff(one.world_from_rig[:count, 0, 3]) for one in (path, later)]
    assert steps[0] == pytest.approx(steps[1], rel=0.05)


def test_two_rows_get_the_same_key_frames_in_order(filmed: list[Panorama]) -> None:
    """A face on either hand: frames are as dense as the nearer of them asks for."""
    asked = list[tuple[str, int, float]]()

    def watcher(row: str) -> Extract:
        return lambda view: asked.append((row, view.frame, view.stamp_s))

    walks = [walk_of(looks=watcher("A")), walk_of(looks=watcher("B"), row="B", spec=BEHIND, attitude=BACK)]
    first, second = driven(walks, filmed)
    stamps = first.measurements.facts.frames.stamps_s.tolist()
    assert second.measurements.facts.frames.stamps_s.tolist() == stamps
    assert asked == [(row, frame, stamp) for frame, stamp in enumerate(stamps) for row in "AB"]
    assert first.moments == second.moments
    near, far = first.measurements.walked, second.measurements.walked
    assert near is not None
    assert far is not None
    steps = [np.linalg.norm(np.diff(path.world_from_rig[:, :3, 3], axis=0), axis=1) for path in (near, far)]
    assert np.median(steps[0] / steps[1]) == pytest.approx(SIDES_M[1] / AWAY_M, rel=0.05)


def test_a_row_that_is_measured_again_alone_is_as_at_first(filmed: list[Panorama], tmp_path: Path) -> None:
    """Beside a row with a nearer face it had more frames, of other numbers."""
    kept = tmp_path / "frames"
    with Journal(kept) as journal:
        driven([walk_of(journal, row="B", spec=BEHIND, attitude=BACK), walk_of(journal)], filmed)
    with Journal(kept) as journal:
        (again,) = driven([walk_of(journal)], filmed)
    (alone,) = driven([walk_of()], filmed)
    assert content(again) == content(alone)


def test_where_an_earlier_map_has_frames_these_are_measured(filmed: list[Panorama], tmp_path: Path) -> None:
    """Its times are rounded; and a time is of one pass alone."""
    frames = FrameTable(np.array([1, 2, 7]) / 15, ("pass 1", "pass 1", "pass 2"))
    path = Trajectory(np.arange(3), np.tile(np.eye(4), (3, 1, 1)))
    write_map(SiteMap({"A": RowMap("A", frames, {}, path, {}, ())}, {}), tmp_path / "map.json")
    video = write_video(tmp_path / "a.mp4", evenly(9, 30))
    rows = f"{{A: {{passes: [{{video: {video}}}, {{video: {video}, start_s: 0.1}}]}}}}"
    (tmp_path / "site.yaml").write_text(f"plugins: {{lights: {{}}}}\nrows: {rows}\n")
    job = job_for(tmp_path / "site.yaml", None, tmp_path / "out", earlier=tmp_path / "map.json")
    request, asked = request_for(job, "A"), list[float]()
    walk = walk_of(looks=lambda view: asked.append(view.stamp_s))
    walk.request = replace(walk.request, path=request.path, path_s=request.path_s)
    (row,) = driven([walk], filmed)
    assert asked == [1 / 15, 2 / 15]
    assert row.measurements.facts.frames.stamps_s.tolist() == asked


def test_each_pass_has_a_path_of_its_own(filmed: list[Panorama], whole: WalkedRow, monkeypatch: Any) -> None:
    walk = walk_of()
    plan = replace(walk.plan, name="pass 2")
    monkeypatch.setattr(drive, "plan_pass", lambda *_: plan)
    driven([walk], filmed)
    walk.begin("pass 2", walk.request.passes[0], SilentMonitor())
    (row,) = driven([walk], filmed[:9])
    frames, path = row.measurements.facts.frames, row.measurements.walked
    assert frames.passes == ("pass 1",) * 5 + ("pass 2",) * 3
    assert path is not None
    first, second = (path.frames[np.isin(path.frames, frames.of_pass(name))] for name in ("pass 1", "pass 2"))
    assert whole.measurements.walked is not None
    assert first.tolist() == whole.measurements.walked.frames.tolist()
    assert second.tolist() == [number + 5 for number in first.tolist() if number < 3]
    assert all(a < b for a, b in pairwise(path.frames.tolist()))


def test_warnings_of_the_drive_name_the_frame_before_them() -> None:
    walk = RowWalk.__new__(RowWalk)
    walk.next, walk.keys = 7, [0, 4, 9]
    assert [walk._frame_at(number) for number in (0, 3, 4, 8, 9, 20)] == [4, 4, 5, 5, 6, 6]


@pytest.mark.parametrize(
    ("part", "seconds"),
    [([0, 0, 0, 0, 0, 0], []), ([-1] * 6, []), ([0, 0, -1, 1, 1, 1], [0.1]), ([0, 1, 1, 1, -1, 2], [0.0, 0.3])],
)
def test_where_a_path_breaks_off_is_told(part: list[int], seconds: list[float]) -> None:
    path = WalkedPath(np.tile(np.eye(4), (6, 1, 1)), np.array(part), np.zeros((6, 6)))
    warnings = [*breaks("pass 1", np.arange(6) / 10, path)]
    assert {warning.code for warning in warnings} <= {"missing-frames"}
    assert [warning.figure for warning in warnings] == [f"pass 1, at {second} s" for second in seconds]
    assert all("3 frames are left out" in warning.details[0] for warning in warnings)


def test_a_path_before_a_face_has_its_distance_as_unit() -> None:
    """Of a drive's longest part; the middle one of the distances that are known counts."""
    poses = np.tile(np.eye(4), (6, 1, 1))
    poses[:, 0, 3] = np.arange(6)
    path = WalkedPath(poses, np.array([0, 0, -1, 1, 1, 1]), np.zeros((6, 6)))
    laid = before_face(path, np.array([0, 2, 3, 4, 5]), [9.0, np.nan, np.nan, 4.0, 4.0])
    assert laid is not None
    assert laid.frames.tolist() == [2, 3, 4]
    assert laid.world_from_rig[:, 0, 3].tolist() == [0.75, 1.0, 1.25]
    assert before_face(path, np.array([0, 2]), [9.0, 9.0]) is None
    assert before_face(path, np.array([3, 4]), [np.nan, np.nan]) is None
