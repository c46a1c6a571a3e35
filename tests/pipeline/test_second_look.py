"""The second look: which plugins take it, what is measured again in the strips that were kept, and when nothing changes."""

import logging
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pydantic import BaseModel, ConfigDict
from savmap.pipeline.second_look import look_again
from savmap.vision.evidence.expectation import Expectation, unexplained

from savmap.errors import StructureError
from savmap.files.journal import Journal
from savmap.graph import LocatedCamera, References
from savmap.pipeline import second_look
from savmap.pipeline.path import PluginAlone
from savmap.pipeline.records import RowMeasurements, RowRequest, WalkedRow, strips_of
from savmap.plugin.manager import LoadedPlugin, loaded_plugin
from savmap.types import (
    Detection,
    Expected,
    Feature,
    Floats,
    FrameTable,
    Panorama,
    PlanePatch,
    RowFacts,
    Trajectory,
    View,
    ViewSpec,
)
from savmap.types.progress import NoteCollector
from savmap.vision.evidence import PackedView, expectation
from savmap.vision.evidence.floor import FloorHeight
from savmap.vision.markers import MarkerTracks
from savmap.vision.networks.segmenter import Segmentation
from savmap.vision.strips import PanoramaStrip, packed_maps
from savmap.vision.views import Region

from ..plugin.made_up_plugin import plugin_class

ROOT = Path(__file__).parents[2]
LAMPS = ROOT / "plugins" / "lights" / "savmap_lights" / "model" / "lights.onnx"
FACE = ViewSpec("face", 0.0, width=96, height=64)
SHOWN = ViewSpec("pass 1 / face", 0.0, width=96, height=64)
COUNT = 12
# The rig stands 2 m before the plane z = 0 and looks at it.
POSE = np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 2], [0, 0, 0, 1]])
PATH = Trajectory(np.arange(COUNT), np.tile(POSE, (COUNT, 1, 1)))


class Config(BaseModel):
    model_config = ConfigDict(extra="forbid")


def watcher(**hooks: Any) -> LoadedPlugin:
    """A plugin that makes a feature of the middle of each detection."""

    def extract_features(self: object, view: View, detections: list[Detection]) -> list[Feature]:
        middles = [np.argwhere(detection.mask).mean(axis=0)[::-1] for detection in detections]
        return [
            Feature(view.frame, view.spec.name, "light", "centre", number, middle[None], np.eye(2)[None])
            for number, middle in enumerate(middles)
        ]

    members = {"classes": ("light",), "model": LAMPS, "extract_features": extract_features, **hooks}
    return loaded_plugin("one", plugin_class(**members), Config())


def rectangle(x: float) -> Expected:
    corners = np.array([[x - 0.2, -0.5, 0], [x + 0.2, -0.5, 0], [x + 0.2, 0.5, 0], [x - 0.2, 0.5, 0]])
    return Expected("light", corners)


@pytest.fixture
def walked() -> WalkedRow:
    """A pass in which nothing was found; the network sees two faint things, at x = -0.8 and 0.8 of the plane."""
    maps = np.zeros((2, FACE.height, FACE.width), np.float32)
    maps[1, 20:44, 20:38] = maps[1, 20:44, 58:76] = 0.3
    maps[0] = 1 - maps[1]
    black, journal = np.zeros((FACE.height, 2 * FACE.height, 3), np.uint8), Journal()
    packed_views = []
    for frame in range(COUNT):
        panorama = Panorama(frame, frame / 15, black)
        strip = PanoramaStrip.of(panorama, Region(0, 64, 0, 128))
        seen = Segmentation(("light",), maps)
        journal.add(strips_of("A"), frame, replace(strip, maps={"one": {SHOWN.name: packed_maps(seen)}}))
        view = View(SHOWN, frame, frame / 15, np.zeros((FACE.height, FACE.width, 3), np.uint8))
        packed_views.append(PackedView.of(view, seen))
    facts = RowFacts("A", FrameTable(np.arange(COUNT) / 15, ("pass 1",) * COUNT), {SHOWN.name: SHOWN}, {"pass 1": 1})
    attitudes = {"pass 1": np.diag([1.0, -1.0, -1.0])}
    nothing = RowMeasurements(facts, {"one": []}, attitudes, frozenset({"one"}), (), MarkerTracks((), {}))
    row = RowRequest("A", (), [], References())
    return WalkedRow(row, nothing, plugins=[watcher()], packed_views={"one": packed_views}, journal=journal)


