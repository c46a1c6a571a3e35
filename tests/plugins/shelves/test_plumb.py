"""The lean of uprights: measured beside the solved map, whatever the frames' poses are off by."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from perfect_maps import structures_of, surveyed_row

from savmap.geometry.pinhole import project
from savmap.graph import Landmark
from savmap.types import Floats, FrameTable, Measured, RowFacts, Track, Trajectory, ViewSpec
from savmap_shelves.inspection.plumb import LEAN, leans, with_leans

UPRIGHTS, FRAMES, Z, SIGMA_PX = (0.0, 2.8, 5.6, 8.4), 60, -0.01, 0.2
BEAMS = (0.4, 2.0, 3.6)
SPEC = ViewSpec("face", 0.0, hfov_deg=110.0, width=1280, height=960)
FACTS = RowFacts("A", FrameTable(np.arange(FRAMES) / 5, ("pass 1",) * FRAMES), {"face": SPEC}, {"pass 1": 1})
FACING = np.diag([1.0, -1.0, -1.0])
"""world_from_rig (3, 3) of a camera that looks at the face."""


def poses(roll: Floats) -> Floats:
    """world_from_rig (n, 4, 4) of a drive along the face, rolled by angles (n,) rad."""
    made = np.tile(np.eye(4), (FRAMES, 1, 1))
    for k, angle in enumerate(roll):
        cos, sin = np.cos(angle), np.sin(angle)
        made[k, :3, :3] = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1.0]]) @ FACING
        made[k, :3, 3] = 8.4 * k / (FRAMES - 1), 2.0, 2.2
    return made


def seen(lean: Mapping[int, float], rng: np.random.Generator) -> tuple[list[Track], Trajectory, dict[str, Landmark]]:
    """Tracks of a rack of which uprights lean (mm in 1 m, about the floor), the solved path, and the landmarks of a map
    that takes them to be upright. The solved frames are rolled by 3 mrad at random."""
    true = poses(np.zeros(FRAMES))
    solved = poses(0.003 * rng.normal(size=FRAMES))
    points: dict[str, tuple[str, dict[str, int | str], float, float, float, bool]] = {}
    for number, x in enumerate(UPRIGHTS, start=1):
        tilt = lean.get(number, 0.0) / 1000
        for side, edge in (("left", x), ("right", x + 0.1)):
            for end, y in (("top", 4.4), ("bottom", 0.1)):
                place = {"upright": number, "side": side, "end": end}
                points[f"upright {number} / {side} / {end}"] = ("upright", place, edge, y, tilt, True)
            bay, beam_side = (number - 1, "right") if side == "left" else (number, "left")
            for level, y in enumerate(BEAMS, start=1) if 0 < bay < len(UPRIGHTS) else ():
                place = {"bay": bay, "beam": level, "side": beam_side, "edge": "lower"}
                points[f"bay {bay} / beam {level} / lower {beam_side}"] = ("beam", place, edge, y, tilt, False)
    tracks, landmarks = [], {}
    for name, (label, place, x, y, tilt, along) in points.items():
        places = np.array([x + tilt * y, y, Z])
        pixels = np.array(
            [
                project(((places - pose[:3, 3]) @ pose[:3, :3])[None] @ SPEC.rig_from_view, SPEC.camera)[0]
                for pose in true
            ]
        )
        near = np.flatnonzero(np.abs(true[:, 0, 3] - x) < 3.5)
        noise = rng.normal(scale=SIGMA_PX, size=(len(near), 2)) + (
            rng.normal(size=(len(near), 1)) * [0.0, 30.0] if along else 0
        )
        covariances = np.tile(np.diag([SIGMA_PX**2, 900.0 if along else SIGMA_PX**2]), (len(near), 1, 1))
        tracks.append(Track(name, label, place, near, ("face",) * len(near), pixels[near] + noise, covariances))
        landmarks[name] = Landmark(np.array([x, y, Z]), 1e-6 * np.eye(3), len(near), 0)
    return tracks, Trajectory(np.arange(FRAMES), solved), landmarks


@pytest.mark.parametrize("lean", [{}, {2: 8.0}, {1: 6.0, 4: -6.0}, dict.fromkeys((1, 2, 3, 4), 5.0)])
def test_each_upright_has_its_lean(lean: dict[int, float]) -> None:
    tracks, path, landmarks = seen(lean, np.random.default_rng(4))
    measured = leans(tracks, FACTS, path, landmarks)
    assert list(measured) == [1, 2, 3, 4]
    for number, value in measured.items():
        assert value.value == pytest.approx(lean.get(number, 0.0), abs=0.3)
        assert 0.3 <= value.sigma < 0.4


def test_pictures_of_other_things_are_outvoted() -> None:
    tracks, path, landmarks = seen({3: 6.0}, np.random.default_rng(5))
    for k, track in enumerate(tracks):
        if track.place.get("upright") == 2:
            pixels = track.pixels.copy()
            pixels[::4, 0] += 15.0
            tracks[k] = replace(track, pixels=pixels)
    measured = leans(tracks, FACTS, path, landmarks)
    assert measured[2].value == pytest.approx(0.0, abs=0.5)
    assert measured[3].value == pytest.approx(6.0, abs=0.5)


def test_an_upright_that_few_frames_show_has_none() -> None:
    tracks, path, landmarks = seen({}, np.random.default_rng(6))
    few = [
        replace(
            track,
            frames=track.frames[:5],
            views=track.views[:5],
            pixels=track.pixels[:5],
            covariances=track.covariances[:5],
        )
        if track.place.get("upright") == 4 or track.place.get("bay") == 3
        else track
        for track in tracks
    ]
    assert 4 not in leans(few, FACTS, path, landmarks)
    assert leans([], FACTS, path, landmarks) == {}


def test_only_uprights_get_an_attribute() -> None:
    tracks, path, landmarks = seen({2: 8.0}, np.random.default_rng(4))
    structures = structures_of(surveyed_row())
    leaning = with_leans(structures, tracks, FACTS, path, landmarks)
    assert [part.id for part in leaning] == [part.id for part in structures]
    with_attribute = {part.id: part.attributes[LEAN] for part in leaning if LEAN in part.attributes}
    assert list(with_attribute) == ["upright 1", "upright 2", "upright 3", "upright 4"]
    assert isinstance(with_attribute["upright 2"], Measured)
    for before, after in zip(structures, leaning, strict=True):
        assert np.array_equal(before.vertices, after.vertices)
        assert {key: value for key, value in after.attributes.items() if key != LEAN} == dict(before.attributes)
