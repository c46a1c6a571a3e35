"""Tracks of a made-up rack as a tracker would give them: exact geometry, then noise, outliers, sway and poor starts."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from made_up_views import VIEW, Rack, project, sightings
from scipy.spatial.transform import Rotation

from savmap.graph import (
    CameraHeight,
    KnownLength,
    Problem,
    References,
    Solution,
    SolveOptions,
    camera_priors,
    merge,
    published_start,
    solve,
)
from savmap.types import Floats, FrameTable, MapWarning, RowFacts, Track, Trajectory, ViewSpec
from savmap_shelves.constraints import GridSettings, constrain

NOMINAL = np.array([[1.0, 0, 0], [0, -1.0, 0], [0, 0, -1.0]])
Setback = tuple[float, float]


@dataclass(frozen=True)
class World:
    """A rack, true poses (n, 4, 4), the tracks, and what the program is told."""

    rack: Rack
    poses: Floats
    tracks: list[Track]
    facts: RowFacts
    rng: np.random.Generator = field(repr=False)


def rack(rng: np.random.Generator, sections: int = 4, levels: tuple[int, int] = (5, 7), bridge: int | None = 2) -> Rack:
    widths = rng.uniform(2.6, 3.8, sections)
    left = np.concatenate([[0.0], np.cumsum(widths + 0.1)])
    beams = []
    for section in range(sections):
        count = int(rng.integers(levels[0], levels[1] + 1))
        bottoms = np.sort(
            rng.uniform(0.15, 0.33)
            + np.arange(count) * (5.6 / count)
            + rng.uniform(-0.1, 0.1, count) * (np.arange(count) > 0)
        )
        beams.append(np.stack([bottoms, bottoms + 0.1], axis=1)[2 if section == bridge else 0 :])
    return Rack(np.stack([left, left + 0.0986], axis=1), tuple(beams))


def path(rng: np.random.Generator, length: float, frames: int, height: float = 3.05, distance: float = 1.5) -> Floats:
    poses = np.tile(np.eye(4), (frames, 1, 1))
    time = np.linspace(0, 1, frames)
    wave = [rng.uniform(0.02, 0.05) * np.sin(2 * np.pi * (rng.uniform(2, 6) * time + rng.uniform())) for _ in range(6)]
    poses[:, 0, 3] = length * (time + wave[0])
    poses[:, 1, 3] = height + 0.3 * wave[1] + rng.normal(0, 0.003, frames)
    poses[:, 2, 3] = distance + 3 * wave[2]
    angles = np.stack([0.5 * wave[3], wave[4], 0.5 * wave[5]], axis=1)
    poses[:, :3, :3] = NOMINAL @ Rotation.from_rotvec(angles).as_matrix()
    return poses


def world(
    seed: int = 0,
    sections: int = 4,
    frames: int = 100,
    noise_px: float = 0.7,
    outliers: float = 0.0,
    misses: float = 0.2,
    levels: tuple[int, int] = (5, 7),
    bridge: int | None = 2,
    setback_m: float = 0.0,
) -> World:
    """A rack seen from a swaying camera. Edges' and corners' noise is drawn line by line, as a detector's is."""
    rng = np.random.default_rng(seed)
    truth = rack(rng, sections, levels, bridge)
    poses = path(rng, float(truth.uprights[-1, 1]), frames)
    return seen_from(truth, poses, rng, noise_px, outliers, misses, setback_m)


def seen_from(
    truth: Rack,
    poses: Floats,
    rng: np.random.Generator,
    noise_px: float = 0.7,
    outliers: float = 0.0,
    misses: float = 0.2,
    setback_m: float = 0.0,
    view: ViewSpec = VIEW,
    name: str = "A",
) -> World:
    """A rack seen from poses of the rig (n, 4, 4) in its frame, in one view."""
    frames = len(poses)
    table = FrameTable(np.arange(frames) / 7.0, ("one",) * frames)
    facts = RowFacts(name, table, {view.name: view}, {"one": 1})
    turn = np.eye(4)
    turn[:3, :3] = view.rig_from_view
    seen: dict[str, list[tuple[int, Floats, Floats]]] = {}
    places: dict[str, tuple[str, dict[str, int | str]]] = {}
    for frame, pose in enumerate(poses):
        for point, label, place, pixel, covariance in sightings(truth, pose @ turn, noise_px, misses, setback_m, rng):
            if rng.random() < outliers:
                pixel = pixel + rng.normal(0, 30, 2)
            places[point] = label, place
            seen.setdefault(point, []).append((frame, pixel, covariance))
    tracks = [_track(point, *places[point], seen[point], view) for point in sorted(seen) if len(seen[point]) > 2]
    return World(truth, poses, tracks, facts, rng)


def said(warning: MapWarning) -> str:
    """All that a warning says."""
    return " ".join((warning.line, *warning.details))


