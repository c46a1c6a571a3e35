"""What is found in the evidence of all frames: rounds, the floor, what is measured of it, and who is not asked twice."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pydantic import BaseModel, ConfigDict

from savmap.errors import SolveError, StructureError
from savmap.files.journal import Journal
from savmap.geometry import pinhole
from savmap.graph import References
from savmap.pipeline import finding
from savmap.pipeline.finding import find_structures, is_near, lies_below, uncertain_objects
from savmap.pipeline.records import RowMeasurements, RowRequest, WalkedRow, strips_of
from savmap.plugin.manager import LoadedPlugin, loaded_plugin
from savmap.types import (
    Feature,
    FlatDepth,
    FlatParts,
    Floats,
    FoundObject,
    FrameTable,
    Panorama,
    PlanePatch,
    RowFacts,
    Structure,
    Trajectory,
    View,
    ViewSpec,
)
from savmap.types.progress import NoteCollector
from savmap.vision.evidence import FloorHeight, FloorTracks, PackedView
from savmap.vision.markers import MarkerTracks
from savmap.vision.networks.segmenter import Segmentation
from savmap.vision.strips import PanoramaStrip
from savmap.vision.views import Region

from ..plugin.made_up_plugin import plugin_class

LAMPS = Path(__file__).parents[2] / "plugins" / "lights" / "savmap_lights" / "model" / "lights.onnx"
SHOWN = ViewSpec("pass 1 / face", 0.0, width=96, height=64)
COUNT = 4
# The rig stands 2 m before the plane z = 0 and looks at it.
POSE = np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 2], [0, 0, 0, 1]])
PATH = Trajectory(np.arange(COUNT), np.tile(POSE, (COUNT, 1, 1)))
FACE = PlanePatch("face", np.array([-2.0, -1.0, 0.0]), np.eye(3)[0], np.eye(3)[1], np.array([4.0, 2.0]), 0.05)
POINTS = {"light 1 / left": np.array([-0.8, 0.0, 0.0])}


class Config(BaseModel):
    model_config = ConfigDict(extra="forbid")


def light(number: int, x: float, probability: float = 1.0, low: float = -0.5) -> FoundObject:
    corners = np.array([[x - 0.2, low, 0], [x + 0.2, low, 0], [x + 0.2, 0.5, 0], [x - 0.2, 0.5, 0]])
    return FoundObject(f"light {number}", "light", corners, probability)


class Asked:
    """A plugin that finds what it is told to, and remembers what it was asked."""

    def __init__(self, found: Callable[[float | None], list[FoundObject]], **hooks: Any) -> None:
        self.paths: list[Trajectory] = []
        self.points: list[dict[str, Floats]] = []
        self.floors: list[float | None] = []
        self.measured: list[int] = []
        asked = self

        def find(
            self: object, gather: Any, path: Trajectory, points: dict[str, Floats], facts: RowFacts, floor: float | None
        ) -> list[FoundObject]:
            asked.paths.append(path)
            asked.points.append(points)
            asked.floors.append(floor)
            assert gather(FACE).of("light").max() == pytest.approx(0.9, abs=0.05)
            return found(floor)

        def measure(
            self: object,
            objects: list[FoundObject],
            spec: ViewSpec,
            frame: int,
            world_from_rig: Floats,
            scores: np.ndarray,
            panorama: Panorama,
        ) -> list[Feature]:
            asked.measured.append(frame)
            assert scores.shape == (1, spec.height // 2, spec.width // 2)
            rays = np.array([item.outline.mean(axis=0) for item in objects]) - world_from_rig[:3, 3]
            pixels = pinhole.project(rays @ world_from_rig[:3, :3] @ spec.rig_from_view, spec.camera)
            return [
                Feature(frame, spec.name, "light", "centre", 0, pixel[None], np.eye(2)[None], object=item.id)
                for item, pixel in zip(objects, pixels, strict=True)
            ]

        members = {"classes": ("light",), "model": LAMPS, "find": find, "measure": measure}
        self.plugin: LoadedPlugin = loaded_plugin("one", plugin_class(**{**members, **hooks}), Config())


def walked(plugin: LoadedPlugin, locates: bool = True, path: Trajectory | None = None) -> WalkedRow:
    """A pass in which the network sees two things, at x = -0.8 and 0.8 of the plane."""
    maps = np.zeros((2, SHOWN.height, SHOWN.width), np.float32)
    maps[1, 20:44, 20:38] = maps[1, 20:44, 58:76] = 0.9
    maps[0] = 1 - maps[1]
    journal, seen, packed_views = Journal(), Segmentation(("light",), maps), []
    for frame in range(COUNT):
        panorama = Panorama(frame, frame / 15, np.zeros((64, 128, 3), np.uint8))
        strip = PanoramaStrip.of(panorama, Region(0, 64, 0, 128))
        journal.add(strips_of("A"), frame, strip)
        view = View(SHOWN, frame, frame / 15, np.zeros((SHOWN.height, SHOWN.width, 3), np.uint8))
        packed_views.append(PackedView.of(view, seen))
    facts = RowFacts("A", FrameTable(np.arange(COUNT) / 15, ("pass 1",) * COUNT), {SHOWN.name: SHOWN}, {"pass 1": 1})
    locators = frozenset({"one"}) if locates else frozenset({"two"})
    attitudes = {"pass 1": POSE[:3, :3]}
    nothing = RowMeasurements(facts, {"one": []}, attitudes, locators, (), MarkerTracks((), {}))
    row = RowRequest("A", (), [], References(), path=path)
    return WalkedRow(row, nothing, plugins=[plugin], packed_views={"one": packed_views}, journal=journal)


SOLVED = Trajectory(PATH.frames, PATH.world_from_rig.copy())


@pytest.fixture(autouse=True)
def solved(monkeypatch: pytest.MonkeyPatch) -> list[RowMeasurements]:
    """Whatever was measured is solved to a path and a landmark; the floor is not seen."""
    asked: list[RowMeasurements] = []

    def located(plugin: LoadedPlugin, row: RowRequest, measurements: RowMeasurements, path: Trajectory) -> Any:
        asked.append(measurements)
        return SimpleNamespace(path=SOLVED, points={"one": POINTS})

    monkeypatch.setattr(finding, "located_by", located)
    monkeypatch.setattr(finding, "floor_before", lambda *_: None)
    return asked


@pytest.fixture(autouse=True)
def first_paths(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """By what plugins the drive's path was laid before the face: along `PATH`."""
    asked: list[str] = []

    def paths_before_face(row: WalkedRow, plugin: LoadedPlugin) -> list[Trajectory]:
        asked.append(plugin.name)
        return [PATH]

    monkeypatch.setattr(finding, "paths_before_face", paths_before_face)
    return asked