def looked(
    walked: WalkedRow,
    plugin: LoadedPlugin,
    expectations: list[Expectation | None],
    monkeypatch: pytest.MonkeyPatch,
    followed: bool = True,
    tracked: dict[str, Floats] | None = None,
) -> tuple[RowMeasurements, list[str]]:
    """What was measured after looks with these expectations, one after the other, and the notes; `followed`: whether what is measured
    anew can be tracked, and `tracked`: the landmarks then."""

    def asked(*arguments: object) -> Expectation | None:
        return expectations.pop(0)

    located = SimpleNamespace(points={"one": tracked or {}}, path=PATH)
    monkeypatch.setattr(second_look, "expect", asked)
    monkeypatch.setattr(second_look.PluginAlone, "located", lambda *arguments: located if followed else None)
    notes = NoteCollector()
    return look_again(replace(walked, plugins=[plugin]), notes).measurements, notes.lines


def test_frames_are_measured_where_objects_are_expected(walked: WalkedRow, monkeypatch: pytest.MonkeyPatch) -> None:
    expected = Expectation([rectangle(0.8)], PATH)
    measured, notes = looked(walked, watcher(), [expected, None], monkeypatch)
    features = measured.features["one"]
    assert [feature.frame for feature in features] == list(range(COUNT))
    assert {feature.view for feature in features} == {SHOWN.name}
    assert np.array([feature.pixels[0] for feature in features]) == pytest.approx(
        np.tile([66.5, 31.5], (COUNT, 1)), abs=3
    )
    assert notes == ["row A: `one` looks again for 1 objects"]