def foot(made: World, upright: int, above: float) -> Track:
    """Where an upright (from 0) seems to stand, so many metres above the floor, in all frames that show it."""
    place = np.array([float(made.rack.uprights[upright].mean()), above, 0.0])
    seen = [(frame, project(pose, place), np.eye(2) * 4.0) for frame, pose in enumerate(made.poses)]
    shown = [one for one in seen if (one[1] > 0).all() and (one[1] < [VIEW.width, VIEW.height]).all()]
    labels: dict[str, int | str] = {"upright": upright + 1, "side": "middle", "end": "foot"}
    return _track(f"upright {upright + 1} / foot", "upright", labels, shown, made.facts.views["face"])


def _track(
    name: str, label: str, place: dict[str, int | str], seen: Sequence[tuple[int, Floats, Floats]], view: ViewSpec
) -> Track:
    frames, pixels, covariances = zip(*seen, strict=True)
    return Track(
        name, label, place, np.array(frames), (view.name,) * len(seen), np.array(pixels), np.array(covariances)
    )


def begin(
    made: World, speed: float = 1.0, height: float = 0.0, distance: float = 1.0, attitude_deg: float = 0.5
) -> Trajectory:
    """The published start, off by a factor in speed and distance, by metres in height, and by degrees in attitude."""
    rng = np.random.default_rng(99)
    turns = Rotation.from_rotvec(np.radians(attitude_deg) * rng.normal(0, 1, (len(made.poses), 3))).as_matrix()
    length = float(np.ptp(made.poses[:, 0, 3])) * speed
    middle = made.poses[:, :3, 3].mean(axis=0)
    return published_start(
        made.facts, made.poses[:, :3, :3] @ turns, length, float(middle[1]) + height, float(middle[2]) * distance
    )


def references(
    made: World, camera: bool = True, length: bool = True, rng: np.random.Generator | None = None
) -> References:
    """Camera height +- 2 cm and the row's length +- 3 mm: exact, or, with `rng`, off by that much."""
    off_height, off_length = rng.normal(0, [0.02, 0.003]) if rng else (0.0, 0.0)
    height, span = float(made.poses[:, 1, 3].mean()) + off_height, float(made.rack.uprights[-1, 1]) + off_length
    return References(
        (CameraHeight(height, 0.02),) if camera else (),
        (KnownLength("upright 1 / left", f"upright {len(made.rack.uprights)} / right", span, 0.003),) if length else (),
    )


def problem(
    made: World,
    start: Trajectory,
    given: References | None = None,
    heights: bool = True,
    setback: Setback = (0.0, 0.01),
) -> Problem:
    settings = GridSettings(made.rack.lowest if heights else None, 0.002, *setback)
    own = constrain(made.tracks, made.facts, start, settings=settings)
    return merge(camera_priors(made.facts, start, given or references(made)), own)


def without_frames(made: World, blind: set[int]) -> World:
    """The same world, but nothing was seen in some frames."""
    tracks = []
    for track in made.tracks:
        kept = np.array([frame not in blind for frame in track.frames.tolist()])
        views = tuple(view for view, keep in zip(track.views, kept, strict=True) if keep)
        tracks.append(
            replace(
                track,
                frames=track.frames[kept],
                views=views,
                pixels=track.pixels[kept],
                covariances=track.covariances[kept],
            )
        )
    return replace(made, tracks=tracks)


def solved(
    made: World,
    start: Trajectory | None = None,
    given: References | None = None,
    options: SolveOptions | None = None,
    heights: bool = True,
    setback: Setback = (0.0, 0.01),
) -> Solution:
    return solve(problem(made, start or begin(made), given, heights, setback), options)


def errors(made: World, solution: Solution) -> tuple[Floats, Floats, Floats, Floats]:
    """Errors m along x (columns) and in height (rows), and their standard deviations."""
    off: dict[str, list[float]] = {"x": [], "y": []}
    sigma: dict[str, list[float]] = {"x": [], "y": []}
    for name, landmark in solution.landmarks_of("shelves").items():
        words = name.replace(" /", "").split()
        if words[0] == "upright" and words[3:] == ["top"]:
            truth, axis = made.rack.uprights[int(words[1]) - 1, ("left", "right").index(words[2])], 0
        elif words[0] == "bay" and words[-1] == "left":
            truth, axis = made.rack.beams[int(words[1]) - 1][int(words[3]) - 1, ("lower", "upper").index(words[4])], 1
        else:
            continue
        off["xy"[axis]].append(landmark.position[axis] - truth)
        sigma["xy"[axis]].append(np.sqrt(landmark.covariance[axis, axis]))
    return np.array(off["x"]), np.array(off["y"]), np.array(sigma["x"]), np.array(sigma["y"])