def test_a_plugin_that_locates_the_camera_finds_and_measures_twice(
    solved: list[RowMeasurements], first_paths: list[str]
) -> None:
    asked = Asked(lambda floor: [light(1, -0.8), light(2, 0.8)])
    measured = find_structures(walked(asked.plugin), NoteCollector()).measurements
    assert first_paths == ["one"]
    assert asked.paths == [PATH, SOLVED]
    assert [dict(points) for points in asked.points] == [{}, POINTS]
    assert asked.measured == [*range(COUNT), *range(COUNT)]
    assert len(solved) == 2
    assert [(f.frame, f.object) for f in measured.features["one"]] == [
        (frame, f"light {number}") for frame in range(COUNT) for number in (1, 2)
    ]
    assert [thing.id for thing in measured.objects["one"]] == ["light 1", "light 2"]
    assert measured.path is SOLVED
    places = np.array([f.pixels[0, 0] for f in measured.features["one"] if f.object == "light 2"])
    assert places == pytest.approx(66.5, abs=1.0)


def test_what_lies_far_ahead_or_behind_is_not_measured() -> None:
    """Beyond three times the camera's distance of 2 m along its way; how far up something is does not matter."""
    camera, along = np.array([0.0, 0.0, 2.0]), np.eye(3)[0]
    assert is_near(light(1, 6.1), camera, along)
    assert not is_near(light(1, -6.3), camera, along)
    high = light(1, 0.0)
    assert is_near(replace(high, outline=high.outline + np.array([0.0, 9.0, 0.0])), camera, along)


def test_an_earlier_maps_path_is_used_from_the_start(first_paths: list[str]) -> None:
    asked = Asked(lambda floor: [light(1, -0.8)])
    find_structures(walked(asked.plugin, path=PATH), NoteCollector())
    assert first_paths == []
    assert asked.paths[0] is PATH


