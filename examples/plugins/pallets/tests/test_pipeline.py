"""From masks to pallets in the map, without a network: what is drawn is found again."""

import made_up as made
import numpy as np
import pytest

from savmap.errors import OutputError, StructureError
from savmap.files.journal import Journal
from savmap.graph import (
    CameraPriors,
    Constraints,
    KeySpace,
    References,
    Solution,
    image_measurements,
    known_coordinate,
    merge,
    solve,
)
from savmap.pipeline.records import RowRequest
from savmap.pipeline.row import measure
from savmap.plugin.manager import loaded_plugin
from savmap.types import Axis, Feature, Floats, Track, Trajectory
from savmap.types.progress import SilentMonitor
from savmap_pallets.constraints import constrain
from savmap_pallets.describe import describe
from savmap_pallets.evaluate import evaluate, matches, off_deg
from savmap_pallets.features import CUT, WHOLE, extract_features
from savmap_pallets.plugin import Pallets, Settings
from savmap_pallets.survey import SurveyedPallet
from savmap_pallets.tracking import track_pallets

SURVEY = {"pallets": [{"x": x, "z": -y, "turn_deg": float(np.degrees(turn))} for x, y, turn in made.PALLETS.tolist()]}
AXES: tuple[Axis, ...] = ("x", "y", "z")


@pytest.fixture(scope="module")
def features() -> list[Feature]:
    poses = made.path().world_from_rig
    return [
        one for frame in range(made.FRAMES) for one in extract_features(made.view(frame), made.detections(poses[frame]))
    ]


@pytest.fixture(scope="module")
def tracks(features: list[Feature]) -> list[Track]:
    return track_pallets(features, made.facts(), made.path(), made.SIZE)


def marks(count: int = 30) -> Constraints:
    """Another room: points on the face, seen in every frame, some of them known: what locates the camera."""
    rng = np.random.default_rng(3)
    points = np.stack([rng.uniform(-2, 8, count), rng.uniform(0, 1, count), np.zeros(count)], axis=1)
    keys = KeySpace("marks").keys([f"mark {number}" for number in range(count)])
    found = [_mark(name, point) for name, point in zip(keys, points, strict=True)]
    known = [
        known_coordinate(axis, keys[name], float(value), 1e-3, f"{name} {axis}")
        for name, point in list(zip(keys, points, strict=True))[:12]
        for axis, value in zip(AXES, point, strict=True)
    ]
    initial = dict(zip(keys, points, strict=True))
    return Constraints("marks", keys, image_measurements(found, keys, made.facts().views), tuple(known), initial)


def _mark(name: str, point: Floats) -> Track:
    view, poses = made.spec(), made.path().world_from_rig
    inside = np.einsum("nji,nj->ni", poses[:, :3, :3], point - poses[:, :3, 3]) @ view.rig_from_view
    pixels = view.camera[0, 0] * inside[:, :2] / inside[:, 2:] + view.camera[:2, 2]
    seen = np.flatnonzero(inside[:, 2] > 0.3)
    return Track(
        name, "mark", {}, seen, (view.name,) * len(seen), pixels[seen], np.tile(0.04 * np.eye(2), (len(seen), 1, 1))
    )


@pytest.fixture(scope="module")
def solution(tracks: list[Track]) -> Solution:
    """A joint solve with the marks; the path that pallets start from is off by centimetres."""
    start = made.path()
    poses = start.world_from_rig.copy()
    poses[:, 0, 3] += 0.03
    off = Trajectory(start.frames, poses)
    room = constrain(tracks, made.facts(), off, made.SIZE, "pallets")
    return solve(merge(CameraPriors(made.facts(), off, References()), marks(), room))


def test_points_lie_on_the_outline() -> None:
    frame = made.path().world_from_rig[5]
    found = extract_features(made.view(5), made.detections(frame, made.PALLETS[1:2]))
    assert len(found) >= 12
    assert {one.part for one in found} == {WHOLE}
    from savmap_pallets.outline import Camera, errors

    off = errors(np.concatenate([one.pixels for one in found]), made.PALLETS[1], made.SIZE, Camera(frame, made.spec()))
    assert np.abs(off).max() < 0.35
    assert abs(off.mean()) < 0.1


def test_a_mask_at_the_border_is_told() -> None:
    frame = made.path().world_from_rig[0]
    found = extract_features(made.view(0), made.detections(frame, np.array([[-3.6, -0.9, 0.3]])))
    assert {one.part for one in found} == {CUT}


@pytest.mark.slow
def test_every_pallet_is_tracked_along_x(tracks: list[Track]) -> None:
    assert [track.name for track in tracks] == ["pallet 1", "pallet 2", "pallet 3"]
    assert all(len(np.unique(track.frames)) >= 5 for track in tracks)


def test_other_things_are_no_pallets(features: list[Feature]) -> None:
    with pytest.raises(StructureError, match="no pallet was seen whole"):
        track_pallets(features, made.facts(), made.path(), 1.8 * made.SIZE)


@pytest.mark.slow
def test_the_joint_solve_finds_place_and_turn(tracks: list[Track], solution: Solution) -> None:
    found = describe(tracks, solution, made.SIZE, "pallets")
    pairs = matches(found, [SurveyedPallet(**entry) for entry in SURVEY["pallets"]])
    assert len(pairs) == 3
    assert max(pair.distance_m for pair in pairs) < 0.004
    assert max(abs(pair.turn_deg) for pair in pairs) < 0.3
    assert all(0 < float(one.attributes["sigma_m"]) < 0.03 for one in found)
    assert found[0].vertices.shape == (8, 3)
    assert np.linalg.norm(found[1].vertices[1] - found[1].vertices[0]) == pytest.approx(1.2)


def test_pallets_tell_of_the_camera_too(tracks: list[Track]) -> None:
    """A factor of ours moves frames: with pallets held where they are, a frame that sees nothing else comes right."""
    room = constrain(tracks, made.facts(), made.path(), made.SIZE, "pallets")
    assert room.factors is not None
    factor = next(room.factors.at(k) for k in range(room.factors.size()) if len(room.factors.at(k).keys()) == 2)
    import gtsam

    frame, pallet = factor.keys()
    values = gtsam.Values()
    true = made.path().world_from_rig[gtsam.symbolIndex(frame)]
    values.insert(frame, gtsam.Pose3(true))
    values.insert(pallet, room.variables[pallet])
    right = factor.error(values)
    values.update(frame, gtsam.Pose3(true).retract(np.array([0, 0, 0, 0.2, 0, 0])))
    assert factor.error(values) > 20 * right


def test_scores(tracks: list[Track], solution: Solution) -> None:
    found = describe(tracks, solution, made.SIZE, "pallets")
    score = evaluate(found[:2], SURVEY)
    assert (score.distances["pallets"].missing, score.distances["pallets"].spurious) == (1, 0)
    other = {"pallets": [{"x": 50.0, "z": 1.0, "turn_deg": 0.0}]}
    assert evaluate(found, other).distances["pallets"].spurious == 3
    assert evaluate(found, {}).distances == {}
    assert off_deg(179.0, 1.0) == pytest.approx(-2.0)
    with pytest.raises(OutputError, match="survey"):
        evaluate(found, {"pallets": [{"x": 1.0}]})


def test_pallets_alone_do_not_locate_the_camera() -> None:
    pallets = loaded_plugin("pallets", Pallets, Settings())
    (error,) = measure([RowRequest("A", (), [pallets], References())], Journal(), SilentMonitor())
    assert isinstance(error, StructureError)
    assert "--plugins NAME,pallets" in str(error)