def test_what_is_expected_beside_what_is_seen_is_measured_where_it_is_seen(
    walked: WalkedRow, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The path was 42 cm off: 10 px. What is absent moves along."""
    aside, elsewhere = rectangle(0.38), replace(rectangle(-1.22), absent=True)
    monkeypatch.setattr(second_look, "drift_of", lambda segmentation, outlines: np.array([10.0 * len(outlines), 0]))
    measured, _ = looked(walked, watcher(), [Expectation([aside, elsewhere], PATH), None], monkeypatch)
    middles = [feature.pixels[0, 0] for feature in measured.features["one"]]
    assert middles == pytest.approx([66.5] * COUNT, abs=1)


def test_what_cannot_be_followed_when_measured_anew_stays_as_it_was_and_is_warned(
    walked: WalkedRow, monkeypatch: pytest.MonkeyPatch
) -> None:
    measured, notes = looked(walked, watcher(), [Expectation([rectangle(0.8)], PATH)], monkeypatch, followed=False)
    assert measured.features == walked.measurements.features
    assert [(warning.code, warning.subjects) for warning in measured.warnings] == [("incomplete-map", ("one",))]
    assert len(notes) == 1


def test_frames_without_a_pose_are_not_measured_again(walked: WalkedRow, monkeypatch: pytest.MonkeyPatch) -> None:
    known = Trajectory(PATH.frames[3:6], PATH.world_from_rig[3:6])
    measured, _ = looked(walked, watcher(), [Expectation([rectangle(0.8)], known), None], monkeypatch)
    assert [feature.frame for feature in measured.features["one"]] == [3, 4, 5]


def test_at_most_two_looks_are_taken(walked: WalkedRow, monkeypatch: pytest.MonkeyPatch) -> None:
    expected = Expectation([rectangle(0.8), rectangle(-0.8)], PATH)
    left = [expected] * 4
    measured, notes = looked(walked, watcher(), left, monkeypatch)
    assert len(notes) == 2
    assert len(left) == 1
    assert len(measured.features["one"]) == 2 * COUNT


def test_what_is_absent_is_not_measured_beside_what_is_there(
    walked: WalkedRow, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What lies beside an object is measured with it, for borders are not known to the pixel."""
    beside, absent = rectangle(-0.35), replace(rectangle(-0.8), absent=True)
    for objects, count in (([beside], 1), ([beside, absent], 0), ([beside, rectangle(-0.8), absent], 1)):
        measured, notes = looked(walked, watcher(), [Expectation(objects, PATH), None], monkeypatch)
        assert len(measured.features["one"]) == count * COUNT
        assert notes == [f"row A: `one` looks again for {len(objects) - (absent in objects)} objects"]


def test_what_is_not_tracked_after_the_last_look_is_warned(walked: WalkedRow, monkeypatch: pytest.MonkeyPatch) -> None:
    tracked = {f"thing 1 / {end}": np.array([-0.8, y, 0.0]) for end, y in (("top", 0.5), ("bottom", -0.5))}
    expected = Expectation([rectangle(0.8), rectangle(-0.8)], PATH, tracked)
    measured, _ = looked(walked, watcher(), [expected] * 3, monkeypatch)
    assert [warning.subjects for warning in measured.warnings] == [("light near thing 1",)]


def test_what_is_tracked_after_the_last_look_and_absent_is_warned(
    walked: WalkedRow, monkeypatch: pytest.MonkeyPatch
) -> None:
    tracked = {
        f"thing {number} / {end}": np.array([x, y, 0.0])
        for number, x in ((1, -0.8), (2, 0.8))
        for end, y in (("top", 0.5), ("bottom", -0.5))
    }
    things = [rectangle(-0.8), replace(rectangle(0.8), absent=True), replace(rectangle(4.0), absent=True)]
    measured, _ = looked(walked, watcher(), [Expectation(things, PATH, tracked)] * 3, monkeypatch)
    assert [warning.subjects for warning in measured.warnings] == [("thing 2",)]


def test_a_look_that_loses_more_than_it_finds_is_not_used(walked: WalkedRow, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of two things one is tracked after the first look, none after the second."""
    things = [rectangle(0.8), rectangle(-0.8)]
    one, none = (
        {f"thing 1 / {end}": np.array([x, y, 0.0]) for end, y in (("top", 0.5), ("bottom", -0.5))} for x in (-0.8, 9.0)
    )
    expectations = [Expectation(things[:1], PATH, none), *(Expectation(things, PATH, points) for points in (one, none))]
    measured, _ = looked(walked, watcher(), [*expectations], monkeypatch)
    assert len(measured.features["one"]) == COUNT
    assert [warning.subjects for warning in measured.warnings] == [("light near thing 1",)]


@pytest.mark.parametrize(("end", "used"), [(0.8, True), (0.2, False)])
def test_a_look_that_loses_an_end_of_what_was_tracked_is_not_used(
    walked: WalkedRow, monkeypatch: pytest.MonkeyPatch, end: float, used: bool
) -> None:
    """Things at both ends were tracked; after the look the landmarks end at the one, or before it."""
    before, after = (
        {f"thing {x} / {y}": np.array([x, y, 0.0]) for x in (-0.8, last) for y in (0.5, -0.5)} for last in (0.8, end)
    )
    expectations = [Expectation([rectangle(-0.8), rectangle(0.8), rectangle(0.0)], PATH, before), None]
    measured, _ = looked(walked, watcher(), [*expectations], monkeypatch, tracked=after)
    assert (measured is not walked.measurements and bool(measured.features["one"])) == used


def test_measured_again_is_told_from_seen(walked: WalkedRow, monkeypatch: pytest.MonkeyPatch) -> None:
    measured, _ = looked(walked, watcher(), [Expectation([rectangle(0.8)], PATH), None], monkeypatch)
    assert all(feature.expected for feature in measured.features["one"])


def test_where_nothing_else_is_expected_nothing_changes(walked: WalkedRow, monkeypatch: pytest.MonkeyPatch) -> None:
    measured, notes = looked(walked, watcher(), [None], monkeypatch)
    assert measured is walked.measurements
    assert notes == []


def located_with(points: dict[str, Floats]) -> LocatedCamera:
    return LocatedCamera(PATH, (), {"one": points})


def test_the_floor_is_given_where_the_pictures_tell_and_remembered(
    walked: WalkedRow, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[float | None] = []

    def height(face: PlanePatch, views: object, specs: object, path: Trajectory, about: float | None) -> Any:
        asked.append(about)
        return FloorHeight(-1.5, 0.7, 0.01) if len(asked) < 3 else None

    monkeypatch.setattr("savmap.vision.evidence.floor.floor_height", height)
    lying = PlanePatch("floor", np.zeros(3), np.eye(3)[0], -np.eye(3)[2], np.ones(2), 0.1)
    standing = PlanePatch("face", np.zeros(3), np.eye(3)[0], np.eye(3)[1], np.ones(2), 0.1)
    planes = [lying, standing]
    alone = PluginAlone(walked.request, watcher(planes=lambda self, points: planes, expect=lambda self: []))
    found = [alone.floor(walked, located_with({"beam / a": np.zeros(3)})) for _ in range(3)]
    assert [(floor[0].name, floor[1].y) if floor else None for floor in found] == [("face", -1.5)] * 2 + [None]
    assert asked == [None, 0.7, 0.7]
    planes.pop()
    assert alone.floor(walked, located_with({})) is None


@pytest.mark.parametrize(("height", "is_floor"), [(-0.3, True), (0.4, True), (1.6, False)])
def test_what_lies_higher_than_much_of_what_was_tracked_is_not_the_floor(
    walked: WalkedRow, monkeypatch: pytest.MonkeyPatch, height: float, is_floor: bool
) -> None:
    """A single thing below the floor may be its mirror image."""
    monkeypatch.setattr("savmap.vision.evidence.floor.floor_height", lambda *_: FloorHeight(height, 0.7, 0.01))
    face = PlanePatch("face", np.zeros(3), np.eye(3)[0], np.eye(3)[1], np.ones(2), 0.1)
    alone = PluginAlone(walked.request, watcher(planes=lambda self, points: [face], expect=lambda self: []))
    points = {f"beam {y} / a": np.array([0.0, y, 0.0]) for y in (0.0, 0.5, 1.0, 1.5, 2.0, 2.5)}
    found = alone.floor(walked, located_with(points))
    assert (found is not None, alone.floor_share) == ((True, 0.7) if is_floor else (False, None))


def test_what_cannot_be_tracked_at_all_is_not_looked_for(walked: WalkedRow) -> None:
    def track(self: object) -> list[Any]:
        raise StructureError("nothing here")

    again = look_again(replace(walked, plugins=[watcher(track=track)]), NoteCollector())
    assert again.measurements is walked.measurements


def test_tracking_that_is_not_used_warns_nobody(walked: WalkedRow, caplog: pytest.LogCaptureFixture) -> None:
    tracked = list[str]()

    def track(self: object) -> list[Any]:
        tracked.append("once")
        logging.getLogger("savmap_one").warning("row A: seen only in part")
        raise StructureError("nothing here")

    look_again(replace(walked, plugins=[watcher(track=track)]), NoteCollector())
    logging.getLogger("savmap_one").warning("row A: seen only in part, and used")
    assert tracked
    assert [record.getMessage() for record in caplog.records] == ["row A: seen only in part, and used"]


@pytest.mark.parametrize(
    ("in_plane", "tracked_at", "warned"),
    [((1.4,), None, 0), ((0.8, 1.4), None, 2), ((1.4,), 0.2, 1)],
    ids=["most of an opening lies behind", "half of it does", "a part of it was tracked"],
)
def test_what_stands_over_others_that_lie_behind_does_so_too(
    monkeypatch: pytest.MonkeyPatch, in_plane: tuple[float, ...], tracked_at: float | None, warned: int
) -> None:
    def long_thing(y: float) -> Expected:
        return Expected("thing", np.array([[0.0, y, 0], [3.0, y, 0], [3.0, y + 0.1, 0], [0.0, y + 0.1, 0]]))

    def behind(part: PlanePatch, *others: object) -> bool:
        return not any(abs(part.origin[1] - y) < 0.1 for y in in_plane)

    monkeypatch.setattr(expectation, "lies_behind", behind)
    plane = PlanePatch("face", np.zeros(3), np.eye(3)[0], np.eye(3)[1], np.array([4.0, 2.0]), 0.02)
    y = -5.0 if tracked_at is None else tracked_at
    tracked = {f"thing 1 / {end}": np.array([x, y, 0.0]) for end, x in (("left", 0.0), ("right", 3.0))}
    left = Expectation([long_thing(y) for y in (0.2, 0.8, 1.1, 1.4)], PATH, tracked, [plane])
    assert len([*unexplained(left, [], {})]) == warned


@pytest.mark.parametrize(("in_plane", "warned"), [([], 0), ([0.8], 2)])
def test_what_meets_only_what_lies_behind_lies_behind_itself(
    monkeypatch: pytest.MonkeyPatch, in_plane: list[float], warned: int
) -> None:
    def box(x: tuple[float, float], y: tuple[float, float]) -> Expected:
        return Expected(
            "thing", np.array([[a, b, 0.0] for a, b in ((x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1]))])
        )

    def behind(part: PlanePatch, *others: object) -> bool:
        return not any(abs(part.origin[1] - y) < 0.1 for y in in_plane)

    monkeypatch.setattr(expectation, "lies_behind", behind)
    plane = PlanePatch("face", np.zeros(3), np.eye(3)[0], np.eye(3)[1], np.array([4.0, 2.0]), 0.02)
    across = [box((-0.1, 0.0), (-1.0, 2.0)), box((3.0, 3.1), (-1.0, 2.0))]
    along = [box((0.0, 3.0), (y, y + 0.1)) for y in (0.2, 0.8)]
    tracked = {f"thing 1 / {end}": np.array([-0.05, y, 0.0]) for end, y in (("top", 2.0), ("bottom", -1.0))}
    left = Expectation([*across, *along], PATH, tracked, [plane])
    assert len([*unexplained(left, [], {})]) == warned


def test_a_plugin_is_asked_with_the_floor_before_its_planes(walked: WalkedRow, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[float | None] = []
    face = PlanePatch("face", np.zeros(3), np.eye(3)[0], np.eye(3)[1], np.ones(2), 0.1)

    def expect(self: object, points: object, evidence: object, floor: float | None) -> list[Expected]:
        told.append(floor)
        return []

    floor = FloorHeight(-1.5, 0.7, 0.01)
    monkeypatch.setattr(PluginAlone, "floor", lambda self, walked, located: (face, floor))
    monkeypatch.setattr(
        PluginAlone, "located", lambda self, measurements: SimpleNamespace(points={"one": {}}, path=PATH)
    )
    alone = PluginAlone(
        RowRequest("A", (), [], References()), watcher(planes=lambda self, points: [face], expect=expect)
    )
    assert second_look.expect(alone, walked, walked.measurements) is None
    assert told == [-1.5]