def two_passes(monkeypatch: pytest.MonkeyPatch, seen: dict[int, list[FoundObject]]) -> Asked:
    """Two passes of two frames, which show objects, by the first frame of the path that they are looked for from; from
    a path of all frames, those of the first pass are found."""
    paths = [Trajectory(PATH.frames[:2], PATH.world_from_rig[:2]), Trajectory(PATH.frames[2:], PATH.world_from_rig[2:])]
    monkeypatch.setattr(finding, "paths_before_face", lambda row, plugin: paths)

    def find(self: object, gather: Any, path: Trajectory, *_: object) -> list[FoundObject]:
        asked.paths.append(path)
        return seen[path.frames[0]]

    asked = Asked(lambda floor: [], find=find)
    return asked


def test_a_second_pass_is_laid_on_the_first_by_what_both_show(monkeypatch: pytest.MonkeyPatch) -> None:
    """The second pass begins 0.7 further along the face, and takes the first one's 1.25 for one."""
    lights = [light(number, x) for number, x in enumerate((-0.8, 0.1, 1.6))]
    others = [replace(item, outline=(item.outline - [0.7, 0.0, 0.0]) / 1.25) for item in lights]
    asked = two_passes(monkeypatch, {0: lights, 2: others})
    find_structures(walked(asked.plugin), NoteCollector())
    assert [path.frames.tolist() for path in asked.paths] == [[0, 1], [2, 3], [*range(COUNT)], [*range(COUNT)]]
    places = asked.paths[2].world_from_rig[:, :3, 3]
    assert places == pytest.approx(np.array([[0.0, 0.0, 2.0]] * 2 + [[0.7, 0.0, 2.5]] * 2))


def test_passes_that_show_nothing_alike_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = two_passes(monkeypatch, {0: [light(1, -0.8), light(2, 0.8)], 2: [light(1, 0.8)]})
    with pytest.raises(StructureError, match="row A: passes 2 and 1 do not show enough of the same bays"):
        find_structures(walked(asked.plugin), NoteCollector())


def test_what_is_less_likely_than_not_is_found_and_not_measured() -> None:
    asked = Asked(lambda floor: [light(1, -0.8), light(2, 0.8, 0.4)])
    measured = find_structures(walked(asked.plugin), NoteCollector()).measurements
    assert {f.object for f in measured.features["one"]} == {"light 1"}
    assert [thing.probability for thing in measured.objects["one"]] == [1.0, 0.4]


def test_a_height_that_something_reaches_through_is_no_floor() -> None:
    def spanning(low: float, high: float) -> FoundObject:
        corners = np.array([[0.0, low, 0.0], [1.0, low, 0.0], [1.0, high, 0.0], [0.0, high, 0.0]])
        return FoundObject("light 1", "light", corners, 1.0)

    beside, lowest, above = spanning(0.0, 3.0), spanning(0.2, 0.3), spanning(1.0, 1.1)
    assert lies_below(0.7, [lowest, above])
    assert not lies_below(0.7, [beside, lowest, above])
    assert not lies_below(0.1, [lowest, above])


@pytest.mark.parametrize(("y", "again"), [(0.7, True), (0.3, False)])
def test_what_reaches_below_the_floor_is_looked_for_again_with_the_floor(
    monkeypatch: pytest.MonkeyPatch, y: float, again: bool
) -> None:
    monkeypatch.setattr(finding, "floor_before", lambda *_: FloorHeight(y, 0.7, 0.01))
    monkeypatch.setattr(finding, "floor_tracks", lambda *_: FloorTracks())
    asked = Asked(lambda floor: [light(1, -0.8), light(2, 0.8)] if floor is None else [light(2, 0.8)])
    measured = find_structures(walked(asked.plugin), NoteCollector()).measurements
    assert asked.floors == ([None, None, y] if again else [None, None])
    assert len(measured.objects["one"]) == 2 - again


def test_a_plugin_that_is_told_the_path_finds_once(solved: list[RowMeasurements], first_paths: list[str]) -> None:
    asked = Asked(lambda floor: [light(1, -0.8)])
    measured = find_structures(walked(asked.plugin, locates=False, path=PATH), NoteCollector()).measurements
    assert (asked.paths, asked.measured) == ([PATH], [*range(COUNT)])
    assert (solved, first_paths) == ([], [])
    assert len(measured.features["one"]) == COUNT


