"""Lamps: from masks to points, from points to tracks, from tracks to the map."""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
import pytest

from savmap.errors import StructureError
from savmap.geometry.pinhole import angles_from_rotation, project
from savmap.graph import KeySpace, Solution, camera_priors, merge, solve
from savmap.types import Detection, Feature, Floats, FrameTable, Panorama, RowFacts, Track, Trajectory, View, ViewSpec
from savmap.vision.view_planning import PassPreview
from savmap.vision.views import Renderer
from savmap_lights.features import extract_features
from savmap_lights.open_ends import SIDES, SIDES_NOT_SEEN
from savmap_lights.plugin import Lights, Settings
from savmap_lights.tracking import track_lamps

LINE = Lights(Settings(line=True))
HEIGHT_M, LINE_Z_M, PITCH_M, LENGTH_M = 7.5, 1.2, 3.0, 1.3
WORLD_FROM_VIEW = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
CEILING = ViewSpec(
    "pass 1 / ceiling", *angles_from_rotation(np.diag([1.0, -1.0, -1.0]) @ WORLD_FROM_VIEW), hfov_deg=110
)


def path(count: int = 40) -> Trajectory:
    """A straight drive along x, the rig's axes along the world's."""
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = np.diag([1.0, -1.0, -1.0])
    poses[:, :3, 3] = np.stack([np.linspace(0, 10, count), np.full(count, 3.0), np.full(count, 1.3)], axis=1)
    return Trajectory(np.arange(count), poses)


def facts(count: int = 40) -> RowFacts:
    return RowFacts("A", FrameTable(np.arange(count) / 5, ("pass 1",) * count), {CEILING.name: CEILING}, {"pass 1": 1})


def ends(line_z: float = LINE_Z_M) -> Floats:
    """Both ends (n, 2, 3) of the strips of one line."""
    starts = np.arange(-3, 12, PITCH_M)
    return np.array([[[x, HEIGHT_M, line_z], [x + LENGTH_M, HEIGHT_M, line_z]] for x in starts])


def seen_pixels(points: Floats, pose: Floats) -> Floats:
    in_rig = (points - pose[:3, 3]) @ pose[:3, :3]
    return project(in_rig @ CEILING.rig_from_view, CEILING.camera)


def view_of(strips: Floats, pose: Floats, frame: int) -> tuple[View, list[Detection]]:
    """Masks of lamps 12 cm wide as a camera at `pose` sees them, drawn with smooth borders."""
    detections = []
    for strip in strips:
        corners = np.array(
            [strip[0] + [0, 0, -0.06], strip[1] + [0, 0, -0.06], strip[1] + [0, 0, 0.06], strip[0] + [0, 0, 0.06]]
        )
        canvas = np.zeros((480, 640), dtype=np.uint8)
        cv2.fillPoly(canvas, [np.round(seen_pixels(corners, pose) * 256).astype(np.int32)], 255, cv2.LINE_AA, 8)
        if (canvas > 127).any():
            detections.append(Detection("light", 0.9, canvas > 127, (canvas / 255).astype(np.float32)))
    image = np.zeros((480, 640, 3), dtype=np.uint8)
    return View(CEILING, frame, frame / 5, image), detections


def features_of(lines: Sequence[Floats]) -> list[Feature]:
    found: list[Feature] = []
    for frame, pose in enumerate(path().world_from_rig):
        found += extract_features(*view_of(np.concatenate(lines), pose, frame))
    return found


def solved(features: Sequence[Feature] | None = None) -> tuple[list[Track], Solution]:
    """One line of lamps, tracked and solved for on a path that is held."""
    tracks = track_lamps(features_of([ends()]) if features is None else features, facts(), path())
    constraints = LINE.constrain(tracks, facts(), path(), KeySpace("lights"))
    return tracks, solve(merge(camera_priors(facts(), path(), fixed=path()), constraints))


def test_ends_of_a_strip_are_found_to_a_pixel() -> None:
    pose = path().world_from_rig[20]
    strip = ends()[2:3]
    points = {f.part: f.pixels[0] for f in extract_features(*view_of(strip, pose, 20))}
    truth = seen_pixels(strip[0], pose)
    found = sorted([points["end a"], points["end b"]], key=lambda p: float(np.linalg.norm(p - truth[0])))
    assert np.abs(np.array(found) - truth).max() < 1.2
    assert np.abs(points["centre"] - truth.mean(axis=0)).max() < 1.0


def test_a_lamp_cut_by_the_frame_has_no_centre() -> None:
    mask = np.zeros((480, 640), dtype=bool)
    mask[0:60, 300:310] = True
    view = View(CEILING, 0, 0.0, np.zeros((480, 640, 3), dtype=np.uint8))
    parts = {f.part for f in extract_features(view, [Detection("light", 0.9, mask, mask.astype(np.float32))])}
    assert "centre" not in parts
    assert len(parts - {"middle"}) == 1


@pytest.mark.slow
@pytest.mark.parametrize("noise_m", [0.0, 0.05])
def test_strips_of_the_nearest_line_become_numbered_tracks(noise_m: float) -> None:
    rough = path()
    shift = np.random.default_rng(3).normal(0, noise_m, (len(rough.frames), 3))
    poses = rough.world_from_rig.copy()
    poses[:, :3, 3] += shift
    tracks = track_lamps(features_of([ends(), ends(LINE_Z_M + 4)]), facts(), replace(rough, world_from_rig=poses))
    assert [t.name for t in tracks] == [f"light {k} / end {e}" for k in range(1, 6) for e in (0, 1)]
    assert all(t.label == "light" for t in tracks)


