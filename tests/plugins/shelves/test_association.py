"""Tracks of what was found: by the object that each feature is of."""

from dataclasses import replace

import numpy as np
import pytest

from savmap.errors import StructureError
from savmap.types import Feature, FrameTable, RowFacts, ViewSpec
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
    tracks = {track.name: track for track in track_structures([*picture(2), *picture(0)], FACTS)}
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
    tracks = track_structures([*picture(2), *picture(0), *parts], FACTS)
    of_parts = {track.name: dict(track.place) for track in tracks if is_part(track)}
    assert of_parts == {
        "parts of bay 1 / beam 1 / lower": {"bay": 1, "beam": 1, "edge": "lower", "end": "part"},
        "parts of upright 2 / left": {"upright": 2, "side": "left", "end": "part"},
    }
    assert next(track for track in tracks if is_part(track)).frames.tolist() == [0, 0, 2, 2]
    assert grid_of(tracks) == grid_of([track for track in tracks if not is_part(track)])


def test_no_beam_is_an_error() -> None:
    bare = [feature for feature in picture(0) if feature.label == "upright"]
    with pytest.raises(StructureError, match="no beam"):
        track_structures(bare, FACTS)


def test_feet_are_tracks_of_their_own() -> None:
    feet = [
        Feature(k, "face", "upright", "foot", 0, np.array([[20.0, 95.0]]), np.eye(2)[None], object="upright 1")
        for k in range(3)
    ]
    (foot,) = (track for track in track_structures([*picture(0), *feet], FACTS) if track.name.endswith("foot"))
    assert foot.place == {"upright": 1, "side": "middle", "end": "foot"}
    assert foot.frames.tolist() == [0, 1, 2]