def test_a_plugin_that_is_told_the_path_and_finds_nothing_is_noted() -> None:
    def nothing(floor: float | None) -> list[FoundObject]:
        raise StructureError("row A: no light shows")

    notes = NoteCollector()
    measured = find_structures(walked(Asked(nothing).plugin, locates=False, path=PATH), notes).measurements
    assert notes.lines == ["row A: no light shows"]
    assert (list(measured.features["one"]), measured.objects["one"]) == ([], ())
    unknown = Asked(nothing)
    assert find_structures(walked(unknown.plugin, locates=False), notes).measurements.features == {"one": []}
    assert unknown.paths == []


def test_what_locates_the_camera_and_finds_or_solves_nothing_ends_the_row(monkeypatch: pytest.MonkeyPatch) -> None:
    def nothing(floor: float | None) -> list[FoundObject]:
        raise StructureError("row A: no light shows")

    def fails(*_: object) -> None:
        raise SolveError("no scale")

    with pytest.raises(StructureError, match="no light shows"):
        find_structures(walked(Asked(nothing).plugin), NoteCollector())
    monkeypatch.setattr(finding, "located_by", fails)
    with pytest.raises(StructureError, match="row A: what is found cannot be solved: no scale"):
        find_structures(walked(Asked(lambda floor: [light(1, -0.8)]).plugin), NoteCollector())


def test_frames_beside_those_with_a_pose_are_measured_on_the_way_that_these_give() -> None:
    asked = Asked(lambda floor: [light(1, -0.8)])
    some = Trajectory(PATH.frames[1:3], PATH.world_from_rig[1:3])
    row = walked(asked.plugin, locates=False, path=some)
    assert [f.frame for f in find_structures(row, NoteCollector()).measurements.features["one"]] == [*range(COUNT)]
    np.testing.assert_allclose(asked.paths[0].world_from_rig, PATH.world_from_rig, atol=1e-9)


def test_frames_without_a_strip_are_not_measured() -> None:
    row = replace(walked(Asked(lambda floor: [light(1, -0.8)]).plugin, locates=False, path=PATH), journal=Journal())
    assert find_structures(row, NoteCollector()).measurements.features["one"] == []


def test_depths_of_flat_parts_are_asked_once_with_the_solved_path(monkeypatch: pytest.MonkeyPatch) -> None:
    depth = FlatDepth("one", "light 1 / left", "z", -0.01, 0.001, np.arange(COUNT), 3, 0.0, 0.001)
    asked: list[Any] = []

    def depth_of(name: str, flat: FlatParts, *others: Any) -> FlatDepth | None:
        asked.append((name, flat.axis, others[-1]))
        return depth if flat.axis == "z" else None

    monkeypatch.setattr(finding, "depth_of", depth_of)
    flats = [FlatParts("light 1 / left", "z", (FACE,)), FlatParts("light 1 / left", "y", ())]
    plugin = Asked(lambda floor: [light(1, -0.8)], flat_parts=lambda self, points: flats).plugin
    assert find_structures(walked(plugin), NoteCollector()).measurements.depths == (depth,)
    assert asked == [("one", "z", SOLVED), ("one", "y", SOLVED)]


def structure(thing: FoundObject, scale: float, shift: Floats) -> Structure:
    count = len(thing.outline)
    vertices = scale * thing.outline + shift
    return Structure(
        thing.id, thing.label, vertices, np.tile(np.eye(3), (count, 1, 1)), tuple("abcd"), np.zeros((0, 2), np.int64)
    )


def test_what_is_not_mapped_is_laid_where_the_mapped_objects_say() -> None:
    found = [light(1, -0.8), light(2, 0.8), light(3, 2.4, 0.3)]
    shift = np.array([3.0, 2.0, 0.0])
    structures = [structure(thing, 1.5, shift) for thing in found[:2]]
    (unsure,) = uncertain_objects(found, structures)
    assert (unsure.id, unsure.probability) == ("light 3", 0.3)
    assert unsure.outline == pytest.approx(1.5 * found[2].outline + shift)
    assert uncertain_objects(found, structures[:1]) == ()
    assert uncertain_objects(found[:2], structures) == ()
