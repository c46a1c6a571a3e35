"""The drive: every frame is seen once; what runs ahead changes nothing of what plugins are asked, in which order, and what they see;
what is kept of a run that was cut off; points and markers that are followed."""

import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image as Pillow
from pydantic import BaseModel, ConfigDict

from savmap.errors import PluginError
from savmap.files import journal as journals
from savmap.files.journal import Journal
from savmap.files.serialization import packed
from savmap.graph import KnownMarker, References, camera_priors
from savmap.pipeline import drive
from savmap.pipeline.drive import RowWalk, Way, numbered
from savmap.pipeline.key_frames import KeyFrames
from savmap.pipeline.records import LocatedRow, RowMeasurements, RowRequest, WalkedRow
from savmap.pipeline.row import marker_constraints
from savmap.pipeline.view_plans import PassPlan
from savmap.plugin.isolation import isolated
from savmap.plugin.manager import LoadedPlugin, loaded_plugin
from savmap.plugin.segmenters import SegmenterPool
from savmap.site.model import Pass, Site
from savmap.site.preflight import tells_scale
from savmap.types import (
    Detection,
    Feature,
    FrameTable,
    Panorama,
    RowFacts,
    Trajectory,
    View,
    ViewPlan,
    ViewSpec,
)
from savmap.types.progress import SilentMonitor
from savmap.video.reader import Clip, DecodeReport, panoramas
from savmap.vision.markers import MarkerTracks
from savmap.vision.networks.segmenter import Segmenter
from savmap.vision.odometry import MOST_PASSED, WINDOW, Followed, Follower
from savmap.vision.views import Renderer

from ..plugin.made_up_plugin import plugin_class
from ..video.made_up_video import evenly, picture, write_video
from ..vision.test_markers import HEIGHT, TAG, corners_at, marked

ROOT = Path(__file__).parents[2]
LAMPS = ROOT / "plugins" / "lights" / "savmap_lights" / "model" / "lights.onnx"
AHEAD, UP = ViewSpec("ahead", 10.0, width=96, height=64), ViewSpec("up", 0.0, 80.0, width=96, height=64)
BACK = replace(AHEAD, yaw_deg=190.0)
Extract = Callable[[View, list[Detection]], list[Feature]]


class Config(BaseModel):
    model_config = ConfigDict(extra="forbid")
    threshold: float = 0.01


def room(name: str, extract: Extract) -> LoadedPlugin:
    def extract_features(self: object, view: View, detections: Any) -> list[Feature]:
        return extract(view, detections)

    watcher = plugin_class(classes=("light",), model=LAMPS, extract_features=extract_features)
    return loaded_plugin(name, watcher, Config())


