"""Tracks of what was found: by the object that each feature is of."""

from dataclasses import replace

import numpy as np
import pytest

from savmap.errors import StructureError
from savmap.geometry import pinhole
from savmap.types import Feature, FrameTable, RowFacts, Trajectory, ViewSpec
from savmap_shelves.association import track_structures
from savmap_shelves.constraints.track_grid import grid_of, is_part

FACTS = RowFacts("A", FrameTable(np.arange(3.0), ("pass 1",) * 3), {"face": ViewSpec("face", 0.0)}, {"pass 1": 1})


def feature(label: str, part: str, instance: int, object: str, x: float, frame: int = 0) -> Feature:
    ends = np.array([[x, 10.0], [x, 90.0]]) if label == "upright" else np.array([[x, 50.0]])
    beside = {} if label == "upright" else {part.split()[-1]: int(part.endswith("right"))}
    covariance = np.tile(np.eye(2), (len(ends), 1, 1))
    return Feature(frame, "face", label, part, instance, ends, covariance, neighbours=beside, object=object)


def picture(frame: int) -> list[Feature]:
    """Two posts, with an edge each, and a beam between them."""
    return [
        feature("upright", "right", 0, "upright 1", 20.0, frame),
        feature("upright", "left", 1, "upright 2", 80.0, frame),
        feature("beam", "lower left", 4, "bay 1 / beam 1", 20.0, frame),
        feature("beam", "upper right", 4, "bay 1 / beam 1", 80.0, frame),
    ]


def test_features_become_tracks_with_names_and_places() -> None:
    tracks = {track.name: track for track in track_structures([*picture(2), *picture(0)], FACTS, None)}
    places = {name: dict(track.place) for name, track in tracks.items()}
    assert places == {
        "upright 1 / right / top": {"upright": 1, "side": "right", "end": "top"},
        "upright 1 / right / bottom": {"upright": 1, "side": "right", "end": "bottom"},
        "upright 2 / left / top": {"upright": 2, "side": "left", "end": "top"},
        "upright 2 / left / bottom": {"upright": 2, "side": "left", "end": "bottom"},
        "bay 1 / beam 1 / lower left": {"bay": 1, "beam": 1, "side": "left", "edge": "lower"},
        "bay 1 / beam 1 / upper right": {"bay": 1, "beam": 1, "side": "right", "edge": "upper"},
    }
    assert all(track.frames.tolist() == [0, 2] for track in tracks.values())
    assert tracks["upright 1 / right / bottom"].pixels[0].tolist() == [20.0, 90.0]


def test_parts_of_an_edge_are_one_track_that_the_grid_does_not_have() -> None:
    parts = [
        replace(feature("beam", "lower part", 4, "bay 1 / beam 1", x, frame), score=0.0)
        for frame in (0, 2)
        for x in (30.0, 50.0)
    ]
    parts += [replace(part, label="upright", part="left part", instance=1, object="upright 2") for part in parts]
    tracks = track_structures([*picture(2), *picture(0), *parts], FACTS, None)
    of_parts = {track.name: dict(track.place) for track in tracks if is_part(track)}
    assert of_parts == {
        "parts of bay 1 / beam 1 / lower": {"bay": 1, "beam": 1, "edge": "lower", "end": "part"},
        "parts of upright 2 / left": {"upright": 2, "side": "left", "end": "part"},
    }
    assert next(track for track in tracks if is_part(track)).frames.tolist() == [0, 0, 2, 2]
    assert grid_of(tracks) == grid_of([track for track in tracks if not is_part(track)])


def test_a_corner_at_another_upright_than_its_bays_is_left_out() -> None:
    wrong = [replace(f, object="upright 3") if f.object == "upright 2" else f for f in picture(0)]
    names = {track.name for track in track_structures(wrong, FACTS, None)}
    assert "bay 1 / beam 1 / lower left" in names
    assert "bay 1 / beam 1 / upper right" not in names


def test_of_two_instances_of_an_object_in_a_picture_the_better_is_taken() -> None:
    worse = replace(feature("beam", "lower left", 7, "bay 1 / beam 1", 30.0), score=0.4)
    (corner,) = (t for t in track_structures([worse, *picture(0)], FACTS, None) if t.name.endswith("lower left"))
    assert corner.pixels.tolist() == [[20.0, 50.0]]


def test_what_is_of_no_object_is_left_out_and_no_beam_is_an_error() -> None:
    bare = [replace(f, object="") if f.label == "beam" else f for f in picture(0)]
    with pytest.raises(StructureError, match="no beam"):
        track_structures(bare, FACTS, None)


def test_feet_that_stand_on_the_floor_are_tracked_by_the_path() -> None:
    """Two on the floor, one that goods hide from below, and one that hardly any frame shows; the rig is 2 m away."""
    pose = np.array([[1.0, 0, 0, 0], [0, -1, 0, 1.5], [0, 0, -1, 2], [0, 0, 0, 1]])
    path = Trajectory(np.arange(3), np.tile(pose, (3, 1, 1)))
    feet = []
    for number, y, frames in ((1, 0.0, 3), (2, 0.02, 3), (3, 0.3, 3), (4, 0.0, 2)):
        ray = (np.array([0.5 * number, y, 0.0]) - pose[:3, 3]) @ pose[:3, :3] @ FACTS.views["face"].rig_from_view
        pixel = pinhole.project(ray, FACTS.views["face"].camera)[None]
        feet += [
            Feature(k, "face", "upright", "foot", number - 1, pixel, np.eye(2)[None], object=f"upright {number}")
            for k in range(frames)
        ]
    features = [*picture(0), *feet]
    standing = {track.name: track for track in track_structures(features, FACTS, path) if track.name.endswith("foot")}
    assert [*standing] == ["upright 1 / foot", "upright 2 / foot"]
    assert standing["upright 1 / foot"].place == {"upright": 1, "side": "middle", "end": "foot"}
    assert not any(track.name.endswith("foot") for track in track_structures(features, FACTS, None))