@pytest.mark.slow
def test_what_shows_in_few_frames_is_no_lamp_however_often_it_is_seen_in_them() -> None:
    ghost = np.array([[[4.6, HEIGHT_M, LINE_Z_M], [5.0, HEIGHT_M, LINE_Z_M]]])
    flashes = [feature for feature in features_of([ghost]) if feature.frame % 3 == 0]
    tracks = track_lamps([*features_of([ends()]), *flashes, *flashes], facts(), path())
    assert [t.name for t in tracks] == [f"light {k} / end {e}" for k in range(1, 6) for e in (0, 1)]


def test_no_lamps_is_said() -> None:
    with pytest.raises(StructureError, match="no three frames show a lamp"):
        track_lamps([], facts(), path())


def test_lamps_are_mapped_from_a_known_path() -> None:
    tracks, solution = solved()
    structures = LINE.describe(tracks, solution.landmarks_of("lights"))
    assert [s.id for s in structures] == [f"light {k}" for k in range(1, 6)]
    for structure, truth in zip(structures, ends(), strict=True):
        assert structure.vertex_labels == ("end 0", "end 1")
        assert np.abs(structure.vertices.mean(axis=0) - truth.mean(axis=0)).max() < 0.02
        assert np.abs(structure.vertices - truth).max() < 0.04
        assert (np.sqrt(np.diagonal(structure.covariances, axis1=1, axis2=2)) < 0.05).all()
        assert structure.solid is not None
        assert np.ptp(structure.solid.outline[:, 0]) == pytest.approx(np.ptp(structure.vertices[:, 0]), abs=0.01)


def test_lamps_seen_in_every_third_frame_are_as_well_supported() -> None:
    seldom = replace(facts(), views={CEILING.name: replace(CEILING, every=3)})
    features = [feature for feature in features_of([ends()]) if feature.frame % 3 == 0]
    tracks = track_lamps(features, seldom, path())
    assert [t.name for t in tracks] == [f"light {k} / end {e}" for k in range(1, 6) for e in (0, 1)]
    with pytest.raises(StructureError, match="no three frames show a lamp"):
        track_lamps(features, facts(), path())


@pytest.mark.slow
@pytest.mark.parametrize(("given", "every"), [({}, 1), ({"every": 4}, 4)])
def test_the_ceiling_is_looked_at_as_often_as_is_set(given: dict[str, int], every: int) -> None:
    panorama = Panorama(0, 0.0, np.zeros((64, 128, 3), np.uint8))
    pass_preview = PassPreview((panorama,), (), Renderer(), np.eye(3))
    plan = Lights(Settings(**given)).render_views(pass_preview, lambda view: [], {}, None)
    assert plan.views[0].every == every


def test_a_lamp_that_could_not_be_placed_is_not_in_the_map() -> None:
    tracks, solution = solved()
    lost = solution.landmarks_of("lights") | {
        "light 2 / end 1": replace(solution.landmarks_of("lights")["light 2 / end 1"], covariance=np.eye(3) * 100.0**2)
    }
    found = LINE.describe(tracks, lost)
    assert [lamp.id for lamp in found] == ["light 1", "light 3", "light 4", "light 5"]


@pytest.mark.slow
@pytest.mark.parametrize(("every", "warned"), [(1, True), (4, False), (0, False)])
def test_light_seen_as_often_as_lamps_is_warned_of(every: int, warned: bool) -> None:
    """The third lamp shines in each so many frames and its ends show in none."""
    shining = features_of([ends()[2:3]]) if every else []
    middles = [
        replace(feature, instance=feature.instance + 500)
        for feature in shining
        if feature.part == "middle" and feature.frame % every == 0
    ]
    tracks, solution = solved([*features_of([np.delete(ends(), 2, axis=0)]), *middles])
    lamps = LINE.describe(tracks, solution.landmarks_of("lights"))
    assert len(lamps) == len(ends()) - 1
    warnings = LINE.warnings(lamps)
    assert [(warning.code, warning.subjects) for warning in warnings] == [("incomplete-map", ("lights",))] * warned
    for warning in warnings:
        assert warning.place is not None
        assert np.abs(np.array(warning.place) - ends()[2].mean(axis=0)).max() < 0.2


@pytest.mark.slow
@pytest.mark.parametrize("lit", [True, False])
def test_lamps_whose_sides_show_nowhere_say_so(lit: bool) -> None:
    squares = ends()
    squares[:, 1, 0] = squares[:, 0, 0] + 0.2
    features: list[Feature] = []
    for frame, pose in enumerate(path().world_from_rig):
        view, detections = view_of(squares, pose, frame)
        shine = np.maximum.reduce([np.zeros((480, 640), np.float32), *(mask.probability for mask in detections)])
        image = np.repeat((255 * shine * lit).astype(np.uint8)[..., None], 3, axis=2)
        features += extract_features(replace(view, image=image), detections)
    tracks = track_lamps(features, facts(), path())
    constraints = LINE.constrain(tracks, facts(), path(), KeySpace("lights"))
    solution = solve(merge(camera_priors(facts(), path(), fixed=path()), constraints))
    lamps = LINE.describe(tracks, solution.landmarks_of("lights"))
    assert len(lamps) >= 3
    assert all(lamp.attributes.get(SIDES) == (None if lit else SIDES_NOT_SEEN) for lamp in lamps)