@pytest.fixture(autouse=True)
def every_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every frame is a key frame: in the pictures nothing can be followed."""
    monkeypatch.setattr(KeyFrames, "is_key", lambda *_: True)


@pytest.fixture
def nothing_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    """No point is followed, which saves time."""
    nothing = Followed(np.zeros(0, np.int64), np.zeros((0, 2), np.float32))
    monkeypatch.setattr(Follower, "update", lambda *_: nothing)


@pytest.fixture
def aimed(tmp_path: Path) -> PassPlan:
    video = write_video(tmp_path / "a.mp4", evenly(24, 30))
    return PassPlan("pass 1", Clip(video), {"one": ViewPlan((AHEAD, UP)), "two": ViewPlan((UP,))})


def threads() -> set[threading.Thread]:
    return set(threading.enumerate())


def walk_of(
    rooms: Sequence[LoadedPlugin], plan: PassPlan, journal: Journal | None = None, row: str = "A", **more: bool
) -> RowWalk:
    """A row with one pass, which begins."""
    row_pass = Pass(video=plan.clip.path)
    references = References(markers=(KnownMarker("tag36h11", 7, 0.2, 0.0005),))
    request = RowRequest(row, (row_pass,), rooms, references, stills=True, **more)
    walk = RowWalk((request, plan), SegmenterPool(rooms), Renderer(), journal or Journal())
    walk.begin(plan.name, row_pass, SilentMonitor())
    return walk


def driven(walk: RowWalk) -> RowWalk:
    """The walk along its pass. Raises its error."""
    drive.drive_along(walk.plan.clip, [walk], walk.renderer, SilentMonitor())
    if walk.failure is not None:
        raise walk.failure
    return walk


@pytest.mark.slow
def test_plugins_are_asked_in_order_by_one_thread_and_see_what_they_would_alone(aimed: PassPlan) -> None:
    before = threads()
    asked: list[tuple[str, int, str, int]] = []
    seen: list[tuple[np.ndarray, np.ndarray]] = []

    def watcher(name: str) -> Extract:
        def extract(view: View, detections: list[Detection]) -> list[Feature]:
            asked.append((name, view.frame, view.spec.name, threading.get_ident()))
            if name == "one":
                probability = detections[0].probability if detections else np.zeros(())
                seen.append((view.image, probability))
            return []

        return extract

    rooms = [room("one", watcher("one")), room("two", watcher("two"))]
    driven(walk_of(rooms, aimed))
    views = [("one", "pass 1 / ahead"), ("one", "pass 1 / up"), ("two", "pass 1 / up")]
    here = threading.get_ident()
    assert asked == [(name, frame, view, here) for frame in range(12) for name, view in views]
    renderer, network = Renderer(), SegmenterPool(rooms).network(rooms[0])
    alone = [renderer.render(one, spec) for one in panoramas(aimed.clip) for spec in aimed.plugins_by_view]
    for (image, probability), view in zip(seen, alone, strict=True):
        assert np.array_equal(image, view.image)
        assert not probability.shape or np.array_equal(probability, network.probabilities(view.image)[1])
    assert threads() == before


@pytest.mark.usefixtures("nothing_followed")
def test_a_view_is_cut_from_each_so_many_frames(aimed: PassPlan) -> None:
    seen: list[tuple[str, int]] = []

    def extract(view: View, detections: list[Detection]) -> list[Feature]:
        seen.append((view.spec.name, view.frame))
        return []

    seldom = replace(aimed, plans={"one": ViewPlan((AHEAD, replace(UP, every=3)))})
    walk = driven(walk_of([room("one", extract)], seldom))
    assert [frame for name, frame in seen if name.endswith("up")] == [0, 3, 6, 9]
    assert [frame for name, frame in seen if name.endswith("ahead")] == list(range(12))
    assert len(walk.stamps) == 12


def test_a_failing_plugin_ends_the_walk_and_its_threads(aimed: PassPlan) -> None:
    before, frames = threads(), []

    def extract(view: View, detections: list[Detection]) -> list[Feature]:
        frames.append(view.frame)
        return [] if view.frame < 3 else 1 / 0  # type: ignore[return-value]

    with pytest.raises(
        PluginError, match=r"`one` failed in `extract_features` at frame 3 of pass 1 .*: ZeroDivisionError"
    ):
        driven(walk_of([room("one", extract)], aimed))
    assert max(frames) == 3
    assert threads() == before


def test_skipped_frames_are_counted_as_they_are_told(tmp_path: Path) -> None:
    folder = tmp_path / "pictures"
    folder.mkdir()
    for number in range(8):
        Pillow.fromarray(picture(number)).save(folder / f"{number}.png")
    for number in (3, 6):
        whole = (folder / f"{number}.png").read_bytes()
        (folder / f"{number}.png").write_bytes(whole[: len(whole) // 2])
    plan = PassPlan("pass 1", Clip(folder, fps=30), {"one": ViewPlan((AHEAD,))})
    walk = driven(walk_of([room("one", lambda view, detections: [])], plan))
    assert walk.skipped == 2
    assert any(f"{walk.skipped} damaged frames skipped" in note for note in walk.notes)


@pytest.mark.slow
def test_pictures_are_forgotten_when_they_are_done_with(aimed: PassPlan) -> None:
    walk = walk_of([room("one", lambda view, detections: [])], aimed)
    network = walk.segmenters.network(walk.plugins[0])
    network._segmentations.clear()
    driven(walk)
    assert not network._segmentations


@pytest.mark.slow
@pytest.mark.parametrize(("cut_off_at", "footage"), [(0, "video"), (5, "pictures"), (11, "video")])
def test_a_walk_that_was_cut_off_goes_on_there(
    aimed: PassPlan, footage: str, cut_off_at: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(journals, "KEEP_S", 0.0)
    asked: list[int] = []
    stops = [True]

    def extract(view: View, detections: list[Detection]) -> list[Feature]:
        asked.append(view.frame)
        if stops and view.frame == cut_off_at and view.spec.name.endswith("up"):
            raise KeyboardInterrupt
        middle = view.image.mean(axis=(0, 1))[:2]
        return [Feature(view.frame, view.spec.name, "light", "centre", 0, middle[None], np.eye(2)[None] * middle[0])]

    def walked(kept: Path | None) -> bytes:
        rooms = [room("one", extract), room("two", extract)]
        with Journal(kept) as journal:
            walk = driven(walk_of(rooms, plan, journal, appearance=True))
        seen = [walk.features, walk.packed_views, walk.stamps, walk.pass_of, walk.cuts, walk.notes, walk.followed]
        return packed([*seen, walk.markers.marks])

    plan = aimed if footage == "video" else replace(aimed, clip=Clip(pictures_of(aimed, tmp_path), images_fps=15.0))
    kept = tmp_path / "frames"
    with pytest.raises(KeyboardInterrupt):
        walked(kept)
    stops.clear()
    asked.clear()
    whole = walked(kept)
    assert sorted(set(asked)) == list(range(cut_off_at, 12))
    assert whole == walked(None)
    assert sorted(set(asked)) == list(range(12))


def pictures_of(aimed: PassPlan, folder: Path) -> Path:
    """The frames of a pass as pictures of a folder."""
    (folder / "pictures").mkdir()
    for panorama in panoramas(aimed.clip):
        cv2.imwrite(str(folder / "pictures" / f"{panorama.frame:04d}.jpg"), panorama.image[..., ::-1])
    return folder / "pictures"


@pytest.mark.slow
def test_what_is_measured_after_a_plugin_failed_is_not_kept(aimed: PassPlan, tmp_path: Path) -> None:
    rooms = isolated([room("one", lambda view, _: [] if view.frame < 3 else 1 / 0), room("two", lambda *_: [])])
    with Journal(tmp_path / "frames") as journal:
        driven(walk_of(rooms, aimed, journal))
    assert Journal(tmp_path / "frames").earlier["A"] == 3


@pytest.mark.slow
def test_two_rows_of_a_drive_see_every_frame_once(aimed: PassPlan, monkeypatch: pytest.MonkeyPatch) -> None:
    """Three plugins, two of which share a network, look at both rows; both rows look up the same way."""
    decoded: list[int] = []
    rendered: list[tuple[float, ViewSpec]] = []
    inferred: list[tuple[float, ViewSpec]] = []
    image_of: dict[int, tuple[float, ViewSpec]] = {}
    kept: list[np.ndarray] = []

    def counted(clip: Clip, *arguments: Any) -> Iterator[Panorama]:
        for panorama in panoramas(clip, *arguments):
            decoded.append(panorama.frame)
            yield panorama

    def render(self: Renderer, panorama: Panorama, spec: ViewSpec) -> View:
        view = plain_render(self, panorama, spec)
        rendered.append((panorama.stamp_s, replace(spec, name="")))
        image_of[id(view.image)] = rendered[-1]
        kept.append(view.image)
        return view

    def predict(self: Segmenter, image: np.ndarray) -> Any:
        inferred.append(image_of[id(image)])
        return plain_predict(self, image)

    plain_render, plain_predict = Renderer.render, Segmenter.predict
    monkeypatch.setattr(Renderer, "render", render)
    monkeypatch.setattr(Segmenter, "predict", predict)
    monkeypatch.setattr(drive, "panoramas", counted)
    plans = {"A": {"one": ViewPlan((AHEAD, UP)), "two": ViewPlan((UP,)), "three": ViewPlan((AHEAD,))}}
    plans["B"] = {"one": ViewPlan((BACK, UP)), "two": ViewPlan((UP,)), "three": ViewPlan((BACK,))}

    def chosen(*_: Any) -> Any:
        row = "A" if len(first) == 0 else "B"
        first.append(row)
        return replace(aimed, plans=plans[row])

    first: list[str] = []
    monkeypatch.setattr(drive, "plan_shown", chosen)
    monkeypatch.setattr(drive, "looked_at", lambda row_pass, _: (row_pass, None, None))
    rooms = [room(name, lambda view, detections: []) for name in ("one", "two", "three")]
    row_pass = Pass(video=aimed.clip.path)
    requests = [RowRequest(name, (row_pass,), rooms, References()) for name in "AB"]
    walked = drive.walk(requests, Journal(), SilentMonitor())
    assert [len(row.measurements.facts.frames.stamps_s) for row in walked if isinstance(row, WalkedRow)] == [12, 12]
    assert decoded == list(range(12))
    assert len(rendered) == len(set(rendered)) == 12 * 3
    assert len(inferred) == len(set(inferred)) == 12 * 3


@pytest.mark.slow
def test_a_row_that_fails_leaves_the_drive_and_the_others_go_on(aimed: PassPlan) -> None:
    fails = walk_of([room("one", lambda view, _: [] if view.frame < 3 else 1 / 0)], aimed, row="B")  # type: ignore[arg-type]
    goes_on = walk_of([room("one", lambda view, _: [])], aimed)
    drive.drive_along(aimed.clip, [fails, goes_on], Renderer(), SilentMonitor())
    assert isinstance(fails.failure, PluginError)
    assert goes_on.failure is None
    assert len(goes_on.stamps) == 12


@pytest.mark.slow
def test_what_an_earlier_run_saw_is_not_decoded_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """But for the last second, in which a frame may still be missing, and what is passed over before it, for nothing can
    be followed in these pictures. The result is the same."""
    monkeypatch.setattr(journals, "KEEP_S", 0.0)
    plan = PassPlan("pass 1", Clip(write_video(tmp_path / "a.mp4", evenly(90, 30))), {"one": ViewPlan((AHEAD,))})
    seen: list[int] = []

    def extract(view: View, detections: list[Detection]) -> list[Feature]:
        seen.append(view.frame)
        if stops and view.frame == 40:
            raise KeyboardInterrupt
        return []

    def walked(kept: Path | None) -> tuple[bytes, list[int]]:
        read: list[int] = []

        def counted(clip: Clip, *arguments: Any) -> Iterator[Panorama]:
            for panorama in panoramas(clip, *arguments):
                read.append(panorama.frame)
                yield panorama

        monkeypatch.setattr(drive, "panoramas", counted)
        with Journal(kept) as journal:
            row = walk_of([room("one", extract)], plan, journal, appearance=True)
            row.request = replace(row.request, references=References())
            walk = driven(row)
        seen = [walk.features, walk.stamps, walk.pass_of, walk.packed_views, walk.notes, walk.warnings, walk.followed]
        return packed(seen), read

    stops, kept = [True], tmp_path / "frames"
    with pytest.raises(KeyboardInterrupt):
        walked(kept)
    stops.clear()
    seen.clear()
    again, read = walked(kept)
    assert seen == list(range(40, 45))
    assert read[0] >= 40 - 17 - MOST_PASSED
    assert (again, list(range(45))) == walked(None)


@pytest.mark.slow
def test_a_snapshot_is_what_was_measured_so_far(aimed: PassPlan) -> None:
    """It needs no frame that follows, and the drive goes on after it."""
    walk = walk_of([room("one", lambda view, _: [])], aimed)
    with drive.Drive([walk], Renderer(), DecodeReport()) as along:
        for panorama in panoramas(aimed.clip):
            along.add(panorama)
            if panorama.frame == 4:
                (row,) = along.snapshot()
                assert len(row.measurements.facts.frames.stamps_s) == 5
        (row,) = along.snapshot()
    assert len(row.measurements.facts.frames.stamps_s) == 12


@pytest.mark.usefixtures("nothing_followed")
def test_how_dark_and_how_bright_a_plugin_sees_is_kept(aimed: PassPlan, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drive, "tones_of", lambda views: (len(views) / 10, views[0].frame / 100))
    walk = driven(walk_of([room("one", lambda view, _: []), room("two", lambda view, _: [])], aimed))
    tones = [{"one": (0.2, frame / 100), "two": (0.1, frame / 100)} for frame in range(12)]
    assert [*walk.walked().measurements.tones] == tones


def test_points_are_followed_in_the_views_of_the_face_alone(aimed: PassPlan) -> None:
    face, ceiling = ViewSpec("face", -90.0, hfov_deg=120.0), ViewSpec("ceiling", 0.0, 80.0)
    plans = {"racks": ViewPlan((face,), np.eye(3)), "lamps": ViewPlan((ceiling,))}
    walk = walk_of([], replace(aimed, plans=plans), appearance=True)
    rough = np.random.default_rng(1).integers(0, 255, (64, 128, 3)).astype(np.uint8)
    image = np.kron(rough, np.ones((4, 4, 1), np.uint8))
    way, follower = Way(), Follower()
    for frame in range(WINDOW):
        panorama = Panorama(frame, frame / 15, image)
        way.take(follower.update(panorama))
        walk.take(numbered(panorama, walk.counted(frame, way)), ([], [], None))
    flows = walk.walked().measurements.flows
    assert {flow.spec.name for flow in flows} == {"pass 1 / face"}
    assert len(flows[0].pixels) > 50


def test_markers_are_searched_in_every_frame(aimed: PassPlan) -> None:
    walk = walk_of([], replace(aimed, plans={}))
    for frame in range(3):
        panorama = marked(frame, HEIGHT, corners_at(8 + frame, 40.0, 0.0), TAG, np.random.default_rng(1))
        walk.take(panorama, ([], [], None))
    assert walk.markers.marks.tracks["tag36h11 7"][0].frames.tolist() == [0, 1, 2]


def test_a_marker_that_was_not_seen_is_noted() -> None:
    facts = RowFacts("A", FrameTable(np.arange(3.0), ("pass 1",) * 3), {}, {})
    start = Trajectory(np.arange(3), np.tile(np.eye(4), (3, 1, 1)))
    references = References(markers=(KnownMarker("tag36h11", 7, 0.2, 0.0005),))
    seen = RowMeasurements(facts, {}, {}, frozenset(), (), MarkerTracks({}, {}))
    row = LocatedRow(RowRequest("A", (), (), references), seen, start, camera_priors(facts, start, references))
    constraints, notes = marker_constraints(row)
    assert not constraints
    assert notes == ["row A: marker tag36h11 7 was not seen well enough; it is not used"]


def test_the_site_file_asks_for_points_and_may_have_markers_alone_for_scale() -> None:
    content: dict[str, Any] = {"rows": {"A": {"passes": [{"video": "a.mp4"}]}}}
    assert not Site.model_validate(content).appearance
    assert Site.model_validate({**content, "appearance": True}).appearance
    marker = {"dictionary": "tag36h11", "id": 7, "size_m": 0.2}
    assert tells_scale(Site.model_validate({**content, "references": {"markers": [marker]}}), "A", ())
